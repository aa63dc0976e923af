"""Runs of `DevicePointSolver` in the simulator, compared with `PointSolver`; `test_device_solver.py` runs it.

Prints JSON: largest differences by name; `same_bits` by name.
"""

import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parent / "bench")]

from gpu import slab  # noqa: E402

from mpmgis.effects.barrier import Barrier  # noqa: E402
from mpmgis.effects.contact import CoulombContact  # noqa: E402
from mpmgis.effects.material import drucker_prager  # noqa: E402
from mpmgis.effects.slots import PointEffects  # noqa: E402
from mpmgis.errors import SceneError  # noqa: E402
from mpmgis.solvers.device_points import DevicePointSolver  # noqa: E402
from mpmgis.solvers.point_numerics import PointNumerics  # noqa: E402
from mpmgis.solvers.points import PointSolver  # noqa: E402

POINTS = 32
EFFECTS = PointEffects(drucker_prager(6.7e6, 4e6, 35.0, 500.0), contact=CoulombContact(0.4))
FIRST, END = 0.008, 0.016  # [s], of frames
NEVER = 1e9


def made(kind, effects=EFFECTS):
    """A solver of `kind` with a small slab that has stress from the start."""
    terrain, frame = slab(POINTS)
    stress = np.tile([-1e3, -1e3, -2e3, 0.0, 0.0, 0.0], (len(frame.particles), 1))
    return kind(frame, terrain, effects, PointNumerics(1.0, density=2000.0, maxima=True), stress)


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
    return particles.arrays() | frame.maxima | {"yields": frame.state["yields"]} | sums


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


def frame_of(kind):
    """The frame at FIRST of a run of `kind` to END, which chooses the step after it."""
    solver = made(kind)
    solver.advance(FIRST, END)
    return solver.frame()


def resumed(kind, frame):
    """`values` at the END of a run of `kind` that continues from `frame`."""
    solver = made(kind)
    solver.restore(frame)
    return values(after(solver, END))


def main():
    """All runs."""
    on_processor, on_device = (values(after(made(kind), FIRST, END)) for kind in (PointSolver, DevicePointSolver))
    frames = {kind: frame_of(kind) for kind in (PointSolver, DevicePointSolver)}
    smaller = []
    for kind in (PointSolver, DevicePointSolver):
        solver = after(made(kind), FIRST)
        solver.share_step(0.5)
        smaller.append(values(after(solver, END)))
    refusal = ""
    try:
        made(DevicePointSolver, EFFECTS._replace(barrier=Barrier()))
    except SceneError as error:
        refusal = str(error)
    found = {
        "as_on_the_processor": difference(on_device, on_processor),
        "from_processor_to_device": difference(resumed(DevicePointSolver, frames[PointSolver]), on_processor),
        "from_device_to_processor": difference(resumed(PointSolver, frames[DevicePointSolver]), on_processor),
        "with_half_the_step": difference(*reversed(smaller)),
        "inserted": inserted(),
        "same_bits_after_resuming": same(resumed(DevicePointSolver, frames[DevicePointSolver]), on_device),
        "refusal": refusal,
    }
    print(json.dumps(found))


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
