"""Compute the values of the trees of forests at the nodes, from files on the solver's grid, with their checks."""

from collections.abc import Iterable
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from ...laws.forest import DETRAINMENT, DRAG, FOREST_ENTRIES, FRICTION, SHARE, SLOW, STRENGTH, THIN, TOO_THICK
from ...system.errors import InputError, SceneError
from .area_shares import (
    Area,
    covered_nodes,
    covers_domain,
    mask_share,
    raster_lowest,
    raster_means,
    square_areas,
    visible_shares,
)
from .feature_placement import area_notes

if TYPE_CHECKING:
    from ...scene.tables import ForestTable
    from ..columns.node_grid import ColumnGrid
    from .feature_notes import Note
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
IN_PROPORTION = [DETRAINMENT, DRAG, FRICTION]  # entries that act by the share of a node's square with trees
OF_LARGEST = [STRENGTH, SLOW, THIN, TOO_THICK]  # limits, of one forest and of one cell of a raster, without a mean


def forest_values(
    forests: "Iterable[tuple[int, ForestTable, PlacedFiles]]", grid: "ColumnGrid", notes: "list[Note]"
) -> np.ndarray:
    """Compute the values of the trees at the nodes.

    What they do is in proportion to the share of the node's square with trees. Limits are not: where several forests
    lie in a square they are those of the one that covers most of it, of equal ones that with the least strength.

    Parameters
    ----------
    forests : iterable of (int, ForestTable, PlacedFiles)
        Number in the scene, table and files of each forest. Where several overlap, the last one applies; there is
        forest where all its values are known.
    grid : ColumnGrid
    notes : list of Note
        To which lines about how it is computed are added.

    Returns
    -------
    float64[ny + 3, nx + 3, FOREST_ENTRIES]
        0 without forest and at ghost nodes.

    Raises
    ------
    SceneError, InputError
        A column without polygons or without numbers; values outside their range; a forest off the terrain.
    """
    areas, trees = [], []
    for number, table, files in forests:
        where, covers = f"[[forest]] number {number}", False
        for area, values in _stands(table, files, grid, where):
            _require_trees_in_range(
                table, values[covered_nodes(area, grid)] if values.ndim > 1 else values[None], where
            )
            areas.append(area)
            trees.append(values)
            covers = covers or covers_domain(area, grid)
        if not covers:
            raise InputError(f"{where} covers no part of the terrain; check its CRS and its values")
        notes += area_notes("forest", where, files, grid)
    found = np.zeros((*square_areas(grid).shape, FOREST_ENTRIES))
    most = np.zeros(found.shape[:2])
    for number, window, part in visible_shares(areas, grid):
        values = trees[number][window] if trees[number].ndim > 1 else trees[number]
        at, most_here = found[window], most[window]
        larger = (part > most_here) | ((part > 0.0) & (part == most_here) & (values[..., STRENGTH] < at[..., STRENGTH]))
        for entry in IN_PROPORTION:
            at[..., entry] += np.where(part > 0.0, part * values[..., entry], 0.0)
        for entry in OF_LARGEST:
            at[..., entry] = np.where(larger, values[..., entry], at[..., entry])
        at[..., SHARE] = np.minimum(at[..., SHARE] + part, 1.0)
        most[window] = np.maximum(most_here, part)
    return np.pad(found, ((1, 1), (1, 1), (0, 0)))


def _stands(table, files, grid, where):
    """Yield (Area, its values [len(ENTRY)], or at the nodes [ny + 1, nx + 1, len(ENTRY)]) of each stand of a table."""
    values, columns, known = np.zeros(len(ENTRY)), {}, None
    if files.values:
        known = np.ones(square_areas(grid).shape)
        values = np.zeros((*known.shape, len(ENTRY)))
    for key, entry in ENTRY.items():
        given = getattr(table, key)
        if key in files.values:
            mean, share = raster_means(*files.values[key], grid)
            at_node = raster_lowest(*files.values[key], grid) if entry in OF_LARGEST else np.nan
            values[..., entry], known = np.where(np.isfinite(at_node), at_node, mean), np.minimum(known, share)
        elif isinstance(given, str):
            columns[key] = given
        else:
            values[..., entry] = given
    if files.features is None:
        if columns:
            key, column = next(iter(columns.items()))
            raise SceneError(f"{where}: {key} = {column!r} is not a file, and without polygons there are no columns")
        share = np.ones(square_areas(grid).shape) if files.raster is None else mask_share(files.raster, grid)
        yield Area(None, share if known is None else share * known), values
        return
    for feature in files.features:
        own = values.copy()
        for key, column in columns.items():
            own[..., ENTRY[key]] = feature.number(column)
        yield Area(feature.shape, known), own


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
