"""Types of the arguments of every kernel of the 3D solver on a device, to compile them without one.

Each kernel contains all laws, which it chooses from by number.
"""

import numba
import numpy as np
from numba import types

from mpmgis.laws import effect_slots
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager
from mpmgis.laws.softening import Softening
from mpmgis.solvers.gpu import (
    device_barriers,
    device_grid_to_points,
    device_point_density,
    device_point_nodes,
    device_point_reports,
    device_point_sort,
    device_points_to_grid,
    rare_points,
)
from mpmgis.solvers.gpu.device_functions import Kernel
from mpmgis.solvers.gpu.device_point_steps import Domain
from mpmgis.solvers.gpu.device_records import MotionLaws, PointMap, PointsInBlocks, RarePoints, TouchedBlocks
from mpmgis.solvers.gpu.rare_points import _between
from mpmgis.solvers.points.point_ground import Ground
from mpmgis.solvers.points.point_records import ColumnSums, ContactLaws, FaceArrays, Site
from mpmgis.solvers.points.point_rows import Settings, Surface

SETTINGS = Settings(
    dx=1.0,
    density=1000.0,
    gravity=9.81,
    cfl=0.4,
    signal_speed=100.0,
    viscous_limit=1.0,
    fixed_dt=0.0,
    clearance=0.5,
    cells_x=10,
    cells_y=10,
    leak_stop=1e-3,
    wall=False,
    holes=False,
    keep_peaks=True,
    arrival_thickness=0.05,
    lone_thickness=0.1,
    density_band=0.05,
    slack=1.0,
)
MODULI = {"bulk_modulus": 6.7e6, "shear_modulus": 4e6}
# laws of any kind have these types
MATERIAL, SOFTENING = drucker_prager(**MODULI, friction_angle=35.0, cohesion=500.0), Softening()
CONTACT = friction_law("Voellmy", 0.2, 300.0)


@Kernel
def within(out):
    """How a wall stops a point."""
    out[0] = _between(out[0], out[1], out[2])


def array(kind, dimensions):
    """Type of a contiguous array."""
    return types.Array(kind, dimensions, "C")


def record(kind, *fields):
    """Type of a record `kind` with `fields` of these types."""
    return types.BaseTuple.from_types(fields, kind)


def blocks_and_site(number):
    """(types of TouchedBlocks, Ground, Site, ColumnSums, FaceArrays) of arrays of `number`."""
    i4, line, table, map_ = types.int32, array(number, 2), array(number, 3), array(types.int32, 3)
    blocks = record(TouchedBlocks, line, array(i4, 2), array(i4, 1), map_)
    faces = record(FaceArrays, line, table, array(number, 4))
    ground = table, map_, line
    return blocks, record(Ground, *ground), record(Site, *ground, table, table), record(ColumnSums, table, table), faces


def points_and_marks(number):
    """(types of PointsInBlocks, RarePoints) of arrays of `number`."""
    i4, byte = types.int32, array(types.uint8, 1)
    places = array(types.int64, 1), array(i4, 1), array(types.int64, 1), array(i4, 2), array(i4, 2)
    return record(PointsInBlocks, array(number, 2), *places), record(
        RarePoints, byte, byte, array(number, 2), array(i4, 2)
    )


def in_precision(law, real):
    """Type of `law` with parameters of `real`."""
    return numba.typeof(effect_slots.in_precision(law, real))


def signatures(real):
    """(name, kernel, types of its arguments) of all kernels for points of `real`."""
    yield from _without_laws(real)
    yield from _with_laws(real)


def _without_laws(real):
    """Signatures of kernels that call neither contact laws nor materials."""
    number = numba.from_dtype(np.dtype(real))
    i4, i8, f8, byte = types.int32, types.int64, types.float64, types.uint8
    run, stage, now, clock, counts = array(i8, 1), array(f8, 1), array(number, 1), array(f8, 1), array(i8, 1)
    rows, keys, order, start = array(number, 2), array(i8, 1), array(i4, 1), array(i8, 1)
    window, pieces, lowest, ids = array(i4, 1), array(i8, 2), array(i4, 3), array(types.uint64, 1)
    touched, sources, nodes, tiles = array(i4, 2), array(i4, 2), array(number, 2), array(number, 2)
    free = array(byte, 1)
    blocks, ground, site, _, faces = blocks_and_site(number)
    points, rare = points_and_marks(number)
    columns, reports, sums, yields = array(number, 3), array(number, 2), array(f8, 2), array(number, 4)
    settings, of_nodes, cells = numba.typeof(SETTINGS), in_precision(SETTINGS, real), array(byte, 1)
    for name, *arguments in (
        ("begin_step", run, stage, now, clock, counts),
        ("clear_window", run, window, window),
        ("count_points", run, counts, rows, keys, window, cells),
        ("sum_pieces", run, window, pieces),
        ("scan_pieces", run, pieces, types.boolean),
        ("rank_places", run, window, pieces, window, start),
        ("scatter_points", run, counts, keys, window, order),
        ("rank_points", run, start, order, cells, order, order),
        ("mark_touched", run, window, lowest, window),
        ("rank_touched", run, window, pieces, lowest, window, touched, sources),
        ("link_blocks", run, window, lowest, window, sources, sources, touched),
        ("decide_order", run, counts),
        ("take_strip", run, rows, ids, keys, order, rows, pieces, i8),
        ("give_strip", run, rows, ids, keys, rows, pieces, i8),
        ("note_order", run, counts, order),
    ):
        yield name, getattr(device_point_sort, name), arguments
    yield "points_to_grid", device_points_to_grid.points_to_grid, (run, rows, order, start, tiles)
    for name, *arguments in (
        ("gather_nodes", run, tiles, sources, nodes),
        ("weigh_contact", run, nodes, touched, ground, reports, of_nodes),
        ("spread_contact", run, reports, blocks, columns),
        ("clear_contact", run, touched, columns),
        ("move_nodes", run, now, nodes, of_nodes),
        ("find_contacts", run, nodes, touched, free, ground, columns, reports, of_nodes, types.boolean),
        ("finish_nodes", run, nodes, touched, free, ground, reports, of_nodes),
        ("note_peaks", run, now, blocks, columns, columns, of_nodes),
    ):
        yield name, getattr(device_point_nodes, name), arguments
    for name, *arguments in (
        ("share_face_rows", run, blocks, faces, of_nodes),
        ("weigh_face_rows", run, now, counts, blocks, site, faces, of_nodes),
        ("weigh_face_columns", run, now, counts, blocks, site, faces, yields, of_nodes),
        ("book_faces", run, counts, blocks, site, faces, yields, reports, reports, of_nodes),
        ("keep_before_faces", run, counts, rows, keys, lowest, array(byte, 2), reports, columns, sums, of_nodes),
        ("weigh_flow", run, nodes, reports),
        ("press_on_crests", run, touched, blocks, columns, reports, reports, of_nodes),
        ("sum_booked", run, reports, start, array(f8, 3)),
        ("collect_barriers", run, stage, array(f8, 3), sums),
    ):
        yield name, getattr(device_barriers, name), arguments
    yield "sum_node_reports", device_point_reports.sum_node_reports, (run, reports, sums)
    yield "sum_node_reports_again", device_point_reports.sum_node_reports, (run, sums, sums)
    yield "sum_point_reports", device_point_reports.sum_point_reports, (run, sums, sums)
    yield "choose_step", device_point_reports.choose_step, (run, stage, clock, counts, sums, array(number, 1), settings)
    finish = run, stage, clock, counts, sums, sums, rows, keys, lowest, settings
    yield "finish_step", device_point_reports.finish_step, finish
    surface, domain = record(Surface, columns, lowest, array(byte, 2)), numba.typeof(Domain(10, 10, False))
    yield "begin_reports", rare_points.begin_reports, (run, array(number, 2), array(i4, 2), sums, settings)
    arguments = run, points, surface, array(i8, 4), array(f8, 1), rare, sums, domain, settings
    yield "settle_rare_points", rare_points.settle_rare_points, arguments


def _with_laws(real):
    """Signatures of kernels that call contact laws, materials or what corrects volumes."""
    number = numba.from_dtype(np.dtype(real))
    run, now, counts, free = array(types.int64, 1), array(number, 1), array(types.int64, 1), array(types.uint8, 1)
    nodes, columns, reports, yields = array(number, 2), array(number, 3), array(number, 2), array(number, 4)
    blocks, ground, site, sums, faces = blocks_and_site(number)
    points, rare = points_and_marks(number)
    barred, domain, settings = array(types.int32, 2), numba.typeof(Domain(10, 10, False)), in_precision(SETTINGS, real)
    contact = settings, record(ContactLaws, in_precision(CONTACT, real), types.boolean, types.boolean)
    motion = record(MotionLaws, in_precision(MATERIAL, real), in_precision(SOFTENING, real), types.int64)
    below = record(PointMap, columns, array(types.int32, 3), array(types.uint8, 2))
    for kernel, *arguments in (
        (device_point_nodes.couple_layers, run, now, blocks, site, columns, columns, reports, *contact),
        (device_point_nodes.press_on_ground, run, now, counts, blocks, free, site, yields, reports, *contact),
        (device_point_nodes.hold_nodes, run, now, blocks, free, site, sums, reports, reports, *contact),
        (device_barriers.settle_faces, run, now, blocks, site, faces, *contact),
        (device_barriers.hold_at_barriers, run, now, barred, blocks, site, sums, reports, reports, *contact),
        (device_grid_to_points.grid_to_points, run, now, points, nodes, below, rare, domain, motion),
        (rare_points.move_rare_points, run, now, points, nodes, columns, rare, domain, settings, motion),
        (
            *(device_point_density.correct_density, run, counts, points, nodes, free, ground, yields),
            *(columns, reports, settings, types.boolean),
        ),
    ):
        yield kernel.function.__name__, kernel, arguments
