"""Write rasters of what a flow made of its bed: eroded depth and rate, last step, forest, new bed and surface."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...frames.flow_end import FlowEnd
from ...laws.quantities import BAND
from ...system.messages import log
from ...terrain.raster_output import SparseBands, write_geotiff
from ..averaging.bed_change import eroded_depth, largest_rate, on_cells, share_beyond

if TYPE_CHECKING:
    from ..averaging.frame_values import FrameValues
    from .export_plan import ExportPlan

BED_BANDS = ("eroded", "erosion_rate_max")
LYING_BANDS = {True: "deposit", False: "thickness_end"}  # of a flow that came to rest, and of one that still moves
FOREST_BANDS = ("detrained", "broken_forest")  # only with forest
SURFACE_BANDS = ("surface_new", "bed_new")
BEYOND_SHARE = 1e-3  # [1] share of a mass beyond the edge of the DTM, above which it is reported


def bed_bands(change: dict, end: FlowEnd) -> tuple[str, ...]:
    """Return the names of the bands of `<name>_bed.tif`.

    Parameters
    ----------
    change : dict
        What the last frame stores of the bed; empty without erosion.
    end : FlowEnd
    """
    lying = LYING_BANDS[end.came_to_rest]
    return () if not change else (*BED_BANDS, lying, *(FOREST_BANDS if "detrained_mass" in change else ()))


def write_bed_rasters(
    plan: "ExportPlan",
    rasters: Path,
    values: "FrameValues",
    end: FlowEnd,
    tags: dict,
    cog: bool,
    rate: np.ndarray | None = None,
) -> dict[str, float]:
    """Write `<name>_bed.tif` and `<name>_surface.tif` where the frames store erosion or forest.

    Parameters
    ----------
    plan : ExportPlan
    rasters : Path
        Folder of the rasters.
    values : FrameValues
        Of the last frame, with `mass`.
    end : FlowEnd
    tags : dict
    cog : bool
        Cloud-optimised files.
    rate : float64[rows, columns], optional [m s-1]
        Largest speed at which the bed receded; without it, that between the frames of the plan.

    Returns
    -------
    dict of str to float
        Largest value of each band; empty where nothing was written.
    """
    change = plan.bed_change
    if not change:
        return {}
    grid = plan.averaging.grid
    _log_beyond(change, grid)
    eroded = eroded_depth(change, grid)
    times = [entry.time for entry in plan.entries]
    if rate is None:
        rate = largest_rate((entry.read_bed_change() for entry in plan.entries), times, grid)
    mass = SparseBands(grid, values.index, [(values.values["mass"], 0.0)])(0, 0, grid.shape[0])
    deposit = np.nan_to_num(mass / plan.averaging.density, nan=0.0)
    bed = plan.terrain.rows_on(grid, 0, grid.shape[0]) - eroded
    named = (
        tags
        | end.tags()
        | {"time": times[-1], "bed_density": float(np.asarray(change["bed_density"])), "depths": "vertical"}
    )
    bands = dict(zip(bed_bands(change, end)[:3], (eroded, rate, deposit), strict=True)) | _forest_bands(
        change, plan, grid
    )
    bands |= dict(zip(SURFACE_BANDS, (bed + deposit + bands.get("detrained", 0.0), bed), strict=True))
    for word, names in (("bed", bed_bands(change, end)), ("surface", SURFACE_BANDS)):
        arrays = [(BAND[name], bands[name].astype(np.float32)) for name in names]
        write_geotiff(rasters / f"{plan.name}_{word}.tif", grid, arrays, named, cog)
    return {name: float(np.nanmax(bands[name])) for name in bed_bands(change, end)}


def _log_beyond(change, grid):
    """Report mass at nodes on the edge of the DTM, which the rasters have only in part."""
    for key, words in (("eroded_mass", "eroded mass"), ("detrained_mass", "mass that stopped in forest")):
        share = share_beyond(change, change[key], grid) if key in change else 0.0
        if share > BEYOND_SHARE:
            log.info(
                f"{100 * share:.2g} % of the {words} is not in the rasters: the outermost nodes stand for half a cell "
                "beyond the edge of the DTM"
            )


def _forest_bands(change, plan, grid):
    """Thickness [m] of the mass that stopped in forest, and the share of each cell whose forest is broken."""
    if "detrained_mass" not in change:
        return {}
    thickness = np.asarray(change["detrained_mass"], dtype=float) / plan.averaging.density
    arrays = (thickness, np.asarray(change["broken_forest"], dtype=float))
    return {name: on_cells(change, values, grid) for name, values in zip(FOREST_BANDS, arrays, strict=True)}
