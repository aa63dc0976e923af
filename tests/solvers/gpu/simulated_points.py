"""Cases of the 3D solver in the CUDA simulator against the CPU's kernels; prints what it found as JSON.

Run as `python simulated_points.py` with NUMBA_ENABLE_CUDASIM=1 (`test_device_points.py` does): numba reads it once.
"""

import json
import sys
from functools import cache, partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from column_scenes import terrain_of
from launch_order import shuffled
from point_scenes import block_of, plane, points_on

from mpmgis.compiled.block_order import GONE
from mpmgis.laws.contact_friction import sticking_contact
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import FLUID, cohesive_mu_i, drucker_prager, elastic, fluid, mu_i
from mpmgis.laws.softening import Softening, softening
from mpmgis.solvers.gpu import device_functions
from mpmgis.solvers.gpu.device_point_loop import LAST_STEP, DevicePoints
from mpmgis.solvers.gpu.launch import Launch
from mpmgis.solvers.points import point_rows as row
from mpmgis.solvers.points import point_solver
from mpmgis.solvers.points import point_time_step as entry
from mpmgis.solvers.points.ground_contact import YIELD, YIELD_STEP
from mpmgis.solvers.points.point_barriers import POINT_BARRIER_SUMS
from mpmgis.solvers.points.point_faces import FACE_BARRIER
from mpmgis.system.errors import SceneError

SOIL = drucker_prager(6.7e6, 4e6, 35.0, 500.0)
SOFT = softening((35.0, 500.0), (20.0, 0.0), 10.0)
STRETCH = np.array([[-3.0, 1.0, 0.0], [0.5, -1.0, 0.5], [2.0, 0.0, -8.0]])  # [s-1]
COULOMB, VOELLMY, STICKING = friction_law("Coulomb", 0.3), friction_law("Voellmy", 0.2, 300.0), sticking_contact()
COHESIVE = cohesive_mu_i(35.0, 500.0, 0.2, 0.3, 1e-3, 2500.0, bulk_modulus=6.7e6, shear_modulus=4e6)
MATERIALS = {
    "elastic": (elastic(6.7e6, 4e6), Softening()),
    "fluid": (fluid(6.7e6, 50.0, 1.0), Softening()),
    "Drucker-Prager": (SOIL, Softening()),
    "Drucker-Prager without friction": (drucker_prager(6.7e6, 4e6, 0.0, 500.0), Softening()),
    "mu(I)": (mu_i(6.7e6, 4e6, 0.4, 0.6, 0.3, 1e-3, 2500.0, 1.0), Softening()),
    "cohesive mu(I)": (COHESIVE, Softening()),
    "cohesive mu(I) with softening": (COHESIVE, SOFT),
}
# Kirchhoff stress [Pa] (xx, yy, zz, xy, xz, yz) of every other point at the start: sheared under pressure, or pulled
STRESSES = np.array([[-1e5, -1e5, -2e5, 5e4, 5e5, 0.0], [6e5, 5e5, 7e5, 0.0, 1e5, 5e4]])
NARROW = Launch(2, 8, 1, 2, 4, 3)
LOADS = "barrier_sums", "face_yields"
NAMES = ("rows", "ids", "keys", "clock", "counts", "ledger", "left_cells", "peaks", "yields", *LOADS)
WIDE = Launch(3, 16, 2, 3, 8, 5)


_folded, folded_ground = {}, point_solver.folded_ground


def folded_once(nodes, height, dx, clearance):
    """`folded_ground`, computed once for each ground: it takes seconds in plain Python."""
    given = nodes.tobytes(), height.tobytes(), dx, clearance
    if given not in _folded:
        _folded[given] = folded_ground(nodes, height, dx, clearance)
    return _folded[given]


point_solver.folded_ground = folded_once


def stretched_over(frame, degrees, above=0.0):
    """`frame` with the velocities of STRETCH added, `above` [m] a plane that falls to the east by `degrees`."""
    place = frame.particles.position
    frame.particles.velocity[:] += (place - place.mean(axis=0)) @ STRETCH
    place[:, 2] += 120.0 - np.tan(np.radians(degrees)) * place[:, 0] + above
    return frame


def slab(precision, contact=COULOMB, size=(1.5, 1, 1), velocity=(3.0, 0.5, -4.0), x=12.0, laws=(SOIL, SOFT), **more):
    """Points that fall on a plane of 30 degrees and strain; 8 a cell of 1 m. `laws` are material and softening."""
    frame = stretched_over(block_of(size, 0.5, (x, 12.2, 0.0), velocity=velocity), 30.0)
    return points_on(plane(30.0), frame, 1.0, laws[0], contact, laws[1], precision=precision, maxima=True, **more)


def stressed(precision, laws):
    """Points on the plane, half of them sheared under pressure and half of them pulled, beyond what soil bears."""
    return slab(precision, size=(1, 1, 1), laws=laws, stress=np.tile(STRESSES, (4, 1)))


def at_cliff(precision, contact=COULOMB):
    """Points at a cliff, whose ground folds."""
    terrain = terrain_of(lambda x, y: np.where(x < 60.0, 30.0, 15.0), 120.0, 40.0, 5.0)
    frame = block_of((1.5, 1, 1), 0.5, (56.6, 12.0, 29.6), velocity=(6.0, 0.0, -6.0))
    place = frame.particles.position
    frame.particles.velocity[:] += (place - place.mean(axis=0)) @ STRETCH
    return points_on(terrain, frame, 1.0, SOIL, contact, SOFT, precision=precision, maxima=True)


def into_wall(precision):
    """Points that run into a wall on the eastern edge, some of them already beyond it."""
    solver = slab(precision, x=198.4, velocity=(40.0, 0.0, 0.0), edges="wall")
    solver.arrays.rows[::4, row.X] = 4.0 + 0.2  # the edge is at 4 in its block
    return solver


def along_wall(precision):
    """Points near the ground that shear along a wall on the southern edge; half of them also towards it."""
    frame = block_of((4, 0.5, 1), 0.5, (12.0, 0.2, 0.0), velocity=(3.0, 0.0, -1.0))
    place, speed = frame.particles.position, frame.particles.velocity
    speed[:, 0] += 12.0 * place[:, 2] ** 2
    speed[:, 1] -= np.where(place[:, 0] > 14.0, 12.0, 0.3) * place[:, 2] ** 2
    place[:, 2] += 120.0 - np.tan(np.radians(30.0)) * place[:, 0]
    return points_on(plane(30.0), frame, 1.0, SOIL, COULOMB, SOFT, precision=precision, maxima=True, edges="wall")


def out_of_domain(precision):
    """Points of which some leave over the southern edge in the first step."""
    solver = slab(precision, x=100.0, velocity=(0.0, -60.0, 0.0))
    solver.arrays.keys[:] = solver.arrays.keys & ((1 << 42) - 1)  # the block row of the edge, at 4 in it
    solver.arrays.rows[:, row.Y] = np.linspace(4.02, 4.45, len(solver.arrays.rows))
    return restarted(solver)


def under_ground(precision):
    """Some of the points are more than a cell below the ground."""
    solver = slab(precision)
    solver.arrays.rows[::5, row.Z] = 0.55
    return restarted(solver)


def restarted(solver):
    """`solver` with the window of its changed keys."""
    from mpmgis.solvers.points.point_blocks import window_of

    window_of(solver.arrays.keys, solver._lowest, solver._counts[entry.WINDOW_FIRST :])
    return solver


def zoned(precision):
    """Friction from a map."""
    return with_zones(slab(precision))


def with_zones(solver):
    """`solver` with friction that differs from row to row of nodes."""
    values = np.full((*solver._ground.shape[:2], 1), 0.3)
    values[::2] = 0.6
    solver._zone_values = values
    solver._effects = solver._effects._replace(zones=True)
    return solver


def device_of(solver, launch=NARROW):
    """DevicePoints of the arrays of `solver`."""
    return DevicePoints(solver.arrays, solver._kernel_places(), solver._settings, solver._effects, launch)


def begun(solver):
    """`solver` whose first step is chosen."""
    solver.advance(solver.time, max_steps=0)
    return solver


def advanced(solver, steps, until=1e9, launch=NARROW, pauses=1):
    """The reason after `steps` on the device, with all arrays back; `pauses`: as often through the host between."""
    for _ in range(pauses):
        device = device_of(begun(solver), launch)
        reason = device.advance(until, np.inf, steps // pauses)
        device.download()
    return reason


@cache
def on_device(make, precision, steps):
    """(solver, reason) after `steps` on the device, for all cases that compare with them; none changes the solver."""
    solver = make(precision)
    return solver, advanced(solver, steps)


def by_id(solver):
    """Rows, ids and keys of the points that have not left; their order in memory differs between CPU and device."""
    n = solver._counts[entry.ROWS]
    here = np.flatnonzero(solver.arrays.keys[:n] != GONE)
    here = here[np.argsort(solver.arrays.ids[here])]
    return solver.arrays.rows[here].astype(float), solver.arrays.ids[here], solver.arrays.keys[here]


def difference(one, other):
    """Largest differences of the state of two solvers, by name, over the size of what is compared."""
    here = {}
    (a, *names), (b, *others) = by_id(one), by_id(other)
    affine = [k + axis for k in (row.AXX, row.AXY, row.AXZ) for axis in range(3)]
    if one.effects.material.kind == FLUID:
        state = {"state": [row.S0], "rate": [row.S1], "supplied": [row.S2]}
    else:
        state = {"state": [k for k in row.STATE if k < a.shape[1]]}
    groups = {"place": [row.X, row.Y, row.Z], "momentum": [row.PX, row.PY, row.PZ], "affine": affine} | state
    for name, columns in groups.items():
        scale = 1.0 if name == "place" else np.abs(a[:, columns]).max(initial=1e-300)
        scale = max(scale, 1e-3 * np.abs(a[:, groups["momentum"]]).max(initial=0.0)) if name == "affine" else scale
        here[name] = float(np.abs(a[:, columns] - b[:, columns]).max(initial=0.0) / scale)
    for name in ("peaks", "yields", "ledger", "left_cells", "barrier_sums", "face_yields"):
        x, y = getattr(one.arrays, name), getattr(other.arrays, name)
        x, y = (x[..., YIELD], y[..., YIELD]) if name.endswith("yields") else (x, y)
        here[name] = float(np.abs(x - y).max(initial=0.0) / max(np.abs(x).max(initial=0.0), 1e-300))
    clock, there = one._clock, other._clock
    here["time"] = float(np.abs(clock[entry.TIME] - there[entry.TIME]) / max(clock[entry.TIME], 1e-300))
    impulses = slice(entry.IMPULSE_GROUND_X, entry.IMPULSE_GRAVITY + 1)
    most = np.abs(clock[impulses]).max()
    here["impulse"] = float(np.abs(clock[impulses] - there[impulses]).max() / max(most, 1e-300))
    losses = [
        entry.GROUND_LOSS,
        entry.PLASTIC_LOSS,
        entry.LIMIT_LOSS,
        entry.LAYER_LOSS,
        entry.FRICTION_LOSS,
        entry.LIFTED_ENERGY,
        entry.BARRIER_LOSS,
        entry.RETURNED,
    ]
    most = np.abs(clock[losses]).max()
    here["losses"] = float(np.abs(clock[losses] - there[losses]).max() / max(most, 1e-300))
    counted = [
        entry.TIP_TOTAL,
        entry.FAR_TOTAL,
        entry.LIFTED_TOTAL,
        entry.STRETCH_TOTAL,
        entry.WALL_TOTAL,
        entry.LIMITED_TOTAL,
        entry.POINT_STEPS,
        entry.CORRECTED_TOTAL,
    ]
    here["counted"] = float(np.abs(clock[counted] - there[counted]).max())
    here["corrected"] = int(clock[entry.CORRECTED_TOTAL])
    gained, too = clock[entry.CORRECTION_ENERGY], there[entry.CORRECTION_ENERGY]
    if one.effects.material.kind == FLUID:
        gained, too = (e + r[:, row.MASS] @ r[:, row.S2] / one.numerics.density for e, r in ((gained, a), (too, b)))
    here["correction"] = float(np.abs(gained - too) / max(np.abs(gained), 1e-300))
    here["exact"] = bool(
        all(np.array_equal(mine, theirs) for mine, theirs in zip(names, others, strict=True))
        and np.array_equal(one._counts, other._counts)
        and np.array_equal(one.arrays.yields[..., YIELD_STEP], other.arrays.yields[..., YIELD_STEP])
        and np.array_equal(one.arrays.face_yields[..., YIELD_STEP], other.arrays.face_yields[..., YIELD_STEP])
    )
    fastest = slice(entry.FASTEST_X, entry.FASTEST_TIME + 1)
    here["fastest"] = float(np.abs(clock[fastest] - there[fastest]).max())
    here["clips"] = {
        name: float(clock[getattr(entry, name)]) for name in ("LIFTED_TOTAL", "WALL_TOTAL", "LIMITED_TOTAL")
    }
    here["torn"] = float(clock[entry.TIP_TOTAL])
    here["out"] = float(one.arrays.ledger[:, 0].sum())
    here["alive"] = int(one._counts[entry.ALIVE])
    here["loads"] = one.arrays.barrier_sums[:, :POINT_BARRIER_SUMS].tolist()
    here["faces"], here["faces_yield"] = (
        int((one._faces[:, FACE_BARRIER] > 0.0).sum()),
        float(one.arrays.face_yields[..., YIELD].max()),
    )
    return here


def compared(make, precision, steps):
    """What differs after `steps` on CPU and device, and the reasons to stop."""
    one, (other, found) = make(precision), on_device(make, precision, steps)
    reason = begun(one).advance(1e9, max_steps=steps)
    return difference(one, other) if found == reason else {"exact": False}


def with_material(laws, precision):
    """`compared` for `stressed` points, and what they do in the first step."""
    steps = 3 if laws[0].kind == FLUID else 2  # it expands in the third
    here, solver = compared(partial(stressed, laws=laws), precision, steps), begun(stressed(precision, laws))
    solver.advance(1e9, max_steps=1)
    rows = solver.arrays.rows
    here["yield at once"] = int((rows[:, row.S6] > 0.0).sum()) if rows.shape[1] > row.S6 else 0
    here["torn at once"], here["least state"] = float(solver._clock[entry.TIP_TOTAL]), float(rows[:, row.S0].min())
    return here


def bits(solver):
    """All that changes, as bytes."""
    return b"".join(getattr(solver.arrays, name).tobytes() for name in NAMES)


def permuted(make, precision, steps):
    """Whether `steps` with thread blocks and threads begun in another order give the same bits."""
    (one, _), other = on_device(make, precision, steps), make(precision)
    with shuffled():
        advanced(other, steps)
    return {"same": bits(one) == bits(other)}


def resumed(make, precision, steps):
    """Whether a run through the host in its middle gives the same bits."""
    (one, _), other = on_device(make, precision, steps), make(precision)
    advanced(other, steps, pauses=2)
    return {"same": bits(one) == bits(other)}


def other_launch(make, precision, steps):
    """Whether the motion is the same with another number of threads (sums of reports may differ in the last bits)."""
    (one, _), other = on_device(make, precision, steps), make(precision)
    advanced(other, steps, launch=WIDE._replace(groups=1))
    first, second = (solver.arrays.rows.tobytes() + solver.arrays.keys.tobytes() for solver in (one, other))
    return {"same": first == second}


def launched(make):
    """Names of all kernels that one step of `make` launches."""
    names, of = [], device_functions.Kernel.of

    def noted(kernel, precision):
        names.append(kernel.function.__name__)
        return of(kernel, precision)

    device_functions.Kernel.of = noted
    try:
        advanced(make("float64"), 1)
    finally:
        device_functions.Kernel.of = of
    return names


def reasons():
    """Reasons to stop: time reached, all points gone."""
    here = {}
    solver = begun(slab("float64"))
    device = device_of(solver)
    here["reached"] = device.advance(2.5 * solver._clock[entry.STEP_NOW], np.inf, 10) == entry.REACHED_TIME
    here["time"] = solver.time
    gone = slab("float64")
    gone._counts[entry.ALIVE], gone.arrays.keys[:] = 0, GONE
    here["left"] = advanced(gone, 3) == entry.ALL_LEFT
    late = begun(slab("float32"))
    late._counts[entry.STEP] = LAST_STEP - 1
    try:
        device_of(late).advance(1e9, np.inf, 2)
        here["too many steps"] = False
    except SceneError as error:
        here["too many steps"] = "--device cpu" in str(error)
    return here


BOTH = ("float64", "float32")
SCENES = {
    "slab": slab,
    "drag": lambda precision: slab(precision, VOELLMY),
    "fluidised bed": lambda precision: slab(precision, friction_law("SamosAT", 0.155, 20.0)),
    "sticking": lambda precision: slab(precision, STICKING),
    "cliff": at_cliff,
    "cliff with drag": lambda precision: at_cliff(precision, VOELLMY),
    "cliff with mud": lambda precision: at_cliff(precision, friction_law("Bingham", 300.0, 40.0)),
    "cliff that sticks": lambda precision: at_cliff(precision, STICKING),
    "wall": into_wall,
    "along a wall": along_wall,
    "outflow": out_of_domain,
    "under ground": under_ground,
    "zones": zoned,
}


def cases():
    """Name -> what answers the results of each case."""
    small = lambda precision: slab(precision, size=(1, 1, 1))  # noqa: E731
    here = {"reasons": reasons}
    for p in BOTH:
        here |= {f"{name} {p}": partial(compared, make, p, 2) for name, make in SCENES.items()}
        here |= {f"{name} {p}": partial(with_material, laws, p) for name, laws in MATERIALS.items()}
        here[f"permuted {p}"] = partial(permuted, SCENES["drag"], p, 2)
        here[f"permuted outflow {p}"] = partial(permuted, out_of_domain, p, 2)
        here[f"resumed {p}"] = partial(resumed, slab, p, 2)
        here[f"other launch {p}"] = partial(other_launch, slab, p, 1)
        here[f"reordered {p}"] = partial(compared, small, p, 21)
    return here


def print_results(cases):
    """Print the results of the cases whose name contains one of the arguments, or of all, as JSON, one a line."""
    for name, case in cases.items():
        if not sys.argv[1:] or any(part in name for part in sys.argv[1:]):
            print(json.dumps([name, case()]), flush=True)


if __name__ == "__main__":
    print_results(cases())
