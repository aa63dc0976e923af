"""Choose the plan of an export from its options and the frames: cells, steps, bands and standoff."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...frames.headline_numbers import errors_of_run
from ...frames.run_terrain import dtm_name
from ...system.messages import log
from ..averaging.band_products import PRODUCTS, RUNNING
from ..averaging.bed_change import bounds_of
from ..averaging.export_resolution import (
    automatic_cell_size,
    automatic_time_step,
    choose_steps,
    default_cell_size,
    export_axes,
    export_grid,
    report_cells,
    require_cells_within,
    run_cell_size,
)
from ..averaging.frame_values import Averaging, automatic_standoff, fastest_mean, reached, survey_frame
from ..averaging.maxima import PRODUCTS_NEEDED, RUNNING_BANDS
from ..averaging.placement import Bed
from .export_inputs import log_unused_options, refuse_nowhere, release_density, solver_peaks
from .export_plan import ExportPlan
from .step_rasters import ARROW_BANDS, ISEESNOW_PRODUCTS, LAST_BANDS

if TYPE_CHECKING:
    from ...system.parallel import FramePool
    from ...terrain.elevation import Terrain
    from .export_options import Export

AUTO = "auto"


def make_plan(asked: "Export", entries: Sequence, terrain: "Terrain", products: tuple, pool: "FramePool") -> ExportPlan:
    """Choose cells, steps and standoff; frames are read only if one of these needs it.

    Parameters
    ----------
    asked : Export
    entries : sequence of FrameEntry
    terrain : Terrain
    products : tuple of str
        Bands of a step.
    pool : FramePool

    Returns
    -------
    ExportPlan
    """
    cells_asked, run_cells = asked["cell_size"], run_cell_size(entries)
    if cells_asked is None:
        own = default_cell_size(terrain.grid, run_cells)
        asked = {**asked, "cell_size": own}
    density = release_density(asked, entries)
    log_unused_options(asked, entries)
    standoff = 0.0 if asked["standoff"] == AUTO else asked["standoff"]
    bed = Bed.of(terrain, asked["bed"], standoff, clamped=asked["paper"])
    axes = export_axes(terrain.grid, asked["north_up"])
    facts = _survey(asked, entries, bed, density, axes, pool)
    bounds = _bounds(asked, entries, facts, bed, axes, terrain, pool)
    if asked["standoff"] == AUTO:
        bed = replace(bed, standoff=automatic_standoff(facts))
        log.info(f"`standoff=auto`: {bed.standoff:.3g} m")
    peaks = solver_peaks(entries[-1])
    if bounds is not None and peaks is not None:
        bounds = _with_peaks(bounds, peaks.bounds(asked["min_depth"]), axes)
    bed_change = entries[-1].read_bed_change()
    if bounds is not None and bed_change:
        bounds = _with_peaks(bounds, bounds_of(bed_change), axes)
    cell_size = _cell_size(asked, facts, terrain)
    require_cells_within(terrain.grid, cell_size, asked["north_up"])
    otherwise = "--extent flow" if bounds is None else None
    grid = export_grid(terrain.grid, cell_size, bounds, north_up=asked["north_up"], otherwise=otherwise)
    report_cells(grid, terrain.grid, run_cells, cells_asked)
    time_step = _time_step(asked, entries, bed, grid, density, pool)
    steps = choose_steps([entry.time for entry in entries], time_step)
    more = (*(ARROW_BANDS if asked["qgis"] else ()), *(("mass",) if bed_change else ()))
    averaging = Averaging(
        bed=bed,
        grid=grid,
        density=density,
        names=needed_products((*products, *more)),
        percentile=asked["percentile"],
        min_depth=asked["min_depth"],
        second_grid=export_grid(terrain.grid) if asked["naming"] == "iseesnow" else None,
        second_names=ISEESNOW_PRODUCTS,
        layers=asked["layers"],
    )
    bands = (*products, *(RUNNING_BANDS if RUNNING in asked["products"] else ()))
    name = entries[0].path.resolve().parent.name or "frames"
    errors = errors_of_run(entries[0].path.parent, entries[0].header.digest)
    dem = dtm_name(terrain.path)
    return ExportPlan(
        name, tuple(entries), tuple(steps), averaging, bands, terrain, time_step, peaks, bed_change, errors, dem
    )


def needed_products(products: tuple) -> tuple[str, ...]:
    """Return products with those that maxima and last step are made of, in the order of the table.

    Parameters
    ----------
    products : tuple of str
    """
    return tuple(name for name in PRODUCTS if name in (*products, *PRODUCTS_NEEDED, *LAST_BANDS))


def _extent(asked):
    return asked["extent"] or ("dtm" if asked["cell_size"] is None else "flow")


def _survey(asked, entries, bed, density, axes, pool):
    """FrameFacts of every frame if cell size or standoff is automatic; else []."""
    if AUTO not in (asked["cell_size"], asked["standoff"]):
        return []
    return list(pool.map(_survey_entry, entries, bed, density, axes))


def _survey_entry(entry, bed, density, axes):
    return survey_frame(entry.read(density), bed, density, axes)


def _reached_by_entry(entry, bed, axes):
    return reached(entry.read_positions(), bed, axes)


def _fastest_entry(entry, bed, grid, density):
    return fastest_mean(entry.read(density), bed, grid, density)


def _bounds(asked, entries, facts, bed, axes, terrain, pool):
    """Bounds of the flow in all frames, along `axes` [m]; None for the whole DTM."""
    whole = _extent(asked) == "dtm"
    if whole and not facts:
        return None
    found = [fact.bounds for fact in facts] or list(pool.map(_reached_by_entry, entries, bed, axes))
    for entry, bounds in zip(entries, found, strict=True):
        if bounds is None:
            refuse_nowhere(entry, terrain)
    return None if whole else _around(found)


def _around(found):
    """The union of several bounds."""
    bounds = np.array(found)
    return (*bounds[:, :2].min(axis=0).tolist(), *bounds[:, 2:].max(axis=0).tolist())


def _with_peaks(bounds, reached, axes):
    """The union of `bounds` and the area reached between frames, (west, south, east, north) [m] or None."""
    if reached is None:
        return bounds
    west, south, east, north = reached
    row, column = axes.rowcol(np.array([west, east]), np.array([north, south]))
    return _around([bounds, (column[0] + 0.5, row[0] + 0.5, column[1] + 0.5, row[1] + 0.5)])


def _cell_size(asked, facts, terrain):
    if asked["cell_size"] != AUTO:
        return asked["cell_size"]
    points = [fact for fact in facts if fact.column_side == 0]  # in a run of columns and points, points are finer
    cell_size, why = automatic_cell_size(points or facts, terrain.grid.cell_size)
    log.info(f"`cell_size=auto`: {cell_size:.4g} m; {why}")
    return cell_size


def _time_step(asked, entries, bed, grid, density, pool):
    if asked["time_step"] != AUTO:
        return asked["time_step"]
    fastest = max(pool.map(_fastest_entry, entries, bed, grid, density))
    time_step = automatic_time_step(grid.cell_size, fastest)
    log.info(
        f"`time_step=auto`: {time_step:.4g} s (Eq 17: cells of {grid.cell_size:.4g} m, mean speed up to "
        f"{fastest:.4g} m/s)"
    )
    return time_step
