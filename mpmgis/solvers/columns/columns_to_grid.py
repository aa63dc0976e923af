"""Transfer of the depth-averaged MPM from columns to grid.

A block sums its columns into a private tile, and the grid gathers the tiles that overlap a node in a fixed order.
No array is shared between loops, so results are bitwise the same for any number of threads.
"""

from typing import NamedTuple

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the functions of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit, jit_borrowing, jit_inline, jit_parallel, prange
from ...compiled.simd_lanes import get, load, multiply_add, put, put_four, store
from ...laws.ground_metric import SLOPE, WATER, cosine_squared, metric_gradient
from ...laws.internal_stress import (
    EarthPressure,
    InPlaneViscosity,
    apparent_viscosity,
    is_hydrostatic,
    is_viscous,
    pressure_factor,
)
from ...laws.still_water import reference_depth
from .column_blocks import BLOCK, TILE, BlockWindow, SortedColumns, TouchedBlocks, first_node
from .column_records import NodeFields, Settings
from .column_report import STIFF
from .column_rows import (
    BATCH,
    L_AREA,
    L_CXX,
    L_CXY,
    L_CYX,
    L_CYY,
    L_DRIVEN,
    L_GX,
    L_GY,
    L_MASS,
    L_PRESSED,
    L_U,
    L_V,
    L_WX0,
    L_WX1,
    L_WX2,
    L_WY0,
    L_WY1,
    L_WY2,
    L_X,
    L_Y,
    LINES,
    QUAD,
    QUADS,
    prefetch_row,
    take_rows,
)
from .spline_bed import bed_at
from .spline_weights import weights

STABLE_SHARE = 0.125  # [1] largest apparent viscosity over rho dx^2 / dt: explicit diffusion is stable up to 0.5
REST_SPEED2 = 1e-12  # [m2 s-2] below which a flow has no direction


class StressLaws(NamedTuple):
    """Laws of the forces that columns give to nodes; those of the same names in `ColumnEffects`."""

    metric: int
    still_water: bool
    earth_pressure: EarthPressure
    viscosity: InPlaneViscosity


@jit_borrowing
def pressure_impulses(
    scratch: np.ndarray,
    quads: np.ndarray,
    place: np.ndarray,
    count: int,
    i_block: int,
    j_block: int,
    bed: np.ndarray,
    lake_level: np.ndarray,
    dt: float,
    settings: Settings,
    laws: StressLaws,
) -> int:
    """Compute what columns give to nodes, as weights and groups of four numbers.

    Node (i, j) gets wy_j * column_i + wx_i * line_j of (mass, momentum east, north, kinetic energy before the step).

    Parameters
    ----------
    scratch : float64[LINES]
        Columns; the weights are added.
    quads : float64[QUADS]
        Becomes the three column_i and the three line_j.
    place : int64[BATCH]
        Becomes the place of the first node of each column in the tile.
    count : int
        Number of columns.
    i_block : int
        Column of the first node of the block.
    j_block : int
        Row of that node.
    bed : float64[ny + 3, nx + 3] [m]
    lake_level : float64[ny, nx] [m]
    dt : float [s]
        Time for which forces act in this step.
    settings : Settings
    laws : StressLaws

    Returns
    -------
    int
        Number of columns whose apparent viscosity was limited.
    """
    _weigh_push(scratch, count, settings.density)
    if laws.still_water:
        _take_still_water(scratch, count, bed, lake_level, settings)
    if not is_hydrostatic(laws.earth_pressure):
        _apply_earth_pressure(scratch, count, dt, laws.earth_pressure)
    if laws.metric == WATER:
        if is_viscous(laws.viscosity):
            return _impulses(scratch, quads, place, count, i_block, j_block, dt, settings, laws.viscosity, WATER, True)
        return _impulses(scratch, quads, place, count, i_block, j_block, dt, settings, laws.viscosity, WATER, False)
    if is_viscous(laws.viscosity):
        return _impulses(scratch, quads, place, count, i_block, j_block, dt, settings, laws.viscosity, SLOPE, True)
    return _impulses(scratch, quads, place, count, i_block, j_block, dt, settings, laws.viscosity, SLOPE, False)


@jit_borrowing
def _weigh_push(scratch, count, density):
    """Compute what pushes columns apart, A rho h^2, and what drives them downhill, their mass."""
    for k in range(count):
        mass, area = get(scratch, L_MASS, k), get(scratch, L_AREA, k)
        put(scratch, L_PRESSED, k, mass * mass / (density * area))
        put(scratch, L_DRIVEN, k, mass)


@jit_borrowing
def _take_still_water(scratch, count, bed, lake_level, settings):
    """Take away from both what balances in a lake at rest."""
    density, inverse_dx = settings.density, 1.0 / settings.dx
    for k in range(count):
        x, y, area = get(scratch, L_X, k), get(scratch, L_Y, k), get(scratch, L_AREA, k)
        level = lake_level[int(y * inverse_dx), int(x * inverse_dx)]
        bed_here = bed_at(bed, x, y, inverse_dx)[0]
        still = density * area * reference_depth(bed_here, level)
        put(scratch, L_PRESSED, k, get(scratch, L_PRESSED, k) - still * still / (density * area))
        put(scratch, L_DRIVEN, k, get(scratch, L_DRIVEN, k) - still)


@jit_borrowing
def _apply_earth_pressure(scratch, count, dt, earth_pressure):
    """Multiply the push by the factor of earth pressure."""
    for k in range(count):
        u, v = get(scratch, L_U, k), get(scratch, L_V, k)
        two_dxy = get(scratch, L_CXY, k) + get(scratch, L_CYX, k)
        rate = _stretching_rate(u, v, get(scratch, L_CXX, k), two_dxy, get(scratch, L_CYY, k))
        put(scratch, L_PRESSED, k, get(scratch, L_PRESSED, k) * pressure_factor(earth_pressure, rate, dt))


@jit_inline
def _impulses(scratch, quads, place, count, i_block, j_block, dt, settings, viscosity, metric, is_stiff):
    """The main loop of `pressure_impulses`, compiled apart for each metric and for viscous flow; it is vectorised."""
    dx, density, gravity = settings.dx, settings.density, settings.gravity
    inverse_dx = 1.0 / dx
    stiff = 0
    for k in range(count):
        mass, area = get(scratch, L_MASS, k), get(scratch, L_AREA, k)
        slope_x, slope_y = get(scratch, L_GX, k), get(scratch, L_GY, k)
        x, y = get(scratch, L_X, k), get(scratch, L_Y, k)
        u, v = get(scratch, L_U, k), get(scratch, L_V, k)
        i0, fx, wx0, wx1, wx2 = weights(x, inverse_dx)
        j0, fy, wy0, wy1, wy2 = weights(y, inverse_dx)
        put(place, 0, k, ((j0 - j_block) * TILE + i0 - i_block) * 4)
        metric_x, metric_y = metric_gradient(metric, slope_x, slope_y)
        c2 = cosine_squared(metric_x, metric_y)
        pressed, driven = get(scratch, L_PRESSED, k), get(scratch, L_DRIVEN, k)
        cxx, cxy, cyx, cyy = (
            get(scratch, L_CXX, k),
            get(scratch, L_CXY, k),
            get(scratch, L_CYX, k),
            get(scratch, L_CYY, k),
        )
        push = dt * 0.5 * gravity * c2 * pressed * inverse_dx
        along_xx, along_xy = 1.0 - c2 * metric_x * metric_x, -c2 * metric_x * metric_y
        along_yy = 1.0 - c2 * metric_y * metric_y
        push_xx, push_xy, push_yx, push_yy = push * along_xx, push * along_xy, push * along_xy, push * along_yy
        if is_stiff:
            dxy = 0.5 * (cxy + cyx)
            apparent = apparent_viscosity(viscosity, mass / (density * area), u, v, cxx, dxy, cyy)
            largest = STABLE_SHARE * density * dx * dx / dt
            stiff += apparent > largest
            drawn = 2.0 * min(apparent, largest) * dt * inverse_dx * mass / density
            push_xx -= drawn * (cxx * along_xx + dxy * along_xy)
            push_xy -= drawn * (cxx * along_xy + dxy * along_yy)
            push_yx -= drawn * (dxy * along_xx + cyy * along_xy)
            push_yy -= drawn * (dxy * along_xy + cyy * along_yy)
        pull = dt * driven * gravity * c2
        w = u * metric_x + v * metric_y
        kinetic = 0.5 * mass * (u * u + v * v + w * w)
        mdx = mass * dx
        cxx, cxy, cyx, cyy = mdx * cxx, mdx * cxy, mdx * cyx, mdx * cyy
        # momentum at the place of the column, extrapolated to the first node: -f cells away in each axis
        qx = mass * u - pull * slope_x - fx * cxx - fy * cxy
        qy = mass * v - pull * slope_y - fx * cyx - fy * cyy
        put(scratch, L_WX0, k, wx0)
        put(scratch, L_WX1, k, wx1)
        put(scratch, L_WX2, k, wx2)
        put(scratch, L_WY0, k, wy0)
        put(scratch, L_WY1, k, wy1)
        put(scratch, L_WY2, k, wy2)
        put_four(
            quads,
            0 * QUAD,
            k,
            wx0 * mass,
            wx0 * qx + push_xx * (fx - 1.5),
            wx0 * qy + push_yx * (fx - 1.5),
            wx0 * kinetic,
        )
        put_four(
            quads,
            1 * QUAD,
            k,
            wx1 * mass,
            wx1 * (qx + cxx) + push_xx * (2.0 - 2.0 * fx),
            wx1 * (qy + cyx) + push_yx * (2.0 - 2.0 * fx),
            wx1 * kinetic,
        )
        put_four(
            quads,
            2 * QUAD,
            k,
            wx2 * mass,
            wx2 * (qx + 2.0 * cxx) + push_xx * (fx - 0.5),
            wx2 * (qy + 2.0 * cyx) + push_yx * (fx - 0.5),
            wx2 * kinetic,
        )
        put_four(quads, 3 * QUAD, k, 0.0, push_xy * (fy - 1.5), push_yy * (fy - 1.5), 0.0)
        line = 2.0 - 2.0 * fy
        put_four(quads, 4 * QUAD, k, 0.0, wy1 * cxy + push_xy * line, wy1 * cyy + push_yy * line, 0.0)
        line = fy - 0.5
        put_four(quads, 5 * QUAD, k, 0.0, 2.0 * wy2 * cxy + push_xy * line, 2.0 * wy2 * cyy + push_yy * line, 0.0)
    return stiff


@jit
def _spread(scratch, quads, place, count, tile, rows, order, first):
    """Add each column's nine products to the block's tile; prefetch the rows of columns to come.

    Columns from the two halves of the batch take turns: neighbours add to the same nodes, and would wait for each
    other's sums.
    """
    half = (count + 1) // 2
    for k in range(half):
        prefetch_row(rows, order, first + 2 * k)
        prefetch_row(rows, order, first + 2 * k + 1)
        _spread_one(scratch, quads, place, k, tile)
        if k + half < count:
            _spread_one(scratch, quads, place, k + half, tile)


@jit_inline
def _spread_one(scratch, quads, place, k, tile):
    t, q = place[k], 4 * k
    wx0, wx1, wx2 = get(scratch, L_WX0, k), get(scratch, L_WX1, k), get(scratch, L_WX2, k)
    node0, node1, node2 = load(quads, q), load(quads, q + QUAD), load(quads, q + 2 * QUAD)
    for j in range(3):
        wy = get(scratch, L_WY0 + j * BATCH, k)
        line = load(quads, q + (3 + j) * QUAD)
        store(tile, t, multiply_add(wy, node0, multiply_add(wx0, line, load(tile, t))))
        store(tile, t + 4, multiply_add(wy, node1, multiply_add(wx1, line, load(tile, t + 4))))
        store(tile, t + 8, multiply_add(wy, node2, multiply_add(wx2, line, load(tile, t + 8))))
        t += TILE * 4


@jit_parallel
def particles_to_grid(
    rows: np.ndarray,
    sorted_columns: SortedColumns,
    window: BlockWindow,
    tiles: np.ndarray,
    fields: NodeFields,
    report: np.ndarray,
    dt: float,
    settings: Settings,
    metric: int,
    still_water: bool,
    earth_pressure: EarthPressure,
    viscosity: InPlaneViscosity,
) -> None:
    """Sum mass, momentum and impulse of each block's columns into its tile (weak form).

    f_i = sum_p A_p rho g c^2 K h_p^2 / 2 P grad N_i - A_p h_p sigma_p P grad N_i - m_p g c^2 grad b N_i, with
    P = I - c^2 grad b grad b^T and momentum sum_p N_i m_p (u_p + C_p (x_i - x_p)) (APIC, Jiang et al. 2015).

    Parameters
    ----------
    rows : float64[columns, ROW]
    sorted_columns : SortedColumns
    window : BlockWindow
    tiles : float64[blocks with columns, TILE * TILE * 4]
    fields : NodeFields
    report : float64[CHUNKS, REPORT]
        Its entry STIFF is set.
    dt : float [s]
        Time for which forces act in this step.
    settings : Settings
    metric, still_water, earth_pressure, viscosity
        Slots of these names (`ColumnEffects`).
    """
    order, start, block, bounds = sorted_columns
    bed, lake_level = fields.bed, fields.lake_level
    for c in prange(CHUNKS):
        scratch = np.empty(LINES)
        quads = np.empty(QUADS)
        place = np.empty(BATCH, np.int64)
        laws = StressLaws(metric, still_water, earth_pressure, viscosity)
        stiff = 0
        for a in range(bounds[c], bounds[c + 1]):
            tile = tiles[a]
            tile[:] = 0.0
            i_block = (block[a] % window.width + window.west) * BLOCK
            j_block = (block[a] // window.width + window.south) * BLOCK
            for first in range(start[a], start[a + 1], BATCH):
                count = min(BATCH, start[a + 1] - first)
                take_rows(rows, order, first, count, scratch, True)
                stiff += pressure_impulses(
                    scratch, quads, place, count, i_block, j_block, bed, lake_level, dt, settings, laws
                )
                _spread(scratch, quads, place, count, tile, rows, order, first)
        report[c, STIFF] = stiff


@jit_inline
def _stretching_rate(u, v, dxx, two_dxy, dyy):
    """Stretching rate of the flow along its direction [s-1]; its divergence at rest."""
    speed2 = u * u + v * v
    along = u * u * dxx + u * v * two_dxy + v * v * dyy
    return along / speed2 if speed2 > REST_SPEED2 else dxx + dyy


@jit_parallel
def gather_tiles(nodes: np.ndarray, tiles: np.ndarray, slot: np.ndarray, touched: TouchedBlocks) -> None:
    """Sum the up to four tiles that overlap each node of the touched blocks, always in the same order.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    tiles : float64[blocks with columns, TILE * TILE * 4]
    slot : int32[places of the window]
        Number of the block with columns at each place, -1 where there are none.
    touched : TouchedBlocks
    """
    rows, columns = nodes.shape[0], nodes.shape[1]
    for k in prange(touched.count):
        j_first, i_first = first_node(touched, k)
        bj, bi = j_first // BLOCK - touched.south, i_first // BLOCK - touched.west
        for j in range(j_first, min(j_first + BLOCK, rows)):
            for i in range(i_first, min(i_first + BLOCK, columns)):
                nodes[j, i, :] = 0.0
        for back_j in range(2):
            for back_i in range(2):
                oi, oj = bi - back_i, bj - back_j
                if oi < 0 or oj < 0 or oi >= touched.width or oj >= touched.height:
                    continue
                active = slot[oj * touched.width + oi]
                if active < 0:
                    continue
                tile = tiles[active]
                for j in range(TILE - BLOCK if back_j else BLOCK):
                    for i in range(TILE - BLOCK if back_i else BLOCK):
                        if j_first + j < rows and i_first + i < columns:
                            t = ((j + BLOCK * back_j) * TILE + i + BLOCK * back_i) * 4
                            for e in range(4):
                                nodes[j_first + j, i_first + i, e] += tile[t + e]
