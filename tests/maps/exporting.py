"""Terrains, frames and a naive exporter for the tests of the export."""

import math
from types import SimpleNamespace

import numpy as np
import pyproj
import shapely
from affine import Affine

from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import Quantity
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

CRS = pyproj.CRS.from_epsg(32632)
WEST, NORTH = 600000.0, 5170200.0
AFFINES = {
    "north-up": Affine(5, 0, WEST, 0, -5, NORTH),
    "oblong": Affine(4, 0, WEST, 0, -6, NORTH),
    "south-up": Affine(5, 0, WEST, 0, 5, NORTH - 200),
    "rotated": Affine(4.5, -2.1, WEST + 60, -2.1, -4.5, NORTH - 20),
    "sheared": Affine(5, 1.5, WEST, -0.7, -4.5, NORTH),
}


def surface(x, y):
    """Elevation [m]: a slope of about 30 degrees with bumps, and a cliff of 12 m."""
    u, v = x - WEST, y - NORTH
    return 900 - 0.5 * u + 0.1 * v + 5 * np.sin(u / 17) * np.cos(v / 23) - 12 * (u > 120)


def terrain(transform=AFFINES["north-up"], shape=(40, 36), holes=()):
    """A terrain on `surface` with nodata at the (row, column) `holes`."""
    grid = Grid(CRS, transform, shape)
    row, column = np.mgrid[: shape[0], : shape[1]]
    elevation = surface(*grid.xy(row, column))
    for hole in holes:
        elevation[hole] = np.nan
    return Terrain(grid, elevation)


def random_frame(ground, count=400, dimension=3, seed=0, margin=0.05, time=0.0, mass=None):
    """Random particles on and around `ground`, of unequal mass; also on pixel borders."""
    random = np.random.default_rng(seed)
    rows, columns = ground.grid.shape
    row = random.uniform(-0.5 - margin * rows, rows - 0.5 + margin * rows, count)
    column = random.uniform(-0.5 - margin * columns, columns - 0.5 + margin * columns, count)
    if ground.grid.transform.b == 0:  # elsewhere rounding decides who owns a border
        row[: count // 20] = np.round(row[: count // 20]) + 0.5
    x, y = ground.grid.xy(row, column)
    origin = np.array([WEST, NORTH - 200, 500.0])
    area = random.uniform(1, 60, count)
    thickness = random.uniform(0.2, 3, count)
    height = surface(x, y) + (0 if dimension == 2 else random.uniform(-0.5, 4, count))
    position = np.stack([x, y, height], axis=1) - origin
    velocity = random.normal(0, 10, (count, 3))
    mass = 1200.0 * area * thickness if mass is None else np.full(count, mass)
    extra = {"area": area, "thickness": thickness} if dimension == 2 else {}
    particles = Particles(position, velocity, mass, area * thickness, id=np.arange(count, dtype=np.uint64), **extra)
    return Frame(particles, time=time, dimension=dimension, crs=CRS, origin=tuple(origin), header={"density": 1200.0})


def write_run(folder, times=(0.0, 1.0, 2.0), dimension=2, count=300, ground=None, drift=6.0, **changes):
    """Write a terrain and frames with particles that move downhill; returns the paths of the frames."""
    ground = ground or terrain()
    frames = []
    for step, time in enumerate(times):
        frame = random_frame(ground, count, dimension, seed=3, margin=-0.2, time=float(time))
        position = frame.particles.position
        position[:, 0] += drift * time
        position[:, 2] = surface(position[:, 0] + WEST, position[:, 1] + NORTH - 200) - 500
        if dimension == 3:
            position[:, 2] += np.random.default_rng(step).uniform(0, 2, count)
        frames.append(frame)
    return write_frames(folder, ground, frames, **changes)


def sheet_frames(speed, times, side=20):
    """Frames of a sheet of `side` x `side` points of 1 m3 above `surface` that all move east at `speed` [m s-1]."""
    frames = []
    for time in times:
        east, north = np.meshgrid(np.linspace(30, 80, side), np.linspace(60, 140, side))
        x, y = east.ravel() + speed * time, north.ravel() - 200.0
        position = np.stack([x, y, surface(x + WEST, y + NORTH) - 500 + 0.5], axis=1)
        velocity = np.tile([float(speed), 0.0, 0.0], (len(x), 1))
        volume = np.ones(len(x))
        particles = Particles(position, velocity, 1200.0 * volume, volume, id=np.arange(len(x), dtype=np.uint64))
        header = {"density": 1200.0, "cell_size": 2.0}
        frames.append(
            Frame(particles, time=float(time), dimension=3, crs=CRS, origin=(WEST, NORTH, 500.0), header=header)
        )
    return frames


def write_frames(folder, ground, frames, **changes):
    """Write some `frames` and their terrain; returns the paths of the frames."""
    folder.mkdir(parents=True, exist_ok=True)
    write_geotiff(folder / "terrain.tif", ground.grid, [(Quantity("elevation", "m", ""), ground.elevation)], {})
    paths = []
    for step, frame in enumerate(frames):
        values = {**vars(frame), "step": step, "dem": "terrain.tif", "digest": "d" * 64} | changes
        paths.append(folder / f"frame_{step:06d}.h5")
        write_frame(paths[-1], Frame(**values))
    return paths


# --- the naive exporter: one particle and one cell at a time, as the equations are written ---------------------------


def pixel_of(grid, x, y):
    """(row, column) of the pixel of a point; a point on a border belongs to the larger row and column."""
    t = grid.transform
    (row, column) = np.linalg.solve([[t.b, t.a], [t.e, t.d]], [x - t.c, y - t.f])
    return math.floor(round(row, 9)), math.floor(round(column, 9))


def naive_ground(ground, frame, p, kind):
    """Pixel (i, j), distance, normal of particle `p`; None outside or on nodata (Eqs 2, 3, 5, 6, 7)."""
    x, y, z = frame.particles.position[p] + np.array(frame.origin)
    i, j = pixel_of(ground.grid, x, y)
    if not (0 <= i < ground.grid.shape[0] and 0 <= j < ground.grid.shape[1]) or math.isnan(ground.elevation[i, j]):
        return None
    east, north = (ground.gradient if kind == "plane" else ground.limited_gradient)[i, j]
    bed = math.nan
    if kind == "bilinear":
        bed = float(ground.sample(x, y))
    if math.isnan(bed):
        centre_x, centre_y = ground.grid.xy(i, j)
        bed = ground.elevation[i, j] + east * (x - centre_x) + north * (y - centre_y)
    normal = np.array([-east, -north, 1]) / math.sqrt(1 + east**2 + north**2)
    return SimpleNamespace(distance=(z - bed) * normal[2], normal=normal)


def naive_cells(ground, frame, grid, kind, percentile=100.0, density=1200.0):
    """(row, column) -> values of every product, one particle at a time."""
    particles, cells = frame.particles, {}
    for p in range(len(particles)):
        here = naive_ground(ground, frame, p, kind)
        x, y, _ = particles.position[p] + np.array(frame.origin)
        home = pixel_of(grid, x, y)
        if here is None or not (0 <= home[0] < grid.shape[0] and 0 <= home[1] < grid.shape[1]):
            continue
        for cell, share, covered in _shares(frame, p, x, y, grid, home):
            members = cells.setdefault(cell, [])
            members.append(
                SimpleNamespace(
                    here=here,
                    mass=particles.mass[p] * share,
                    covered=covered,
                    velocity=particles.velocity[p],
                    is_home=cell == home,
                )
            )
    return {cell: _products(members, frame, grid, percentile, density) for cell, members in cells.items()}


def _shares(frame, p, x, y, grid, home):
    """(cell, share of the particle, share of the cell covered); a point lies in one cell."""
    if frame.dimension == 3:
        return [(home, 1.0, 0.0)]
    half = 0.5 * math.sqrt(frame.particles.area[p])
    square, t = shapely.box(x - half, y - half, x + half, y + half), grid.transform
    parts = []
    reach = int(half / min(grid.transform.a, -grid.transform.e)) + 2
    for i in range(max(home[0] - reach, 0), min(home[0] + reach + 1, grid.shape[0])):
        for j in range(max(home[1] - reach, 0), min(home[1] + reach + 1, grid.shape[1])):
            cell = shapely.box(t.c + j * t.a, t.f + i * t.e, t.c + (j + 1) * t.a, t.f + (i + 1) * t.e)
            overlap = square.intersection(cell).area
            if overlap > 1e-9 * grid.cell_area:
                parts.append(((i, j), overlap))
    whole = sum(overlap for _, overlap in parts)
    return [(cell, overlap / whole, overlap / grid.cell_area) for cell, overlap in parts]


def _products(members, frame, grid, percentile, density):
    mass = sum(m.mass for m in members)
    upright = sum(m.mass * m.here.normal[2] for m in members)
    mean = sum(m.mass * m.velocity for m in members) / mass
    normal = sum(m.mass * m.velocity.dot(m.here.normal) for m in members) / mass
    parallel = sum(m.mass * (m.velocity - m.velocity.dot(m.here.normal) * m.here.normal) for m in members) / mass
    t_vol = upright / density / grid.cell_area
    if frame.dimension == 2:
        depth = thickness = t_vol / min(1.0, sum(m.covered for m in members))
    else:
        ranked = sorted(members, key=lambda m: m.here.distance)
        below = 0.0
        for m in ranked:
            below += m.mass
            if below >= percentile / 100 * mass * (1 - 1e-12):
                break
        depth, thickness = max(0.0, m.here.distance), m.here.distance - ranked[0].here.distance
    return {
        "h": depth,
        "t": thickness,
        "t_vol": t_vol,
        "Un": normal,
        "Ut": math.hypot(*parallel),
        "Ut_E": parallel[0],
        "Ut_N": parallel[1],
        "n": sum(m.is_home for m in members),
        "mass": mass / grid.cell_area,
        "p": density * mean.dot(mean),
    }
