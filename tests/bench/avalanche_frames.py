"""Frames of an ice avalanche over a cliff with any number of points: input for the export of a large 3D run.

The size is that of the Whymper case (Vicari et al. 2025, NHESS 25:3897): 150 000 m3 in 900 000 points, 150 s, 50 m/s.
The motion is that of mass points: one slice after the other is released. Each point slides with its own friction, which
stretches the flow, flies over the cliff, keeps its velocity along the ground where it lands, and stops. There is no
solver, but speeds, thicknesses, an airborne part and a deposit are like those of a flow.
"""

from functools import cached_property

import numpy as np
import pyproj

from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import Quantity
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

GRAVITY = 9.81
END_TIME, STEP = 150.0, 0.05  # s
BREAKING = 90.0  # s: time in which the release comes off in slices, from the front to the tail
LENGTH, WIDTH, CELL = 1500.0, 700.0, 2.0  # m: the terrain and its pixel
BLOCK = (60.0, 100.0, 25.0)  # m: length, width and height of the release, 150 000 m3
START, CLIFF, DROP = 60.0, 420.0, 40.0  # m from the west: tail of the block, cliff edge; height of the cliff
FRICTIONS = np.linspace(0.33, 0.75, 12)
DENSITY = 850.0  # kg m-3
BLOCK_SIDE = 4.0  # m: four cells of the solver
CRS = pyproj.CRS.from_epsg(32632)
CORNER = np.array([400000.0, 5080000.0, 2000.0])  # of the terrain's south-western corner


def profile(x):
    """Elevation [m] along the path: 40 degrees, a cliff, 30 degrees that decrease to level ground."""
    steep = np.tan(np.radians(40.0)) * (CLIFF - np.minimum(x, CLIFF)) + DROP * (x < CLIFF)
    below = np.clip(x - CLIFF, 0.0, None)
    return steep + 150.0 - 0.577 * 500.0 * (1 - np.exp(-below / 500.0))


def rough(x, y):
    """Elevation [m] added across the path: a wide trough, and bumps of a metre and of ten centimetres."""
    trough = 0.0004 * (y - WIDTH / 2) ** 2
    return trough + np.sin(x / 17.0) * np.cos(y / 23.0) + 0.1 * np.sin(x / 2.3 + y / 3.1)


def surface(x, y):
    """Elevation [m] over the foot of the terrain; `x`, `y` [m] from its south-western corner."""
    return profile(x) + rough(x, y)


def terrain():
    """The terrain of the frames, in pixels of 2 m."""
    rows, columns = int(WIDTH / CELL), int(LENGTH / CELL)
    grid = Grid.north_up(CRS, CORNER[0], CORNER[1] + WIDTH, CELL, (rows, columns))
    x, y = grid.xy(*np.mgrid[:rows, :columns])
    return Terrain(grid, CORNER[2] + surface(x - CORNER[0], y - CORNER[1]))


class Avalanche:
    """The event with `count` points.

    Parameters
    ----------
    count : int
    """

    def __init__(self, count):
        random = np.random.default_rng(2025)
        self.count = count
        self.along, across, self.up = (random.random(count) for _ in range(3))
        self.across = (across - 0.5) * BLOCK[1]
        # the front starts first and moves longest: less friction
        share = np.clip(1.0 - self.along + random.normal(0.0, 0.15, count), 0.0, 1.0)
        self.friction = share * (len(FRICTIONS) - 1)
        self.volume = np.full(count, np.prod(BLOCK) / count)

    @cached_property
    def paths(self):
        """float64[times, starts, frictions, 4]: distance, height over the profile [m], and their rates [m s-1]."""
        return _paths(START + np.linspace(0.0, BLOCK[0], 13), FRICTIONS)

    def frame(self, time, step=0):
        """Frame of all points at `time` [s]."""
        x, lifted, u, rise = self._on_path(time)
        spread = 1.0 + np.clip(x - START - BLOCK[0], 0.0, None) / 600.0  # wider as it goes
        thickness = np.where(x < CLIFF, BLOCK[2], 0.7 * BLOCK[2]) / spread**1.5
        y = WIDTH / 2 + self.across * spread
        z = surface(x, y) + lifted + self.up * thickness
        slope_east, slope_north = (
            (surface(x + dx, y + dy) - surface(x - dx, y - dy)) / 1.0 for dx, dy in ((0.5, 0), (0, 0.5))
        )
        v = np.where(np.abs(x - CLIFF) > 1.0, u * self.across / 600.0, 0.0)
        along_ground = np.where(np.abs(slope_east) < 3.0, u * slope_east + v * slope_north, 0.0)
        w = np.where(lifted > 0.1, rise, along_ground)
        order = np.lexsort((y // BLOCK_SIDE, x // BLOCK_SIDE))  # as our solver leaves its points: block after block
        particles = Particles(
            np.stack([x, y, z], axis=1)[order],
            np.stack([u, v, w], axis=1)[order],
            (DENSITY * self.volume)[order],
            self.volume[order],
            id=order.astype(np.uint64),
        )
        return Frame(
            particles,
            time=time,
            step=step,
            dimension=3,
            solver="points",
            crs=CRS,
            origin=tuple(CORNER),
            dem="terrain.tif",
            digest="bench",
            header={"density": DENSITY, "cell_size": 1.0},
        )

    def _on_path(self, time):
        """Distance, height over the profile and their rates of every point, interpolated between the computed paths."""
        paths = self.paths
        k = np.rint(np.clip(time - BREAKING * (1.0 - self.along), 0.0, END_TIME) / STEP).astype(int)
        start = self.along * (paths.shape[1] - 1)
        i, j = (
            np.minimum(start.astype(int), paths.shape[1] - 2),
            np.minimum(self.friction.astype(int), paths.shape[2] - 2),
        )
        s, f = (start - i)[:, None], (self.friction - j)[:, None]
        low = paths[k, i, j] * (1 - s) + paths[k, i + 1, j] * s
        high = paths[k, i, j + 1] * (1 - s) + paths[k, i + 1, j + 1] * s
        return (low * (1 - f) + high * f).T


def write_frames(folder, times, count):
    """Write the event with `count` points at `times` [s] as the folder of a run; returns the paths of its frames."""
    folder.mkdir()
    ground, event = terrain(), Avalanche(count)
    write_geotiff(folder / "terrain.tif", ground.grid, [(Quantity("elevation", "m", ""), ground.elevation)], {})
    paths = [folder / f"frame_{step:06d}.h5" for step in range(len(times))]
    for step, (path, time) in enumerate(zip(paths, times, strict=True)):
        write_frame(path, event.frame(float(time), step))
    return paths


def _paths(starts, frictions):
    """Integrate mass points down the profile; they leave the ground where it falls faster than they do."""
    x, mu = (grid.copy() for grid in np.meshgrid(starts, frictions, indexing="ij"))
    lifted, u, rise = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    kept = []
    for _ in range(int(END_TIME / STEP) + 1):
        kept.append(np.stack([x, lifted, u, rise], axis=-1))
        flying = lifted > 0.05
        tangent = (profile(x + 0.5) - profile(x - 0.5)) / 1.0
        tangent = np.where(np.abs(x - CLIFF) < 0.6, -0.839, tangent)
        cosine2 = 1.0 / (1.0 + tangent**2)
        push = -GRAVITY * cosine2 * tangent
        brake = mu * GRAVITY * cosine2
        slid = np.where(u > 0, np.maximum(u + STEP * (push - brake), 0.0), np.maximum(STEP * (push - brake), 0.0))
        u = np.where(flying, u, slid)
        height = profile(x) + lifted
        x = x + STEP * u
        rise = np.where(flying, rise - GRAVITY * STEP, u * tangent)
        fallen = height + STEP * rise - profile(x)
        lifted = np.where(fallen > 0.05, fallen, 0.0)
    return np.array(kept)
