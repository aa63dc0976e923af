"""A slope of 27 degrees that runs out on level ground, as files; scenes on it, run by the command."""

import json

import geopandas
import h5py
import numpy as np
import rasterio
import shapely
from affine import Affine

from mpmgis.commands.shell.main import main

WEST, SOUTH, PIXEL, COLUMNS, ROWS = 400_000.0, 5_100_000.0, 10.0, 80, 40
FOOT = 400.0  # [m] where the slope ends

SCENE = """
[terrain]
dem = "dtm.tif"
[release]
source = "release.geojson"
thickness = 2.0
density = 1000
[friction]
law = "Voellmy"
mu = 0.2
xi = 1000
[numerics]
cell_size = 10.0
particles_per_cell = 4
[output]
end_time = 30
frame_interval = 5
"""

# A user's own law: Voellmy's, written again.
LAW = """from typing import NamedTuple


class Mine(NamedTuple):
    mu: float
    xi: float

    def basal_stress(self, density, gravity, normal_stress, thickness_normal, speed):
        return self.mu * normal_stress + density * gravity * speed * speed / self.xi
"""

# Ends itself by a signal once a solver of a kind has reached a time, or instead of the n-th time that a file gets its
# name.
CHILD = """
import os, sys
from mpmgis.commands.shell.main import main
from mpmgis.simulation import cost_prediction
from mpmgis.solvers.columns.column_solver import ColumnSolver
from mpmgis.solvers.points.point_solver import PointSolver
number, what, where, *arguments = sys.argv[1:]
replace, seen = os.replace, []
record = os.path.join(arguments[arguments.index("-o") + 1], "run.json")  # before it is there, steps are only tried
cost_prediction.PACE_SECONDS = float("inf")  # and so they are after a second of a run

def end():
    os.kill(os.getpid(), int(number))

def watched(march):
    def advance(solver, *given, **named):
        code = march(solver, *given, **named)
        if solver.time >= float(where) and not seen and os.path.exists(record):
            seen.append(True)
            end()
        return code
    return advance

def name(part, path):
    if os.path.basename(path) == where.split(":")[0]:
        seen.append(path)
        if len(seen) == int(where.split(":")[1]):
            end()
    replace(part, path)

solvers = {"columns": ColumnSolver, "points": PointSolver}
if what in solvers:
    solvers[what].advance = watched(solvers[what].advance)
else:
    os.replace = name
sys.exit(main(arguments))
"""


def slide(cell_size, end_time, frame_interval, head='solver = "points"', friction='law = "Coulomb"\nmu = 0.3', more=""):
    """A scene of a block (`block.geojson`) that slides down a strip of the slope, with `more` lines of [numerics]."""
    return f"""
{head}
[terrain]
dem = "dtm.tif"
window = [{WEST}, {SOUTH + 100}, {WEST + 400}, {SOUTH + 300}]
[release]
source = "block.geojson"
thickness = 12.0
density = 1500
[material]
law = "DruckerPrager"
bulk_modulus = 4e6
shear_modulus = 2e6
friction_angle = 35
[friction]
{friction}
[numerics]
cell_size = {cell_size}
{more}
[output]
end_time = {end_time}
frame_interval = {frame_interval}
"""


def write_raster(path, values, crs="EPSG:32632", nodata=-9999.0):
    """A raster on the site's pixels."""
    profile = {
        "driver": "GTiff",
        "height": ROWS,
        "width": COLUMNS,
        "count": 1,
        "dtype": "float64",
        "crs": crs,
        "transform": Affine(PIXEL, 0, WEST, 0, -PIXEL, SOUTH + ROWS * PIXEL),
        "nodata": nodata,
    }
    with rasterio.open(path, "w", **profile) as target:
        target.write(np.where(np.isfinite(values), values, nodata), 1)


def write_shapes(path, shapes, crs="EPSG:32632", **columns):
    """Features given from the site's corner, in map coordinates."""
    moved = [shapely.transform(shape, lambda p: p + np.array([WEST, SOUTH])) for shape in shapes]
    table = geopandas.GeoDataFrame(columns, geometry=moved, crs="EPSG:32632")
    table.to_crs(crs).to_file(path)


def distances():
    """(x, y) of pixel centres from the site's corner [m]."""
    x, y = (np.arange(COLUMNS) + 0.5) * PIXEL, (ROWS - np.arange(ROWS) - 0.5) * PIXEL
    return np.meshgrid(x, y)


def write_site(folder):
    """The terrain and a release of 2 m on the slope."""
    x, _ = distances()
    write_raster(folder / "dtm.tif", np.maximum(0.5 * (FOOT - x), 0.0) + 100.0)
    write_shapes(folder / "release.geojson", [shapely.box(60, 150, 160, 250)])
    return folder


def write_block_site(folder):
    """The same with the block of 40 x 40 m that `slide` releases."""
    write_shapes(write_site(folder) / "block.geojson", [shapely.box(100, 180, 140, 220)])
    return folder


def run(site, scene, *options):
    """Exit code of `mpmgis run` on `scene`."""
    (site / "scene.toml").write_text(scene)
    return main(["run", str(site / "scene.toml"), "--overwrite", *options])


def refused(site, capsys, scene):
    """The line with which `scene` is refused, before anything is written."""
    assert run(site, scene) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mpmgis")]
    assert not (site / "results").exists()
    assert len(lines) == 1
    return lines[0]


def record(site, folder="results"):
    """What the run wrote of itself."""
    return json.loads((site / folder / "run.json").read_text())


def decisions(site, scene, capsys):
    """Effect -> its decision as `mpmgis effects --json` prints it, without a run."""
    (site / "scene.toml").write_text(scene)
    capsys.readouterr()
    assert main(["effects", str(site / "scene.toml"), "--json"]) == 0
    return {d["effect"]: d for d in json.loads(capsys.readouterr().out)}


def contents(folder):
    """(file, name) -> bytes of all that the frames of a run hold, but for which of two buffers was in use."""
    found = {}
    for path in sorted(folder.glob("frame_*.h5")):
        with h5py.File(path) as file:
            found[path.name, "time"] = (file.attrs["time"], file.attrs["step"], file.attrs["digest"])
            file.visititems(
                lambda name, item, frame=path.name: (
                    found.__setitem__((frame, name), item[()].tobytes())
                    if isinstance(item, h5py.Dataset) and name != "state/counts"
                    else None
                )
            )
    return found
