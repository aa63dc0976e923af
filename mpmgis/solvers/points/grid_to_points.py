"""Grid to points: velocities, deformation and stress of the points, and their places after a step.

Each block copies the nodes that its points read into a private tile and works on batches of points (`point_rows`).
"""

from math import sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit_borrowing, jit_parallel, kernel_part, law_function, prange
from ...compiled.simd_lanes import get, lanes, load, multiply_add, put, store, transposed
from ...laws.affine_transfer import TURNING_GRADIENT
from ...laws.fluid_material import fluid_step
from ...laws.material import COHESIVE_MU_I, DRUCKER_PRAGER, ELASTIC, FLUID, MU_I, ORDINARY, Material
from ...laws.material import FAR as FAR_CODE
from ...laws.material import NO_TENSION as TIP_CODE
from ...laws.material_choice import stress_step_far
from ...laws.softening import EXPONENTIAL, LINEAR, TANGENT, Softening, exponential_cone, linear_cone, tangent_cone
from ...laws.solid_material import (
    returned_cohesive_mu_i,
    returned_drucker_prager,
    returned_elastic,
    returned_mu_i,
    state_of_strain,
    stress_of_strain,
    trial_strain,
)
from . import point_batch as line
from . import point_report as entry
from .affine_limit import STILL, THIN, limit_thin
from .point_batch import BATCH, INTEGERS, LINES, QUAD, QUADS
from .point_edges import all_inside, book_out, deepest_level, find_blocks, give_keys, keep_inside, widen_window
from .point_rows import (
    BLOCK,
    GHOSTS,
    S4,
    TILE_LAYER,
    TILE_ROW,
    ActiveBlocks,
    Edges,
    Settings,
    SortedPoints,
    StepFactors,
    Surface,
    give_rows,
    take_rows,
    weigh,
)

THIRD = 1.0 / 3.0
NO_WINDOW = 1 << 40  # western and southern block of a window of no points


@kernel_part
def _read_nodes(tile, nodes, targets):
    """Copy the velocities of the eight node blocks that a tile overlaps."""
    for o in range(8):
        part = nodes[targets[o]]
        oi, oj, ok = o & 1, (o >> 1) & 1, o >> 2
        for k in range(2 if ok else BLOCK):
            for j in range(2 if oj else BLOCK):
                t = (k + BLOCK * ok) * TILE_LAYER + (j + BLOCK * oj) * TILE_ROW + BLOCK * oi * 4
                n = (k * BLOCK + j) * BLOCK * 4
                for i in range(2 if oi else BLOCK):
                    store(tile, t + 4 * i, load(part, n + 4 * i))


@kernel_part
def _weigh_moments(scratch):
    """Compute the weights times the offset [cells] of their node from the point."""
    for q in range(BATCH):
        fx, fy, fz = get(scratch, line.FX, q), get(scratch, line.FY, q), get(scratch, line.FZ, q)
        put(scratch, line.MX0, q, -get(scratch, line.WX0, q) * fx)
        put(scratch, line.MX1, q, get(scratch, line.WX1, q) * (1.0 - fx))
        put(scratch, line.MX2, q, get(scratch, line.WX2, q) * (2.0 - fx))
        put(scratch, line.MY0, q, -get(scratch, line.WY0, q) * fy)
        put(scratch, line.MY1, q, get(scratch, line.WY1, q) * (1.0 - fy))
        put(scratch, line.MY2, q, get(scratch, line.WY2, q) * (2.0 - fy))
        put(scratch, line.MZ0, q, -get(scratch, line.WZ0, q) * fz)
        put(scratch, line.MZ1, q, get(scratch, line.WZ1, q) * (1.0 - fz))
        put(scratch, line.MZ2, q, get(scratch, line.WZ2, q) * (2.0 - fz))


@kernel_part
def _read_tile(scratch, quads, integers, count, tile):
    """Interpolate the velocity of each point, and its first moments about the point along x, y, z [m s-1 cells]."""
    nothing = lanes(0.0, 0.0, 0.0, 0.0)
    for q in range(count):
        t = integers[line.I_PLACE + q]
        wx0, wx1, wx2 = get(scratch, line.WX0, q), get(scratch, line.WX1, q), get(scratch, line.WX2, q)
        mx0, mx1, mx2 = get(scratch, line.MX0, q), get(scratch, line.MX1, q), get(scratch, line.MX2, q)
        mean = moment_x = moment_y = moment_z = nothing
        for k in range(3):
            layer = layer_x = layer_y = nothing
            for j in range(3):
                n0, n1, n2 = load(tile, t), load(tile, t + 4), load(tile, t + 8)
                row = multiply_add(wx0, n0, multiply_add(wx1, n1, multiply_add(wx2, n2, nothing)))
                row_x = multiply_add(mx0, n0, multiply_add(mx1, n1, multiply_add(mx2, n2, nothing)))
                wy = get(scratch, line.WY0 + j * BATCH, q)
                layer = multiply_add(wy, row, layer)
                layer_x = multiply_add(wy, row_x, layer_x)
                layer_y = multiply_add(get(scratch, line.MY0 + j * BATCH, q), row, layer_y)
                t += TILE_ROW
            wz = get(scratch, line.WZ0 + k * BATCH, q)
            mean = multiply_add(wz, layer, mean)
            moment_x = multiply_add(wz, layer_x, moment_x)
            moment_y = multiply_add(wz, layer_y, moment_y)
            moment_z = multiply_add(get(scratch, line.MZ0 + k * BATCH, q), layer, moment_z)
            t += TILE_LAYER - 3 * TILE_ROW
        store(quads, line.Q_MEAN + 4 * q, mean)
        store(quads, line.Q_MOMENT_X + 4 * q, moment_x)
        store(quads, line.Q_MOMENT_Y + 4 * q, moment_y)
        store(quads, line.Q_MOMENT_Z + 4 * q, moment_z)


@kernel_part
def _transpose_quads(scratch, quads, count):
    """Transpose groups of four into lines: velocity and its first moments; beyond `count` those of the last point."""
    for q in range(count, BATCH):
        for group in range(4):
            store(quads, group * QUAD + 4 * q, load(quads, group * QUAD + 4 * (count - 1)))
    for q in range(0, BATCH, 4):
        near = _transpose_quad(scratch, quads, line.Q_MEAN + 4 * q, line.U + q)
        store(scratch, line.NEAR + q, near)
        _transpose_quad(scratch, quads, line.Q_MOMENT_X + 4 * q, line.XX + q)
        _transpose_quad(scratch, quads, line.Q_MOMENT_Y + 4 * q, line.XY + q)
        _transpose_quad(scratch, quads, line.Q_MOMENT_Z + 4 * q, line.XZ + q)


@kernel_part
def _transpose_quad(scratch, quads, group, target):
    """Write the first three entries of four groups to three lines; return the fourth entries."""
    a, b, c, d = transposed(load(quads, group), load(quads, group + 4), load(quads, group + 8), load(quads, group + 12))
    store(scratch, target, a)
    store(scratch, target + BATCH, b)
    store(scratch, target + 2 * BATCH, c)
    return d


def _state_of(scratch, q):
    """Return the eight numbers of state of a point of the batch."""
    return (
        get(scratch, line.S0, q),
        get(scratch, line.S1, q),
        get(scratch, line.S2, q),
        get(scratch, line.S3, q),
        get(scratch, line.S4, q),
        get(scratch, line.S5, q),
        get(scratch, line.S6, q),
        get(scratch, line.S7, q),
    )


def _gradient_of(scratch, q, g):
    """Return the gradient of the step of a point of the batch; `g` times the moments of the velocity."""
    return (
        g * get(scratch, line.XX, q),
        g * get(scratch, line.XY, q),
        g * get(scratch, line.XZ, q),
        g * get(scratch, line.YX, q),
        g * get(scratch, line.YY, q),
        g * get(scratch, line.YZ, q),
        g * get(scratch, line.ZX, q),
        g * get(scratch, line.ZY, q),
        g * get(scratch, line.ZZ, q),
    )


def _put_stress(scratch, q, stress):
    """Write six numbers to the lines of the stress, which hold the deviator of the strain before."""
    xx, yy, zz, xy, xz, yz = stress
    put(scratch, line.TXX, q, xx)
    put(scratch, line.TYY, q, yy)
    put(scratch, line.TZZ, q, zz)
    put(scratch, line.TXY, q, xy)
    put(scratch, line.TXZ, q, xz)
    put(scratch, line.TYZ, q, yz)


def _put_tensor(scratch, q, x):
    """Write six numbers to the first lines of the new state."""
    xx, yy, zz, xy, xz, yz = x
    put(scratch, line.N0, q, xx)
    put(scratch, line.N1, q, yy)
    put(scratch, line.N2, q, zz)
    put(scratch, line.N3, q, xy)
    put(scratch, line.N4, q, xz)
    put(scratch, line.N5, q, yz)


def _strain_fluid(scratch, factors, material):
    """Compute state and stress of each point of a fluid after the step."""
    dt = factors.dt
    g = factors.gradient * dt
    for q in range(BATCH):
        s0, s1, s2 = get(scratch, line.S0, q), get(scratch, line.S1, q), get(scratch, line.S2, q)
        volume, supplied, stress, code = fluid_step(material, s0, s1, s2, _gradient_of(scratch, q, g), dt)
        put(scratch, line.N0, q, volume)
        put(scratch, line.N1, q, s1)
        put(scratch, line.N2, q, supplied)
        put(scratch, line.N3, q, get(scratch, line.S3, q))
        _put_stress(scratch, q, stress)
        put(scratch, line.CODE, q, code)


def _stretch(scratch, factors):
    """Compute the trial strain of each point after the step (`solid_material.trial_strain`)."""
    g = factors.gradient * factors.dt
    for q in range(BATCH):
        s0, s1, s2, s3, s4, s5, _, _ = _state_of(scratch, q)
        x, trace, deviator, norm, near = trial_strain((s0, s1, s2, s3, s4, s5), _gradient_of(scratch, q, g))
        _put_tensor(scratch, q, x)
        _put_stress(scratch, q, deviator)
        put(scratch, line.TRACE, q, trace)
        put(scratch, line.NORM, q, norm)
        put(scratch, line.CODE, q, ORDINARY if near else FAR_CODE)


def _find_cones(scratch, material, softening):
    """Compute the cone of each point (`solid_material.cone_of`), each form of softening in a loop of its own."""
    if softening.kind == EXPONENTIAL:
        for q in range(BATCH):
            slope, strength = exponential_cone(softening, get(scratch, line.S6, q))
            put(scratch, line.SLOPE, q, slope)
            put(scratch, line.STRENGTH, q, strength)
    elif softening.kind == TANGENT:
        for q in range(BATCH):
            slope, strength = tangent_cone(softening, get(scratch, line.S6, q))
            put(scratch, line.SLOPE, q, slope)
            put(scratch, line.STRENGTH, q, strength)
    elif softening.kind == LINEAR:
        for q in range(BATCH):
            slope, strength = linear_cone(softening, get(scratch, line.S6, q))
            put(scratch, line.SLOPE, q, slope)
            put(scratch, line.STRENGTH, q, strength)
    else:
        for q in range(BATCH):
            put(scratch, line.SLOPE, q, material.slope)
            put(scratch, line.STRENGTH, q, material.strength)


def _strain_of(scratch, q):
    """Return cone, trace, norm, e_d and v_c of a point of the batch."""
    cone = get(scratch, line.SLOPE, q), get(scratch, line.STRENGTH, q)
    trace, norm = get(scratch, line.TRACE, q), get(scratch, line.NORM, q)
    return cone, trace, norm, get(scratch, line.S6, q), get(scratch, line.S7, q)


def _put_returned(scratch, q, returned):
    """Write what the law of a material returns."""
    trace, kept, plastic_strain, opening, code, yields = returned
    put(scratch, line.TRACE, q, trace)
    put(scratch, line.KEPT, q, kept)
    put(scratch, line.N6, q, plastic_strain)
    put(scratch, line.N7, q, opening)
    put(scratch, line.YIELDS, q, 1.0 if yields else 0.0)
    put(scratch, line.CODE, q, max(get(scratch, line.CODE, q), code))  # FAR is the largest


def _return_strain(scratch, dt, material):
    """Reduce the trial strain of each point to what is elastic, each kind of material in a loop of its own."""
    if material.kind == DRUCKER_PRAGER:
        for q in range(BATCH):
            cone, trace, norm, plastic_strain, opening = _strain_of(scratch, q)
            returned = returned_drucker_prager(material, cone, trace, norm, plastic_strain, opening, dt)
            _put_returned(scratch, q, returned)
    elif material.kind == MU_I:
        for q in range(BATCH):
            cone, trace, norm, plastic_strain, opening = _strain_of(scratch, q)
            _put_returned(scratch, q, returned_mu_i(material, cone, trace, norm, plastic_strain, opening, dt))
    elif material.kind == COHESIVE_MU_I:
        for q in range(BATCH):
            cone, trace, norm, plastic_strain, opening = _strain_of(scratch, q)
            returned = returned_cohesive_mu_i(material, cone, trace, norm, plastic_strain, opening, dt)
            _put_returned(scratch, q, returned)
    else:
        for q in range(BATCH):
            cone, trace, norm, plastic_strain, opening = _strain_of(scratch, q)
            _put_returned(scratch, q, returned_elastic(material, cone, trace, norm, plastic_strain, opening, dt))


def _deviator_of(scratch, q):
    """Return the deviator of the strain of a point of the batch."""
    return (
        get(scratch, line.TXX, q),
        get(scratch, line.TYY, q),
        get(scratch, line.TZZ, q),
        get(scratch, line.TXY, q),
        get(scratch, line.TXZ, q),
        get(scratch, line.TYZ, q),
    )


def _load(scratch, material):
    """Compute the stress of each point of an elastic material."""
    for q in range(BATCH):
        _put_stress(scratch, q, stress_of_strain(material, get(scratch, line.TRACE, q), _deviator_of(scratch, q)))


def _unload(scratch, material):
    """Compute the stress of each point from its elastic strain, and the state b - I of those that yield."""
    for q in range(BATCH):
        trace, (dxx, dyy, dzz, dxy, dxz, dyz) = get(scratch, line.TRACE, q), _deviator_of(scratch, q)
        kept, yields = get(scratch, line.KEPT, q), get(scratch, line.YIELDS, q) > 0.0
        deviator = kept * dxx, kept * dyy, kept * dzz, kept * dxy, kept * dxz, kept * dyz
        fxx, fyy, fzz, fxy, fxz, fyz = state_of_strain(trace, deviator)
        xxx, xyy, xzz = get(scratch, line.N0, q), get(scratch, line.N1, q), get(scratch, line.N2, q)
        xxy, xxz, xyz = get(scratch, line.N3, q), get(scratch, line.N4, q), get(scratch, line.N5, q)
        x = (
            fxx if yields else xxx,
            fyy if yields else xyy,
            fzz if yields else xzz,
            fxy if yields else xxy,
            fxz if yields else xxz,
            fyz if yields else xyz,
        )
        _put_tensor(scratch, q, x)
        _put_stress(scratch, q, stress_of_strain(material, trace, deviator))


@kernel_part
def _strain(scratch, factors, material, softening):
    """Compute state and stress of each point after the step.

    It is `material_choice.stress_step` part by part, each in a loop over the batch that the compiler vectorises: 12 ns
    instead of 130 for Drucker-Prager (measured 2026-11-21).
    """
    if material.kind == FLUID:
        _strain_fluid(scratch, factors, material)
    else:
        _stretch(scratch, factors)
        if material.kind == DRUCKER_PRAGER or material.kind == COHESIVE_MU_I:
            _find_cones(scratch, material, softening)
        _return_strain(scratch, factors.dt, material)
        if material.kind == ELASTIC:
            _load(scratch, material)
        else:
            _unload(scratch, material)


@kernel_part
def _strain_far(scratch, count, factors, material, softening, report):
    """Compute state and stress of points whose strain is too large for the series, one by one; report their number."""
    dt = factors.dt
    g, far = factors.gradient * dt, 0
    for q in range(count):
        far += get(scratch, line.CODE, q) == FAR_CODE
    if far == 0:
        return
    report[entry.FAR] += far
    for q in range(count):
        if scratch[line.CODE + q] == FAR_CODE:
            state, gradient = _state_of(scratch, q), _gradient_of(scratch, q, g)
            state, stress, code = stress_step_far(material, softening, state, gradient, dt)
            for k in range(8):
                scratch[line.N0 + k * BATCH + q] = state[k]
            _put_stress(scratch, q, stress)
            report[entry.HELD_STRETCH] += code == FAR_CODE


@kernel_part
def _keep_rotation(scratch):
    """Keep only the antisymmetric part of the first moments of the velocity."""
    for q in range(BATCH):
        xy, yx = get(scratch, line.XY, q), get(scratch, line.YX, q)
        xz, zx = get(scratch, line.XZ, q), get(scratch, line.ZX, q)
        yz, zy = get(scratch, line.YZ, q), get(scratch, line.ZY, q)
        put(scratch, line.XX, q, 0.0)
        put(scratch, line.YY, q, 0.0)
        put(scratch, line.ZZ, q, 0.0)
        put(scratch, line.XY, q, 0.5 * (xy - yx))
        put(scratch, line.YX, q, 0.5 * (yx - xy))
        put(scratch, line.XZ, q, 0.5 * (xz - zx))
        put(scratch, line.ZX, q, 0.5 * (zx - xz))
        put(scratch, line.YZ, q, 0.5 * (yz - zy))
        put(scratch, line.ZY, q, 0.5 * (zy - yz))


@kernel_part
def _move(scratch, count, factors):
    """Compute place, momentum and affine momentum after the step, as lines of a row.

    A = dx (m C - next_dt V0 (4 / dx^2) tau): a node i cells away gets w A i in addition to the momentum of the point.
    """
    turn, step, push = factors.gradient, factors.shift, factors.push
    for q in range(BATCH):
        mass = get(scratch, line.MASS, q)
        u, v, w = get(scratch, line.U, q), get(scratch, line.V, q), get(scratch, line.W, q)
        cxx, cxy, cxz = get(scratch, line.XX, q), get(scratch, line.XY, q), get(scratch, line.XZ, q)
        cyx, cyy, cyz = get(scratch, line.YX, q), get(scratch, line.YY, q), get(scratch, line.YZ, q)
        czx, czy, czz = get(scratch, line.ZX, q), get(scratch, line.ZY, q), get(scratch, line.ZZ, q)
        shear2 = cxx * cxx + cxy * cxy + cxz * cxz + cyx * cyx + cyy * cyy + cyz * cyz + czx * czx
        shear2 += czy * czy + czz * czz
        put(scratch, line.AFFINE2, q, 4.0 * shear2)
        shear2 *= turn * turn
        speed2 = u * u + v * v + w * w
        put(scratch, line.SPEED2, q, speed2)
        put(scratch, line.SHEAR_MOST, q, max(get(scratch, line.SHEAR_MOST, q), shear2))
        put(scratch, line.SPEED_MOST, q, max(get(scratch, line.SPEED_MOST, q), speed2))
        torn = 1.0 if (get(scratch, line.CODE, q) == TIP_CODE) & (q < count) else 0.0
        put(scratch, line.TORN, q, get(scratch, line.TORN, q) + torn)
        x, y, z = get(scratch, line.X, q), get(scratch, line.Y, q), get(scratch, line.Z, q)
        put(scratch, line.FX, q, x)
        put(scratch, line.FY, q, y)
        put(scratch, line.FZ, q, z)
        put(scratch, line.X, q, x + step * u)
        put(scratch, line.Y, q, y + step * v)
        put(scratch, line.Z, q, z + step * w)
        put(scratch, line.PX, q, mass * u)
        put(scratch, line.PY, q, mass * v)
        put(scratch, line.PZ, q, mass * w)
        pushed, carried = push * mass, 4.0 * mass
        txy, txz = pushed * get(scratch, line.TXY, q), pushed * get(scratch, line.TXZ, q)
        tyz = pushed * get(scratch, line.TYZ, q)
        put(scratch, line.AXX, q, carried * cxx - pushed * get(scratch, line.TXX, q))
        put(scratch, line.AYX, q, carried * cyx - txy)
        put(scratch, line.AZX, q, carried * czx - txz)
        put(scratch, line.AXY, q, carried * cxy - txy)
        put(scratch, line.AYY, q, carried * cyy - pushed * get(scratch, line.TYY, q))
        put(scratch, line.AZY, q, carried * czy - tyz)
        put(scratch, line.AXZ, q, carried * cxz - txz)
        put(scratch, line.AYZ, q, carried * cyz - tyz)
        put(scratch, line.AZZ, q, carried * czz - pushed * get(scratch, line.TZZ, q))


@kernel_part
def _yield_work(scratch, count):
    """Add the plastic work q de_d per volume, times the density: q = sqrt(3/2) |dev tau|, e_d is in the state."""
    for q in range(BATCH):
        txx, tyy, tzz = get(scratch, line.TXX, q), get(scratch, line.TYY, q), get(scratch, line.TZZ, q)
        txy, txz, tyz = get(scratch, line.TXY, q), get(scratch, line.TXZ, q), get(scratch, line.TYZ, q)
        mean = (txx + tyy + tzz) * THIRD
        square = (txx - mean) * (txx - mean) + (tyy - mean) * (tyy - mean) + (tzz - mean) * (tzz - mean)
        square += 2.0 * (txy * txy + txz * txz + tyz * tyz)
        mass = get(scratch, line.MASS, q) if q < count else 0.0
        work = mass * sqrt(1.5 * square) * (get(scratch, line.N6, q) - get(scratch, line.S6, q))
        put(scratch, line.YIELDED, q, get(scratch, line.YIELDED, q) + work)


# the loops too are inlined into `_strain`: it takes 31 numbers of laws once a batch, which saves a tenth of the step
for _part in (
    *(_state_of, _gradient_of, _put_stress, _put_tensor, _strain_of, _put_returned, _deviator_of),
    *(_strain_fluid, _stretch, _find_cones, _return_strain, _load, _unload),
):
    law_function(_part)


@jit_borrowing
def _advance_blocks(points, blocks, nodes, surface, part, settings, dt, next_dt, laws, work, report):
    """Apply `grid_to_points` to active blocks `part` = (first, end); `work` = (scratch, quads, integers)."""
    scratch, quads, integers = work
    rows, order, start = points.rows, points.order, points.start
    material, softening, transfer = laws
    dx, real = settings.dx, scratch.dtype.type
    factors = StepFactors(
        real(4.0 / dx),
        real(dt),
        real(dt / dx),
        real(next_dt * 4.0 / (dx * settings.density)),
        real(THIN * settings.density * dx * dx * dx),
        real((STILL * settings.signal_speed) ** 2),
    )
    for a in range(part[0], part[1]):
        tile, block = blocks.tiles[a], blocks.places[a]
        column, row, level = block[0], block[1], block[2]
        _read_nodes(tile, nodes, blocks.targets[a])
        west, south = GHOSTS - BLOCK * column, GHOSTS - BLOCK * row
        edges = Edges(real(west), real(south), real(west + settings.cells_x), real(south + settings.cells_y))
        deepest = real(deepest_level(surface.ground, block, dx))
        widen_window(report, row, column, level - surface.lowest[row, column, 0] + surface.lowest[row, column, 1])
        for first in range(start[a], start[a + 1], BATCH):
            count = min(BATCH, start[a + 1] - first)
            take_rows(rows, order, first, count, scratch)
            weigh(scratch, integers)
            _weigh_moments(scratch)
            _read_tile(scratch, quads, integers, count, tile)
            _transpose_quads(scratch, quads, count)
            _strain(scratch, factors, material, softening)
            _strain_far(scratch, count, factors, material, softening, report)
            if transfer == TURNING_GRADIENT:
                _keep_rotation(scratch)
            _move(scratch, count, factors)
            limit_thin(scratch, quads, integers, count, tile, block, edges, surface.ground, settings, factors, report)
            if rows.shape[1] > S4:
                _yield_work(scratch, count)
            if settings.wall:
                report[entry.HELD_WALL] += keep_inside(scratch, count, edges)
            if not all_inside(scratch, integers, edges) or settings.holes:
                book_out(scratch, integers, count, block, surface.inside, edges, settings, report)
            find_blocks(scratch, integers)
            give_keys(scratch, integers, points, first, count, block, surface, deepest, settings, report)
            give_rows(rows, order, first, count, scratch)


@jit_parallel
def grid_to_points(
    points: SortedPoints,
    blocks: ActiveBlocks,
    nodes: np.ndarray,
    surface: Surface,
    reports: np.ndarray,
    settings: Settings,
    dt: float,
    next_dt: float,
    material: Material,
    softening: Softening,
    transfer: int,
) -> None:
    """Interpolate the velocity field, move the points, strain them and compute the stress of the next step.

    APIC: v_p = sum w_i v_i, C_p = 4/dx^2 sum w_i v_i (x_i - x_p)^T (Jiang et al. 2015); the deformation follows C.
    In thin sheets and at free surfaces a limited C is carried on where the nodes' velocities are not linear.
    Points that leave over an edge or into a cell without elevation are recorded and removed.

    Parameters
    ----------
    points : SortedPoints
    blocks : ActiveBlocks
    nodes : float[touched, BLOCK_SIZE]
        Velocities and masses.
    surface : Surface
    reports : float64[CHUNKS, REPORT]
        Is set.
    settings : Settings
    dt, next_dt : float [s]
        Length of this step and of the next one.
    material : Material
    softening : Softening
        Both in the precision of the rows.
    transfer : int
        A constant of `affine_transfer`.
    """
    for c in prange(CHUNKS):
        report = reports[c]
        report[:] = 0.0
        report[entry.BLOCK_WEST] = report[entry.BLOCK_SOUTH] = NO_WINDOW
        report[entry.BLOCK_EAST] = report[entry.BLOCK_NORTH] = report[entry.BLOCK_TALL] = -1
        scratch, quads = np.zeros(LINES, points.rows.dtype), np.zeros(QUADS, points.rows.dtype)
        work = scratch, quads, np.zeros(INTEGERS, np.int32)
        part = points.bounds[c], points.bounds[c + 1]
        laws = material, softening, transfer
        _advance_blocks(points, blocks, nodes, surface, part, settings, dt, next_dt, laws, work, report)
        for q in range(BATCH):
            report[entry.SHEAR_MAX] = max(report[entry.SHEAR_MAX], scratch[line.SHEAR_MOST + q])
            report[entry.SPEED2_MAX] = max(report[entry.SPEED2_MAX], scratch[line.SPEED_MOST + q])
            report[entry.AT_TIP] += scratch[line.TORN + q]
            report[entry.PLASTIC] += scratch[line.YIELDED + q] / settings.density
