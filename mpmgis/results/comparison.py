"""Compare two results: matching bands, footprints, overlap and differences."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from affine import Affine

from ..maps.averaging.result_bands import SAME_QUANTITY
from ..system.errors import InputError
from ..terrain.grid import Grid

# the last step of a flow that still moves is compared with the deposit of another; both names are printed
LAST_STEPS = tuple((f"{name}_deposit", f"{name}_last") for name in ("h", "t", "t_vol"))
FOOTPRINT_BANDS = ("pft", "h_max", "h", "t_vol", "h_deposit", "h_last")  # in order of preference
SMALLEST_COUNTS = ("Un_min",)  # bands whose peak is their smallest value
PERCENTILE = 99.0  # [%] high value that does not depend on a single cell
MOST_CELLS = 100_000_000  # of the grid on which two footprints are compared, to limit the memory
THICKNESS, DIFFERENCE, MASK, ELEVATION = "thickness", "difference of DEMs", "mask", "elevations"  # kinds of raster
_ONES = (1.0, 255.0)  # mask values inside the footprint
_NO_THICKNESS = 10.0  # [m] no flow exceeds this thickness in every cell of a raster
_NEGATIVE_SHARE = 1e-3  # [1] of the non-zero cells; more negative values than this are not noise
_ON_THE_CELL = 1e-6  # [cells] tolerance for cell centres on a cell border of the other grid
_ROWS_AT_ONCE = 256  # resampled together, to limit the memory


class Overlap(NamedTuple):
    """Plan areas [m2] covered by `both` footprints, `only_first` and `only_second`."""

    both: float
    only_first: float
    only_second: float

    @property
    def either(self) -> float:
        """Area [m2] of the union."""
        return self.both + self.only_first + self.only_second

    @property
    def iou(self) -> float:
        """Intersection over union, 0 to 1; NaN where both footprints are empty."""
        return self.both / self.either if self.either > 0 else math.nan


class Difference(NamedTuple):
    """First minus second where both have flow: mean and root mean square; NaN without common cells."""

    mean: float
    rms: float


def matched_bands(first: Sequence, second: Sequence) -> list[tuple]:
    """Return pairs of band names of the same quantity, in the order of `first`; None for a missing partner.

    An identical name has priority over an equivalent one (`SAME_QUANTITY`).

    Parameters
    ----------
    first, second : sequence of str
        Band names of both results.

    Returns
    -------
    list of (str or None, str or None)
    """
    pairs = [(name, name if name in second else None) for name in first]
    taken = {other for _, other in pairs}
    for k, (name, other) in enumerate(pairs):
        for twin in () if other else _twins(name):
            if twin in second and twin not in taken:
                pairs[k] = (name, twin)
                taken.add(twin)
    pairs += [(None, name) for name in second if name not in taken]
    return pairs


def _twins(name):
    return [other for group in (*SAME_QUANTITY, *LAST_STEPS) if name in group for other in group if other != name]


def kind_of_raster(values: np.ndarray) -> str:
    """Return the most likely content of a raster without metadata: MASK, DIFFERENCE, ELEVATION or THICKNESS.

    A mask has one value (1 or 255) and 0 or nodata; a difference of DEMs has both signs; elevations exceed
    _NO_THICKNESS [m] in every cell.

    Parameters
    ----------
    values : float[rows, columns]
        NaN without a value.

    Returns
    -------
    str
    """
    known = values[np.isfinite(values)]
    nonzero = known[known != 0]
    if nonzero.size == 0:
        return THICKNESS
    if nonzero.min() == nonzero.max() and nonzero[0] in _ONES:
        return MASK
    if np.count_nonzero(nonzero < 0) > _NEGATIVE_SHARE * nonzero.size:
        return DIFFERENCE
    return ELEVATION if known.min() > _NO_THICKNESS else THICKNESS


def require_present_name(asked: str | None) -> None:
    """Raise InputError if a band name is one of earlier versions; the error gives the present name.

    Parameters
    ----------
    asked : str or None

    Raises
    ------
    InputError
    """
    if asked is not None and asked.startswith("deposit_"):
        now = f"{asked.removeprefix('deposit_')}_deposit"
        raise InputError(f"--band {asked!r} is now named {now!r}; use that name")


def footprint_bands(pairs: list, asked: str | None = None, complete: bool = True) -> tuple:
    """Return the pair of bands whose footprints are compared: the one named `asked`, else peak thickness.

    The only band of a result is compared whatever its name.

    Parameters
    ----------
    pairs : list of (str or None, str or None)
        From `matched_bands`.
    asked : str, optional
    complete : bool
        Whether both results must have the band.

    Returns
    -------
    (str or None, str or None)

    Raises
    ------
    InputError
        No such pair.
    """
    whole = [pair for pair in pairs if None not in pair] if complete else pairs
    if asked is not None:
        found = next((pair for pair in whole if asked in pair), None) or _with_only_band(pairs, asked)
        if found is None:
            raise InputError(f"--band {asked!r} is not in both results; {_choices(pairs, whole)}")
        return found
    found = next((pair for name in FOOTPRINT_BANDS for pair in whole if name in pair), None)
    if found is None and complete:
        found = _only_bands(pairs)
    if found is None and len(whole) == 1:
        found = whole[0]
    if found is None:
        raise InputError(f"no band of peak thickness in both results; {_choices(pairs, whole)}")
    return found


def _with_only_band(pairs, asked):
    """The band `asked` of one result with the only, otherwise unmatched, band of the other; else None."""
    names = [[pair[k] for pair in pairs if pair[k] is not None] for k in (0, 1)]
    for k in (0, 1):
        if asked in names[k] and len(names[1 - k]) == 1 and all(None in pair for pair in pairs):
            return (asked, names[1][0]) if k == 0 else (names[0][0], asked)
    return None


def _only_bands(pairs):
    """The only band of one result with the peak thickness or only band of the other; None if both have several."""
    first = [a for a, _ in pairs if a is not None]
    second = [b for _, b in pairs if b is not None]
    if min(len(first), len(second)) != 1:
        return None
    chosen = [names[0] if len(names) == 1 else _thickest(names) for names in (first, second)]
    return None if None in chosen else tuple(chosen)


def _thickest(names):
    return next((name for name in FOOTPRINT_BANDS if name in names), None)


def _choices(pairs, whole):
    if whole:
        return f"use --band with one of {', '.join(a or b for a, b in whole)}"
    first, second = (", ".join(pair[k] for pair in pairs if pair[k]) or "none" for k in (0, 1))
    return f"the first has {first}; the second has {second}"


def peak(values: np.ndarray, name: str = "") -> float:
    """Return the largest finite value of a band (smallest for `SMALLEST_COUNTS`); NaN without finite values.

    Parameters
    ----------
    values : float[rows, columns]
    name : str
        Of the band.
    """
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return math.nan
    return float(finite.min() if name in SMALLEST_COUNTS else finite.max())


def high_percentile(values: np.ndarray, name: str = "") -> float:
    """Return the 99th percentile of the cells with flow: a peak that does not depend on a single cell.

    Parameters
    ----------
    values : float[rows, columns]
        Cells with flow are finite and not 0.
    name : str
        Of the band; for `SMALLEST_COUNTS` it is the 1st percentile.

    Returns
    -------
    float
        NaN without flow.
    """
    flowing = values[np.isfinite(values) & (values != 0)]
    if flowing.size == 0:
        return math.nan
    return float(np.percentile(flowing, 100 - PERCENTILE if name in SMALLEST_COUNTS else PERCENTILE))


def difference(first: np.ndarray, second: np.ndarray, where: np.ndarray) -> Difference:
    """Return the difference of two bands on the same grid.

    Parameters
    ----------
    first, second : float[rows, columns] [unit of the bands]
    where : bool[rows, columns]
        The cells that are compared.

    Returns
    -------
    Difference
    """
    gap = (first - second)[where]
    gap = gap[np.isfinite(gap)]
    if gap.size == 0:
        return Difference(math.nan, math.nan)
    with np.errstate(over="ignore"):  # values of a damaged file
        return Difference(float(gap.mean()), float(np.sqrt((gap**2).mean())))


def footprint(values: np.ndarray, threshold: float) -> np.ndarray:
    """Return the cells above a threshold; nodata (NaN) is no flow.

    Parameters
    ----------
    values : float[rows, columns]
    threshold : float [unit of `values`]

    Returns
    -------
    bool[rows, columns]
    """
    with np.errstate(invalid="ignore"):
        return values > threshold


def mask_corners(mask: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the corners of the bounding window of the True cells.

    Parameters
    ----------
    mask : bool[rows, columns]
    grid : Grid

    Returns
    -------
    float64[4, 2] [m]
        Map coordinates; empty [0, 2] without True cells.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return np.empty((0, 2))
    row = np.array([rows[0] - 0.5, rows[0] - 0.5, rows[-1] + 0.5, rows[-1] + 0.5])
    column = np.array([columns[0] - 0.5, columns[-1] + 0.5, columns[-1] + 0.5, columns[0] - 0.5])
    return np.stack(grid.xy(row, column), axis=-1)


def joint_grid(grids: Sequence, points: np.ndarray) -> Grid:
    """Return the common grid of a comparison: the finest of `grids`, cropped or extended to contain all `points`.

    Parameters
    ----------
    grids : sequence of Grid
        The first of those with the smallest cells is used.
    points : float[n, 2] [m]
        Map coordinates, n at least 1.

    Returns
    -------
    Grid

    Raises
    ------
    InputError
        More than 1e8 cells: the points are too far apart for this cell size.
    """
    finest = min(grids, key=lambda grid: round(grid.cell_size, 9))
    row, column = finest.rowcol(*np.asarray(points, float).T)
    top, left = (math.floor(round(float(v.min()) + 0.5, 6)) for v in (row, column))
    bottom, right = (math.ceil(round(float(v.max()) + 0.5, 6)) for v in (row, column))
    shape = (max(bottom - top, 1), max(right - left, 1))
    if shape[0] * shape[1] > MOST_CELLS:
        raise InputError(
            f"the footprints span {shape[0]} x {shape[1]} cells of {finest.cell_size:g} m, expected at most "
            f"{MOST_CELLS:g} cells; check that both cover the same area, or use coarser rasters"
        )
    return Grid(finest.crs, finest.transform * Affine.translation(left, top), shape)


def nearest(values: np.ndarray, grid: Grid, onto: Grid, outside: float = np.nan) -> np.ndarray:
    """Resample a raster to the cell centres of another grid, by the nearest cell.

    With target cells that are not larger, peaks are kept and borders move by half a cell at most. A centre on the
    border of two cells belongs to the larger row and column.

    Parameters
    ----------
    values : [rows, columns]
    grid : Grid
        Of `values`.
    onto : Grid
    outside : float
        Value beyond the raster.

    Returns
    -------
    [rows, columns]
        On the grid `onto`, of the type of `values`.
    """
    rows, columns = values.shape
    result = np.full(onto.shape, outside, dtype=values.dtype)
    for first in range(0, onto.shape[0], _ROWS_AT_ONCE):
        part = result[first : first + _ROWS_AT_ONCE]
        place = np.ogrid[first : first + len(part), : onto.shape[1]]
        row, column = (np.floor(v + (0.5 + _ON_THE_CELL)) for v in grid.rowcol(*onto.xy(*place)))
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        row, column = (np.broadcast_to(v, inside.shape)[inside].astype(np.intp) for v in (row, column))
        part[inside] = values[row, column]
    return result


def north_up_grid(grid: Grid) -> Grid:
    """Return a north-up grid with square cells of the same size that covers `grid`; `grid` itself if it is north-up.

    Parameters
    ----------
    grid : Grid

    Returns
    -------
    Grid
    """
    if grid.is_north_up:
        return grid
    west, south, east, north = grid.bounds
    size = grid.cell_size
    shape = tuple(math.ceil(round(span / size, 6)) for span in (north - south, east - west))
    return Grid.north_up(grid.crs, west, north, size, shape)


def overlap(first: np.ndarray, second: np.ndarray, cell_area: float) -> Overlap:
    """Return the overlap of two footprints on the same grid.

    Parameters
    ----------
    first, second : bool[rows, columns]
    cell_area : float [m2]

    Returns
    -------
    Overlap
    """
    counts = (np.count_nonzero(first & second), np.count_nonzero(first & ~second), np.count_nonzero(second & ~first))
    return Overlap(*(count * cell_area for count in counts))
