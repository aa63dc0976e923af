"""Dry sand down a flume onto a wall (set-up of Moriguchi et al. 2009), through the commands: force on the wall.

python tests/scenes/sand_flume/make.py FOLDER [--angle 45 --cell 0.04 --mu 0.45]
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain

from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles

GRAVITY, DENSITY, MU = 9.81, 1379.0, 0.45
MASS, WIDTH, PATH = 50.0, 0.3, 1.8  # [kg], [m] across, [m] along the floor from the sand's front to the wall
BOX = 0.4, MASS / (DENSITY * WIDTH * 0.4)  # [m], length along and height across the floor
WIDE, PER_CELL, BEHIND = 3, 2, 4  # cells across the strip, points along a cell's side, cells behind the wall's face
WINDOW = 0.05  # [s] over which the largest force is a mean


class Size(NamedTuple):
    """Angle of the floor [deg] and cell [m]."""

    angle: float = 45.0
    cell: float = 0.04

    @property
    def wall(self):
        """x [m] of the wall's face, whole cells."""
        return float(np.ceil(((PATH + BOX[0]) * np.cos(np.radians(self.angle)) + BOX[1]) / self.cell) * self.cell)


def write_inputs(folder, size):
    """The floor, which falls to 0 at the wall, the sand and the wall, of a strip WIDE cells wide."""
    slope, cell, width = np.radians(size.angle), size.cell, WIDE * size.cell
    x = (np.arange(round(size.wall / cell) + BEHIND) + 0.5) * cell
    chain.write_raster(folder / "dtm.tif", np.tile((size.wall - x) * np.tan(slope), (WIDE, 1)), 0.0, width, cell)
    wall = shapely.box(size.wall, -cell, size.wall + (BEHIND + 1) * cell, width + cell)
    chain.write_polygons(folder / "wall.geojson", [wall], None)
    spacing = cell / PER_CELL
    counts = round(BOX[0] / spacing), WIDE * PER_CELL, round(BOX[1] / spacing)
    axes = [(np.arange(count) + 0.5) * spacing for count in counts]
    along, y, up = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    before = PATH + BOX[0] - along  # [m] along the floor to the wall's foot
    cos, sin = np.cos(slope), np.sin(slope)
    position = np.column_stack([size.wall - before * cos + up * sin, y, before * sin + up * cos])
    volume = np.full(len(y), MASS / DENSITY * width / WIDTH / len(y))
    sand = Particles(position, np.zeros_like(position), DENSITY * volume, volume)
    write_frame(folder / "sand.h5", Frame(sand, dimension=3, time=0.0, header={"density": DENSITY}))


def make(folder, size, **changed):
    """The run in `folder`; answers its record."""
    folder = chain.fresh(folder)
    write_inputs(folder, size)
    chain.write_scene("sand_flume", folder, cell_size=size.cell, **changed)
    return chain.run_scene(folder)[0]


def at_rest(angle, mu=MU):
    """Force [N] of 50 kg on a smooth vertical wall whose friction on the floor, all of it, holds it back."""
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return MASS * GRAVITY * (sin - mu * cos) / (cos + mu * sin)


def arrival(angle, mu=MU):
    """When [s] a rigid block from the sand's place is at the wall."""
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.sqrt(2.0 * PATH / (GRAVITY * (sin - mu * cos)))


class Load(NamedTuple):
    """On a wall 0.3 m wide."""

    arrival: float  # [s], of the first force
    peak: float  # [N], largest mean of WINDOW
    at: float  # [s]
    last: float  # [N], mean of the last 0.3 s


def load(folder, size):
    """The Load of a run."""
    time, force = chain.loads(folder, *chain.FORCE)
    force *= WIDTH / (WIDE * size.cell)
    every = float(np.median(np.diff(time)))
    count = max(1, round(WINDOW / every))
    mean = np.convolve(force, np.ones(count) / count, "same")
    top = int(np.argmax(mean))
    last = force[time > time[-1] - 0.3].mean()
    return Load(float(time[np.argmax(force > 1.0)]), float(mean[top]), float(time[top]), float(last))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--angle", type=float, default=45.0, help="of the floor [deg]")
    parser.add_argument("--cell", type=float, default=0.04, help="[m]")
    parser.add_argument("--mu", type=float, default=MU, help="friction of the floor")
    asked = parser.parse_args()
    size = Size(asked.angle, asked.cell)
    record = make(asked.folder, size, mu=asked.mu)
    found = load(asked.folder, size)
    row = [
        f"{value:.3g}"
        for value in (size.angle, size.cell, *found, arrival(size.angle, asked.mu), at_rest(size.angle, asked.mu))
    ]
    header = ["angle", "cell", "arrival [s]", "peak [N]", "at [s]", "last [N]", "block arrives [s]", "at rest [N]"]
    print(chain.table([row], header))
    print("volume:", record["volume"])


if __name__ == "__main__":
    main()
