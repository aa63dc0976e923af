"""Resolution of an export: cell size, time step, steps and grid (Vicari et al. 2025, NHESS 25:3897, Eqs 15, 17)."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from affine import Affine

from ...system.errors import InputError
from ...system.messages import log
from ...terrain.grid import Grid

POINTS_PER_CELL = 5  # [1] with 5 random points per cell, exp(-5) = 0.7 % of the cells stay empty
MOST_CELLS = 400_000_000  # [cells] of a raster: one float32 band has 1.6 GB
SAME_SIZE = 1e-6  # [1] relative difference of two cell sizes that are the same: rounding
FINEST_CELL = 1e-6  # [m] smallest side of a cell


class FrameFacts(NamedTuple):
    """Data of one frame for the choice of the cell size.

    Parameters
    ----------
    bounds : (float, float, float, float) or None [m]
        First column, first row, last column and last row of the flow on the DTM, along the `export_axes`; None without
        flow.
    particle_volume : float [m3]
        Mean at release.
    dilation : float [1]
        10 % quantile of release volume over current volume.
    thickness : float [m]
        Median volume-equivalent thickness over the wet pixels of the DTM.
    spacing : float [m]
        Of the solver grid.
    below : float [1]
        Share of the mass below the bed; 0 for columns.
    offset : float [m]
        Distance with 1 % of the mass below it; 0 for columns.
    column_side : float [m]
        Mean side of the squares of columns; 0 for points.
    """

    bounds: tuple | None
    particle_volume: float
    dilation: float
    thickness: float
    spacing: float
    below: float
    offset: float
    column_side: float = 0.0


def automatic_cell_size(facts: Iterable[FrameFacts], terrain_cell: float) -> tuple[float, str]:
    """Compute cs_e [m] by Eq 15, coarse enough that few cells inside the flow stay empty.

    The largest of V_p^(1/3) (V_p dilated), sqrt(5 V_mean / median thickness) and the finer of DTM and solver grid,
    rounded up to a divisor of the DTM cell, or above it to a multiple of half the solver cell. Columns leave no cell
    empty inside the flow: for them the side of their squares replaces the second term.

    Parameters
    ----------
    facts : iterable of FrameFacts
    terrain_cell : float [m]
        Cell size of the DTM.

    Returns
    -------
    (float, str)
        cs_e [m] and its inputs, as text.
    """
    facts = [fact for fact in facts if fact.bounds is not None]
    volume = float(np.median([fact.particle_volume for fact in facts]))
    dilation = min(fact.dilation for fact in facts)
    thickness = float(np.median([fact.thickness for fact in facts]))
    spacing = min(fact.spacing for fact in facts)  # estimated spacing grows as particles spread
    side = float(np.median([fact.column_side for fact in facts]))
    by_volume = (volume / dilation) ** (1.0 / 3.0)
    by_coverage, coverage = _coverage(side, volume, thickness)
    by_grids = min(terrain_cell, spacing)
    wanted = max(by_volume, by_coverage, by_grids)
    if wanted <= terrain_cell:
        cell = terrain_cell / math.floor(terrain_cell / wanted * (1 + 1e-9))
    else:
        cell = 0.5 * spacing * math.ceil(wanted / (0.5 * spacing) * (1 - 1e-9))
    why = (
        f"Eq 15 gives {by_volume:.3g} m (particle volume {volume:.3g} m3, density down to {dilation:.2f} of the "
        f"release's), {coverage}, "
        f"the finer of DTM ({terrain_cell:g} m) and solver grid ({spacing:.3g} m) {by_grids:.3g} m"
    )
    return cell, why


def _coverage(side, volume, thickness):
    """Return the cell size [m] that leaves few cells inside the flow empty, and the reason as text."""
    if side > 0:
        return side, f"columns fill squares of {side:.3g} m"
    cell = math.sqrt(POINTS_PER_CELL * volume / thickness) if thickness > 0 else 0.0
    return cell, f"{POINTS_PER_CELL} particles per cell need {cell:.3g} m (median thickness {thickness:.3g} m)"


def automatic_time_step(cell_size: float, fastest: float) -> float:
    """Compute dt_e [s] by Eq 17: the time to cross one export cell; inf at rest.

    Parameters
    ----------
    cell_size : float [m]
    fastest : float [m s-1]
        Largest depth-averaged horizontal speed.
    """
    return cell_size / fastest if fastest > 0 else math.inf


class Crossing(NamedTuple):
    """The pair of consecutive frames between which the flow crosses most cells.

    Parameters
    ----------
    cells : float [1]
        Number of cells crossed.
    interval : float [s]
        Between the two frames.
    speed : float [m s-1]
    fastest : float [m s-1]
        Of all frames, for Eq 17.
    """

    cells: float
    interval: float
    speed: float
    fastest: float


def farthest_crossing(times: Sequence, speeds: Sequence, cell_size: float) -> Crossing:
    """Find the largest displacement between consecutive frames, in export cells; Eq 17 requires at most one cell.

    Parameters
    ----------
    times : sequence of float [s]
        Of the frames, ascending.
    speeds : sequence of float [m s-1]
        Largest depth-averaged horizontal speed of each frame. The larger one of two frames is used.
    cell_size : float [m]

    Returns
    -------
    Crossing
        Of the worst pair; zeros for fewer than two frames.
    """
    if len(times) < 2:
        return Crossing(0.0, 0.0, 0.0, 0.0)
    intervals = np.diff(np.asarray(times, float))
    faster = np.maximum(speeds[:-1], speeds[1:])
    worst = int(np.argmax(intervals * faster))
    interval, speed = float(intervals[worst]), float(faster[worst])
    return Crossing(interval * speed / cell_size, interval, speed, float(np.max(speeds)))


def choose_steps(times: Sequence, time_step: float | None = None) -> list[int]:
    """Choose the frames to export: the nearest frame to each multiple of a time step, without repetition.

    The earlier of two equally near frames is used. Without a multiple between the first and the last time, the frame
    nearest to any multiple is used.

    Parameters
    ----------
    times : sequence of float [s]
        Ascending.
    time_step : float, optional [s]
        Default: every frame. inf: the first frame alone.

    Returns
    -------
    list of int
        Numbers of the frames.
    """
    times = np.asarray(times, float)
    if time_step is None:
        return list(range(len(times)))
    if not math.isfinite(time_step):
        return [0]
    count = times / time_step
    count = np.where(np.abs(count - np.rint(count)) < 1e-9 * np.maximum(1.0, np.abs(count)), np.rint(count), count)
    # only the multiples just before and just after each frame are needed
    multiples = np.unique(np.concatenate([np.floor(count), np.ceil(count)]))
    between = multiples[(multiples >= count[0]) & (multiples <= count[-1])]
    if not len(between):
        between = np.rint(count[:1])
    return _nearest(times, between * time_step)


def _nearest(times, moments):
    after = np.minimum(np.searchsorted(times, moments), len(times) - 1)
    before = np.maximum(after - 1, 0)
    to_earlier, to_later = np.abs(times[before] - moments), np.abs(times[after] - moments)
    earlier = to_earlier <= to_later * (1 + 1e-12)
    return sorted({int(i) for i in np.where(earlier, before, after)})


def export_axes(terrain_grid: Grid, north_up: bool = True) -> Grid:
    """Return a grid of one 1 m cell at the origin of the export cells, along their axes.

    North-up: at the upper left corner of the DTM's bounds. A rotated or sheared DTM may keep its axes: then it is at
    the first corner of the DTM, along its axes. A DTM along east and north, in any order, always gives north-up
    cells.

    Parameters
    ----------
    terrain_grid : Grid
        Of the DTM.
    north_up : bool
        Also for a rotated DTM.
    """
    t = terrain_grid.transform
    if north_up or not terrain_grid.is_rotated:
        west, _, _, north = terrain_grid.bounds
        return Grid(terrain_grid.crs, Affine(1.0, 0.0, west, 0.0, -1.0, north), (1, 1))
    width, height = terrain_grid.sides
    return Grid(terrain_grid.crs, Affine(t.a / width, t.b / height, t.c, t.d / width, t.e / height, t.f), (1, 1))


def run_cell_size(entries: Iterable) -> float | None:
    """Return the cell size [m] of the run that wrote frames, of its coarsest stage; None where it is not known.

    Parameters
    ----------
    entries : iterable of FrameEntry
    """
    sizes = [entry.header.header.get("cell_size") for entry in entries]
    return max(sizes) if sizes and None not in sizes else None


def default_cell_size(terrain_grid: Grid, run_cells: float | None) -> float | None:
    """Return the cell size [m] of a product where none is asked for: that of a run with finer cells than its DTM.

    Parameters
    ----------
    terrain_grid : Grid
        Of the DTM.
    run_cells : float or None [m]
        Cell size of the run.

    Returns
    -------
    float or None
        None: the cells of the DTM, also where a raster of those of the run would be too large.
    """
    if run_cells is None or run_cells >= terrain_grid.cell_size * (1 - SAME_SIZE):
        return None
    west, south, east, north = terrain_grid.bounds
    return run_cells if (east - west) * (north - south) <= MOST_CELLS * run_cells**2 else None


def report_cells(grid: Grid, terrain_grid: Grid, run_cells: float | None, asked: float | None) -> None:
    """Report cells of a product that are coarser than those of its run, and cells of the run that were chosen for it.

    Parameters
    ----------
    grid, terrain_grid : Grid
        Of the product and of the DTM.
    run_cells : float or None [m]
        Cell size of the run.
    asked : float or None [m]
        Cell size that the user gives.
    """
    if run_cells is None:
        return
    if grid.cell_size > run_cells * (1 + SAME_SIZE):
        log.info(
            f"cells of {grid.cell_size:.4g} m are coarser than those of the run, {run_cells:.4g} m: areas and "
            f"distances are too large by parts of a cell; use `cell_size={run_cells:.4g}`"
        )
    elif asked is None and grid.cell_size < terrain_grid.cell_size * (1 - SAME_SIZE):
        log.info(
            f"cells of {grid.cell_size:.4g} m, as the run has; those of the DTM are {terrain_grid.cell_size:.4g} m"
        )


def export_grid(
    terrain_grid: Grid,
    cell_size: float | None = None,
    bounds: tuple | None = None,
    margin: int = 1,
    north_up: bool = True,
    option: str = "--cs-e",
    otherwise: str | None = None,
) -> Grid:
    """Return the export grid, aligned with the DTM (`export_axes`).

    Without `cell_size` it has the cells of the DTM (for a rotated DTM, north-up: squares of the same area), else
    square cells of that size. Without `bounds` it covers the DTM, and its last row and column may extend beyond the
    edge.

    Parameters
    ----------
    terrain_grid : Grid
        Of the DTM.
    cell_size : float, optional [m]
    bounds : (float, float, float, float), optional [m]
        First column, first row, last column, last row, along `export_axes`: the grid is the part that contains them.
    margin : int
        Cells around `bounds`.
    north_up : bool
        Also for a rotated DTM.
    option, otherwise : str
        Option that the message of an error advises to change, and what else it advises to do.

    Raises
    ------
    InputError
        More than 400 million cells, or cells below 1e-6 m.
    """
    axes, own = export_axes(terrain_grid, north_up), terrain_grid.is_rotated and not north_up
    if cell_size is not None:
        width = height = float(cell_size)
    elif own or not terrain_grid.is_rotated:
        width, height = terrain_grid.sides
    else:
        width = height = terrain_grid.cell_size
    across, down = _lengths(terrain_grid, own)
    columns, rows = _cells_along(across, width), _cells_along(down, height)
    first_column = first_row = 0
    if bounds is not None:
        first_column, columns = _part(bounds[0], bounds[2], width, columns, margin)
        first_row, rows = _part(bounds[1], bounds[3], height, rows, margin)
    if width < FINEST_CELL or columns * rows > MOST_CELLS:
        raise InputError(
            f"cells of {width:g} m make a raster of {float(columns * rows):.3g} cells, expected at most "
            f"{MOST_CELLS:.0e}; use a larger {option}{'' if otherwise is None else f' or {otherwise}'}"
        )
    cells = terrain_grid.transform if own and cell_size is None else axes.transform * Affine.scale(width, height)
    transform = cells * Affine.translation(int(first_column), int(first_row))
    return Grid(terrain_grid.crs, transform, (int(rows), int(columns)))


def require_cells_within(terrain_grid: Grid, cell_size: float | None, north_up: bool, option: str = "--cs-e") -> None:
    """Raise an error unless the cells are smaller than the DTM: else they would be a raster of one cell.

    Parameters
    ----------
    terrain_grid : Grid
        Of the DTM.
    cell_size : float or None [m]
    north_up : bool
    option : str
        That gives the cell size.

    Raises
    ------
    InputError
    """
    longer = max(_lengths(terrain_grid, terrain_grid.is_rotated and not north_up))
    if cell_size is not None and cell_size > longer * (1 + 1e-9):
        raise InputError(
            f"{option} got cells of {cell_size:g} m, expected at most the longer side of the DTM, {longer:g} m; use a "
            f"smaller {option}"
        )


def _lengths(grid, own):
    """Extent [m] of a DTM along its `own` rows and columns, or to the east and to the south."""
    if own:
        return tuple(count * side for count, side in zip(grid.shape[::-1], grid.sides, strict=True))
    west, south, east, north = grid.bounds
    return east - west, north - south


def _cells_along(length, cell):
    return max(1, math.ceil(length / max(cell, FINEST_CELL) - 1e-6))


def _part(low, high, cell, most, margin):
    cell = max(cell, FINEST_CELL)
    first = max(math.floor(low / cell) - margin, 0)
    return first, min(math.floor(high / cell) + 1 + margin, most) - first
