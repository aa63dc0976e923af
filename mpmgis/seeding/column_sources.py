"""Sources of columns: one for each release part, at the requested resolution."""

from collections.abc import Callable, Sequence

import numpy as np

from ..system.errors import InputError
from ..terrain.grid import Grid
from ..terrain.release_parts import ReleaseArea, ThicknessRaster
from .equal_mass_columns import EqualMassColumns
from .halton_columns import HaltonColumns
from .lattice_columns import LatticeColumns, Tiling, tiling_rows
from .part_scene import PartScene
from .release_volume import PartVolume, integral
from .seeding_options import SeedOptions

_BLOCK = 4  # sub-squares along a cell's side where spacing or count set the lattice: 4 x 4 to a cell
_TOLERANCE = 0.01  # [1] of a requested count: no larger error is accepted
_GOOD_ENOUGH = 0.004  # [1] of a requested count: the search ends


def column_sources(
    grid: Grid,
    release: ReleaseArea,
    volumes: list[PartVolume],
    scenes: list[PartScene],
    slope: tuple[np.ndarray, Grid] | None,
    options: SeedOptions,
) -> list:
    """Return a source of columns for each release part.

    Parameters
    ----------
    grid : Grid
        Grid of the DTM.
    release : ReleaseArea
    volumes : list of PartVolume
        One a part.
    scenes : list of PartScene
        One a part.
    slope : (float64[rows, columns], Grid) or None
        tan of the slope, for refinement.
    options : SeedOptions

    Returns
    -------
    list
        EqualMassColumns, HaltonColumns or LatticeColumns: each has `counts` int64[blocks], `count`, and `fill` over a
        range of blocks.

    Raises
    ------
    InputError
        The requested number of columns cannot be met, or the cells cannot be cut regularly.
    """
    polygons = release.polygons
    expected = options.expected(grid, release.area)
    if options.mass == "equal":
        shares = apportion(expected, [part.volume for part in volumes])
        return [
            EqualMassColumns(polygon, n, options.squares, grid, scene, options.points, options.seed)
            for polygon, n, scene in zip(polygons, shares, scenes, strict=True)
        ]
    if options.points == "halton":
        mean = 1.0 if slope is None else 1.0 + options.refine_slope * _mean_steepness(slope, polygons)
        shares = apportion(expected * (1.0 if options.count else mean), [polygon.area for polygon in polygons])
        return [
            HaltonColumns(polygon, n, options.cells(grid), options.refine_slope, slope, options.seed)
            for polygon, n in zip(polygons, shares, strict=True)
        ]
    return _lattice_sources(grid, polygons, slope, options, expected)


def apportion(total: float, weights: Sequence[float]) -> list[int]:
    """Return whole numbers with a given sum in proportion to `weights`, at least 1 each.

    Parameters
    ----------
    total : float
        The sum, rounded.
    weights : sequence of float
    """
    weights = np.asarray(weights, dtype=float)
    total = max(round(total), len(weights))
    wanted = (total - len(weights)) * weights / weights.sum()
    shares = np.floor(wanted).astype(int)
    largest = np.argsort(shares - wanted, kind="stable")[: total - len(weights) - shares.sum()]
    shares[largest] += 1
    return (shares + 1).tolist()


def _mean_steepness(slope: tuple[np.ndarray, Grid], polygons: Sequence) -> float:
    """Return the mean of min(tan slope, 1) over the polygons."""
    raster = ThicknessRaster(np.minimum(slope[0], 1.0), slope[1])
    totals = [integral(polygon, raster) for polygon in polygons]
    return sum(total for total, _, _ in totals) / sum(area for _, _, area in totals)


def _lattice_sources(
    grid: Grid, polygons: Sequence, slope: tuple[np.ndarray, Grid] | None, options: SeedOptions, expected: float
) -> list[LatticeColumns]:
    """Return columns on the cells' own tiling, on a lattice of free spacing, or with the requested count."""
    beta = options.refine_slope

    def make(cells, n0, forced=None):
        tiling = Tiling(n0, beta, cells.aspect)
        forced = forced or [0] * len(polygons)
        return [
            LatticeColumns(polygon, cells, tiling, options.points, options.seed, slope, extra)
            for polygon, extra in zip(polygons, forced, strict=True)
        ]

    cells = options.cells(grid)
    if options.per_cell is not None:
        _require_regular(options, cells)
        return make(cells, options.per_cell)
    if beta:
        per_cell = expected / sum(polygon.area for polygon in polygons) * cells.cell_area
        if options.spacing is not None:
            return make(cells, per_cell)
        return _meet_count(lambda n0, forced=None: make(cells, n0, forced), per_cell, 1.0, options.count)
    if options.spacing is not None:
        return make(options.squares(grid, _BLOCK * options.spacing), _BLOCK**2)
    start = np.sqrt(sum(polygon.area for polygon in polygons) / options.count)
    return _meet_count(
        lambda spacing, forced=None: make(options.squares(grid, _BLOCK * spacing), _BLOCK**2, forced),
        start,
        -0.5,
        options.count,
    )


def _require_regular(options, cells):
    if options.points == "jittered" and not tiling_rows(options.per_cell, cells.aspect)[1]:
        raise InputError(
            f"jittered points need a cell that is cut regularly, {options.per_cell} a cell is not; use 4, 6, 9, 12, "
            "16 or 25"
        )


def _meet_count(
    make: Callable[..., list[LatticeColumns]], start: float, power: float, wanted: int
) -> list[LatticeColumns]:
    """Return sources whose columns number `wanted` within 1 %: `make(x)` has about const * x^(1 / power) of them.

    The rim makes the number jump, so secant steps are followed by a scan; where no lattice fits (few columns), the
    smallest pieces of one that has slightly more are joined to their neighbours.
    """
    tried = {}

    def number(x):
        if x not in tried:
            tried[x] = sum(source.count for source in make(x))
        return tried[x]

    x = start
    for _ in range(10):
        n = number(x)
        if abs(n - wanted) <= _GOOD_ENOUGH * wanted:
            return make(x)
        x *= (wanted / n) ** power
    best = min(tried, key=lambda x: abs(tried[x] - wanted))
    if abs(tried[best] - wanted) > _TOLERANCE * wanted:
        for share in np.linspace(0.85, 1.15, 41).tolist():
            number(best * share)
        best = min(tried, key=lambda x: abs(tried[x] - wanted))
    if abs(tried[best] - wanted) <= _TOLERANCE * wanted:
        return make(best)
    return _joined_to(make, tried, wanted)


def _joined_to(make: Callable[..., list[LatticeColumns]], tried: dict[float, int], wanted: int) -> list[LatticeColumns]:
    """Return sources whose smallest pieces are joined until `wanted` columns are left."""
    more = [x for x in tried if tried[x] > wanted]
    best = min(more, key=lambda x: tried[x]) if more else min(tried, key=lambda x: abs(tried[x] - wanted))
    sources = make(best)
    extra = sum(source.count for source in sources) - wanted
    pieces = np.array([source.mergeable for source in sources])
    if extra > 0 and pieces.sum() > extra:
        shares = np.minimum(np.floor(extra * pieces / pieces.sum()).astype(int), pieces - 1)
        for i in np.argsort(-pieces):
            shares[i] += max(min(extra - shares.sum(), pieces[i] - 1 - shares[i]), 0)
        forced = [source.joined + int(share) for source, share in zip(sources, shares, strict=True)]
        sources = make(best, forced)
    got = sum(source.count for source in sources)
    if abs(got - wanted) > _TOLERANCE * wanted:
        raise InputError(
            f"--count {wanted} cannot be met within {100 * _TOLERANCE:g} % on this release; the nearest is {got}: ask "
            f"for that, or for more"
        )
    return sources
