"""Cases in which the volumes of fluid points are corrected, in the CUDA simulator against the CPU's kernels.

Run as `simulated_points.py`. The first step is one of those that correct (`point_density.EVERY`).
"""

from functools import partial

import numpy as np
import shapely
from simulated_barriers import TURNED, cornered, wall, with_opening
from simulated_points import (
    BOTH,
    COULOMB,
    STICKING,
    VOELLMY,
    begun,
    block_of,
    difference,
    launched,
    on_device,
    other_launch,
    permuted,
    plane,
    points_on,
    print_results,
    resumed,
    slab,
    stretched_over,
    terrain_of,
)

from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import fluid
from mpmgis.solvers.features.walls import Wall
from mpmgis.solvers.points import point_rows as row
from mpmgis.solvers.points import point_time_step as entry
from mpmgis.solvers.points.ground_contact import YIELD
from mpmgis.solvers.points.point_barriers import FILLED, FILLED_TOP, SHARE
from mpmgis.solvers.points.point_density import EVERY

WATER, LINEAR = fluid(6.7e6, 50.0, 1.0), fluid(6.7e6, 50.0, 0.0)
SMOOTH = friction_law("Coulomb", 0.0)
SPACING = 0.5  # [m] of points in cells of 1 m
HEAVY = 12.0  # times the mass of points that lie as densely as the fluid
PRESSED, SQUEEZED = (part * WATER.bulk_modulus for part in (0.06, 0.5))  # [Pa], by less and by more than the band
SHORT = 1e-4  # [s]


def dense(
    precision,
    size=(1.5, 1, 1),
    place=(57.5, 12.2, 0.0),
    degrees=0.0,
    velocity=(8.0, 0.5, -12.0),
    contact=COULOMB,
    terrain=None,
    material=WATER,
    spacing=SPACING,
    heavy=HEAVY,
    pressure=PRESSED,
    time_step=SHORT,
    **options,
):
    """Points so heavy that the nodes around them are too full; the block begins at `place`, its height over the ground.

    They are under `pressure` [Pa] from the start. A `time_step` of None is that of the solver.
    """
    frame = block_of(size, spacing, place, velocity=velocity)
    frame.particles.mass[:] *= heavy
    frame.particles.volume[:] *= heavy
    frame = stretched_over(frame, degrees)
    terrain = terrain or plane(degrees, 80.0, 24.0, 120.0, 4.0)
    stress = np.tile([-pressure, -pressure, -pressure, 0.0, 0.0, 0.0], (len(frame.particles), 1)) if pressure else None
    options |= {"precision": precision, "maxima": True, "stress": stress, "time_step": time_step}
    return points_on(terrain, frame, 1.0, material, contact, **options)


def pool(precision, barrier):
    """A compressed fluid of one point per cell, 3 m deep, between a `barrier` and walls on the other three sides.

    J increases where all nodes are full, and not at the surface; smooth ground does not yield under it.
    """
    terrain = terrain_of(lambda x, y: 120.0 + 0.0 * x, 12.0, 4.0, 1.0)
    return dense(
        precision,
        (4, 4, 3),
        (0.1, 0.1, 0.0),
        velocity=(0.0, 0.0, 0.0),
        spacing=1.0,
        heavy=1.0,
        pressure=SQUEEZED,
        contact=SMOOTH,
        walls=(barrier,),
        edges="wall",
        terrain=terrain,
    )


def ring():
    """A wall around a yard of 4 m x 4 m. Some of its nodes count as those of an opening, where J is kept."""
    outer, inner = shapely.box(52.0, 8.0, 64.0, 20.0), shapely.box(56.0, 12.0, 60.0, 16.0)
    return Wall("ring", outer.difference(inner), height=8.0)


def later(precision, step):
    """Dense points in a flow of which `step` steps are done."""
    solver = begun(dense(precision))
    solver._counts[entry.STEP] = step
    return solver


# A few cells wide and high, because folds take milliseconds a node in plain Python.
CLIFF = terrain_of(lambda x, y: np.where(x < 60.0, 120.0, 110.0), 80.0, 12.0, 4.0)
LONG = {"size": (7, 1, 1), "spacing": 1.0, "heavy": 4.0}
ACTS = {  # all or some of the points are corrected
    "ground that yields": dense,
    "ground that yields at once": partial(dense, degrees=20.0, pressure=0.0, time_step=None),
    "ground that does not yield": partial(dense, contact=STICKING, walls=(wall(59.1, mu=0.5),)),
    "ground and drag": partial(dense, contact=VOELLMY, degrees=25.0),
    "in the air": partial(dense, place=(55.3, 12.2, 9.0)),
    "another law of pressure": partial(dense, material=LINEAR),
    "longer step": partial(dense, time_step=None),
    "folded ground": partial(dense, place=(53.2, 6.2, 0.0), terrain=CLIFF, **LONG),
    "eastern wall": partial(dense, place=(78.4, 12.2, 0.0), edges="wall"),
    "western wall": partial(dense, place=(0.1, 12.2, 0.0), velocity=(-8.0, 0.5, -12.0), edges="wall"),
    "corner of walls": partial(dense, place=(78.3, 22.7, 0.0), velocity=(8.0, 8.0, -3.0), edges="wall"),
    "corner of walls too": partial(dense, place=(0.1, 0.2, 0.0), velocity=(-8.0, -8.0, -3.0), edges="wall"),
    "corner without walls": partial(dense, place=(78.3, 22.7, 0.0), velocity=(0.1, 0.1, -3.0)),
    "before a wall": partial(dense, place=(56.0, 12.2, 0.0), walls=(wall(),)),
    "before a wall with friction": partial(dense, place=(56.0, 12.2, 0.0), walls=(wall(57.3, mu=0.5),)),
    "before a thin wall": partial(dense, place=(56.2, 12.2, 0.0), walls=(wall(57.9, 0.1, mu=0.3),)),
    "over a wall": partial(dense, place=(56.0, 12.2, 0.6), size=(2.5, 1, 1.5), walls=(wall(57.2, height=1.5),)),
    "turned wall on a slope": partial(dense, place=(57.1, 12.2, 0.0), degrees=30.0, walls=(TURNED,)),
    "opening": partial(dense, place=(52.2, 11.2, 0.0), walls=(with_opening(),), **(LONG | {"size": (7, 3, 1)})),
    "inner corner": partial(dense, place=(56.0, 11.9, 0.0), walls=(cornered(0.0),)),
    "inner corner, turned": partial(dense, place=(56.2, 11.6, 0.0), walls=(cornered(0.3, 25.0),)),
    "yard": partial(dense, size=(1, 1, 1), place=(56.1, 12.1, 0.0), walls=(ring(),)),
    "pool before a wall": partial(pool, barrier=wall(4.0)),
    "pool over a wall": partial(pool, barrier=wall(3.3, height=1.7)),
    "second correction": partial(later, step=EVERY - 1),  # in the second of two steps
}
RESTS = {  # no point is corrected
    "free surface": partial(dense, heavy=1.0, pressure=SQUEEZED),
    "folds only": partial(dense, place=(59.2, 6.2, 0.0), terrain=CLIFF),
    "between corrections": partial(later, step=1),
}


def corrected(make, precision, steps=1):
    """`compared`, with what the correction meets in the first step.

    One step contains the correction and the stress that follows from its first part.
    """
    one, (other, found) = begun(make(precision)), on_device(make, precision, steps)
    least = float(one.arrays.rows[:, row.S0].min())
    reason = one.advance(1e9, max_steps=steps)
    here = difference(one, other) if found == reason else {"exact": False}
    here["least before"], barriers = least, one._barriers
    here["gained"] = one.balances()["energy_of_volume_corrections"]
    here["yield"] = float(one.arrays.yields[one.step % 2, ..., YIELD].max())
    here["folds"] = int(one._known_ground.folds.shape[0] > 1)
    if one.walls:
        part = barriers[..., FILLED]
        here["filled"] = int(((part > 0.0) & (part < 1.0)).sum())
        here["crests"] = float(barriers[..., FILLED_TOP].max())
        here["openings"] = int((barriers[..., SHARE] > 0.0).sum())
    return here


def corrections(make):
    """How often a step of `make` launches the correction."""
    return launched(make).count("correct_density")


def cases():
    """Name -> what answers the results of each case."""
    here = {f"launches {name}": partial(corrections, make) for name, make in (("fluid", dense), ("soil", slab))}
    for p in BOTH:
        here |= {f"{name} {p}": partial(corrected, make, p) for name, make in (ACTS | RESTS).items()}
        here[f"second correction {p}"] = partial(corrected, ACTS["second correction"], p, 2)
        here[f"permuted {p}"] = partial(permuted, ACTS["before a wall"], p, 1)
        here[f"permuted pool {p}"] = partial(permuted, ACTS["pool before a wall"], p, 1)
        here[f"resumed {p}"] = partial(resumed, ACTS["before a wall"], p, 2)
        here[f"other launch {p}"] = partial(other_launch, ACTS["ground that yields"], p, 1)
    return here


if __name__ == "__main__":
    print_results(cases())
