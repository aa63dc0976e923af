"""Messages about the frames and the maxima of an export."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...exchange.frame_list import OWN, missing_frames
from ...system.messages import log
from ..averaging.export_resolution import automatic_time_step, farthest_crossing
from ..averaging.maxima import BANDS as SOLVER_BANDS
from ..averaging.maxima import MAXIMA_BANDS, WITHOUT_THRESHOLD

if TYPE_CHECKING:
    from .export_options import Export
    from .export_plan import ExportPlan
    from .step_rasters import Tally

MOST_FRAMES_LISTED = 12  # [frames] of another code that have a line each


def log_export(asked: "Export", plan: "ExportPlan", tally: "Tally") -> None:
    """Log facts and warnings about the frames of an export, each once.

    Parameters
    ----------
    asked : Export
    plan : ExportPlan
    tally : Tally
    """
    if plan.entries[0].reader != OWN:
        _log_third_party(plan, tally)
    _log_kinds(plan.entries)
    grid, times = plan.averaging.grid, [entry.time for entry in plan.entries]
    crossing = farthest_crossing(times, tally.speeds, grid.cell_size)
    if plan.peaks is not None:
        log.info(_peaks_text(plan, crossing))
    count, mass, name = tally.outside
    if count:
        log.info(
            f"{name}: {count} particles ({mass:.4g} kg) are outside the DTM or on nodata; they are left out, not moved"
        )
    count, name = tally.moved
    if count:
        log.info(
            f"{name}: {count} particles are outside the DTM; `paper` moves them to the nearest cell of its edge (Eq 5)"
        )
    count, name = tally.without_slope
    if count:
        log.info(f"{name}: {count} particles are where the DTM has no slope; only their mass and number are used")
    share, lowest, name = tally.below
    if share >= 0.01 and asked["standoff"] == 0:
        log.info(
            f"{name}: {100 * share:.0f} % of the mass is below the DTM (lowest {lowest:.2f} m), as usual in grid-based "
            "codes; `standoff=auto` moves the surface; t_vol is computed from mass and is correct without it"
        )
    missing = missing_frames(plan.entries)
    if missing:
        log.info(f"frames are missing in this series: {', '.join(missing)}; maxima and steps omit them")
    if tally.column_side > grid.cell_size * (1 + 1e-6) and asked["cell_size"] is not None:
        log.info(
            f"the frames resolve {tally.column_side:.3g} m: cells of {grid.cell_size:.3g} m show the same flow on a "
            "finer raster and add no detail"
        )
    if 0.0 < tally.solver_cell < grid.cell_size * (1 - 1e-6):
        log.info(
            f"cells of {grid.cell_size:.4g} m are larger than those of the solver, {tally.solver_cell:.4g} m: h, t and "
            "their maxima are the largest values in each cell and grow with it; their sum is no volume. t_vol is the "
            "mean; `cell_size` gives smaller cells"
        )
    side, name = tally.point_side
    if grid.cell_size < side * (1 - 1e-6):
        log.info(
            f"warning: cells of {grid.cell_size:.3g} m are smaller than required by Eq 15, {side:.3g} m (cube root of "
            f"a point's mean volume in {name}): cells inside the flow remain empty; use `cell_size={side:.3g}` or "
            "more, or auto"
        )
    _warn_of_crossing(plan, crossing)
    _log_last_step(plan, times)


def _log_third_party(plan, tally):
    """Log number, mass and volume of every frame; in a long series of the first, the last, and each with a change."""
    density, before = plan.averaging.density, None
    for k, (entry, (count, mass, below)) in enumerate(zip(plan.entries, tally.frames, strict=True)):
        now = (count, f"{mass:.6g}")
        if now != before or len(plan.entries) <= MOST_FRAMES_LISTED or k == len(plan.entries) - 1:
            log.info(
                f"{entry.path.name}: {entry.time:g} s, {count} particles, {mass:.6g} kg, {mass / density:.6g} m3 at "
                f"{density:g} kg m-3; {100 * below:.0f} % of the mass below the DTM"
            )
        before = now
    _log_loss(plan, tally)


def _log_loss(plan, tally):
    """Log particles that a code lost between the frame with the most particles and the last."""
    k = max(range(len(tally.frames)), key=lambda k: tally.frames[k][:2])
    (most, most_mass, _), (last, last_mass, _) = tally.frames[k], tally.frames[-1]
    if last < most or last_mass < most_mass * (1 - 1e-9):
        fullest = "the first" if k == 0 else f"that of {plan.entries[k].time:g} s"
        log.info(
            f"the last frame has {most - last} particles and {most_mass - last_mass:.4g} kg less than {fullest}: the "
            "code removed them, or they left its grid; maxima and deposit omit them"
        )


def _log_kinds(entries):
    """Log changes between columns and points, whose depths are defined differently."""
    kinds = {2: "columns", 3: "points"}
    for before, entry in pairwise(entries):
        if before.header.dimension != entry.header.dimension:
            log.info(
                f"frames up to {before.path.name} are {kinds[before.header.dimension]}, {entry.path.name} is "
                f"{kinds[entry.header.dimension]}: h of columns is their thickness, of points the highest point; "
                "t_vol has the same meaning in both"
            )


def _peaks_text(plan, crossing):
    """Text: maxima from the solver, the others with the reason, and the interval of the frames for these."""
    peaks = plan.peaks
    bands = peaks.bands(plan.averaging.min_depth)
    word = f"maxima: {', '.join(bands)} include the solver's maxima of all steps up to t = {peaks.time:g} s"
    others = [name for name in SOLVER_BANDS if name not in bands]
    if any(entry.header.dimension == 3 for entry in plan.entries):
        word += "; of points, h_max and t_max include the thickness from mass, as t_vol, and h and t of the frames"
    if not others:
        word += f"; {', '.join(name for name in bands if name not in WITHOUT_THRESHOLD)} are of flow deeper than "
        word += f"{peaks.arrival_thickness:g} m"
        if apart := _crossing_text(plan, crossing):
            of_frames = [name for name in MAXIMA_BANDS if name not in bands]
            word += f"; {' and '.join(of_frames)} are from the frames alone: {apart}"
    if others:
        word += (
            f"; its {', '.join(others)} are of flow deeper than {peaks.arrival_thickness:g} m and are not used with "
            f"`min_depth={plan.averaging.min_depth:g}`: give `min_depth={peaks.arrival_thickness:g}` to use them"
        )
    return word


def _log_last_step(plan, times):
    if plan.time_step is None or np.isinf(plan.time_step) or len(times) < 2:  # infinite: maxima alone
        return
    last = times[plan.steps[-1]]
    if last < times[-1]:
        end = f"the last step is at {last:.4g} s, the last frame at {times[-1]:.4g} s"
        log.info(f"`time_step={plan.time_step:.4g}`: {end}; maxima and deposit are of all frames")


def _crossing_text(plan, crossing):
    """Text: interval of the frames and that required by Eq 17; "" if it is short enough."""
    if crossing.cells <= 1 + 1e-6:
        return ""
    cell = plan.averaging.grid.cell_size
    got = f"the frames are up to {crossing.interval:.4g} s apart"
    if plan.time_step is not None and plan.time_step < crossing.interval * (1 - 1e-6):
        got += f", so `time_step={plan.time_step:.4g}` uses each of them once"
    required = automatic_time_step(cell, crossing.fastest)
    fastest = f"mean speed up to {crossing.fastest:.3g} m/s"
    return f"{got}; Eq 17 requires dt_e = {required:.3g} s (cells of {cell:.4g} m, {fastest})"


def _warn_of_crossing(plan, crossing):
    """Warn if maxima from the frames alone miss cells: farther apart than Eq 17 requires, or one frame alone."""
    if len(plan.entries) == 1 and plan.entries[0].time > 0 and not _has_all_maxima(plan):
        entry = plan.entries[0]
        log.info(f"warning: {entry.path.name} is the only frame: maxima are those of t = {entry.time:.4g} s alone")
    word = _crossing_text(plan, crossing)
    if word and not _has_all_maxima(plan):
        required = automatic_time_step(plan.averaging.grid.cell_size, crossing.fastest)
        log.info(
            f"warning: {word}. The flow crosses {crossing.cells:.3g} cells between frames and maxima miss cells: write "
            f"frames every {required:.3g} s, or use cells of {crossing.interval * crossing.speed:.3g} m (`cell_size`)"
        )


def _has_all_maxima(plan):
    """Whether the solver stored all maxima that it can store."""
    return plan.peaks is not None and plan.peaks.bands(plan.averaging.min_depth) == SOLVER_BANDS
