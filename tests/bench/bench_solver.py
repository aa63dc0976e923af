"""The depth-averaged solver in nanoseconds per particle and step, against the same step in NumPy."""

import sys
import time
from pathlib import Path

import numpy as np
from numpy_step import numpy_step

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
from column_scenes import columns_of, solver_on, terrain_of

from mpmgis.compiled.block_order import STRIP
from mpmgis.compiled.jit import set_threads
from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.friction import friction_law

PROTOTYPE = {1: 40.0, 2: 24.0}  # plain friction, no curvature
BYTES = 3 * 12 * 8 + 20  # a row is read twice and written once; key and order
STEPS, REPEATS = 20, 5


def scene(per_side, dx=5.0, time_step=None):
    """A sheet of `per_side`^2 columns, 16 per cell, that slides down a rough slope."""
    size = per_side * dx / 4 + 400
    terrain = terrain_of(lambda x, y: 0.5 * (size - x) + 5 * np.sin(x / 50) * np.cos(y / 60), size, size, dx)
    frame = columns_of(2.0, 100, 100 + per_side * dx / 4, 100, 100 + per_side * dx / 4, dx / 4)
    return solver_on(terrain, frame, dx, friction_law("Voellmy", 0.2, 2000.0), curvature=CURVATURE, time_step=time_step)


def nanoseconds(solver):
    """Least ns per particle and step over the repeats, after a warm-up."""
    n = len(solver.frame().particles)
    solver.advance(1e9, max_steps=5)
    best = np.inf
    for _ in range(REPEATS):
        began = time.perf_counter()
        solver.advance(1e9, max_steps=STEPS)
        best = min(best, time.perf_counter() - began)
    return best / (STEPS * n) * 1e9


def numpy_nanoseconds(solver):
    """The same for the NumPy step, and the distance of its columns from those of the solver after three steps [m]."""
    p, grid, dt = solver.frame().particles, solver.grid, 0.05
    n = len(p)
    state = {
        "x": p.position[:, 0] - grid.x0,
        "y": p.position[:, 1] - grid.y0,
        "u": p.velocity[:, 0],
        "v": p.velocity[:, 1],
        "c": np.zeros((2, 2, n)),
        "mass": p.mass,
        "area": p.area,
        "kappa": np.zeros(n),
        "gradient": solver.arrays.rows[:, 10:12].T.copy(),
    }
    times = []
    floor = solver._settings.thickness_floor
    for kick in (0.5 * dt, dt, 1.5 * dt):  # as the solver does up to a frame
        began = time.perf_counter()
        numpy_step(state, grid.bed, grid.gradient, 5.0, dt, kick, 1000.0, 0.2, 2000.0, floor)
        times.append(time.perf_counter() - began)
    return min(times) / n * 1e9, state


def copy_rate():
    """Rate of a large copy [bytes per second], read and written."""
    a = np.ones(40_000_000)
    b = np.empty_like(a)
    best = np.inf
    for _ in range(3):
        began = time.perf_counter()
        np.copyto(b, a)
        best = min(best, time.perf_counter() - began)
    return 2 * a.nbytes / best


def rows():
    """Rows of the table."""
    reference_solver = scene(500, time_step=0.05)
    reference, state = numpy_nanoseconds(reference_solver)
    reference_solver.advance(0.15)
    p = reference_solver.frame().particles
    order = np.argsort(p.id)
    apart = np.abs(p.position[order, 0] - reference_solver.grid.x0 - state["x"]).max()
    name = "the same step in NumPy (1 thread)"
    agreement = f"{apart:.0e} m from the solver after 3 steps"
    yield "step in NumPy, 250,000 columns", reference, "ns/particle/step", agreement, None
    for threads in (1, 2):
        used = set_threads(threads)
        for per_side in (160, 500, 1000):
            measured = nanoseconds(scene(per_side))
            case = f"solver, {per_side**2:,} columns, {used} thread{'s' * (used > 1)}"
            yield case, measured, "ns/particle/step", name, measured / reference
            if per_side == 1000:
                published = f"prototype, {PROTOTYPE[threads]:.0f} ns"
                yield case, measured, "ns/particle/step", published, measured / PROTOTYPE[threads]
    set_threads(None)
    floor = BYTES / copy_rate() * 1e9
    yield "memory floor of a step", floor, "ns/particle/step", f"{BYTES} bytes at this machine's copy rate", None
    solver = scene(1000)
    now = solver.arrays
    used = sum(a.nbytes for a in (now.rows, now.ids, now.keys, solver._order)) + 1e6 * 8 * (STRIP + 2)
    yield "solver memory, grid apart", used / 1e6, "bytes/particle", "300 bytes required", used / 1e6 / 300
