"""MOX report 15/2025, 4.4.2, through the commands: a mudflow onto an L-shaped barrier, columns first, then 3D.

python tests/scenes/lecco/make.py FOLDER [--per-cell 16 --points 1] [--png FOLDER]
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
from oblique import View

EAST, NORTH, PIXEL = 750.0, 1000.0, 5.0  # [m]
CENTRE, HALF_AXES, ANGLES = (420.0, 550.0), (np.sqrt(500.0), 20.0), 256  # of the release, as printed
MEAN_HEIGHT = 206.4  # [m], of the release above the local datum: 0.02 of it is 5.8e3 m3 over the ellipse
SHARE = 0.02  # thickness over height, Eq 13
BOX = (200.0, 400.0, 400.0, 600.0)  # west, south, east, north [m], as printed
DENSITY, GRAVITY = 1300.0, 9.81
BULK = 5.2e7  # [Pa], as in scene.toml
# the way down from the release's centre: (distance on the map [m], slope [degrees]); a shoulder, a scarp, its foot
AXIS = np.array([-170.0, -45.0]) / np.hypot(170.0, 45.0)
PROFILE = ((-600, 30), (-40, 17), (98, 17), (109, 64), (129, 64), (151, 5), (900, 5))
GULLY_CURVE, GULLY_HALF = 60.0, 35.0  # [m], radius of the gully's bed, half its width; straight banks beyond
SHOULDER = (-60.0, 98.0)  # [m] along the flow path, where the wood stands
BARRIER = 158.0  # [m] along the flow path, of the long arm's upslope face
ARM, RETURN, THICK = (-30.0, 40.0), 30.0, 3.0  # [m]: the long arm across the way, length of the short one, thickness


class Size(NamedTuple):
    """How large a making is: columns in a cell of 2.5 m, cells of the points [m]."""

    per_cell: int = 324
    points: float = 0.625


def along(x, y):
    """(distance along the flow path [m], distance to its left, looking down [m]) of places on the map."""
    dx, dy = np.asarray(x) - CENTRE[0], np.asarray(y) - CENTRE[1]
    return dx * AXIS[0] + dy * AXIS[1], dy * AXIS[0] - dx * AXIS[1]


def on_map(distance, left):
    """Place on the map of places along and beside the way; the inverse of `along`."""
    return (
        CENTRE[0] + AXIS[0] * np.asarray(distance) - AXIS[1] * np.asarray(left),
        CENTRE[1] + AXIS[1] * np.asarray(distance) + AXIS[0] * np.asarray(left),
    )


def elevation(x, y):
    """Ground [m] above an arbitrary datum: the way's profile, with a gully across it."""
    fine = np.linspace(PROFILE[0][0], PROFILE[-1][0], 30001)
    slope = np.tan(np.radians(np.interp(fine, *np.transpose(PROFILE))))
    fallen = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(fine))])
    distance, left = along(x, y)
    beside = np.abs(left)
    bank = np.where(beside < GULLY_HALF, 0.5 * beside**2, GULLY_HALF * (beside - 0.5 * GULLY_HALF)) / GULLY_CURVE
    return np.interp(0.0, fine, fallen) - np.interp(distance, fine, fallen) + bank


def ground():
    """float[200, 150] [m]: the DTM, its mean over the release at MEAN_HEIGHT."""
    column, row = np.meshgrid(np.arange(round(EAST / PIXEL)), np.arange(round(NORTH / PIXEL)))
    x, y = (column + 0.5) * PIXEL, NORTH - (row + 0.5) * PIXEL
    inside = (y - CENTRE[1]) ** 2 / 4.0 + (x - CENTRE[0]) ** 2 / 5.0 <= 100.0
    height = elevation(x, y)
    return height + MEAN_HEIGHT - height[inside].mean()


def release():
    """The printed ellipse as a polygon of the same area."""
    angle = 2.0 * np.pi * np.arange(ANGLES) / ANGLES
    swell = np.sqrt(np.pi / (0.5 * ANGLES * np.sin(2.0 * np.pi / ANGLES)))
    x, y = (swell * half * turned for half, turned in zip(HALF_AXES, (np.cos(angle), np.sin(angle)), strict=True))
    return shapely.Polygon(np.column_stack([CENTRE[0] + x, CENTRE[1] + y]))


def strip(first, last, right, left):
    """A rectangle along the flow path as a polygon on the map."""
    corners = (first, right), (last, right), (last, left), (first, left)
    return shapely.Polygon([on_map(*corner) for corner in corners])


def barrier():
    """The L: an arm across the way, and one upslope from its right end."""
    across = strip(BARRIER, BARRIER + THICK, *ARM)
    upslope = strip(BARRIER - RETURN, BARRIER + THICK, ARM[0], ARM[0] + THICK)
    return shapely.union_all([across, upslope])


def write_inputs(folder):
    """DTM, thickness, release, wood, barrier and box."""
    height = ground()
    chain.write_raster(folder / "dtm.tif", height, 0.0, NORTH, PIXEL)
    chain.write_raster(folder / "thickness.tif", SHARE * height, 0.0, NORTH, PIXEL)
    for name, shape in (
        ("release", release()),
        ("wood", strip(*SHOULDER, -90.0, 90.0)),
        ("barrier", barrier()),
        ("box", shapely.box(*BOX)),
    ):
        chain.write_polygons(folder / f"{name}.geojson", [shape], None)


def make(folder, size=None, scene="lecco", **changed):
    """Inputs and `mpmgis run` of a scene in `folder`; answers its run.json."""
    size = size or Size()
    folder = chain.fresh(folder)
    write_inputs(folder)
    path = chain.write_scene(scene, folder, particles_per_cell=size.per_cell, **changed)
    path.write_text(path.read_text().replace("cell_size = 0.625", f"cell_size = {size.points}"))
    return chain.run_scene(folder)[0]


class Front(NamedTuple):
    """The flow over time, float64[frames]."""

    time: np.ndarray  # [s]
    place: np.ndarray  # [m] along the flow path, of the foremost hundredth of the mass
    speed: np.ndarray  # [m s-1], its mean
    mean: np.ndarray  # [m s-1], of all
    fastest: np.ndarray  # [m s-1]


def front_of(folder):
    """The Front of a run."""
    rows = []
    for frame in chain.frames(folder):
        place, mass = chain.placed(frame), frame.particles.mass
        distance, _ = along(place[:, 0], place[:, 1])
        speed = np.linalg.norm(frame.particles.velocity, axis=1)
        order = np.argsort(-distance)
        last = order[np.searchsorted(np.cumsum(mass[order]), 0.01 * mass.sum())]
        ahead = distance >= distance[last]
        rows.append(
            (
                frame.time,
                distance[last],
                np.average(speed[ahead], weights=mass[ahead]),
                np.average(speed, weights=mass),
                speed.max(),
            )
        )
    return Front(*np.array(rows).T)


def whereabouts(frame):
    """Name -> mass [kg] of a frame: before the barrier, on or behind it, past its open end."""
    place, mass = chain.placed(frame), frame.particles.mass
    distance, left = along(place[:, 0], place[:, 1])
    beyond = distance > BARRIER + 0.5 * THICK
    within = (left > ARM[0]) & (left < ARM[1])
    beside = (left <= ARM[0] + 0.5 * THICK) & (distance > BARRIER - RETURN)
    return {
        "before": float(mass[~beyond & ~beside].sum()),
        "over": float(mass[(beyond & within) | beside].sum()),
        "past the open end": float(mass[beyond & (left >= ARM[1])].sum()),
    }


class Load(NamedTuple):
    """barriers.csv as columns, float64[frames]."""

    time: np.ndarray  # [s]
    force: np.ndarray  # [N], mean normal force since the frame before
    moment: np.ndarray  # [N m], length of the horizontal mean moment about the foot
    overtopped: np.ndarray  # [kg] so far
    peak: np.ndarray  # [N], largest of a single step so far


def load_of(folder):
    """The Load of a run's barrier, in its last stage if it has several."""
    moment = np.hypot(*chain.loads(folder, "mean moment east [N m]", "mean moment north [N m]"))
    time, force, passed, largest = chain.loads(
        folder, "time [s]", "mean normal force [N]", "overtopped mass [kg]", "largest normal force of a step so far [N]"
    )
    return Load(time, force, moment, passed, largest)


def smoothed(time, values, window):
    """Means of `values` [n], each that of the time since the one before, over `window` [s] until each time."""
    total = np.concatenate([[0.0], np.cumsum(values[1:] * np.diff(time))])
    return (total - np.interp(time - window, time, total, left=0.0)) / window


def pressure_on_face(frame, cell, across=2.0, up=1.0, deep=1.5):
    """float64[rows, columns] [Pa]: mean pressure in fields of `across` x `up` m of the long arm's upslope face.

    The points' own pressure K (1 / J - 1), J their volume over that at rest, of those within `deep` cells of the face;
    0 where hardly anything is. Row 0 is at the foot, column 0 at the short arm.
    """
    place, particles = chain.placed(frame), frame.particles
    distance, left = along(place[:, 0], place[:, 1])
    near = (np.abs(distance - BARRIER) < deep * cell) & (left > ARM[0] + THICK) & (left < ARM[1])
    rest = particles.mass[near] / DENSITY
    pressure = np.maximum(BULK * (rest / particles.volume[near] - 1.0), 0.0)
    column = ((left[near] - ARM[0] - THICK) / across).astype(int)
    row = np.maximum((place[near, 2] - foot()) / up, 0.0).astype(int)
    shape = int(30.0 / up), int((ARM[1] - ARM[0] - THICK) / across) + 1
    low = row < shape[0]
    field, fields = row[low] * shape[1] + column[low], shape[0] * shape[1]
    volume = np.bincount(field, rest[low], fields)
    weighed = np.bincount(field, (rest * pressure)[low], fields)
    enough = volume > 0.25 * across * up * deep * cell
    return np.where(enough, weighed / np.maximum(volume, 1e-12), 0.0).reshape(shape)


def ground_at(x, y):
    """The DTM [m] at places on the map, the pixel's that they lie in."""
    height = ground()
    row, column = ((NORTH - np.asarray(y)) / PIXEL).astype(int), (np.asarray(x) / PIXEL).astype(int)
    return height[np.clip(row, 0, height.shape[0] - 1), np.clip(column, 0, height.shape[1] - 1)]


def foot():
    """Elevation [m] of the ground in the middle of the long arm."""
    return float(ground_at(*on_map(BARRIER, 0.0)))


def outline(axis, shape, colour, label):
    """Draw a polygon's outline."""
    axis.plot(*shape.exterior.xy, color=colour, lw=1.2, label=label)


def map_figure(folder, png):
    """Where all lies, what flows where, and the way down in profile."""
    figure, ((plan, profile),) = profiles.picture(1, 2, (12.0, 4.6))
    profiles.ground(plan, folder / "dtm.tif")
    for frame, colour, label in zip(
        chain.nearest(folder, (30.0, 38.0)), ("tab:orange", "tab:red"), ("flow at 30 s", "at 38 s"), strict=True
    ):
        place = chain.placed(frame)[:: max(1, len(frame.particles) // 20_000)]
        plan.plot(place[:, 0], place[:, 1], ",", color=colour, label=label)
    outline(plan, release(), "blue", "release")
    outline(plan, strip(*SHOULDER, -90.0, 90.0), "green", "wood")
    outline(plan, shapely.box(*BOX), "magenta", "3D box")
    outline(plan, barrier(), "black", "barrier")
    profiles.view(plan, (180.0, 520.0, 380.0, 660.0))
    plan.set(xlabel="x [m]", ylabel="y [m]")
    plan.legend(fontsize=7, loc="upper right", markerscale=10)
    way = np.linspace(-60.0, 230.0, 600)
    shift = ground_at(*CENTRE) - elevation(*CENTRE)
    height = elevation(*on_map(way, 0.0)) + shift
    profile.plot(way, height, "k")
    profile.fill_between([BARRIER, BARRIER + THICK], foot(), foot() + 20.0, color="0.3", label="barrier")
    profile.axhspan(height[np.abs(way) < HALF_AXES[1]].min(), height[np.abs(way) < HALF_AXES[1]].max(), alpha=0.1)
    profile.set(xlabel="distance along the flow path from the release [m]", ylabel="z above the local datum [m]")
    steep = profile.twinx()
    steep.plot(way, np.interp(way, *np.transpose(PROFILE)), "r", lw=0.8)
    steep.set_ylabel("slope [degrees]", color="r")
    profiles.save(figure, png)


def coloured(values, largest, name="turbo"):
    """float[n, 3]: colours of `values` between 0 and `largest`."""
    return profiles.matplotlib.colormaps[name](np.clip(values / largest, 0.0, 1.0))[:, :3]


def scenery(view, west, east, south, north, step=0.35):
    """Add the ground, shaded, and the barrier, its faces in grey, to a View."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(west, east, step), np.arange(south, north, step)))
    shift = ground_at(*CENTRE) - elevation(*CENTRE)
    height = elevation(x, y) + shift
    dx, dy = (elevation(x + a, y + b) - elevation(x, y) for a, b in ((1.0, 0.0), (0.0, 1.0)))
    light = (1.0 + 0.5 * dx - 0.8 * dy) / np.sqrt(1.0 + dx**2 + dy**2)
    shade = 0.5 + 0.45 * np.clip(light / 1.3, 0.0, 1.0)
    view.add(np.column_stack([x, y, height]), np.column_stack([shade, shade * 0.97, shade * 0.9]), 3)
    rim = barrier().exterior
    along_rim = np.arange(0.0, rim.length, step)
    at = np.array([rim.interpolate(part).coords[0] for part in along_rim])
    base = elevation(at[:, 0], at[:, 1]) + shift
    for up in np.arange(0.0, 20.0, step):
        view.add(np.column_stack([at, base + up]), 0.35 + 0.006 * up, 3)
    inside = shapely.contains_xy(barrier(), x, y)
    view.add(np.column_stack([x[inside], y[inside], height[inside] + 20.0]), 0.6, 3)


def snapshots_figure(folder, times, png, largest=25.0):
    """What one sees at the barrier from behind it, looking up the slope, points coloured by speed."""
    figure, axes = profiles.picture(1, len(times), (13.0, 5.2))
    for axis, frame in zip(axes[0], chain.nearest(folder, times), strict=True):
        view = View(35.0, 28.0, 0.3)
        scenery(view, 225.0, 345.0, 455.0, 570.0)
        place = chain.placed(frame)
        near = (place[:, 0] < 345.0) & (place[:, 1] > 455.0)
        speed = np.linalg.norm(frame.particles.velocity[near], axis=1)
        view.add(place[near], coloured(speed, largest), 2)
        axis.imshow(view.image())
        axis.set_axis_off()
        axis.set_title(f"T = {frame.time:.1f} s", fontsize=10)
    bar = profiles.matplotlib.cm.ScalarMappable(profiles.matplotlib.colors.Normalize(0.0, largest), "turbo")
    figure.colorbar(bar, ax=axes[0], label="speed [m/s]", shrink=0.6)
    profiles.save(figure, png)


def section_figure(folder, times, png, half=1.5, largest=25.0):
    """Points within `half` [m] of the way, from the side, at `times` [s]."""
    figure, axes = profiles.picture(len(times) // 2, 2, (12.0, 1.7 * len(times)), sharex=True, sharey=True)
    way = np.linspace(60.0, 185.0, 500)
    shift = ground_at(*CENTRE) - elevation(*CENTRE)
    for axis, frame in zip(axes.ravel(), chain.nearest(folder, times), strict=True):
        place = chain.placed(frame)
        distance, left = along(place[:, 0], place[:, 1])
        near = np.abs(left) < half
        speed = np.linalg.norm(frame.particles.velocity[near], axis=1)
        axis.fill_between(way, 80.0, elevation(*on_map(way, 0.0)) + shift, color="0.8", lw=0)
        axis.fill_between([BARRIER, BARRIER + THICK], foot(), foot() + 20.0, color="0.35", lw=0)
        seen = axis.scatter(distance[near], place[near, 2], c=speed, s=0.8, lw=0, cmap="turbo", vmin=0, vmax=largest)
        axis.set(xlim=(90.0, 185.0), ylim=(foot() - 6.0, foot() + 50.0), aspect="equal")
        axis.text(150.0, foot() + 43.0, f"T = {frame.time:.1f} s", fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("distance along the flow path [m]")
    for axis in axes[:, 0]:
        axis.set_ylabel("z [m]")
    figure.colorbar(seen, ax=axes, label="speed [m/s]", shrink=0.5)
    profiles.save(figure, png)


def load_figure(folder, cell, png):
    """Force, moment and overtopped mass over time; pressure on the face when it is largest."""
    load = load_of(folder)
    figure, ((force, moment, face),) = profiles.picture(1, 3, (13.0, 4.0))
    force.plot(load.time, load.force / 1e6, lw=0.7, label="mean of 0.1 s")
    force.plot(load.time, smoothed(load.time, load.force, 1.0) / 1e6, label="mean of 1 s")
    force.set(xlabel="time [s]", ylabel="normal force on the barrier [MN]")
    moment.plot(load.time, load.moment / 1e6, lw=0.7, label="moment about the foot [MN m]")
    over = moment.twinx()
    over.plot(load.time, load.overtopped / 1e3, "r", lw=0.8)
    over.set_ylabel("went over [t]", color="r")
    moment.set(xlabel="time [s]", ylabel="horizontal moment [MN m]")
    for axis in (force, moment):
        axis.set_xlim(30.0, load.time[-1])
        axis.legend(fontsize=8)
    fields, time = largest_pressure(folder, cell)
    seen = face.imshow(
        np.where(fields > 0.0, fields / 1e6, np.nan),
        origin="lower",
        cmap="magma_r",
        vmin=0.0,
        extent=[ARM[0] + THICK, ARM[0] + THICK + 2.0 * fields.shape[1], 0.0, fields.shape[0]],
        aspect="auto",
    )
    figure.colorbar(seen, ax=face, label="pressure, mean of 2 x 1 m [MPa]")
    face.set(xlabel="along the long arm [m]", ylabel="above its foot [m]", title=f"T = {time:.1f} s", ylim=(0.0, 22.0))
    profiles.save(figure, png)


def largest_pressure(folder, cell):
    """(fields of `pressure_on_face` of the frame that has the largest, its time [s])."""
    best = None
    for frame in chain.frames(folder):
        if frame.dimension == 3:
            fields = pressure_on_face(frame, cell)
            if best is None or fields.max() > best[0].max():
                best = fields, frame.time
    return best


def comparison_figure(runs, png):
    """Front and speeds of `runs`, a folder by label."""
    figure, ((place, speed, force),) = profiles.picture(1, 3, (13.0, 4.0))
    for label, folder in runs.items():
        front = front_of(folder)
        place.plot(front.time, front.place, label=label)
        speed.plot(front.time, front.speed, label=label)
        if any((folder / "results").glob("barriers*.csv")):
            load = load_of(folder)
            force.plot(load.time, smoothed(load.time, load.force, 0.5) / 1e6, label=label)
    place.axhline(BARRIER, color="gray", lw=0.6)
    place.set(xlabel="time [s]", ylabel="front along the flow path [m]")
    speed.set(xlabel="time [s]", ylabel="speed of the foremost 1 % [m/s]")
    force.set(xlabel="time [s]", ylabel="normal force, mean of 0.5 s [MN]", xlim=(28.0, 38.0))
    for axis in (place, speed, force):
        axis.legend(fontsize=8)
    profiles.save(figure, png)


def summary(folder, cell):
    """Name -> number of a run with points."""
    record, load, front = chain.record(folder), load_of(folder), front_of(folder)
    (last,) = chain.nearest(folder, (np.inf,))
    where, barriers = whereabouts(last), record["balances"]["barriers"]["barrier"]
    fields, time = largest_pressure(folder, cell)
    before = front.place < BARRIER - 5.0
    return {
        "volume released [m3]": record["mass"]["released"] / DENSITY,
        "3D from [s]": record["stages"][0]["time"],
        "points": len(last.particles),
        "outside the box [t]": record["mass"]["outside_windows"] / 1e3,
        "front speed, largest before the barrier [m/s]": front.speed[before].max(),
        "fastest point [m/s]": front.fastest.max(),
        "force, single step [MN]": load.peak[-1] / 1e6,
        "force, mean of 0.1 s [MN]": smoothed(load.time, load.force, 0.1).max() / 1e6,
        "force, mean of 1 s [MN]": smoothed(load.time, load.force, 1.0).max() / 1e6,
        "moment, mean of 0.1 s [MN m]": smoothed(load.time, load.moment, 0.1).max() / 1e6,
        "pressure on 2 x 1 m [MPa]": fields.max() / 1e6,
        "when [s]": time,
        "rho v^2 of the front [MPa]": DENSITY * front.speed[before].max() ** 2 / 1e6,
        "before the barrier at the end [t]": where["before"] / 1e3,
        "over it [t]": where["over"] / 1e3,
        "past its open end [t]": where["past the open end"] / 1e3,
        "counted over its crest [t]": barriers["overtopped_mass"] / 1e3,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    default = Size()
    parser.add_argument("--per-cell", type=int, default=default.per_cell, help="columns in a cell of 2.5 m")
    parser.add_argument("--points", type=float, default=default.points, help="cells of the 3D grid [m]")
    parser.add_argument("--png", type=Path, help="folder for the figures (default: FOLDER)")
    asked = parser.parse_args()
    size, folder = Size(asked.per_cell, asked.points), chain.fresh(asked.folder)
    png = asked.png or folder
    runs = {name: folder / name for name in ("3D from 30 s", "columns", "swe")}
    whole, columns, water = runs.values()
    coarse = Size(min(size.per_cell, 16))
    make(whole, size)
    map_figure(whole, png / "lecco_map.png")
    snapshots_figure(whole, (30.0, 34.0, 38.0), png / "lecco_snapshots.png")
    section_figure(whole, (31.0, 32.0, 33.0, 34.0, 36.0, 38.0), png / "lecco_section.png")
    load_figure(whole, size.points, png / "lecco_load.png")
    rows = [(name, f"{value:.4g}") for name, value in summary(whole, size.points).items()]
    print(chain.table(rows, ("", f"3D in cells of {size.points:g} m")))
    make(columns, coarse, "lecco/columns")
    make(water, coarse, "lecco/swe")
    comparison_figure(runs, png / "lecco_compared.png")
    for name in ("columns", "swe"):
        front = front_of(runs[name])
        print(
            f"{name}: front past {BARRIER:g} m at {np.interp(BARRIER - 5, front.place, front.time):.1f} s, "
            f"fastest {front.fastest.max():.1f} m/s"
        )


if __name__ == "__main__":
    main()
