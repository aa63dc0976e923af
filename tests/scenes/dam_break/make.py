"""Water let go in a tank (Lobovsky et al. 2014; Martin and Moyce 1952), through the commands: front, pressure, force.

python tests/scenes/dam_break/make.py FOLDER [--depth 0.6 --cells 32] [--png FOLDER]
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain
import profiles

GRAVITY, DENSITY = 9.81, 997.0
RESERVOIR, TANK = 0.6, 1.61  # [m], length of the water and of the tank
ARRIVED = 100.0  # [Pa], from which water is at a sensor
BEHIND, WIDE = 4, 3  # cells of ground behind the wall's face, and across the strip

# Lobovsky et al. (2014), J. Fluids Struct. 48:407, Figure 12 left, H = 0.6 m: t sqrt(g / H) and (0.6 m + path) / H.
FRONT = np.array(
    [
        (0.1075, 1.0791),
        (0.2153, 1.1668),
        (0.3231, 1.2550),
        (0.4309, 1.3416),
        (0.5388, 1.4298),
        (0.6466, 1.5320),
        (0.7544, 1.6332),
        (0.8622, 1.7442),
        (0.9703, 1.8548),
        (1.0914, 2.0047),
        (1.1993, 2.1443),
        (1.3071, 2.2823),
        (1.4015, 2.4120),
        (1.5093, 2.5624),
        (1.5767, 2.6615),
    ]
)
# Martin and Moyce (1952), Phil. Trans. A 244:312, square column of 2.25 inches: T = t sqrt(g / a), Z = front / a.
MARTIN_MOYCE = np.array(
    [(0.43, 1.11), (0.62, 1.22), (0.80, 1.44), (0.97, 1.67), (1.14, 1.89), (1.29, 2.11), (1.45, 2.33), (1.62, 2.56)]
)
# Lobovsky et al. (2014), H = 0.6 m, 3 mm above the bed: medians of peak [Pa], rise and decay time [s], impulse [Pa s].
IMPACT = {"peak": 18569.0, "rise": 0.007, "decay": 0.104, "impulse": 1274.0}
# Table 2, H = 0.3 m, 100 runs: height of the sensor [m], median, 2.5 and 97.5 % of the peak [Pa].
PEAKS = np.array(
    [
        (0.003, 9144.0, 7506.0, 13098.0),
        (0.015, 5749.0, 5326.0, 6331.0),
        (0.030, 4376.0, 3979.0, 4962.0),
        (0.080, 3015.0, 2418.0, 3632.0),
    ]
)


class Size(NamedTuple):
    """Depth of the water [m] and cells over it."""

    depth: float = 0.6
    cells: int = 16

    @property
    def cell(self):
        return self.depth / self.cells


def write_inputs(folder, size):
    """Level ground, the water and the wall of a strip WIDE cells wide."""
    cell = size.cell
    columns = int(np.ceil(TANK / cell)) + BEHIND
    width = WIDE * cell
    chain.write_raster(folder / "dtm.tif", np.zeros((WIDE, columns)), 0.0, width, cell)
    chain.write_polygons(folder / "release.geojson", [shapely.box(0.0, 0.0, RESERVOIR, width)], None)
    wall = shapely.box(TANK, -cell, (columns + 1) * cell, width + cell)
    chain.write_polygons(folder / "wall.geojson", [wall], None)


def make(folder, size, **changed):
    """The run in `folder`; answers its record."""
    folder = chain.fresh(folder)
    write_inputs(folder, size)
    stiff = DENSITY * 400.0 * GRAVITY * size.depth
    chain.write_scene(
        "dam_break", folder, thickness=size.depth, cell_size=size.cell, bulk_modulus=f"{stiff:.4g}", **changed
    )
    return chain.run_scene(folder)[0]


class Course(NamedTuple):
    """The water over time, float64[frames] or [frames, sensors]."""

    time: np.ndarray  # [s]
    front: np.ndarray  # [m], foremost point
    pressure: np.ndarray  # [Pa] at the wall, mean over the points within a cell of each sensor


def course(folder, size, heights):
    """The Course of a run with sensors at `heights` [m] on the wall."""
    stiff = DENSITY * 400.0 * GRAVITY * size.depth
    rows = []
    for frame in chain.frames(folder):
        place, particles = chain.placed(frame), frame.particles
        pressure = stiff * (particles.mass / (DENSITY * particles.volume) - 1.0)
        near = place[:, 0] > TANK - 1.5 * size.cell
        rows.append(
            (
                frame.time,
                place[:, 0].max(),
                *(_mean(pressure[near & (np.abs(place[:, 2] - height) < 0.75 * size.cell)]) for height in heights),
            )
        )
    rows = np.array(rows)
    return Course(rows[:, 0], rows[:, 1], rows[:, 2:])


def _mean(values):
    return float(values.mean()) if len(values) else 0.0


def front_error(found, size, since=0.75):
    """Largest |Z / measured - 1| of the front against FRONT from t sqrt(g / H) = `since` on, no shift in time."""
    late = FRONT[:, 0] >= since
    time = FRONT[late, 0] * np.sqrt(size.depth / GRAVITY)
    return chain.relative(np.interp(time, found.time, found.front) / size.depth, FRONT[late, 1])


def front_speed(time, place):
    """dZ / dt* between t* = 0.86 and 1.41, of times and places in units of the depth."""
    late = (time > 0.86) & (time < 1.41)
    return float(np.polyfit(time[late], place[late], 1)[0])


def early_impulse(found, sensor=0):
    """Integral of the pressure [Pa s] over the rise and decay time of the experiment, from the arrival on."""
    begun = found.time[np.argmax(found.pressure[:, sensor] > ARRIVED)]
    now = (found.time >= begun) & (found.time <= begun + IMPACT["rise"] + IMPACT["decay"])
    return float(np.trapezoid(found.pressure[now, sensor], found.time[now]))


def first_pressure(found, window=0.02):
    """float[sensors] [Pa]: largest mean over a `window` [s]; blows of single points last less."""
    return np.array([smoothed(found.time, values, window).max() for values in found.pressure.T])


def smoothed(time, values, window=0.01):
    """Mean of `values` over a `window` [s]: sound between water and wall is left out."""
    count = max(1, round(window / np.median(np.diff(time))))
    return np.convolve(values, np.ones(count) / count, "same")


def figures_of(folder, size):
    """Name -> (measured, found) in words."""
    found = course(folder, size, PEAKS[:, 0])
    rows = {}
    if size.depth == RESERVOIR:
        rows["front from t* = 0.75 on"] = ("", f"{100 * front_error(found, size):.1f} % off at most")
        scaled = found.time * np.sqrt(GRAVITY / size.depth), found.front / size.depth
        rows["speed of the front, dZ / dt*"] = f"{front_speed(*FRONT.T):.2f}", f"{front_speed(*scaled):.2f}"
        rows["impulse of 0.111 s at 3 mm [Pa s]"] = f"{IMPACT['impulse']:.0f}", f"{early_impulse(found):.0f}"
    for (height, median, low, high), mine in zip(PEAKS, first_pressure(found), strict=True):
        measured = f"{median:.0f} ({low:.0f} to {high:.0f})" if size.depth == 0.3 else ""
        rows[f"peak at {1e3 * height:g} mm [Pa]"] = measured, f"{mine:.0f}"
    time, force = chain.loads(folder, *chain.FORCE)
    rows["largest force, mean of 0.02 s [N/m]"] = "", f"{smoothed(time, force, 0.02).max() / (WIDE * size.cell):.0f}"
    return rows


def figure(folder, size, png):
    """Front and pressure at 3 mm over time."""
    found = course(folder, size, PEAKS[:1, 0])
    scale = np.sqrt(GRAVITY / size.depth)
    figure, ((front, pressure),) = profiles.picture(1, 2, (10.0, 4.0))
    front.plot(found.time * scale, found.front / size.depth, label=f"{size.cells} cells over H")
    front.plot(*FRONT.T, "k.", label="Lobovsky et al. (2014)")
    front.plot(*MARTIN_MOYCE.T, "k+", label="Martin and Moyce (1952)")
    front.set(xlabel="t sqrt(g / H)", ylabel="front / H", xlim=(0.0, 1.8))
    front.legend(fontsize=8)
    pressure.plot(found.time, smoothed(found.time, found.pressure[:, 0]), label="3 mm, mean of 0.01 s")
    pressure.axhline(IMPACT["peak"], color="black", lw=0.6, ls=":", label="median of the measured peaks")
    pressure.set(xlabel="t [s]", ylabel="pressure on the wall [Pa]")
    pressure.legend(fontsize=8)
    profiles.save(figure, png)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--depth", type=float, default=0.6, help="of the water [m]; measured are 0.6 and 0.3")
    parser.add_argument("--cells", type=int, default=16, help="over the depth")
    parser.add_argument("--png", type=Path, help="folder for the figure")
    asked = parser.parse_args()
    size = Size(asked.depth, asked.cells)
    make(asked.folder, size)
    rows = [(name, *values) for name, values in figures_of(asked.folder, size).items()]
    print(chain.table(rows, ["", "measured", "found"]))
    if asked.png:
        figure(asked.folder, size, asked.png / "dam_break.png")


if __name__ == "__main__":
    main()
