"""Frames of a block that slides down the slope of `slope_site` and out on level ground, with known values."""

import csv

import numpy as np
import pyproj
import shapely
from slope_site import FOOT, SOUTH, WEST, write_shapes, write_site

from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles

CRS = pyproj.CRS.from_epsg(32632)
DENSITY, THICKNESS, SIDE = 1000.0, 2.0, 100.0  # [kg m-3], [m] vertical, [m] of the block's square in plan
TANGENT, MIDDLE = 0.5, 200.0  # of the slope; northing of the block's middle from the site's corner
MASS = DENSITY * THICKNESS * SIDE**2
START, FRICTION = 150.0, 0.25
REST = START + TANGENT * (FOOT - START) / FRICTION  # where Coulomb friction stops a block without extent


def bed(x):
    return np.maximum(TANGENT * (FOOT - x), 0.0) + 100.0


def block(x, speed=0.0, dimension=2, spacing=5.0, layers=4):
    """Particles of the block whose middle is `x` [m] from the corner; `speed` [m s-1] is horizontal."""
    steps = np.arange(-SIDE / 2 + spacing / 2, SIDE / 2, spacing)
    east, north = (values.ravel() for values in np.meshgrid(x + steps, MIDDLE + steps))
    slope = np.where(east < FOOT, -TANGENT, 0.0)
    velocity = np.stack([np.full(len(east), speed), np.zeros(len(east)), speed * slope], axis=1)
    n, area = len(east), spacing**2
    if dimension == 2:
        position = np.stack([east, north, bed(east)], axis=1)
        extra = {"thickness": np.full(n, THICKNESS), "area": np.full(n, area)}
        volume = np.full(n, THICKNESS * area)
    else:
        heights = (np.arange(layers) + 0.5) * THICKNESS / layers
        position = np.concatenate([np.stack([east, north, bed(east) + height], axis=1) for height in heights])
        velocity, volume, extra = np.tile(velocity, (layers, 1)), np.full(n * layers, THICKNESS * area / layers), {}
    ids = np.arange(len(volume), dtype=np.uint64)
    return Particles(position, velocity, DENSITY * volume, volume, id=ids, **extra)


def table(path):
    """Rows of a CSV file by the names of its columns."""
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write_line(path, *places, crs="EPSG:32632"):
    """A line through `places`, (x, y) [m] from the site's corner; down the middle of the slope where none is given."""
    write_shapes(path, [shapely.LineString(places or [(20, MIDDLE), (780, MIDDLE)])], crs=crs)
    return path


def write_block_run(folder, places=(START, 350.0, REST), times=(0.0, 10.0, 20.0), speeds=None, dimension=2, **changes):
    """A folder `run` of frames with the block at `places` and the site's terrain; answers it."""
    write_site(folder)
    run = folder / "run"
    run.mkdir()
    (folder / "dtm.tif").rename(run / "terrain.tif")
    for step, (place, time) in enumerate(zip(places, times, strict=True)):
        speed = 0.0 if speeds is None else speeds[step]
        particles = block(place, speed, dimension)
        frame = Frame(
            particles,
            time=time,
            step=step,
            dimension=dimension,
            crs=CRS,
            origin=(WEST, SOUTH, 0.0),
            dem="terrain.tif",
            digest="b" * 64,
            header={"density": DENSITY},
        )
        for name, value in changes.items():
            object.__setattr__(frame, name, value)
        write_frame(run / f"frame_{step:06d}.h5", frame)
    return run
