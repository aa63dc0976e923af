"""Runs of `DevicePointSolver` in the simulator, compared with `PointSolver`; `test_device_solver.py` runs it.

Prints JSON: largest differences by name; `same_bits` by name.
"""

import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import shapely

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[2]), str(HERE.parents[1] / "bench")]

from compared_runs import after, continued, difference  # noqa: E402
from gpu import slab  # noqa: E402

from mpmgis.laws.effect_slots import PointEffects  # noqa: E402
from mpmgis.laws.friction import friction_law  # noqa: E402
from mpmgis.laws.material import drucker_prager  # noqa: E402
from mpmgis.solvers.features.walls import Wall  # noqa: E402
from mpmgis.solvers.gpu.device_point_solver import DevicePointSolver  # noqa: E402
from mpmgis.solvers.points.point_numerics import PointNumerics  # noqa: E402
from mpmgis.solvers.points.point_solver import PointSolver  # noqa: E402

POINTS = 32
EFFECTS = PointEffects(drucker_prager(6.7e6, 4e6, 35.0, 500.0), contact=friction_law("Coulomb", 0.4))
FIRST, END = 0.008, 0.016  # [s], of frames
KINDS = PointSolver, DevicePointSolver


def made(kind, walls=(), empty=False):
    """A solver of `kind` with a small slab that has stress from the start; with `walls` it moves into them."""
    terrain, frame = slab(POINTS)
    stress = np.tile([-1e3, -1e3, -2e3, 0.0, 0.0, 0.0], (len(frame.particles), 1))
    if walls:
        frame.particles.velocity[:, 0] = 5.0
    if empty:
        frame, stress = replace(frame, particles=frame.particles.take([])), None
    effects = EFFECTS._replace(barrier=True) if walls else EFFECTS
    return kind(frame, terrain, effects, PointNumerics(1.0, density=2000.0, maxima=True), stress, walls=walls)


def dam(west=9.2, mu=0.4):
    """A wall before the slab, which has faces."""
    return (Wall("dam", shapely.box(west, -50.0, west + 4.0, 80.0), height=20.0, mu=mu),)


def values(solver):
    """All that a frame of the solver holds, by name, and its energy; points in the order of their ids."""
    frame = solver.frame()
    particles = frame.particles.take(np.argsort(frame.particles.id))
    sums = {"energy": np.array(solver.energy()), "clock": np.array([solver.time, solver.step, solver.speed_max])}
    at_walls = {name: frame.state[name] for name in ("barriers", "face_yields") if name in frame.state}
    return particles.arrays() | frame.maxima | {"yields": frame.state["yields"]} | at_walls | sums


def main():
    """All runs."""
    smaller, begun_empty = [], []
    for kind in KINDS:
        solver = after(made(kind), FIRST)
        solver.share_step(0.5)
        smaller.append(values(after(solver, END)))
        begun_empty.append(values(filled(kind)))
    found, same_bits = continued(made, values, KINDS, FIRST, END)
    at_walls, same_bits_at_walls = continued(partial(made, walls=dam()), values, KINDS, FIRST, END)
    found |= {f"{name}_with_a_barrier": value for name, value in at_walls.items()}
    found |= {
        "with_half_the_step": difference(*reversed(smaller)),
        "inserted": inserted(),
        "inserted_into_no_points": difference(*reversed(begun_empty)),
        "same_bits_after_resuming": same_bits,
        "same_bits_with_a_barrier": same_bits_at_walls,
        "load": float(values(after(made(DevicePointSolver, dam()), FIRST, END))["barriers"][0, 0]),
    }
    print(json.dumps(found))


def filled(kind):
    """A solver of `kind` at END that begins without points; the slab comes at FIRST."""
    solver = made(kind, empty=True)
    solver.advance(FIRST, END)
    solver.wait(FIRST)
    solver.insert(slab(POINTS)[1])
    return after(solver, END)


def inserted():
    """Largest difference after the points are inserted once more during the run."""
    found = []
    for kind in KINDS:
        solver = after(made(kind), FIRST)
        more = slab(POINTS)[1]
        more.particles.position[:, 0] += 4.0
        more.particles.position[:, 2] -= 2.0
        more.particles.id[:] += 1000
        solver.insert(more)
        found.append(values(after(solver, END)))
    return difference(*reversed(found))


if __name__ == "__main__":
    main()
