"""Cases of the depth-averaged solver in the CUDA simulator against the CPU's kernels; prints what it found as JSON.

Run as `python simulated_columns.py [NAME...]` with NUMBA_ENABLE_CUDASIM=1 (`test_device_columns.py` does).
"""

import json
import sys
from functools import cache, partial

import numpy as np
from column_slots import SCENES, made
from launch_order import shuffled

from mpmgis.compiled.block_order import GONE
from mpmgis.solvers.columns import column_rows as row
from mpmgis.solvers.columns import column_time_step as entry
from mpmgis.solvers.columns.column_arrays import changing_fields
from mpmgis.solvers.gpu import device_column_loop
from mpmgis.solvers.gpu.device_column_loop import DeviceColumns
from mpmgis.solvers.gpu.launch import ACTIVE, Launch

NARROW, WIDE = Launch(2, 8, 1, 2, 1, 3), Launch(3, 16, 1, 3, 1, 5)
REPEATED = "slide", "outflow west and south", "lowered bed", "barriers and walls", "forest, erosion and walls"
NAMES = ("rows", "ids", "keys", "wet", "clock", "counts", "ledger", "peaks", "barrier_sums", "left_cells")
PLACES = (  # of what is largest: of nodes with values that differ by rounding another may be taken
    entry.DEEPEST_X,
    entry.DEEPEST_Y,
    entry.FASTEST_X,
    entry.FASTEST_Y,
    entry.BOUND_NOW_X,
    entry.BOUND_NOW_Y,
)
ENERGIES = (
    entry.KINETIC_NOW,
    entry.KINETIC_PEAK,
    entry.FRICTION_TOTAL,
    entry.MERGING_TOTAL,
    entry.BARRIER_TOTAL,
    entry.LIMITED_TOTAL,
    entry.WORK_TOTAL,
    entry.BENT_TOTAL,
    entry.ENTRAINED_POTENTIAL_TOTAL,
)


def device_of(solver, launch=NARROW):
    """DeviceColumns of the arrays of `solver`."""
    return DeviceColumns(solver.arrays, solver._settings, solver.fields, solver.effects, launch)


def advanced(solver, steps, until=1e9, launch=NARROW, pauses=1):
    """The reason after `steps` on the device, with all arrays back; `pauses`: as often through the host between."""
    for _ in range(pauses):
        device = device_of(solver, launch)
        reason = device.advance(until, steps // pauses)
        device.download()
    return reason


@cache
def on_device(make, steps):
    """(solver, reason) after `steps` on the device, for all cases that compare with them; none changes the solver."""
    solver = make()
    return solver, advanced(solver, steps)


def scaled(a, b):
    """Largest difference over the largest value of `b`."""
    return float(np.abs(a - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), 1e-300))


def by_id(solver):
    """Rows, ids and keys of the columns that have not left; their order in memory differs between CPU and device."""
    n = solver._counts[entry.ROWS]
    here = np.flatnonzero(solver.arrays.keys[:n] != GONE)
    here = here[np.argsort(solver.arrays.ids[here])]
    return solver.arrays.rows[here], solver.arrays.ids[here], solver.arrays.keys[here]


def difference(one, other):
    """Largest differences of the state of two solvers, by name, over the size of what is compared."""
    (a, ids, keys), (b, other_ids, other_keys) = by_id(one), by_id(other)
    exact = {"ids": bool(np.array_equal(ids, other_ids)), "keys": bool(np.array_equal(keys, other_keys))}
    exact |= {
        name: bool(np.array_equal(getattr(one.arrays, name), getattr(other.arrays, name))) for name in ("counts", "wet")
    }
    here = {"inexact": [name for name, same in exact.items() if not same]}
    if here["inexact"]:
        return here
    groups = {
        "place": (row.X, row.Y),
        "velocity": (row.U, row.V),
        "affine": range(row.CXX, row.CYY + 1),
        "mass": (row.MASS,),
        "area": (row.AREA,),
        "slope": (row.GX, row.GY),
    }
    for name, numbers in groups.items():
        here[name] = scaled(b[:, list(numbers)], a[:, list(numbers)])
    for name in ("ledger", "peaks", "barrier_sums", "left_cells"):
        here[name] = scaled(getattr(other.arrays, name), getattr(one.arrays, name))
    for name in changing_fields(one.effects):
        here[name] = scaled(getattr(other.fields, name), getattr(one.fields, name))
    clock, there = one._clock, other._clock
    here["energies"] = scaled(there[list(ENERGIES)], clock[list(ENERGIES)])
    rest = [k for k in range(entry.CLOCK) if k not in ENERGIES and k not in PLACES]
    here["clock"] = float((np.abs(clock - there) / np.maximum(np.abs(clock), 1e-9))[rest].max())
    here["places"] = scaled(there[list(PLACES)], clock[list(PLACES)])
    return here


def facts(solver):
    """What a scene is for: that it happened."""
    clock, sums = solver._clock, solver.fields.forest_sums
    names = (
        "CLAMPED_TOTAL",
        "STRETCH_TOTAL",
        "THIN_AREA_TOTAL",
        "SPEED_TOTAL",
        "WALL_TOTAL",
        "STIFF_TOTAL",
        "THIN_TOTAL",
        "GREEDY_TOTAL",
        "AIRBORNE_TOTAL",
        "ENTRAINED_TOTAL",
        "BARRIER_TOTAL",
        "LIMITED_TOTAL",
        "KICK_BEFORE",
    )
    here = {name: float(clock[getattr(entry, name)]) for name in names}
    here |= {"out": [float(mass) for mass in solver.arrays.ledger[:, 0]], "alive": int(solver._counts[entry.ALIVE])}
    held = solver.arrays.barrier_sums.tolist()
    return here | {"forest": [float(value) for value in sums], "held": held, "steps": solver.step}


def compared(make, steps):
    """What differs after `steps` on CPU and device, and the reasons to stop."""
    one, (other, found) = make(), on_device(make, steps)
    reason = one.advance(1e9, max_steps=steps)
    here = difference(one, other) | {"facts": facts(one), "reason": reason}
    return here if found == reason else here | {"inexact": [f"reason {found}, not {reason}"]}


def bits(solver):
    """All that changes, as bytes."""
    changing = [getattr(solver.arrays, name) for name in NAMES] + list(solver.fields)
    return b"".join(array.tobytes() for array in changing)


def permuted(make, steps):
    """Whether `steps` with thread blocks and threads begun in another order give the same bits."""
    (one, _), other = on_device(make, steps), make()
    with shuffled():
        advanced(other, steps)
    return {"same": bits(one) == bits(other)}


def resumed(make, steps):
    """Whether a run through the host in its middle gives the same bits."""
    (one, _), other = on_device(make, steps), make()
    advanced(other, steps, pauses=2)
    return {"same": bits(one) == bits(other)}


def other_launch(make, steps):
    """Whether the motion is the same with another number of threads (sums of reports may differ in the last bits)."""
    (one, _), other = on_device(make, steps), make()
    advanced(other, steps, launch=WIDE)
    first, second = (solver.arrays.rows.tobytes() + solver.arrays.keys.tobytes() for solver in (one, other))
    return {"same": first == second}


def grown(make, steps):
    """Whether arrays that are too small at first, in every step anew, give the same bits."""
    (one, _), other = on_device(make, steps), make()
    rooms, device_column_loop.ROOMS = (
        device_column_loop.ROOMS,
        tuple((room, needed, 1) for room, needed, _ in device_column_loop.ROOMS),
    )
    try:
        advanced(other, steps)
    finally:
        device_column_loop.ROOMS = rooms
    return {"same": bits(one) == bits(other)}


def scrambled(make):
    """Largest difference of the tiles if the columns of each block are in a random order, over the largest sum."""
    tiles, sort, rng = [], device_column_loop.Sorted.sort, np.random.default_rng(5)

    def mix(self, *arguments):
        sort(self, *arguments)
        order, start = self.order.copy_to_host(), self.start.copy_to_host()
        for a in range(self.run.copy_to_host()[ACTIVE]):
            rng.shuffle(order[start[a] : start[a + 1]])
        self.order.copy_to_device(order)

    for change in (sort, mix):
        device_column_loop.Sorted.sort = change
        try:
            device = device_of(make())
            device.advance(1e9, 1)
        finally:
            device_column_loop.Sorted.sort = sort
        tiles.append(device._now.tiles.copy_to_host()[: device._now.host[ACTIVE]])
    return {"tiles": scaled(*tiles)}


def reasons():
    """Reasons to stop: time reached, all columns gone, a state that is not finite."""
    here = {}
    solver = made()
    device = device_of(solver)
    here["reached"] = device.advance(0.25, 10) == entry.REACHED_TIME and solver.time == 0.25
    gone = made()
    gone._counts[entry.ALIVE], gone.arrays.keys[:] = 0, GONE
    here["left"] = advanced(gone, 3) == entry.ALL_LEFT
    broken = made()
    broken.arrays.rows[5, row.U] = np.nan
    here["not finite"] = advanced(broken, 3) == entry.NOT_FINITE_STATE and bool(broken._counts[entry.BAD])
    here["one step"] = broken.step == 1
    return here


def cases():
    """Name -> what answers the results of each case."""
    here = {"reasons": reasons, "scrambled": partial(scrambled, made)}
    here |= {name: partial(compared, make, steps) for name, (make, steps) in SCENES.items()}
    for name in REPEATED:
        here |= {f"{kind.__name__}: {name}": partial(kind, SCENES[name][0], 2) for kind in (permuted, resumed)}
    for name in ("slide", "forest, erosion and walls"):
        here |= {f"{kind.__name__}: {name}": partial(kind, SCENES[name][0], 2) for kind in (other_launch, grown)}
    return here


def main():
    """Print the results of the cases named in the arguments, or of all, as JSON, one a line."""
    for name, case in cases().items():
        if not sys.argv[1:] or name in sys.argv[1:]:
            print(json.dumps([name, case()]), flush=True)


if __name__ == "__main__":
    main()
