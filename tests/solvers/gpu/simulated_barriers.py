"""Cases of rigid barriers in the CUDA simulator against the CPU's kernels; prints what it found as JSON.

Run as `simulated_points.py`.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import shapely
import shapely.affinity
from simulated_points import (
    BOTH,
    COULOMB,
    SOFT,
    SOIL,
    VOELLMY,
    block_of,
    compared,
    launched,
    permuted,
    plane,
    points_on,
    print_results,
    resumed,
    slab,
    stretched_over,
    terrain_of,
    with_zones,
)

from mpmgis.solvers.features.walls import Wall
from mpmgis.solvers.gpu.device_barriers import own_rows
from mpmgis.solvers.points.point_barriers import BARRIER, POINT_BARRIER_ENTRIES
from mpmgis.solvers.points.point_faces import FACE_BARRIER, FACE_ENTRIES


def at_barrier(
    precision,
    *walls,
    degrees=0.0,
    x=57.5,
    y=12.2,
    z=0.0,
    speed=12.0,
    size=(1.5, 1, 1),
    contact=COULOMB,
    terrain=None,
    **options,
):
    """Points that run into `walls`, over a plane that falls to the east by `degrees`, `z` [m] above it."""
    frame = stretched_over(block_of(size, 0.5, (x - size[0], y, 0.0), velocity=(speed, 0.5, -1.0)), degrees, z)
    terrain = terrain or plane(degrees, 80.0, 24.0, 120.0, 4.0)
    options |= {"precision": precision, "maxima": True}
    return points_on(terrain, frame, 1.0, SOIL, contact, SOFT, walls=walls, **options)


def wall(west=57.5, thickness=4.0, height=20.0, mu=0.0, south=-50.0, name="dam"):
    """A wall across the flow."""
    return Wall(name, shapely.box(west, south, west + thickness, 80.0), height=height, mu=mu)


def with_opening(mu=0.2, height=20.0):
    """A wall with an opening a cell and a half wide before the flow."""
    whole = wall(mu=mu, height=height)
    return replace(whole, footprint=whole.footprint.difference(shapely.box(0.0, 12.1, 80.0, 13.6)))


def drawn(seed, precision):
    """Points that run into a wall; cell size, slope, contact, speed, and all of the wall drawn with a `seed`."""
    draw = np.random.default_rng(seed)
    cell, degrees, angle = draw.choice([0.5, 1.0, 2.0]), draw.uniform(-30.0, 30.0), draw.uniform(0.0, 360.0)
    thickness, height = draw.uniform(0.1, 5.0) * cell, draw.uniform(1.5, 20.0) * cell
    shape = shapely.affinity.rotate(shapely.box(40.0, -60.0, 40.0 + thickness, 80.0), angle, (40.0, 12.0))
    walls = (Wall("drawn", shape, height=height, mu=draw.choice([0.0, draw.uniform(0.1, 0.8)])),)
    across = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    frame = block_of((1.5 * cell, cell, cell), 0.5 * cell)
    place = frame.particles.position
    place += np.array([40.0, 12.0, 0.0]) - draw.uniform(0.2, 0.9) * cell * across - place.mean(axis=0) * [1.0, 1.0, 0.0]
    frame.particles.velocity[:] = draw.uniform(2.0, 15.0) * across + draw.uniform(-2.0, 2.0, 3)
    place[:, 2] += 120.0 - np.tan(np.radians(degrees)) * place[:, 0]
    options = {"precision": precision, "maxima": True}
    contact = (COULOMB, VOELLMY)[draw.integers(2)]
    return points_on(plane(degrees, 80.0, 24.0, 120.0, 4.0), frame, cell, SOIL, contact, SOFT, walls=walls, **options)


def cornered(mu, degrees=0.0):
    """An L whose inner corner is before the flow, turned by `degrees` about it."""
    corner = 57.5, 13.4
    shape = shapely.union_all([shapely.box(57.5, -50.0, 61.5, 17.4), shapely.box(30.0, 13.4, 61.5, 17.4)])
    return Wall("corner", shapely.affinity.rotate(shape, degrees, corner), height=20.0, mu=mu)


# A few cells wide and high, because folds take milliseconds a node in plain Python.
STEP = terrain_of(lambda x, y: np.where(x < 60.0, 120.0, 110.0), 80.0, 12.0, 4.0)
TURNED = Wall("turned", shapely.Polygon([(57.5, -9), (61.5, -9), (66.5, 60), (62.5, 60)]), height=20.0, mu=0.5)
BARRIERS = {
    "smooth face": lambda p: at_barrier(p, wall()),
    "face with friction": lambda p: at_barrier(p, wall(mu=0.5)),
    "face and drag": lambda p: at_barrier(p, wall(mu=0.5), contact=VOELLMY),
    "thin wall": lambda p: at_barrier(p, wall(57.9, 0.1, mu=0.3)),
    "overtopping": lambda p: at_barrier(p, wall(57.2, height=1.5, mu=0.3), x=58.4, z=1.0, size=(2.5, 1, 1.5)),
    "over a face": lambda p: at_barrier(p, wall(57.2, height=3.75, mu=0.3), x=58.0, z=2.0, size=(1.5, 1, 2)),
    "at a crest": lambda p: at_barrier(p, wall(57.2, height=6.3, mu=0.3), x=59.2, z=4.2, size=(2.5, 1, 2.5)),
    "opening": lambda p: at_barrier(p, with_opening(), x=58.6, size=(2.5, 1.5, 1)),
    "two barriers": lambda p: at_barrier(p, wall(mu=0.2), wall(56.0, 1.6, 1.0, 0.4, 13.0, "block"), x=57.4),
    "at the edge": lambda p: at_barrier(p, wall(mu=0.3), y=0.1, degrees=20.0, speed=4.0, edges="wall"),
    "at a cliff": lambda p: at_barrier(p, wall(57.2, 1.0, mu=0.3), terrain=STEP, y=6.2, z=0.3),
    "on friction zones": lambda p: with_zones(at_barrier(p, wall(mu=0.3))),
    "inner corner": lambda p: at_barrier(p, cornered(0.0), x=57.2, y=11.9, speed=6.0),
    "inner corner with friction": lambda p: at_barrier(p, cornered(0.4), x=57.2, y=11.9, contact=VOELLMY),
    "inner corner, turned": lambda p: at_barrier(p, cornered(0.0, 25.0), x=57.9, y=11.6),
    "turned on a slope": lambda p: at_barrier(p, TURNED, degrees=30.0, x=58.6, speed=1.5),
}
KERNELS = {
    *("share_face_rows", "weigh_face_rows", "weigh_face_columns", "settle_faces", "book_faces", "keep_before_faces"),
    *("press_on_crests", "hold_at_barriers", "sum_booked", "collect_barriers", "weigh_flow"),
}


def of_barriers(make):
    """Names of the kernels of barriers that one step launches."""
    return sorted(KERNELS.intersection(launched(make)))


def rows_of_loads(draws=30):
    """Node columns and faces of drawn barriers whose row is not one of their barrier's, or is another's too."""
    draw, worst = np.random.default_rng(5), 0
    for _ in range(draws):
        count = int(draw.integers(1, 9))
        barriers = np.zeros((*draw.integers(1, 30, 2), POINT_BARRIER_ENTRIES))
        barriers[..., BARRIER] = draw.integers(0, count + 1, barriers.shape[:2]) * draw.integers(0, 2)
        faces = np.zeros((draw.integers(0, 40), FACE_ENTRIES))
        faces[:, FACE_BARRIER] = draw.integers(0, count + 1, len(faces))
        columns, numbered, own, start = own_rows(barriers, faces, count)
        at = tuple(columns.T)
        rows = np.concatenate([numbered[at][:, BARRIER], own[own[:, FACE_BARRIER] > 0.0, FACE_BARRIER]]).astype(int) - 1
        of = np.concatenate([barriers[at][:, BARRIER], faces[faces[:, FACE_BARRIER] > 0.0, FACE_BARRIER]]).astype(int)
        wrong = (rows < start[of - 1]) | (rows >= start[of])
        worst += int(wrong.sum()) + len(rows) - len(set(rows.tolist())) + int(start[-1] - len(rows))
        worst += int((numbered[..., BARRIER] > 0.0).sum() != (barriers[..., BARRIER] > 0.0).sum())
    return {"worst": worst, "cases": draws}


def cases():
    """Name -> what answers the results of each case."""
    here = {"rows of loads": rows_of_loads}
    for p in BOTH:
        here |= {f"{name} {p}": partial(compared, make, p, 2) for name, make in BARRIERS.items()}
        here |= {f"drawn {seed} {p}": partial(compared, partial(drawn, seed), p, 2) for seed in (0, 1, 3, 11)}
        here[f"permuted {p}"] = partial(permuted, BARRIERS["two barriers"], p, 2)
        here[f"permuted opening {p}"] = partial(permuted, BARRIERS["opening"], p, 2)
        here[f"resumed {p}"] = partial(resumed, BARRIERS["two barriers"], p, 2)
    scenes = {"slab": slab} | {name: BARRIERS[name] for name in ("two barriers", "overtopping", "opening")}
    return here | {f"launched {name}": partial(of_barriers, make) for name, make in scenes.items()}


if __name__ == "__main__":
    print_results(cases())
