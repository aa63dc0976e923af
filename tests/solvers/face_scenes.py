"""Bodies between ground and walls whose rest or slide is exact: full basins of any shape, a block along a wall."""

import numpy as np
import shapely
from column_scenes import terrain_of
from exact_solutions import G
from point_scenes import integrate_to, load_between, points_on, sorted_points
from scipy.optimize import brentq
from test_points_catalogue import cauchy_stress, elastic_of

from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import fluid
from mpmgis.laws.material_choice import wave_speed
from mpmgis.solvers.features.walls import Wall

DENSITY = 1000.0
CELL, DEEP, WIDE = 1.0, 10.0, 12.0  # of the basins [m]; they are three cells across
SOIL = elastic_of(50e6, 0.3)
SWING = 4.0 * DEEP / wave_speed(SOIL, DENSITY)  # slowest of a body as deep [s]
LOOKS = 16


def standing_wall(west, thickness=4.0, name="dam", mu=0.0):
    """A wall from `west` [m] across the whole terrain, higher than any flow."""
    return Wall(name, shapely.box(west, -50.0, west + thickness, 50.0), height=60.0, mu=mu)


def filled(bed, west, east, surface, width=3.0 * CELL, spacing=0.5 * CELL):
    """A Frame of points that fill the basin `bed(x)` [m] from `west` to `east` up to `surface` [m]."""
    y = spacing * (np.arange(round(width / spacing)) + 0.5)
    places, volumes = [], []
    for x in west + spacing * (np.arange(round((east - west) / spacing)) + 0.5):
        depth = surface - float(bed(x))
        count = round(depth / spacing)
        along, up = (part.ravel() for part in np.meshgrid(y, depth / count * (np.arange(count) + 0.5), indexing="ij"))
        places.append(np.column_stack([np.full(len(up), x), along, surface - depth + up]))
        volumes.append(np.full(len(up), spacing**2 * depth / count))
    position, volume = np.concatenate(places), np.concatenate(volumes)
    ids = np.arange(len(volume), dtype=np.uint64)
    return Frame(Particles(position, np.zeros_like(position), DENSITY * volume, volume, id=ids), dimension=3)


def resting_in(bed, length, west, east, surface, material, walls=(), cell=CELL):
    """A PointSolver of the body that fills `bed(x)` [m], smooth, under a hydrostatic stress.

    With -rho g (surface - z) I an elastic body is in equilibrium in any smooth basin, as a fluid is.
    """
    frame = filled(bed, west, east, surface)
    stress = np.zeros((len(frame.particles.id), 6))
    stress[:, :3] = -DENSITY * G * (surface - frame.particles.position[:, 2:])
    terrain = terrain_of(lambda x, y: bed(x), length, 3.0 * cell, cell)
    return points_on(
        terrain, frame, cell, material, friction_law("Coulomb", 0.0), stress=stress, walls=walls, edges="wall"
    )


def mean_stress(solver, start, end):
    """(normal stresses [n, 3] [Pa], places [n, 3] [m]) as means over LOOKS times from `start` to `end` [s]."""
    integrate_to(solver, start)
    stress = place = 0.0
    for until in np.linspace(start, end, LOOKS + 1)[1:]:
        integrate_to(solver, until)
        place = place + sorted_points(solver).position / LOOKS
        stress = stress + cauchy_stress(solver)[:, :3] / LOOKS
    return stress, place


def between_walls(degrees, above):
    """(vertical and lateral stress beside the western and the eastern wall over the exact one [2, 2], solver).

    A body rests between two barriers on smooth ground that rises to the east by `degrees`, `above` [cells] a node at
    the western one. Taken are the lowest two cells within two cells of the walls, over two swings after six.
    """
    west, rise = 7.0, np.tan(np.radians(degrees))
    east, base = west + WIDE, 20.0 + above * CELL
    surface = base + DEEP + max(0.0, WIDE * rise)

    def bed(x):
        return base + (x - west) * rise

    walls = standing_wall(west - 4.0, name="west"), standing_wall(east, name="east")
    solver = resting_in(bed, 28.0, west, east, surface, SOIL, walls)
    stress, place = mean_stress(solver, 6.0 * SWING, 8.0 * SWING)
    exact = -DENSITY * G * (surface - place[:, 2])
    lowest = (place[:, 2] - bed(place[:, 0])) * np.cos(np.radians(degrees)) < 2.0 * CELL
    ratios = []
    for near in (place[:, 0] - west < 2.0 * CELL, east - place[:, 0] < 2.0 * CELL):
        ratios.append([stress[near & lowest, k].sum() / exact[near & lowest].sum() for k in (2, 0)])
    return np.array(ratios), solver


def along_wall(
    degrees, time, material, place=0.0, azimuth=0.0, friction=25.0, cell=0.5, size=(3.0, 8.0, 1.5), settled=False
):
    """(distance moved [m], exact one [m], force into the wall over the exact one, solver) of a block after `time` [s].

    It lies between smooth ground, which leans towards a wall at 45 degrees, and that wall, and slides along it as on a
    bed of `degrees` with the angle of `friction`. The ground's outward normal is (lean, fall, 1) and the wall's (-1, 0,
    0), so the way is (0, 1, -fall), and the wall bears m g lean / (1 + fall^2). The wall's face lies `place` [cells]
    from a node, turned by `azimuth` [degrees]. A block that is `settled` starts at the place and with the stress
    at which it rests after 4 s, with one degree more friction than its slope where it would slide.
    """
    mu, pull, lean = np.tan(np.radians(friction)), np.tan(np.radians(degrees)), 1.0
    fall = brentq(lambda b: b * np.sqrt(1.0 + b * b) / lean - pull, 0.0, 10.0)
    cos, sin = np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))
    extent = 32.0
    middle = 0.5 * extent + place * cell

    def bed(x, y):
        x, y = x - middle, y - middle
        return 60.0 - lean * (x * cos + y * sin) - fall * (y * cos - x * sin)

    spacing = 0.5 * cell
    axes = [spacing * (np.arange(round(length / spacing)) + 0.5) for length in size]
    across, along, up = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    across, along = across - size[0], along - 0.75 * size[1]
    x, y = middle + across * cos - along * sin, middle + across * sin + along * cos
    start, n = np.column_stack([x, y, bed(x, y) + up]), len(x)
    volume, ids = np.full(n, spacing**3), np.arange(n, dtype=np.uint64)
    stress = None
    if settled:
        *_, before = along_wall(degrees, 4.0, material, place, azimuth, max(friction, degrees + 1.0), cell, size)
        start, stress = sorted_points(before).position, cauchy_stress(before)
        stress *= np.exp(stress[:, :3].mean(axis=1) / material.bulk_modulus)[:, None]  # J in small strains
    frame = Frame(Particles(start, np.zeros((n, 3)), 1500.0 * volume, volume, id=ids), dimension=3)
    corners = [
        (middle + a * cos - b * sin, middle + a * sin + b * cos) for a, b in ((0, -60), (4, -60), (4, 60), (0, 60))
    ]
    wall = Wall("dam", shapely.Polygon(corners), height=60.0, mu=mu)
    terrain = terrain_of(bed, extent, extent, cell)
    solver = points_on(
        terrain, frame, cell, material, friction_law("Coulomb", 0.0), stress=stress, walls=(wall,), edges="wall"
    )
    integrate_to(solver, time)
    down = np.array([-sin, cos, -fall]) / np.sqrt(1.0 + fall**2)
    bears = solver.mass_start * G * lean / (1.0 + fall**2)
    exact = 0.5 * max(G * fall / np.sqrt(1.0 + fall**2) - mu * bears / solver.mass_start, 0.0) * time**2
    force = solver.balances()["barriers"]["dam"]["normal_impulse"] / time
    return ((sorted_points(solver).position - start) @ down).mean(), exact, force / bears, solver


def pool_before_wall(seconds, place=0.3, material=None, long=16, wide=12, deep=5):
    """(share of the mass more than a hundredth of a cell inside a wall, force on it over the exact one, solver).

    A pool of `long` x `wide` x `deep` cells of 0.125 m is released 1.8 cells before a barrier, whose face lies `place`
    [cells] behind a node, and washes against it. The force is the mean of the last fifth of the `seconds`.
    """
    cell = 0.125
    face = (long + place) * cell
    frame = filled(lambda x: 0.0, 0.0, face - 1.8 * cell, deep * cell, wide * cell, 0.5 * cell)
    terrain = terrain_of(lambda x, y: 0.0 * x, (long + 8) * cell, wide * cell, cell)
    water = material or fluid(DENSITY * G * deep * cell * 100.0, 0.0, 0.0)
    walls = (standing_wall(face, 6.0 * cell),)
    solver = points_on(terrain, frame, cell, water, friction_law("Coulomb", 0.0), walls=walls, edges="wall")
    force = load_between(solver, 0.8 * seconds, seconds)
    mass, width = frame.particles.mass.sum(), wide * cell
    level = mass / (DENSITY * face * width)
    now = solver.frame().particles
    inside = now.mass[now.position[:, 0] > face + 0.01 * cell].sum() / mass
    return inside, force / (0.5 * DENSITY * G * level**2 * width), solver
