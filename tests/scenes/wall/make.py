"""MOX report 15/2025, 4.4.1, with the commands of mpmgis: water flows down a plane and hits a wall.

python tests/scenes/wall/make.py FOLDER [--width 1 --cell 0.1] [--png FOLDER]
"""

import argparse
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain
import profiles
import shallow_water

LENGTH, FOOT, FLOOR, WALL = 40.0, 10.0, 6.67, 20.0  # [m]; the domain of the paper ends at 25 m, this one is longer
RELEASE, SURFACE = (1.5, 5.0), 9.5  # [m]
DENSITY, GRAVITY = 1000.0, 9.81
BOX = WALL - 0.25  # [m], end of the 3D box of the scene as printed; no flow may start inside a barrier
PIXEL = 0.1  # [m]
THIN = 0.01  # [m], depth at the front
AT_WALL = 1.0  # [m] before the wall, in which run-up is measured
BERNOULLI = np.sqrt(2.0 * GRAVITY * (SURFACE - FLOOR))  # 7.45 m/s: speed that the whole head gives
SHEET = 0.02  # run-up is the height above which this share of the mass is; the higher points are splash


class Size(NamedTuple):
    """Width of the channel [m], a whole number of cells, and cell size of columns and points [m]."""

    width: float = 5.0
    cell: float = 0.0625


def bed(x):
    """Bed of Eq 11 [m], with the step of 3.3 mm at the foot, as printed."""
    return np.where(x < FOOT, 10.0 - x / 3.0, FLOOR)


def write_inputs(folder, width):
    """Write DTM, surface, release and wall of a channel `width` [m] wide."""
    x = (np.arange(round(LENGTH / PIXEL)) + 0.5) * PIXEL
    rows = round(width / PIXEL)
    chain.write_raster(folder / "dtm.tif", np.tile(bed(x), (rows, 1)), 0.0, width, PIXEL)
    chain.write_raster(folder / "surface.tif", np.full((rows, len(x)), SURFACE), 0.0, width, PIXEL)
    chain.write_polygons(folder / "release.geojson", [shapely.box(RELEASE[0], 0.0, RELEASE[1], width)], None)
    chain.write_polygons(folder / "wall.geojson", [shapely.box(WALL, -1.0, WALL + 3.0, width + 1.0)], None)
    chain.write_polygons(folder / "box.geojson", [shapely.box(0.0, -1.0, BOX, width + 1.0)], None)


def scene_in(folder, name, size, **changed):
    """Write the inputs and the scene `name` with the given `size` to `folder`; returns the folder."""
    folder = chain.fresh(folder)
    write_inputs(folder, size.width)
    chain.write_scene(name, folder, cell_size=size.cell, **changed)
    return folder


def make_free(folder, size):
    """Run the scene without a wall; returns the record of the run."""
    return chain.run_scene(scene_in(folder, "wall/free", size))[0]


def make_wall(folder, size, **changed):
    """Run the scene with the wall, first columns, then points; returns the record of the run."""
    return chain.run_scene(scene_in(folder, "wall", size, **changed))[0]


def make_printed(folder, free, size, **changed):
    """Run the scene as printed, from the last frame of the run in `free`; returns the record of the run."""
    folder = scene_in(folder, "wall/printed", size, **changed)
    shutil.copy(sorted((free / "results").glob("frame_*.h5"))[-1], folder / "columns.h5")
    return chain.run_scene(folder)[0]


def depth_along(x, volume, width, cell):
    """Depth [m] in cells along the channel, from the volumes of particles in them."""
    found = np.bincount((x / cell).astype(int), volume, minlength=round(LENGTH / cell))
    return found / (cell * width)


def front_of(depth, cell):
    """x [m] to which the water is at least THIN deep, without a gap from the deepest cell; drops beyond are ignored."""
    deepest = int(np.argmax(depth))
    thin = np.nonzero(depth[deepest:] < THIN)[0]
    return (deepest + (thin[0] if len(thin) else len(depth) - deepest)) * cell


class Slide(NamedTuple):
    """A flow along the channel over time, float64[frames]."""

    time: np.ndarray  # [s]
    front: np.ndarray  # [m]
    speed: np.ndarray  # [m s-1], mean of |U| over the mass
    past: np.ndarray  # [1], share of the mass beyond the position of the wall

    def arrival(self):
        """Time [s] at which the front reaches the position of the wall."""
        return float(np.interp(WALL, np.maximum.accumulate(self.front), self.time))


def slide_of(folder, width, cell=0.25):
    """The Slide of a run of columns."""
    rows = []
    for frame in chain.frames(folder):
        x, mass = chain.placed(frame)[:, 0], frame.particles.mass
        speed = np.average(np.linalg.norm(frame.particles.velocity, axis=1), weights=mass)
        front = front_of(depth_along(x, frame.particles.volume, width, cell), cell)
        rows.append((frame.time, front, speed, mass[x > WALL].sum() / mass.sum()))
    return Slide(*np.array(rows).T)


def finite_volumes(times, end=LENGTH, cell=0.01):
    """(cell centres [m], Lines) of the same water by finite volumes, with a wall at x = `end`."""
    x = (np.arange(round(end / cell)) + 0.5) * cell
    wet = (x > RELEASE[0]) & (x < RELEASE[1])
    depth = np.where(wet, np.maximum(SURFACE - bed(x), 0.0), 0.0)
    return x, shallow_water.march(depth, bed(x), cell, times)


def slide_by_finite_volumes(times):
    """The Slide of finite volumes without a wall; speeds are along the bed, like those of columns."""
    x, lines = finite_volumes(times)
    cell = x[1] - x[0]
    steep = np.where(x < FOOT, np.hypot(1.0, 1.0 / 3.0), 1.0)
    rows = []
    for line in lines:
        volume = line.depth.sum()
        speed = (line.depth * np.abs(line.speed) * steep).sum() / volume
        rows.append((line.time, front_of(line.depth, cell), speed, line.depth[x > WALL].sum() / volume))
    return Slide(*np.array(rows).T)


class Impact(NamedTuple):
    """What happens at the wall over time, float64[frames] of the 3D part."""

    time: np.ndarray  # [s]
    run_up: np.ndarray  # [m], elevation above which SHEET of the mass is, near the wall
    top: np.ndarray  # [m], of the highest point
    splash: np.ndarray  # [1], share of the mass above the release's surface
    fastest: np.ndarray  # [m s-1]
    over: np.ndarray  # [1], share of the mass faster than the whole head allows
    energy: np.ndarray  # [J], kinetic and potential above the floor
    volume: np.ndarray  # [1], over the volume at rest


def impact_of(folder):
    """The Impact of the 3D frames of a run."""
    rows = []
    for frame in chain.frames(folder):
        if frame.dimension != 3:
            continue
        place, particles = chain.placed(frame), frame.particles
        mass, speed = particles.mass, np.linalg.norm(particles.velocity, axis=1)
        total, up = mass.sum(), place[:, 2]
        rows.append(
            (
                frame.time,
                height_exceeded(up, mass, place[:, 0] > WALL - AT_WALL),
                up.max(),
                mass[up > SURFACE].sum() / total,
                speed.max(),
                mass[speed > BERNOULLI].sum() / total,
                (0.5 * mass * speed**2 + mass * GRAVITY * (up - FLOOR)).sum(),
                particles.volume.sum() * DENSITY / total,
            )
        )
    return Impact(*np.array(rows).T)


def height_exceeded(up, mass, near):
    """Elevation [m] above which the points that are `near` have SHEET of the total mass; the floor if there is none."""
    order = np.argsort(-up[near])
    above = np.cumsum(mass[near][order]) / mass.sum()
    return float(up[near][order][np.searchsorted(above, SHEET)]) if len(above) and above[-1] > SHEET else FLOOR


def load_by_finite_volumes(times, width):
    """(force [N], depth at the wall [m]) of shallow water on the wall at `times` [s]."""
    _, lines = finite_volumes(times, WALL)
    depth = np.array([line.depth[-1] for line in lines])
    return 0.5 * DENSITY * GRAVITY * depth**2 * width, depth


def side_view(axis, frame, text, fastest, east=22.0):
    """Draw points in the channel seen from the south, coloured by speed; returns the artist for a colour bar."""
    place, speed = chain.placed(frame), np.linalg.norm(frame.particles.velocity, axis=1)
    some = slice(None, None, max(1, len(speed) // 40_000))
    x = np.linspace(0.0, east, 400)
    axis.fill_between(x, FLOOR - 0.4, bed(x), color="0.75", lw=0)
    axis.fill_between([WALL, east], FLOOR, 11.4, color="0.35", lw=0)
    seen = axis.scatter(
        place[some, 0], place[some, 2], c=speed[some], s=0.6, lw=0, cmap="turbo", vmin=0.0, vmax=fastest
    )
    axis.axhline(SURFACE, color="black", lw=0.4, ls=":")
    axis.set(xlim=(8.0, east), ylim=(FLOOR - 0.4, 11.4), ylabel="z [m]", aspect="equal")
    axis.text(8.2, 10.7, text, fontsize=9)
    return seen


def sequence_figure(folder, times, png, origin=0.0, fastest=10.0):
    """Draw side views at `times` [s]."""
    figure, axes = profiles.picture(len(times), 1, (8.0, 2.6 * len(times)), sharex=True)
    for axis, frame in zip(axes[:, 0], chain.nearest(folder, times, origin), strict=True):
        kind = "columns, at their bed" if frame.dimension == 2 else f"{len(frame.particles)} points"
        seen = side_view(axis, frame, f"T = {origin + frame.time:.2f} s, {kind}", fastest)
    axes[-1, 0].set_xlabel("x [m]")
    figure.colorbar(seen, ax=axes[:, 0], label="speed [m/s]", shrink=0.5)
    profiles.save(figure, png)


def columns_figure(slide, width, png):
    """Draw front and mean speed over time: columns, finite volumes, the paper."""
    exact = slide_by_finite_volumes(np.arange(1, 61) * 0.05)
    figure, ((front, speed),) = profiles.picture(1, 2, (10.0, 4.0))
    front.plot(slide.time, slide.front, label="columns")
    front.plot(exact.time, exact.front, "k--", lw=1, label="finite volumes")
    front.plot(*rigid_front(), color="gray", ls=":", label="rigid block from x = 5 m")
    front.axhline(WALL, color="0.4", lw=0.5)
    front.plot(3.3, WALL, "r*", ms=10, label="impact in the paper")
    front.set(xlabel="time [s]", ylabel="front, deeper than 1 cm [m]")
    speed.plot(slide.time, slide.speed, label="columns")
    speed.plot(exact.time, exact.speed, "k--", lw=1, label="finite volumes")
    speed.plot(3.0, 6.8, "r*", ms=10, label="'constant velocity' in the paper")
    speed.set(xlabel="time [s]", ylabel="mean speed over the mass [m/s]")
    for axis in (front, speed):
        axis.legend(fontsize=8)
    profiles.save(figure, png)


def rigid_front():
    """(times [s], positions [m]) of a block that slides from x = 5 m without friction and without loss at the foot."""
    sine, cosine = 1.0 / np.sqrt(10.0), 3.0 / np.sqrt(10.0)
    slope = (FOOT - RELEASE[1]) / cosine
    at_foot = np.sqrt(2.0 * slope / (GRAVITY * sine))
    fast = np.sqrt(2.0 * GRAVITY * sine * slope)
    down = np.linspace(0.0, at_foot, 30)
    place = RELEASE[1] + 0.5 * GRAVITY * sine * cosine * down**2
    return np.append(down, at_foot + (WALL - FOOT) / fast), np.append(place, WALL)


def wall_figure(folder, width, png):
    """Draw force per metre of wall, run-up and speeds over time."""
    impact, (time, force) = impact_of(folder), chain.loads(folder, *chain.FORCE)
    times = np.arange(1, round(impact.time[-1] / 0.05) + 1) * 0.05
    shallow, depth = load_by_finite_volumes(times, width)
    figure, ((load, height, speed),) = profiles.picture(1, 3, (12.0, 4.0))
    load.plot(time, force / width / 1e3, label="3D, mean of 0.05 s")
    load.plot(times, shallow / width / 1e3, "k--", lw=1, label="shallow water, finite volumes")
    load.set(xlabel="time [s]", ylabel="force on a metre of wall [kN]")
    height.plot(impact.time, impact.run_up, label="above it 2 % of the mass")
    height.plot(impact.time, impact.top, lw=0.7, label="highest point")
    height.plot(times, FLOOR + depth, "k--", lw=1, label="shallow water at the wall")
    height.axhline(SURFACE, color="gray", lw=0.6, ls=":", label="all the head there is")
    height.set(xlabel="time [s]", ylabel=f"z within {AT_WALL:g} m of the wall [m]")
    speed.plot(impact.time, impact.fastest, lw=0.7, label="fastest point")
    speed.axhline(BERNOULLI, color="gray", lw=0.6, ls=":", label="all the head there is")
    share = speed.twinx()
    share.plot(impact.time, 100.0 * impact.over, "r", lw=0.8)
    share.set_ylabel("mass faster than that [%]", color="r")
    speed.set(xlabel="time [s]", ylabel="speed [m/s]", ylim=(0.0, None))
    for axis in (load, height, speed):
        axis.set_xlim(impact.time[0], impact.time[-1])
        axis.legend(fontsize=7)
    profiles.save(figure, png)


def peaks(folder):
    """Name -> largest values at the wall and their times."""
    impact, (time, force) = impact_of(folder), chain.loads(folder, *chain.FORCE)
    at = int(np.argmax(impact.run_up))
    return {
        "run-up of 2 % of the mass [m]": impact.run_up[at],
        "when [s]": impact.time[at],
        "highest point [m]": impact.top.max(),
        "most mass above 9.5 m [%]": 100.0 * impact.splash.max(),
        "fastest point [m/s]": impact.fastest.max(),
        "most mass faster than 7.45 m/s after the impact [%]": 100.0 * impact.over[impact.time > 2.2].max(initial=0.0),
        "largest force, mean of 0.05 s [kN]": force.max() / 1e3,
        "when it is [s]": time[int(np.argmax(force))],
        "energy lost [%]": 100.0 * (1.0 - impact.energy[-1] / impact.energy[0]),
        "largest volume over that at rest": impact.volume.max(),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="output folder")
    default = Size()
    parser.add_argument("--width", type=float, default=default.width, help="width of the channel [m] (default: 5)")
    parser.add_argument(
        "--cell", type=float, default=default.cell, help="cell size of columns and points [m] (default: 0.0625)"
    )
    parser.add_argument("--png", type=Path, help="folder for the figures (default: FOLDER)")
    asked = parser.parse_args()
    size, folder = Size(asked.width, asked.cell), chain.fresh(asked.folder)
    png = asked.png or folder
    make_free(folder / "free", size)
    slide = slide_of(folder / "free", size.width)
    print(f"front at the position of the wall at {slide.arrival():.2f} s; at 3 s mean speed {slide.speed[-1]:.2f} m/s,")
    print(f"front at {slide.front[-1]:.1f} m, {100 * slide.past[-1]:.1f} % of the mass beyond the position of the wall")
    columns_figure(slide, size.width, png / "wall_columns.png")
    make_wall(folder / "wall", size)
    sequence_figure(folder / "wall", (1.6, 2.2, 2.6, 3.0, 3.4, 4.0), png / "wall_sequence.png")
    wall_figure(folder / "wall", size.width, png / "wall_load.png")
    make_printed(folder / "printed", folder / "free", size)
    sequence_figure(folder / "printed", (3.0, 3.3, 3.5), png / "wall_printed.png", 3.0)
    both = peaks(folder / "wall"), peaks(folder / "printed")
    rows = [(name, f"{both[0][name]:.4g}", f"{both[1][name]:.4g}") for name in both[0]]
    print(chain.table(rows, ("", "3D from 1.6 s", "3D from 3 s, as printed")))


if __name__ == "__main__":
    main()
