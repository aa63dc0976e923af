"""NHESS 25:3897, section 3, with the commands of mpmgis: ice avalanche over crevasses and a cliff (synthetic terrain).

python tests/scenes/whymper/make.py FOLDER [--cell 2] [--end 150] [--law CohesiveMuI] [--no-crevasses] [--estimate]
                                           [--precision float32] [--frame-interval 1] [--evaluate] [--png FOLDER]
"""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain
import profiles

from mpmgis.frames.frame_files import read_frame
from mpmgis.simulation.cost_prediction import predicted
from mpmgis.simulation.preparation import prepare

CRS, WEST, MIDDLE, HEAD = "EPSG:32632", 343_000.0, 5_081_000.0, 4_000.0  # near the mountain; the terrain is synthetic
LENGTH, HALF, PIXEL = 1300.0, 200.0, 1.0  # [m]: along the flow (east), to each side of the flow line, pixel of the DTM
# slope of the bed [degrees] at distances [m] along the flow line; its tangent is linear between them
SLOPES = (
    (0.0, 48.0),
    (100.0, 48.0),
    (170.0, 41.0),
    (340.0, 38.0),
    (385.0, 30.0),
    (399.5, 30.0),
    (400.5, 74.0),
    (411.5, 74.0),
    (412.5, 40.0),
    (520.0, 36.0),
    (700.0, 26.0),
    (900.0, 15.0),
    (1100.0, 8.0),
    (1300.0, 5.0),
)
TROUGH = 0.0012  # [m-1], coefficient of the parabola across the valley
CREVASSES, CREVASSE_WIDE, CREVASSE_DEEP, CREVASSE_HALF = (262.0, 282.0, 302.0, 322.0), 8.0, 10.0, 80.0  # [m]
CLIFF = (400.0, 412.0)  # [m]
SERAC = (65.0, -40.0, 127.5, 40.0)  # west, south, east, north [m]: 5000 m2
GLACIERS = ((55.0, 398.0), (414.0, 640.0))  # [m] along the flow
PERCENTILES = (100, 80, 60, 40, 20)
PRODUCTS = ("t_vol", "detached", "n")
MASS = 150_000.0 * 850.0  # [kg]
# Parameters of CohesiveMuI that the scene does not have. They are not in the paper: mu2 - mu1 and I0 are those of glass
# beads (Jop et al. 2006), the density is that of ice. No measured size of fragments of an ice avalanche was found.
GRAINS = {"rate_friction": 0.262, "inertial_number": 0.279, "grain_diameter": 0.3, "grain_density": 917.0}


def bed(x, y, crevasses=True):
    """Elevation [m] at distances `x` [m] along the flow line and `y` to the left of it."""
    fine = np.arange(0.0, LENGTH + 0.05, 0.1)
    tangent = np.interp(fine, [at for at, _ in SLOPES], np.tan(np.radians([angle for _, angle in SLOPES])))
    fallen = np.concatenate([[0.0], np.cumsum(0.05 * (tangent[1:] + tangent[:-1]))])
    height = HEAD - np.interp(x, fine, fallen) + TROUGH * y**2
    height = height + 0.8 * np.sin(x / 23.0 + 0.4) * np.sin(y / 17.0 + 1.0)
    height = height + 0.4 * np.sin(x / 11.0 + y / 47.0) * np.sin(y / 9.0 - x / 61.0)
    return height - crevasse_depth(x, y) if crevasses else height


def crevasse_depth(x, y):
    """Depth [m] of the crevasses: slightly oblique trenches with walls 1.5 m wide in plan."""
    depth = np.zeros(np.broadcast(x, y).shape)
    for place in CREVASSES:
        across = np.abs(x - place - 0.12 * y)
        wall = np.clip((0.5 * CREVASSE_WIDE - across) / 1.5, 0.0, 1.0)
        ends = np.clip((CREVASSE_HALF - np.abs(y)) / 10.0, 0.0, 1.0)
        depth = np.maximum(depth, CREVASSE_DEEP * wall * ends)
    return depth


def box(west, south, east, north):
    """A rectangle in map coordinates, given by distances along and across the flow line."""
    return shapely.box(WEST + west, MIDDLE + south, WEST + east, MIDDLE + north)


def write_inputs(folder, crevasses=True):
    """Write DTM, release and zones."""
    x = (np.arange(round(LENGTH / PIXEL)) + 0.5) * PIXEL
    y = HALF - (np.arange(round(2 * HALF / PIXEL)) + 0.5) * PIXEL
    chain.write_raster(folder / "dtm.tif", bed(*np.meshgrid(x, y), crevasses), WEST, MIDDLE + HALF, PIXEL, CRS)
    chain.write_polygons(folder / "serac.geojson", [box(*SERAC)], CRS)
    glaciers = [box(start, -HALF, end, HALF) for start, end in GLACIERS]
    chain.write_polygons(folder / "glacier.geojson", glaciers, CRS)


def write_all(
    folder, cell=1.0, end=150.0, crevasses=True, law="DruckerPrager", grains=GRAINS, precision="float64", interval=0.2
):
    """Write the inputs and the scene to `folder`, which is emptied first; returns the folder.

    `law` is the material, `grains` are parameters of CohesiveMuI, `interval` [s] is the time between frames.
    """
    folder = chain.fresh(folder)
    write_inputs(folder, crevasses)
    path = chain.write_scene("whymper", folder, cell_size=float(cell), end_time=float(end), frame_interval=interval)
    text = path.read_text().replace("[numerics]\n", f'[numerics]\nprecision = "{precision}"\n')
    if law == "CohesiveMuI":
        keys = "".join(f"{key} = {value}\n" for key, value in grains.items())
        text = text.replace('law = "DruckerPrager"\n', f'law = "{law}"\n{keys}')
    path.write_text(text)
    return folder


def make(folder, cell=1.0, end=150.0, crevasses=True, **given):
    """Write the inputs in `folder`, run and export; returns (contents of run.json, wall times of run and export [s]).

    `given` is passed to `write_all`.
    """
    folder = write_all(folder, cell, end, crevasses, **given)
    record, running = chain.run_scene(folder)
    return record, running, export(folder)


def export(folder):
    """`mpmgis export-raster` of the run in `folder`, also of an unfinished one; returns its wall time [s]."""
    interval = chain.record(folder)["scene"]["output"]["frame_interval"]
    return chain.export(folder, "--cs-e", _cell(folder), "--dt-e", interval, "--no-qgis", products=PRODUCTS)[1]


def estimate(folder, cell=1.0, end=150.0, threads=2):
    """(points, predicted time [s], predicted memory [bytes]) of a run that is not started."""
    prepared = prepare(write_all(folder, cell, end) / "scene.toml")
    ahead = predicted(prepared, threads)
    return prepared.particles, ahead.seconds, ahead.memory


def along(path, *names, step=1.0, start=0.0, end=LENGTH):
    """Distance along the flow line [m] and bands of a raster there."""
    distance, values = profiles.cells_along(path, (WEST + start, MIDDLE), (WEST + end, MIDDLE), step, *names)
    return distance + start, values


STRIP, JUMP = (CREVASSES[0] - 10.0, CREVASSES[-1] + 15.0), (CLIFF[0], CLIFF[1] + 60.0)  # [m] along the flow


def columns_within(path, between, *names):
    """Bands of a raster in the columns of cells `between` two distances along the flow [m], and a cell's area [m2]."""
    read, transform = profiles.bands(path, *names)
    x = transform.c + (np.arange(read[names[0]].shape[1]) + 0.5) * transform.a - WEST
    inside = (x > between[0]) & (x < between[1])
    return {name: band[:, inside] for name, band in read.items()}, transform.a**2


def clearest_step(folder, between):
    """(step, area [m2]) with the largest area `between` two distances [m] where the flow is detached from the bed."""
    areas = []
    for step in profiles.steps(folder / "gis"):
        read, cell = columns_within(step.path, between, "detached")
        areas.append((cell * float(np.nansum(read["detached"])), step))
    area, step = max(areas, key=lambda pair: pair[0])
    return step, area


def jump_step(folder):
    """The exported step with most detached cells between the edge of the cliff and 60 m beyond its foot."""
    return clearest_step(folder, JUMP)[0]


def frame_at(folder, time):
    """The frame nearest to `time` [s]: time, positions along and across the flow line and up [n, 3], masses, speeds."""
    record = chain.record(folder)
    interval = record["scene"]["output"]["frame_interval"]
    frame = read_frame(folder / "results" / f"frame_{round(time / interval):06d}.h5", with_state=False)
    place = frame.particles.position + np.array(frame.origin) - [WEST, MIDDLE, 0.0]
    return frame.time, place, frame.particles.mass, np.linalg.norm(frame.particles.velocity, axis=1)


def angle(start, end):
    """Angle [degrees] below the horizontal from one place (distance, elevation) to another."""
    return float(np.degrees(np.arctan2(start[1] - end[1], end[0] - start[0])))


def findings(folder):
    """Name -> number of the results on the page."""
    step = jump_step(folder)
    x, line = along(step.path, "h", "t", "Un", "Ut", "detached")
    over = (x > JUMP[0]) & (x < JUMP[1])
    slope = (x > 340.0) & (x < 380.0)
    wet = line["h"] > 0.0
    first, last = frame_at(folder, 0.0), frame_at(folder, profiles.steps(folder / "gis")[-1].time)
    top, centre = first[1][np.argmax(first[1][:, 2])], np.average(first[1], axis=0, weights=first[2])
    order = np.argsort(last[1][:, 0])
    toe = last[1][order[np.searchsorted(np.cumsum(last[2][order]), 0.99 * last[2].sum())]]
    rest = np.average(last[1], axis=0, weights=last[2])
    within = crevasse_depth(last[1][:, 0], last[1][:, 1]) > 0.0
    speeds = frame_at(folder, step.time)[2:]
    breaking, cleared = clearest_step(folder, STRIP)
    breaking = breaking if cleared else step  # without crevasses the flow does not break: use the step of the jump
    strip, _ = columns_within(breaking.path, STRIP, "Un", "Ut")
    return {
        "time of the jump [s]": step.time,
        "h - t over the cliff, largest [m]": float(np.nanmax((line["h"] - line["t"])[over])),
        "h - t on the slope above, largest [m]": float(np.nanmax((line["h"] - line["t"])[slope & wet])),
        "cells of the profile clear of the bed": int(np.nansum(line["detached"][over])),
        "Un over the cliff, largest [m/s]": float(np.nanmax(line["Un"][over])),
        "Un where it lands, least [m/s]": float(np.nanmin(line["Un"][over])),
        "Un on the slope above, mean of |Un| [m/s]": float(np.nanmean(np.abs(line["Un"][slope]))),
        "Ut on the slope above, mean [m/s]": float(np.nanmean(line["Ut"][slope])),
        "time of most breaking on the crevasses [s]": breaking.time,
        "area clear of the bed there [m2]": cleared,
        "Un there, standard deviation [m/s]": float(np.nanstd(strip["Un"])),
        "Ut there, standard deviation over mean": float(np.nanstd(strip["Ut"]) / np.nanmean(strip["Ut"])),
        "speed at the jump, mean over the mass [m/s]": float(np.average(speeds[1], weights=speeds[0])),
        "speed at the jump, of 99 % of the mass at most [m/s]": float(np.quantile(speeds[1], 0.99)),
        "time at the end [s]": last[0],
        "distance of the toe (99 % of the mass) [m]": float(toe[0]),
        "angle from the top to the toe [degrees]": angle(top[[0, 2]], toe[[0, 2]]),
        "angle of the centre of mass [degrees]": angle(centre[[0, 2]], rest[[0, 2]]),
        "share of the mass in the crevasses at the end": float(last[2][within].sum() / last[2].sum()),
        "share of the mass above the cliff at the end": float(last[2][last[1][:, 0] < CLIFF[0]].sum() / last[2].sum()),
        "mean speed at the end [m/s]": float(np.average(last[3], weights=last[2])),
    }


def percentile_profiles(folder, step, cell):
    """Percentile -> (distance along the flow line [m], h, t [m]) of figure S2, by `mpmgis profile --percentile`."""
    line = folder / "line.geojson"
    chain.write_polygons(line, [shapely.LineString([(WEST + 230.0, MIDDLE), (WEST + 560.0, MIDDLE)])], CRS)
    found = {}
    for percentile in PERCENTILES:
        table = folder / f"profile_{percentile}.csv"
        chain.mpmgis(
            "profile",
            folder / "results",
            "--line",
            line,
            "--at-times",
            step.time,
            "--cs-e",
            cell,
            "--percentile",
            percentile,
            "-o",
            table,
            "--overwrite",
        )
        with open(table, encoding="utf-8", newline="") as file:
            rows = [[float(row[name] or "nan") for name in ("along_m", "h_m", "t_m")] for row in csv.DictReader(file)]
        along_line, h, t = np.array(rows).T
        found[percentile] = along_line + 230.0, h, t
    return found


def percentile_findings(profiles_found, step):
    """Results for the statements of section S3 on figure S2: h and t at 20 % over h and t, detached and attached."""
    x, h, t = profiles_found[100]
    _, low_h, low_t = profiles_found[20]
    places, bands = along(step.path, "detached", "n")
    detached, count = (np.interp(x, places, np.nan_to_num(bands[name])) for name in ("detached", "n"))
    kept = {}
    for name, part in (("detached", (detached > 0.5) & (x > JUMP[0])), ("attached", detached < 0.5)):
        part = part & (t > 1.0) & (count >= 5)
        for letter, whole, low in (("h", h, low_h), ("t", t, low_t)):
            kept[f"{letter} at 20 % over {letter}, {name}"] = float(np.median(low[part] / whole[part]))
    few = (count > 0) & (count <= 4) & (h > 0.0)
    return kept | {"h at 20 % over h, cells of 4 points at most": float(np.median(low_h[few] / h[few]))}


def _draw_percentiles(found, step, path):
    """Draw figures S2 and S3: depth and thickness by percentile, and the number of points in the cells."""
    figure, axes = profiles.picture(3, 1, (9.0, 8.0), sharex=True)
    shades = np.linspace(0.15, 0.9, len(found))
    for (percentile, (x, h, t)), shade in zip(found.items(), shades, strict=True):
        for axis, values in ((axes[0, 0], h), (axes[1, 0], t)):
            wet = np.where(found[100][1] > 0.0, values, np.nan)
            axis.plot(x, wet, color=(shade, 0.2, 1.0 - shade), lw=1.0, label=f"P = {percentile}")
    places, bands = along(step.path, "n", start=230.0, end=560.0)
    axes[2, 0].step(places, np.nan_to_num(bands["n"]), "k", where="mid", lw=0.8)
    for axis, label in zip(axes[:, 0], ("h [m]", "t [m]", "points in a cell"), strict=True):
        axis.axvspan(*CLIFF, color="gray", alpha=0.3, lw=0)
        axis.set_ylabel(label)
    axes[0, 0].legend(fontsize=8)
    axes[2, 0].set_xlabel("along the flow line [m]")
    axes[0, 0].set_title(f"t = {step.time:.1f} s along the flow line; gray: the cliff")
    profiles.save(figure, path)


def figures(folder, png, name="whymper"):
    """Draw all figures of the page; their file names begin with `name`."""
    step = jump_step(folder)
    _draw_maps(folder, png / f"{name}_maps.png")
    _draw_jump(folder, step, png / f"{name}_jump.png")
    _draw_profile(folder, step, png / f"{name}_profile.png")
    _draw_sections(folder, step.time, png / f"{name}_sections.png")
    _draw_percentiles(percentile_profiles(folder, step, _cell(folder)), step, png / f"{name}_percentiles.png")


def _cell(folder):
    """Cell size [m] of the run and of its export."""
    return chain.record(folder)["scene"]["numerics"]["cell_size"]


ORIGIN = (WEST, MIDDLE)


def _draw_maps(folder, path):
    """Draw the map of the site, the largest depth and speed, and the deposit."""
    figure, axes = profiles.picture(4, 1, (9.0, 9.5), sharex=True)
    extremes = profiles.maxima(folder / "gis")
    for axis in axes[:, 0]:
        profiles.ground(axis, folder / "dtm.tif", ORIGIN)
        profiles.view(axis, (0.0, LENGTH, -140.0, 140.0))
        axis.plot([0.0, LENGTH], [0.0, 0.0], "k-", lw=0.4)
        axis.set_ylabel("[m]")
    for start, end in GLACIERS:
        axes[0, 0].axvspan(start, end, color="tab:cyan", alpha=0.2, lw=0)
    west, south, east, north = SERAC
    axes[0, 0].fill([west, east, east, west], [south, south, north, north], color="tab:red", alpha=0.6)
    axes[0, 0].set_title("Serac (red), glacier (cyan), crevasses, cliff at 400 m; flow to the right", fontsize=9)
    for axis, source, band, label, high, cmap in (
        (axes[1, 0], extremes, "h_max", "h_max [m]", 30, "viridis"),
        (axes[2, 0], extremes, "Ut_max", "Ut_max [m/s]", 60, "plasma"),
        (axes[3, 0], profiles.deposit(folder / "gis"), "t_vol", "deposit, t_vol [m]", 8, "viridis"),
    ):
        profiles.layer(axis, source, band, label, ORIGIN, 0.0, high, cmap, above=0.0)
    axes[3, 0].set_xlabel("along the flow line [m]")
    profiles.save(figure, path)


def _draw_jump(folder, step, path):
    """Draw figure 2d-g: Un, Ut, t, h around the cliff."""
    figure, axes = profiles.picture(2, 2, (10.0, 6.5), sharex=True, sharey=True)
    for axis, (band, label, low, high, cmap) in zip(
        axes.ravel(),
        (
            ("Un", "Un [m/s]", -25, 25, "RdBu"),
            ("Ut", "Ut [m/s]", 0, 50, "plasma"),
            ("t", "t [m]", 0, 25, "viridis"),
            ("h", "h [m]", 0, 25, "viridis"),
        ),
        strict=True,
    ):
        profiles.ground(axis, folder / "dtm.tif", ORIGIN)
        profiles.layer(axis, step.path, band, label, ORIGIN, low, high, cmap, above=None if band[0] == "U" else 0.0)
        profiles.view(axis, (230.0, 540.0, -100.0, 100.0))
        axis.axhline(0.0, color="black", lw=0.4)
    figure.suptitle(f"t = {step.time:.1f} s; Un: blue leaves the bed, red meets it; cliff from 400 to 412 m")
    profiles.save(figure, path)


def _draw_profile(folder, step, path):
    """Draw figure 2h, i: velocities, depth, thickness and the bed along the flow line."""
    figure, axes = profiles.picture(3, 1, (9.0, 8.0), sharex=True)
    (speeds,), (heights,), (terrain,) = axes
    x, line = along(step.path, "h", "t", "Un", "Ut", "detached", start=230.0, end=560.0)
    speeds.plot(x, line["Ut"], "c", label="Ut")
    speeds.plot(x, line["Un"], "m", label="Un")
    speeds.axhline(0.0, color="black", lw=0.4)
    wet = line["h"] > 0.0
    heights.plot(x, np.where(wet, line["h"], np.nan), "r", label="h")
    heights.plot(x, np.where(wet, line["t"], np.nan), "b", label="t")
    heights.fill_between(
        x,
        0,
        1,
        where=line["detached"] == 1,
        transform=heights.get_xaxis_transform(),
        color="orange",
        alpha=0.25,
        lw=0,
        label="detached",
    )
    terrain.plot(x, bed(x, 0.0 * x), "k")
    for axis, label in ((speeds, "[m/s]"), (heights, "[m]"), (terrain, "bed [m]")):
        axis.axvspan(*CLIFF, color="gray", alpha=0.3, lw=0)
        axis.set_ylabel(label)
    speeds.legend(fontsize=8)
    heights.legend(fontsize=8)
    terrain.set_xlabel("along the flow line [m]")
    speeds.set_title(f"t = {step.time:.1f} s along the flow line; gray: the cliff")
    profiles.save(figure, path)


def _draw_sections(folder, jump, path, half=2.0):
    """Draw points within `half` [m] of the flow line, seen from the side, at four times."""
    last = profiles.steps(folder / "gis")[-1].time
    times = [0.35 * jump, 0.7 * jump, jump, min(1.5 * jump, last)]
    figure, axes = profiles.picture(2, 2, (10.0, 8.5), sharex=True, sharey=True)
    x = np.arange(50.0, 580.0, 0.5)
    for axis, wanted in zip(axes.ravel(), times, strict=True):
        time, place, _, speed = frame_at(folder, wanted)
        near = np.abs(place[:, 1]) < half
        dots = axis.scatter(place[near, 0], place[near, 2], 1.5, speed[near], cmap="plasma", vmin=0, vmax=60, lw=0)
        axis.plot(x, bed(x, 0.0 * x), "k", lw=0.8)
        axis.set(title=f"t = {time:.1f} s", xlim=(50.0, 550.0), ylim=(3480.0, 3980.0))
    figure.colorbar(dots, ax=axes, label="speed [m/s]", shrink=0.6)
    for axis in axes[-1]:
        axis.set_xlabel("along the flow line [m]")
    for axis in axes[:, 0]:
        axis.set_ylabel("[m]")
    profiles.save(figure, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="output folder")
    parser.add_argument("--cell", type=float, default=2.0, help="cell size of grid and export [m] (paper: 1)")
    parser.add_argument("--end", type=float, default=150.0, help="end time [s] (default: 150)")
    parser.add_argument("--no-crevasses", action="store_true", help="the same slope without crevasses")
    parser.add_argument("--law", choices=["DruckerPrager", "CohesiveMuI"], default="DruckerPrager", help="material")
    parser.add_argument("--grain", type=float, help="`grain_diameter` of CohesiveMuI [m] (default: 0.3)")
    parser.add_argument("--precision", choices=["float64", "float32"], default="float64", help="precision of points")
    parser.add_argument("--frame-interval", type=float, default=0.2, help="time between frames [s] (default: 0.2)")
    parser.add_argument("--evaluate", action="store_true", help="export and evaluate the existing run in FOLDER")
    parser.add_argument("--estimate", action="store_true", help="print the predicted time and memory, and exit")
    parser.add_argument("--png", type=Path, help="folder for the figures (default: FOLDER)")
    asked = parser.parse_args()
    if asked.estimate:
        points, seconds, memory = estimate(asked.folder, asked.cell, asked.end)
        print(f"{points} points, on 2 threads {seconds / 60:.0f} minutes and {memory / 1e9:.1f} GB predicted")
        return
    if asked.evaluate:
        running, exporting, record = 0.0, export(asked.folder), chain.record(asked.folder)
    else:
        grains = GRAINS | ({"grain_diameter": asked.grain} if asked.grain else {})
        record, running, exporting = make(
            asked.folder,
            asked.cell,
            asked.end,
            not asked.no_crevasses,
            law=asked.law,
            grains=grains,
            precision=asked.precision,
            interval=asked.frame_interval,
        )
    balances = record["balances"]
    print(f"{record['particles']} points, {record['steps']} steps, run {running:.0f} s, export {exporting:.0f} s")
    print({key: value for key, value in balances.items() if not isinstance(value, (dict, list))})
    print(chain.table([(key, f"{value:.4g}") for key, value in findings(asked.folder).items()], ("", "measured")))
    step = jump_step(asked.folder)
    kept = percentile_findings(percentile_profiles(asked.folder, step, _cell(asked.folder)), step)
    print(chain.table([(key, f"{value:.3g}") for key, value in kept.items()], ("", "measured")))
    figures(asked.folder, asked.png or asked.folder)


if __name__ == "__main__":
    main()
