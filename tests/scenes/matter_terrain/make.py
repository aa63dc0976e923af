"""A slide computed by the 3D code Matter and by mpmgis from the same particles; exports both results and compares them.

python tests/scenes/matter_terrain/make.py FOLDER [--cell 1.56827] [--split 1] [--png FOLDER]
"""

import argparse
import contextlib
import io
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain
import profiles

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations
from mpmgis.exchange.frame_list import list_frames
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.frames.particles import Particles
from mpmgis.terrain.dtm import read_terrain

DATA = Path(__file__).resolve().parents[3] / "../shared/data/matter_terrain"
CRS, ORIGIN, AXES, DENSITY = "EPSG:32632", (600000.0, 5170000.0, 0.0), ("e", "u", "-n"), 1500.0
TOLD = ("--crs", CRS, "--origin", "600000,5170000,0", "--axes", "e,u,-n", "--density", DENSITY)
TIMES, INTERVAL, CELL = (0.0, 9.0, 18.0, 30.0), 3.0, 2.0  # [s] of Matter's frames, [s] of ours, [m] of the export
SAME = ("--cs-e", CELL, "--extent", "dtm", "--standoff", "auto", "--products", "t_vol", "--overwrite")


def divided(particles, split):
    """Particles of which each is a cube, divided into `split` parts along each edge; all start at rest."""
    place = (np.arange(split) + 0.5) / split - 0.5
    offsets = np.stack(np.meshgrid(place, place, place, indexing="ij"), axis=-1).reshape(-1, 3)
    edge = np.cbrt(particles.volume)[:, None, None]
    position = (particles.position[:, None] + edge * offsets).reshape(-1, 3)
    mass, volume = (np.repeat(part / split**3, split**3) for part in (particles.mass, particles.volume))
    return Particles(position, np.zeros_like(position), mass, volume)


def write_inputs(folder, split=1):
    """Write the DTM as GeoTIFF, and the particles of Matter at time 0, `split` along each edge, as a frame."""
    ground = read_terrain(DATA / "terrain_epsg32632.asc", CRS)
    west, _, _, north = ground.grid.bounds
    chain.write_raster(folder / "dtm.tif", ground.elevation, west, north, ground.grid.cell_size, CRS)
    terms = Declarations(crs=ground.grid.crs, origin=ORIGIN, axes=AXES, density=DENSITY)
    (entry,) = list_frames([DATA / "particles_f0.ply"], terms)
    start = replace(entry.read(), dem="dtm.tif")
    if split > 1:
        start = replace(start, particles=divided(start.particles, split))
    write_frame(folder / "start.h5", start)


def make(folder, split=1, **changed):
    """Write the inputs, run mpmgis with `changed` keys of the scene, export both results; returns the run's record."""
    folder = chain.fresh(folder)
    write_inputs(folder, split)
    chain.write_scene("matter_terrain", folder, **changed)
    record, _ = chain.run_scene(folder)
    matters = (DATA / f"particles_f{time:g}.ply" for time in TIMES)
    ours = (folder / "results" / f"frame_{round(time / INTERVAL):06d}.h5" for time in TIMES)
    chain.mpmgis("export-raster", *matters, "-o", folder / "matter_gis", "--dem", folder / "dtm.tif", *TOLD, *SAME)
    chain.mpmgis("export-raster", *ours, "-o", folder / "ours_gis", *SAME)
    return record


def told_by_compare(folder, *options):
    """Output of `mpmgis compare --json` for our export and the export of Matter's result."""
    words = ["compare", folder / "ours_gis", folder / "matter_gis", "--dem", folder / "dtm.tif", "--json", *options]
    with contextlib.redirect_stdout(io.StringIO()) as said:
        if main([str(word) for word in words]):
            raise SystemExit("mpmgis compare failed")
    return json.loads(said.getvalue())


def centres(folder):
    """Time [s] -> centres of mass of (mpmgis, Matter): E from the origin, N from the origin, height [m]."""
    terms = Declarations(origin=ORIGIN, axes=AXES, density=DENSITY)
    found = {}
    for entry in list_frames([DATA], terms):
        ours = read_frame(folder / "results" / f"frame_{round(entry.time / INTERVAL):06d}.h5", with_state=False)
        shift = np.asarray(ours.origin) - ORIGIN
        mass = ours.particles.mass
        mean = np.average(ours.particles.position, axis=0, weights=mass) + shift
        found[entry.time] = mean, entry.read().particles.position.mean(axis=0)
    return found


def volume(folder, side, time):
    """Volume [m3] of a step of an export, from t_vol and the slope of the DTM cell, which the exporter uses too."""
    ground = read_terrain(folder / "dtm.tif")
    thickness = profiles.bands(profiles.step_at(folder / f"{side}_gis", time).path, "t_vol")[0]["t_vol"]
    stretched = np.sqrt(1.0 + (ground.limited_gradient**2).sum(axis=-1))
    return float(np.nansum(thickness * stretched) * CELL**2)


def compared(folder):
    """Rows (quantity, mpmgis, Matter, difference) for the deposits and for all times."""
    last = "t_vol_deposit" if profiles.deposit(folder / "ours_gis").stem.endswith("deposit") else "t_vol_last"
    peak, deposit = told_by_compare(folder), told_by_compare(folder, "--band", last)
    rows = [("overlap of the footprints (IoU), all times", f"{peak['iou']:.3f}", "", "")]
    rows.append(("overlap of the deposits (IoU)", f"{deposit['iou']:.3f}", "", ""))
    rows.append(_row("area of the deposit [m2]", deposit["a"]["area_m2"], deposit["b"]["area_m2"]))
    fronts = (deposit[side]["runout_at"][0] - ORIGIN[0] for side in "ab")
    rows.append(_row("front of the deposit, E [m]", *fronts))
    for band in peak["bands"]:
        if band["a"] in ("h_max", "Ut_max", "h_deposit", "h_last", last):
            rows.append(_row(f"{band['a']} [{band['unit']}], 99th percentile", band["p99_a"], band["p99_b"]))
    for time in TIMES[1:]:
        ours, matters = (volume(folder, side, time) for side in ("ours", "matter"))
        rows.append(_row(f"volume at {time:g} s [m3]", ours, matters))
    for time, (ours, matters) in centres(folder).items():
        if time:
            rows.append(_row(f"centre of mass at {time:g} s, E [m]", ours[0], matters[0]))
            rows.append(_row(f"centre of mass at {time:g} s, height [m]", ours[2], matters[2]))
    return rows


def _row(what, ours, matters):
    return what, f"{ours:.5g}", f"{matters:.5g}", f"{ours - matters:+.3g}"


def figure(folder, png):
    """Draw the thickness t_vol of Matter, of mpmgis, and the difference, at each time after the start."""
    sheet, axes = profiles.picture(len(TIMES) - 1, 3, (13.0, 6.6))
    dem = folder / "dtm.tif"
    for row, time in zip(axes, TIMES[1:], strict=True):
        steps = [profiles.step_at(folder / f"{side}_gis", time).path for side in ("matter", "ours")]
        for axis, path, title in zip(row, steps, ("Matter", "ours"), strict=False):
            profiles.ground(axis, dem, ORIGIN[:2])
            profiles.layer(axis, path, "t_vol", "t_vol [m]", ORIGIN[:2], 0.0, 4.0, above=0.05)
            axis.set_title(f"{title}, {time:g} s", fontsize=10)
        (theirs, transform), (ours, _) = (profiles.bands(path, "t_vol") for path in steps)
        theirs, ours = theirs["t_vol"], ours["t_vol"]
        profiles.ground(row[2], dem, ORIGIN[:2])
        both = np.where((ours > 0.05) | (theirs > 0.05), ours - theirs, np.nan)
        shown = row[2].imshow(
            both, cmap="RdBu", vmin=-1.0, vmax=1.0, extent=profiles.extent_of(transform, both.shape, ORIGIN[:2])
        )
        sheet.colorbar(shown, ax=row[2], label="ours - Matter [m]", shrink=0.8)
        row[2].set_title(f"difference, {time:g} s", fontsize=10)
        east = centres(folder)[time][1][0]
        for axis in row:
            profiles.view(axis, [east - 110.0, east + 110.0, -70.0, 70.0])
    profiles.save(sheet, png)


def cli():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="output folder")
    parser.add_argument("--cell", dest="cell_size", type=float, help="cell size of the run [m] (default: as in Matter)")
    parser.add_argument("--split", type=int, default=1, help="particles along each edge of a particle (default: 1)")
    parser.add_argument("--png", type=Path, help="folder for the figure (default: FOLDER)")
    asked = parser.parse_args()
    if not DATA.is_dir():
        raise SystemExit(f"{DATA} does not exist: the scene starts from particles of Matter")
    changed = {} if asked.cell_size is None else {"cell_size": asked.cell_size}
    record = make(asked.folder, asked.split, **changed)
    print(chain.table(compared(asked.folder), ("", "ours", "Matter", "difference")))
    print({k: record["balances"][k] for k in ("mass_error_relative", "momentum_error_relative", "mach_max")})
    figure(asked.folder, (asked.png or asked.folder) / "matter_and_ours.png")


if __name__ == "__main__":
    cli()
