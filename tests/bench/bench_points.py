"""The 3D solver in nanoseconds per point and step, against its plain reference implementation, compiled."""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
import plain_points
from column_scenes import terrain_of
from point_scenes import block_of, points_on

from mpmgis.compiled.block_order import STRIP
from mpmgis.compiled.jit import set_threads
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager, fluid
from mpmgis.laws.material_choice import wave_speed
from mpmgis.laws.softening import Softening, softening
from mpmgis.solvers.points.point_rows import BLOCK_SIZE, TILE_SIZE

WANTED = {"float64": 60.0, "float32": 35.0}  # ns on 2 threads, required
PROTOTYPE = {"float64": 48.0, "float32": 29.0}
STEPS, REPEATS = 10, 4
PEAKED = {"25 cells deep": {}, "3 cells deep": {"long": 160, "wide": 160, "high": 6}}
SLOPE = 0.5
SOIL = drucker_prager(6.7e6, 4e6, 35.0, 500.0)
MATERIALS = {
    "Drucker-Prager": (SOIL, None),
    "Drucker-Prager with softening": (SOIL, softening((35.0, 500.0), (20.0, 0.0), 10.0)),
    "fluid": (fluid(7.1e6, 0.0, 0.0), None),
}


def scene(material, soft=None, long=100, wide=100, high=50, size=(160.0, 100.0), precision="float64", maxima=False):
    """A slab of long x wide x high points, 8 per cell of 1 m, that slides down a plane."""
    terrain = terrain_of(lambda x, y: SLOPE * (size[0] - x), *size, 10.0)
    frame = block_of((long / 2, wide / 2, high / 2), 0.5, (10.0, 20.0, 0.0))
    place = frame.particles.position
    place[:, 2] += SLOPE * (size[0] - place[:, 0])
    return points_on(
        terrain, frame, 1.0, material, friction_law("Coulomb", 0.3), soft, precision=precision, maxima=maxima
    )


def nanoseconds(solver, points):
    """Least ns per point and step over the repeats, after a warm-up that compiles."""
    solver.advance(1e9, max_steps=5)
    best = np.inf
    for _ in range(REPEATS):
        began = time.perf_counter()
        solver.advance(1e9, max_steps=STEPS)
        best = min(best, time.perf_counter() - began)
    return best / (STEPS * points) * 1e9


def cost_of_maxima(precision, **size):
    """Least ns per point and step with maxima of every step, and its ratio to that without, in alternating repeats."""
    solvers = [scene(SOIL, None, precision=precision, maxima=maxima, **size) for maxima in (False, True)]
    least = np.full(2, np.inf)
    for turn in range(2 * REPEATS + 1):
        for k, solver in enumerate(solvers):
            began = time.perf_counter()
            solver.advance(1e9, max_steps=STEPS)
            if turn:
                least[k] = min(least[k], time.perf_counter() - began)
    return least[1] / (STEPS * solvers[1].particles) * 1e9, least[1] / least[0]


def plain_nanoseconds():
    """ns of the plain loop, compiled without changes, on one thread."""
    step = plain_points.compiled_step()
    solver = scene(SOIL, None, 40, 40, 20)
    p = solver.frame().particles
    place = p.position - solver._corner_from((0.0, 0.0, 0.0))
    n = len(place)
    nodes = np.zeros((int(place[:, 2].max()) + 14, *solver._ground.shape[:2], 4))
    state = place, p.velocity, np.zeros((n, 3, 3)), p.mass, np.zeros((n, 8)), np.zeros((n, 6))
    sound = wave_speed(SOIL, 1000.0)
    times, ground = [], solver._ground[..., :3].copy()
    yields = plain_points.yields_of(solver)
    for _ in range(3):
        began = time.perf_counter()
        step(*state, nodes, ground, yields, 1.0, 1e-3, 1000.0, 9.81, 0.3, SOIL, Softening(), sound)
        times.append(time.perf_counter() - began)
    return min(times) / n * 1e9


def memory(solver):
    """Bytes per point of the solver's arrays of points, of the buffers for sorting them, and of its tiles and nodes if
    blocks are full (512 points)."""
    now = solver.arrays
    arrays, real = (now.rows, now.ids, now.keys, solver._order), now.rows.itemsize
    blocks = (TILE_SIZE + 2 * BLOCK_SIZE) * real / 512
    return sum(array.nbytes for array in arrays) / solver.particles + STRIP * real + 2 * 8 + blocks


def rows():
    """Rows of the table."""
    reference, unit = plain_nanoseconds(), "ns/point/step"
    made = "compiled, 1 thread, float64; two thirds of its time is contact"
    yield "plain loop, 32,000 points, Drucker-Prager", reference, unit, made, None
    for precision, wanted in WANTED.items():
        for threads in (1, 2):
            used = set_threads(threads)
            for name, (material, soft) in MATERIALS.items():
                solver = scene(material, soft, precision=precision)
                measured = nanoseconds(solver, 500_000)
                case = f"{name}, {precision}, 500,000 points, {used} thread{'s' * (used > 1)}"
                yield case, measured, unit, "the plain loop (1 thread)", measured / reference
                if name == "Drucker-Prager" and used == 2:
                    yield case, measured, unit, f"{wanted:.0f} ns required", measured / wanted
                    prototype = PROTOTYPE[precision]
                    yield case, measured, unit, f"prototype, {prototype:.0f} ns", measured / prototype
                    wide = nanoseconds(scene(SOIL, size=(1600.0, 100.0), precision=precision), 500_000)
                    yield f"the same, {precision}, on a terrain ten times as long", wide, unit, case, wide / measured
        for words, size in PEAKED.items():
            measured, ratio = cost_of_maxima(precision, **size)
            case = f"maxima of every step, {words}, {precision}, 2 threads"
            yield case, measured, unit, "the same without; at most 1.1 required", ratio
        used = memory(scene(SOIL, None, 20, 20, 20, precision=precision))
        yield f"memory of the points, Drucker-Prager, {precision}", used, "bytes/point", "250 required", used / 250.0
