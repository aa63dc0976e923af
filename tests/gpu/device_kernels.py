"""Types of the arguments of every kernel of the 3D solver on a device, to compile them without one."""

import numba
import numpy as np
from numba import types

from mpmgis.effects.barrier import Barrier, NoBarrier
from mpmgis.effects.contact import CoulombContact, VoellmyContact
from mpmgis.effects.friction import NoZones
from mpmgis.effects.material import MuI, drucker_prager
from mpmgis.effects.slots import WholeGradient
from mpmgis.effects.softening import NoSoftening, softening
from mpmgis.gpu import (
    grid_to_points,
    point_barriers,
    point_nodes,
    point_reports,
    point_sort,
    points_to_grid,
    rare_points,
)
from mpmgis.gpu.compiled import Kernel
from mpmgis.gpu.point_steps import Domain
from mpmgis.gpu.rare_points import _between
from mpmgis.kernels.point_rows import Settings

SETTINGS = Settings(
    dx=1.0, density=1000.0, gravity=9.81, cfl=0.4, signal_speed=100.0, viscous_limit=1.0, fixed_dt=0.0, clearance=0.5,
    cells_x=10, cells_y=10, leak_stop=1e-3, wall=False, holes=False, keep_peaks=True, arrival_thickness=0.05,
    lone_thickness=0.1, slack=1.0,
)  # fmt: skip
SOIL = drucker_prager(6.7e6, 4e6, 35.0, 500.0)
MATERIALS = {
    "drucker_prager": (SOIL, NoSoftening()),
    "softening": (SOIL, softening((35.0, 500.0), (20.0, 0.0), 10.0)),
    "mu_i": (MuI(1e6, 1e6, 0.4, 0.6, 0.3, 1e-3, 2500.0, 1.0), NoSoftening()),
}
CONTACTS = {"coulomb": CoulombContact(0.3), "voellmy": VoellmyContact(0.2, 300.0)}


@Kernel
def within(out):
    """How a wall stops a point."""
    out[0] = _between(out[0], out[1], out[2])


def array(kind, dimensions):
    """Type of a contiguous array."""
    return types.Array(kind, dimensions, "C")


def in_precision(law, real):
    """Type of `law` with parameters of `real`."""
    return numba.typeof(type(law)(*(real(value) if isinstance(value, float) else value for value in law)))


def signatures(real):
    """(name, kernel, types of its arguments) of all kernels for points of `real`."""
    number = numba.from_dtype(np.dtype(real))
    i4, i8, f8, byte = types.int32, types.int64, types.float64, types.uint8
    run, stage, now, clock, counts = array(i8, 1), array(f8, 1), array(number, 1), array(f8, 1), array(i8, 1)
    rows, keys, order, start = array(number, 2), array(i8, 1), array(i4, 1), array(i8, 1)
    window, pieces, lowest, ids = array(i4, 1), array(i8, 2), array(i4, 3), array(types.uint64, 1)
    touched, sources, nodes, tiles = array(i4, 2), array(i4, 2), array(number, 2), array(number, 2)
    ground, free = (array(number, 3), array(i4, 3), array(number, 2)), array(byte, 1)
    columns, reports, sums, yields = array(number, 3), array(number, 2), array(f8, 2), array(number, 4)
    settings, of_nodes = numba.typeof(SETTINGS), in_precision(SETTINGS, real)
    places = (*ground, array(number, 3), array(number, 3))
    zones, barrier = in_precision(NoZones(), real), in_precision(NoBarrier(), real)
    for name, *arguments in (
        ("begin_step", run, stage, now, clock, counts),
        ("clear_window", run, window, window),
        ("count_points", run, counts, keys, window),
        ("sum_pieces", run, window, pieces),
        ("scan_pieces", run, pieces, types.boolean),
        ("rank_places", run, window, pieces, window, start),
        ("scatter_points", run, counts, keys, window, order),
        ("rank_points", run, start, order, order),
        ("mark_touched", run, window, lowest, window),
        ("rank_touched", run, window, pieces, lowest, array(byte, 2), window, touched, sources),
        ("link_blocks", run, window, lowest, window, sources, sources, touched),
        ("decide_order", run, counts),
        ("take_strip", run, rows, ids, keys, order, rows, pieces, i8),
        ("give_strip", run, rows, ids, keys, rows, pieces, i8),
        ("note_order", run, counts, order),
    ):
        yield name, getattr(point_sort, name), arguments
    yield "points_to_grid", points_to_grid.points_to_grid, (run, rows, order, start, tiles)
    for name, *arguments in (
        ("gather_nodes", run, tiles, sources, nodes),
        ("weigh_contact", run, nodes, touched, *ground, reports, of_nodes),
        ("spread_contact", run, reports, touched, window, lowest, columns),
        ("clear_contact", run, touched, columns),
        ("move_nodes", run, now, nodes, of_nodes),
        ("find_contacts", run, nodes, touched, free, *ground, columns, reports, of_nodes, barrier),
        ("finish_nodes", run, nodes, touched, free, *ground, reports, of_nodes),
        ("note_peaks", run, now, nodes, touched, window, lowest, ground[0], columns, of_nodes),
    ):
        yield name, getattr(point_nodes, name), arguments
    walled = in_precision(Barrier(), real)
    yield "find_contacts_barred", point_nodes.find_contacts, (
        run, nodes, touched, free, *ground, columns, reports, of_nodes, walled,
    )  # fmt: skip
    for label, barrier_type in (("", barrier), ("_barred", walled)):
        for name, law in CONTACTS.items():
            laws = of_nodes, in_precision(law, real), zones, barrier_type
            given = nodes, touched, window, lowest
            layers = "couple_layers", run, now, *given, *places, columns, columns, reports, *laws
            press = "press_on_ground", run, now, counts, *given, free, *places, yields, reports, *laws
            hold = "hold_nodes", run, now, nodes, touched, free, *places, columns, columns, reports, reports, *laws
            for kernel, *arguments in (layers, press, hold):
                yield f"{kernel}_{name}{label}", getattr(point_nodes, kernel), arguments
    for name, law in CONTACTS.items():
        laws = of_nodes, in_precision(law, real), zones, walled
        given = nodes, touched, window, lowest
        settle = "settle_faces", run, now, *given, *ground, columns, reports, columns, *laws
        hold = "hold_at_barriers", run, now, touched, *given, *places, columns, columns, reports, reports, *laws
        for kernel, *arguments in (settle, hold):
            yield f"{kernel}_{name}", getattr(point_barriers, kernel), arguments
    around, lines = (nodes, touched, window, lowest, *ground), (reports, columns)
    for name, *arguments in (
        ("share_face_rows", run, nodes, touched, window, lowest, *lines, of_nodes),
        ("weigh_face_rows", run, now, counts, *around, *lines, yields, of_nodes),
        ("weigh_face_columns", run, now, counts, *around, *lines, yields, of_nodes),
        ("book_faces", run, counts, *around, *lines, yields, yields, reports, reports, of_nodes),
        ("keep_before_faces", run, counts, rows, keys, lowest, array(byte, 2), reports, columns, sums, of_nodes),
        ("weigh_flow", run, nodes, reports),
        ("sum_booked", run, reports, start, array(f8, 3)),
        ("collect_barriers", run, stage, array(f8, 3), sums),
    ):
        yield name, getattr(point_barriers, name), arguments
    yield "sum_node_reports", point_reports.sum_node_reports, (run, reports, sums)
    yield "sum_node_reports_again", point_reports.sum_node_reports, (run, sums, sums)
    yield "sum_point_reports", point_reports.sum_point_reports, (run, sums, sums)
    yield "choose_step", point_reports.choose_step, (run, stage, clock, counts, sums, array(number, 1), settings)
    finish = run, stage, clock, counts, sums, sums, rows, keys, lowest, settings
    yield "finish_step", point_reports.finish_step, finish
    marks = array(byte, 1), array(byte, 1), array(number, 2), array(i4, 2)
    map_, domain = (lowest, array(byte, 2)), numba.typeof(Domain(10, 10, False))
    for label, (material, soft) in MATERIALS.items():
        laws = in_precision(material, real), in_precision(soft, real), in_precision(WholeGradient(), real)
        around, scales = (order, start, touched, sources, nodes), array(number, 1)
        arguments = run, scales, rows, keys, *around, array(number, 3), *map_, *marks, domain, *laws
        yield f"grid_to_points_{label}", grid_to_points.grid_to_points, arguments
        arguments = run, scales, rows, *around, ground[0], *marks, domain, of_nodes, *laws
        yield f"move_rare_points_{label}", rare_points.move_rare_points, arguments
    given, left = (rows, keys, order, start, touched), (array(i8, 4), array(f8, 1))
    arguments = run, *given, ground[0], *map_, *left, *marks, sums, domain, settings
    yield "settle_rare_points", rare_points.settle_rare_points, arguments
