"""Estimate the largest loads on the buildings of a polygon layer, from frames or an export."""

import math
from pathlib import Path

import numpy as np

from ..maps.averaging.averaging_options import USUAL_DEPTH
from ..maps.averaging.exported_steps import is_export
from ..maps.averaging.frame_values import cells_of
from ..system.errors import InputError
from ..system.messages import Progress, log, unwatched
from ..system.option import PathLike
from ..terrain.elevation import Terrain
from ..terrain.spatial_inputs import Feature
from .barrier_loads import BANDS, largest_loads, outline_of
from .building_layer import read_buildings
from .opened_results import open_flow
from .question_options import Question


def building_loads(
    asked: Question, path: PathLike, drag: float, output: Path, progress: Progress = unwatched
) -> tuple[list[Feature], list[dict], Terrain]:
    """Estimate the largest loads on the buildings at `path`.

    Parameters
    ----------
    asked : Question
        Results: frames, or an export whose steps have the bands Ut_E and Ut_N. Flow shallower than its `min_depth` does
        not load.
    path : path
        Polygons.
    drag : float [1]
        C_d of the dynamic pressure.
    output : Path
        Where the answer goes.
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    (list of Feature, list of dict, Terrain)
        Buildings, their loads (`barrier_loads.FIELDS`), terrain.

    Raises
    ------
    MpmgisError
        Largest values only, no velocities by direction, no density, not polygons.
    """
    min_depth = asked["min_depth"]
    if any(is_export(one) for one in asked["frames"]):  # its cells have their minimum depth already
        asked = {**asked, "min_depth": USUAL_DEPTH}
    flow = open_flow(asked, output)
    if flow.density is None:
        raise InputError(f"{flow.name}: its density is not known, which `buildings` needs; name the frames instead")
    buildings = read_buildings(path, flow.terrain)
    if not buildings:
        raise InputError(f"{path} has no polygon; give a layer of buildings")
    outlines = [outline_of(building.shape, flow.grid.cell_size) for building in buildings]
    ends = np.cumsum([len(outline.x) for outline in outlines])
    pieces = cells_of(flow.grid, *(np.concatenate([getattr(one, axis) for one in outlines]) for axis in "xy"))
    cells, places = np.unique(pieces, return_inverse=True)
    found = flow.at_cells(cells, BANDS, range(len(flow.times)), progress)
    loads = []
    outside = [float((part < 0).mean()) for part in np.split(pieces, ends[:-1])]
    for outline, place, share in zip(outlines, np.split(places, ends[:-1]), outside, strict=True):
        values = {name: found[name][:, place] for name in BANDS}
        own = largest_loads(outline, flow.times, values, flow.density, drag, min_depth)
        loads.append(dict.fromkeys(own, math.nan) if share == 1.0 and flow.entries else own)
    _log_outside(flow, outside)
    hit = sum(one["flow_force"] > 0 for one in loads)
    log.info(
        f"{hit} of {len(buildings)} buildings are reached; their loads are estimates from the undisturbed flow "
        f"(C_d = {drag:g})"
    )
    return buildings, loads, flow.terrain


def _log_outside(flow, shares):
    """Report buildings of whose outline `shares` are outside the cells: frames cover the DTM, exports their flow."""
    whole, partly = sum(share == 1.0 for share in shares), sum(0.0 < share < 1.0 for share in shares)
    if not whole and not partly:
        return
    where, how = ("DTM", "without loads") if flow.entries else ("cells of the export", "as not reached")
    log.info(
        f"{whole} of {len(shares)} buildings are outside the {where} and are written {how}; of {partly} a part is "
        "outside, which is not loaded"
    )
