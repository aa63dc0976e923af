"""Runs of `DeviceColumnSolver` in the simulator, compared with `ColumnSolver`; `test_device_solver.py` runs it.

Prints JSON: largest differences by name, `same_bits` by name, and answers.
"""

import json

import numpy as np
from column_slots import erodible, made, pile
from compared_runs import after, continued, difference

from mpmgis.laws.entrainment import entrainment_law
from mpmgis.solvers.columns import column_time_step
from mpmgis.solvers.columns.column_solver import ColumnSolver
from mpmgis.solvers.columns.node_grid import CellWindow
from mpmgis.solvers.gpu.device_column_solver import DeviceColumnSolver

KINDS = ColumnSolver, DeviceColumnSolver
FIRST, END = 0.3, 0.6  # [s], of frames
LAWS = {"entrainment": entrainment_law("ErosionEnergy", 2000.0, 1e-3), "places": erodible, "gradient": False}


def solver_of(kind, **more):
    """A solver of `kind` with a pile that erodes its bed."""
    return made(kind, frame=pile(spacing=5.0), **LAWS | more)


def values(solver):
    """All that a frame of the solver holds, by name, and its balances; columns in the order of their ids."""
    frame = solver.frame()
    particles = frame.particles.take(np.argsort(frame.particles.id))
    change = {name: array for name, array in frame.bed_change.items() if name != "transform"}
    clock = {"clock": np.array([solver.time, solver.step, solver.speed_max, *solver.energy()])}
    names = "mass_now", "mass_out", "energy_lost_to_ground", "energy_lost_to_eroded_mass", "kinetic_energy"
    balances = solver.balances()
    return particles.arrays() | frame.maxima | change | clock | {name: np.array([balances[name]]) for name in names}


def compared(run):
    """Largest difference of the `values` of the solvers of both kinds after `run`."""
    return difference(*(values(run(solver_of(kind))) for kind in reversed(KINDS)))


def inserted(solver):
    """The pile comes once more, beside the flow, on top of a part of it."""
    after(solver, FIRST)
    more = pile(spacing=5.0, west=40.0, east=60.0, south=40.0, north=60.0, thickness=0.7)
    more.particles.id[:] += 1000
    solver.insert(more, CellWindow(np.ones((5, 5), np.uint8), 8, 8))
    return after(solver, END)


def taken_out(solver):
    """The columns in the east are taken out."""
    after(solver, FIRST)
    frame = solver.take_out(lambda x, y: x > np.median(x))
    assert len(frame.particles) and len(frame.particles) < 36
    return after(solver, END)


def with_half_the_step(solver):
    """The second part with half the step."""
    after(solver, FIRST)
    solver.share_step(0.5)
    return after(solver, END)


def released(solver):
    """An area is armed, and asked for until it has fired; then the run goes on."""
    nodes = np.array([9, 10]), np.array([13, 13])
    solver.arm(1, nodes, 0.05)
    code = column_time_step.RUNNING
    while code != column_time_step.TRIGGER_REACHED and solver.time < 5.0:
        assert not solver.fired(1, nodes)
        code = solver.advance(5.0, max_steps=2)
    assert solver.fired(1, nodes) and not (solver.arrays.wet[nodes] // 2).any()
    return after(solver, solver.time + 0.2)


def allowed_to_stop(solver):
    """Rest ends a run only where it may."""
    solver.arrays.rows[:, 2:8] = 0.0
    solver._clock[column_time_step.MOVING_PEAK] = 1e9
    assert solver.advance(1.0, max_steps=2, may_stop=False) == column_time_step.RUNNING
    assert solver.advance(1.0, max_steps=2, may_stop=True) == column_time_step.STOPPED_MOVING
    return solver


def main():
    """All runs."""
    found, same_bits = continued(solver_of, values, KINDS, FIRST, END)
    found["same_bits_after_resuming"] = same_bits
    runs = inserted, taken_out, with_half_the_step, released
    found |= {run.__name__: compared(run) for run in runs}
    found["allowed_to_stop"] = difference(
        *(values(allowed_to_stop(solver_of(kind, stop_at_rest=True))) for kind in KINDS)
    )
    print(json.dumps(found))


if __name__ == "__main__":
    main()
