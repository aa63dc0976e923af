"""Compute the values of the trees of forests at the nodes, from files on the solver's grid, with their checks."""

from collections.abc import Iterable
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from ...laws.forest import DETRAINMENT, DRAG, FOREST_ENTRIES, FRICTION, SLOW, STRENGTH, THIN, TOO_THICK
from ...system.errors import InputError, SceneError
from .area_values import cell_values, within

if TYPE_CHECKING:
    from ...scene.tables import ForestTable
    from ..columns.node_grid import ColumnGrid
    from .feature_placement import PlacedFiles

ENTRY = {  # key of [[forest]] -> index among the values of the trees
    "detrainment": DETRAINMENT,
    "drag": DRAG,
    "friction": FRICTION,
    "strength": STRENGTH,
    "detrainment_speed": SLOW,
    "detrainment_thickness": THIN,
    "breaking_thickness": TOO_THICK,
}


def forest_values(forests: "Iterable[tuple[int, ForestTable, PlacedFiles]]", grid: "ColumnGrid") -> np.ndarray:
    """Compute the values of the trees at the nodes.

    Parameters
    ----------
    forests : iterable of (int, ForestTable, PlacedFiles)
        Number in the scene, table and files of each forest. Where several overlap, the last one applies; a node has
        forest where all its values are known.
    grid : ColumnGrid

    Returns
    -------
    float64[ny + 3, nx + 3, FOREST_ENTRIES]
        0 without forest and at ghost nodes.

    Raises
    ------
    SceneError, InputError
        A column without polygons or without numbers; values outside their range; a forest off the terrain.
    """
    x, y = grid.node_points()
    inner = grid.domain_nodes()
    found = np.zeros((*x.shape, FOREST_ENTRIES))
    for number, table, files in forests:
        where, covers = f"[[forest]] number {number}", False
        for mask, values in _stands(table, files, x, y, where):
            trees = inner[mask] & np.isfinite(values).all(axis=-1)
            _require_trees_in_range(table, values[trees], where)
            found[mask] = np.where(trees[:, None], values, found[mask])
            covers = covers or trees.any()
        if not covers:
            raise InputError(f"{where} covers no node of the terrain; check its CRS and its values")
    return found


def _stands(table, files, x, y, where):
    """Yield (bool nodes, values [n, FOREST_ENTRIES] at these) for each polygon of a table, or for its mask."""
    values = np.zeros((*x.shape, FOREST_ENTRIES))
    columns = {}
    for key, entry in ENTRY.items():
        given = getattr(table, key)
        if key in files.values:
            values[..., entry] = cell_values(*files.values[key], x, y)
        elif isinstance(given, str):
            columns[key] = given
        else:
            values[..., entry] = given
    if files.features is None:
        if columns:
            key, column = next(iter(columns.items()))
            raise SceneError(f"{where}: {key} = {column!r} is not a file, and without polygons there are no columns")
        mask = np.ones(x.shape, bool)
        if files.raster is not None:
            mask = np.nan_to_num(cell_values(*files.raster, x, y)) != 0
        yield mask, values[mask]
        return
    for feature in files.features:
        mask = within(feature.shape, x, y)
        own = values[mask]
        for key, column in columns.items():
            own[:, ENTRY[key]] = feature.number(column)
        yield mask, own


def _require_trees_in_range(table, values, where):
    """Refuse `values` [n, FOREST_ENTRIES] outside the ranges of the keys of `table`."""
    limits = {f.name: f.metadata for f in fields(table)}
    for key, entry in ENTRY.items():
        own, low, high = values[:, entry], limits[key]["low"], limits[key]["high"]
        if not own.size:
            continue
        if own.min() < low or own.max() > high or (limits[key]["above"] and own.min() <= low):
            worst = own.max() if own.max() > high else own.min()
            above = "above " if limits[key]["above"] else ""
            raise SceneError(f"{where}: {key} reaches {worst:g}, expected {above}{low:g} to {high:g}")
