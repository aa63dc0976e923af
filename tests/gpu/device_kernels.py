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
    return numba.typeof(type(law)(*map(real, law)))


def signatures(real):
    """(name, kernel, types of its arguments) of all kernels for points of `real`."""
    number = numba.from_dtype(np.dtype(real))
    i4, i8, f8, byte = types.int32, types.int64, types.float64, types.uint8
    run, stage, clock, counts = array(i8, 1), array(f8, 1), array(f8, 1), array(i8, 1)
    rows, keys, order, start = array(number, 2), array(i8, 1), array(i4, 1), array(i8, 1)
    window, pieces, lowest, ids = array(i4, 1), array(i8, 2), array(i4, 3), array(types.uint64, 1)
    touched, sources, nodes, tiles = array(i4, 2), array(i4, 2), array(number, 2), array(number, 2)
    ground, free, columns, reports = (
        (array(f8, 3), array(i4, 3), array(f8, 2)),
        array(byte, 1),
        array(f8, 3),
        array(f8, 2),
    )
    settings, places = numba.typeof(SETTINGS), (*ground, array(f8, 3), array(f8, 3))
    zones, barrier = numba.typeof(NoZones()), numba.typeof(NoBarrier())
    for name, *arguments in (
        ("begin_step", run, stage, clock, counts),
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
        ("weigh_contact", run, nodes, touched, *ground, reports, settings),
        ("spread_contact", run, reports, touched, window, lowest, columns),
        ("clear_contact", run, touched, columns),
        ("move_nodes", run, stage, nodes, settings),
        ("find_contacts", run, nodes, touched, free, *ground, columns, reports, settings, barrier),
        ("finish_nodes", run, nodes, touched, free, *ground, reports, settings),
        ("note_peaks", run, stage, nodes, touched, window, lowest, ground[0], columns, settings),
    ):
        yield name, getattr(point_nodes, name), arguments
    walled = numba.typeof(Barrier())
    yield "find_contacts_barred", point_nodes.find_contacts, (
        run, nodes, touched, free, *ground, columns, reports, settings, walled,
    )  # fmt: skip
    for label, barrier_type in (("", barrier), ("_barred", walled)):
        for name, law in CONTACTS.items():
            laws = settings, numba.typeof(law), zones, barrier_type
            given = nodes, touched, window, lowest
            layers = "couple_layers", run, stage, *given, *places, columns, columns, reports, *laws
            press = "press_on_ground", run, stage, counts, *given, free, *places, array(f8, 4), reports, *laws
            hold = "hold_nodes", run, stage, nodes, touched, free, *places, columns, columns, reports, reports, *laws
            for kernel, *arguments in (layers, press, hold):
                yield f"{kernel}_{name}{label}", getattr(point_nodes, kernel), arguments
    for name, law in CONTACTS.items():
        laws = settings, numba.typeof(law), zones, walled
        given = nodes, touched, window, lowest
        settle = "settle_faces", run, stage, *given, *ground, array(f8, 3), reports, columns, *laws
        hold = "hold_at_barriers", run, stage, touched, *given, *places, columns, columns, reports, reports, *laws
        for kernel, *arguments in (settle, hold):
            yield f"{kernel}_{name}", getattr(point_barriers, kernel), arguments
    around, lines = (nodes, touched, window, lowest, *ground), (reports, columns)
    for name, *arguments in (
        ("weigh_face_rows", run, stage, counts, *around, *lines, array(f8, 4), settings),
        ("weigh_face_columns", run, stage, counts, *around, *lines, array(f8, 4), settings),
        ("book_faces", run, counts, *around, *lines, array(f8, 4), array(f8, 4), reports, reports, settings),
        ("weigh_flow", run, nodes, reports),
        ("sum_booked", run, reports, start, columns),
        ("collect_barriers", run, stage, columns, reports),
    ):
        yield name, getattr(point_barriers, name), arguments
    yield "sum_node_reports", point_reports.sum_node_reports, (run, reports, reports)
    yield "sum_point_reports", point_reports.sum_point_reports, (run, reports, reports)
    yield "choose_step", point_reports.choose_step, (run, stage, clock, counts, reports, array(number, 1), settings)
    finish = run, stage, clock, counts, reports, reports, rows, keys, lowest, settings
    yield "finish_step", point_reports.finish_step, finish
    for label, (material, soft) in MATERIALS.items():
        laws = in_precision(material, real), in_precision(soft, real), in_precision(WholeGradient(), real)
        given = run, array(number, 1), rows, keys, order, start, touched, sources, nodes
        marks = array(byte, 1), array(byte, 1), array(number, 2), array(i4, 2)
        map_, domain = (lowest, array(byte, 2)), numba.typeof(Domain(10, 10, False))
        arguments = *given, array(number, 3), *map_, *marks, domain, *laws
        yield f"grid_to_points_{label}", grid_to_points.grid_to_points, arguments
        arguments = *given, ground[0], *map_, array(i8, 4), array(f8, 1), *marks, reports, domain, settings, *laws
        yield f"move_rare_points_{label}", rare_points.move_rare_points, arguments
