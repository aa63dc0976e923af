"""Runs of `DevicePointSolver` in the simulator, compared with `PointSolver`; `test_device_solver.py` runs it.

Prints JSON: largest differences by name; `same_bits` by name.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[2]), str(HERE.parents[1] / "bench")]

from gpu import slab  # noqa: E402

from mpmgis.laws.contact_friction import coulomb_contact  # noqa: E402
from mpmgis.laws.effect_slots import PointEffects  # noqa: E402
from mpmgis.laws.material import drucker_prager  # noqa: E402
from mpmgis.solvers.features.walls import Wall  # noqa: E402
from mpmgis.solvers.gpu.device_point_solver import DevicePointSolver  # noqa: E402
from mpmgis.solvers.points.point_numerics import PointNumerics  # noqa: E402
from mpmgis.solvers.points.point_solver import PointSolver  # noqa: E402

POINTS = 32
EFFECTS = PointEffects(drucker_prager(6.7e6, 4e6, 35.0, 500.0), contact=coulomb_contact(0.4))
FIRST, END = 0.008, 0.016  # [s], of frames
NEVER = 1e9


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


def after(solver, *times):
    """The solver, advanced through `times` of frames."""
    for until, following in zip(times, (*times[1:], NEVER), strict=True):
        solver.advance(until, following)
    return solver


def values(solver):
    """All that a frame of the solver holds, by name, and its energy; points in the order of their ids."""
    frame = solver.frame()
    particles = frame.particles.take(np.argsort(frame.particles.id))
    sums = {"energy": np.array(solver.energy()), "clock": np.array([solver.time, solver.step, solver.speed_max])}
    at_walls = {name: frame.state[name] for name in ("barriers", "face_yields") if name in frame.state}
    return particles.arrays() | frame.maxima | {"yields": frame.state["yields"]} | at_walls | sums


def difference(one, other):
    """Largest difference of `values`, over the largest value of each."""
    return max(
        float(np.abs(np.asarray(a, float) - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), 1e-300))
        for a, b in ((one[name], other[name]) for name in one)
        if np.asarray(a).dtype.kind == "f" and np.isfinite(b).all()
    )


def same(one, other):
    """Whether two `values` have the same bits."""
    return all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


def frame_of(kind, walls=()):
    """The frame at FIRST of a run of `kind` to END, which chooses the step after it."""
    solver = made(kind, walls)
    solver.advance(FIRST, END)
    return solver.frame()


def resumed(kind, frame, walls=()):
    """`values` at the END of a run of `kind` that continues from `frame`."""
    solver = made(kind, walls)
    solver.restore(frame)
    return values(after(solver, END))


def continued(walls=()):
    """(largest differences by name, same bits after resuming) of runs with `walls`, in one part or from a frame."""
    kinds = PointSolver, DevicePointSolver
    on_processor, on_device = (values(after(made(kind, walls), FIRST, END)) for kind in kinds)
    frames = {kind: frame_of(kind, walls) for kind in kinds}
    there = resumed(DevicePointSolver, frames[PointSolver], walls)
    back = resumed(PointSolver, frames[DevicePointSolver], walls)
    found = {
        "as_on_the_processor": difference(on_device, on_processor),
        "from_processor_to_device": difference(there, on_processor),
        "from_device_to_processor": difference(back, on_processor),
    }
    return found, same(resumed(DevicePointSolver, frames[DevicePointSolver], walls), on_device)


def main():
    """All runs."""
    smaller, begun_empty = [], []
    for kind in (PointSolver, DevicePointSolver):
        solver = after(made(kind), FIRST)
        solver.share_step(0.5)
        smaller.append(values(after(solver, END)))
        begun_empty.append(values(filled(kind)))
    found, same_bits = continued()
    at_walls, same_bits_at_walls = continued(dam())
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
    for kind in (PointSolver, DevicePointSolver):
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
