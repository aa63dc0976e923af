"""Ends of runs and flows that spread, in the CUDA simulator against the CPU's kernels; prints what it found as JSON.

Run as `simulated_points.py`.
"""

from functools import partial

import numpy as np
from simulated_barriers import BARRIERS
from simulated_points import (
    BOTH,
    COULOMB,
    NARROW,
    VOELLMY,
    advanced,
    begun,
    bits,
    compared,
    difference,
    print_results,
    restarted,
    slab,
)

from mpmgis.solvers.points import point_rows as row
from mpmgis.solvers.points import point_time_step as entry

LITTLE = NARROW._replace(room=1)  # arrays for a single block, which nearly every step outgrows
ENDS = {
    name: getattr(entry, name)
    for name in ("RUNNING", "REACHED_TIME", "ALL_LEFT", "NOT_FINITE_STATE", "LEAKED", "SCATTERED")
}


def not_finite(value, column, edges, precision):
    """A flow of which one point has a `value` that is no number."""
    solver = slab(precision, x=198.4 if edges == "wall" else 12.0, edges=edges)
    solver.arrays.rows[5, column] = value
    return solver


def sunk(precision):
    """A flow that lies below the ground as a whole."""
    solver = slab(precision)
    solver.arrays.rows[:, row.Z] = 0.55
    return restarted(solver)


def thrown(precision, contact=COULOMB, velocity=(2e3, 500.0, 0.0), step=0.02):
    """A flow whose first step carries points over many blocks."""
    solver = begun(slab(precision, contact, velocity=velocity, x=60.0))
    solver._clock[entry.STEP_NOW] = step
    return solver


def scattered(precision):
    """Two flows far apart, thrown so high that their window has too many blocks."""
    solver = slab(precision)
    rows, mass = solver.arrays.rows, solver.arrays.rows[:, row.MASS]
    rows[:, row.PX : row.PY + 1], rows[:, row.PZ] = 0.0, 1e5 * mass
    for column in (row.AXX, row.AXY, row.AXZ):
        rows[:, column : column + 3] = 0.0
    solver.arrays.keys[::2] += (6 << 42) + (44 << 21)
    solver = begun(restarted(solver))
    solver._clock[entry.STEP_NOW] = 20.0
    return solver


def leaving(precision):
    """A flow of which all points leave over the southern edge in the first step."""
    return thrown(precision, velocity=(0.0, -2e3, 0.0), step=0.05)


def ended(make, precision, steps=3, pauses=1):
    """Reason and number of steps on CPU and device, and what differs."""
    one, other = make(precision), make(precision)
    reason = begun(one).advance(1e9, max_steps=steps)
    there = advanced(other, steps, pauses=pauses)
    names = {code: name for name, code in ENDS.items()}
    here = {"reason": names[reason], "steps": int(one._counts[entry.STEP])}
    here |= {"reason_there": names[there], "steps_there": int(other._counts[entry.STEP])}
    here["bad"] = [one._clock[[entry.BAD_AT_X, entry.BAD_AT_Y]].tolist(), int(one._counts[entry.BAD])]
    here["bad_there"] = [other._clock[[entry.BAD_AT_X, entry.BAD_AT_Y]].tolist(), int(other._counts[entry.BAD])]
    return here | {"difference": difference(one, other)}


def grown(make, precision, steps=2):
    """Whether arrays that grow in the middle of a run change no bits, and how often they grew."""
    from mpmgis.solvers.gpu.device_point_loop import DevicePoints

    one, other, count, grow = make(precision), make(precision), [0], DevicePoints._grow

    def counted(device):
        count[0] += 1
        grow(device)

    reason = advanced(one, steps)
    DevicePoints._grow = counted
    try:
        same = advanced(other, steps, launch=LITTLE) == reason
    finally:
        DevicePoints._grow = grow
    return {"same": same and bits(one) == bits(other), "grew": count[0] - 1}


def cases():
    """Name -> what answers the results of each case."""
    here = {}
    for p in BOTH:
        ends = {
            "nan": partial(not_finite, np.nan, row.PX, "outflow"),
            "nan at walls": partial(not_finite, np.nan, row.PX, "wall"),
            "infinite": partial(not_finite, np.inf, row.PZ, "outflow"),
            "sunk": sunk,
            "scattered": scattered,
            "leaving": leaving,
        }
        here |= {f"{name} {p}": partial(ended, make, p) for name, make in ends.items()}
        here[f"left twice {p}"] = partial(ended, leaving, p, 4, 2)
        here[f"thrown {p}"] = partial(compared, thrown, p, 3)
        here[f"thrown with drag {p}"] = partial(compared, partial(thrown, contact=VOELLMY), p, 3)
        here[f"grown {p}"] = partial(grown, partial(thrown, contact=VOELLMY), p, 2)
        here[f"grown at barriers {p}"] = partial(grown, BARRIERS["opening"], p, 2)
    return here


if __name__ == "__main__":
    print_results(cases())
