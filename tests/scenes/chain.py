"""Common functions of the scenes: write rasters and polygons, run commands of `mpmgis`, find results.

The folder of a scene has `make.py`, which writes the inputs and runs the commands, and `scene.toml` as a user would
write it.
"""

import contextlib
import csv
import importlib.util
import io
import json
import shlex
import shutil
import sys
import time
from pathlib import Path

import geopandas
import numpy as np
import rasterio
from affine import Affine

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame

SCENES = Path(__file__).parent
FORCE = "time [s]", "mean normal force [N]"  # columns of loads on barriers; of the time since the frame before


def scene_module(name, program="make"):
    """The module `program`.py of the scene `name`; the modules of all scenes have the same names."""
    key = f"scene_{name}_{program}"
    if key not in sys.modules:
        spec = importlib.util.spec_from_file_location(key, SCENES / name / f"{program}.py")
        sys.modules[key] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[key])
    return sys.modules[key]


def write_raster(path, values, west, north, cell, crs=None):
    """Write float[rows, columns], the first row in the north, as float64 GeoTIFF."""
    rows, columns = values.shape
    profile = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": 1,
        "dtype": "float64",
        "nodata": -9999.0,
        "crs": crs,
        "transform": Affine(cell, 0.0, west, 0.0, -cell, north),
    }
    with rasterio.open(path, "w", **profile) as target:
        target.write(values, 1)


def write_polygons(path, shapes, crs, **columns):
    """Write polygons [map coordinates] with `columns` of values; the suffix of the path gives the format."""
    geopandas.GeoDataFrame(columns, geometry=list(shapes), crs=crs).to_file(path)


def write_scene(scene, folder, **changed):
    """Copy `scene.toml` of the scene to `folder` with new values of the `changed` keys; returns the path.

    Each changed key must occur once in the file, so that the replaced line is the intended one.
    """
    lines = (SCENES / scene / "scene.toml").read_text().splitlines()
    for key, value in changed.items():
        at = [k for k, line in enumerate(lines) if line.split("=")[0].strip() == key]
        if len(at) != 1:
            raise ValueError(f"{scene}/scene.toml has {key} {len(at)} times, expected once")
        lines[at[0]] = f"{key} = {value}"
    path = Path(folder) / "scene.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def mpmgis(*arguments):
    """Run the command `mpmgis` with `arguments`, and print it as typed in a shell; returns its wall time [s].

    The standard output of the command is not printed.
    """
    words = [str(word) for word in arguments]
    print("$ mpmgis", shlex.join(words), flush=True)
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        code = main(words)
    if code:
        raise SystemExit(code)
    return time.perf_counter() - began


def run_scene(folder, *options):
    """`mpmgis run` of the scene in `folder`; returns (contents of run.json, wall time [s])."""
    seconds = mpmgis("run", Path(folder) / "scene.toml", "--overwrite", "--yes", *options)
    return record(folder), seconds


def record(folder):
    """Contents of run.json of the run in `folder`."""
    return json.loads((Path(folder) / "results" / "run.json").read_text())


def export(folder, *options, products=()):
    """`mpmgis export-raster` of the run in `folder` to `folder`/gis; returns (that folder, wall time [s])."""
    folder = Path(folder)
    more = ["--products", ",".join(products)] if products else []
    seconds = mpmgis("export-raster", folder / "results", "-o", folder / "gis", "--overwrite", *more, *options)
    return folder / "gis", seconds


def fresh(folder):
    """Create `folder`, or empty it if a make.py wrote it; exit if it has other contents."""
    folder = Path(folder)
    if folder.exists() and any(folder.iterdir()) and not (folder / ".scene").exists():
        raise SystemExit(f"{folder} has files that no make.py wrote; choose another folder")
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    (folder / ".scene").touch()
    return folder


def table(rows, header):
    """Rows of text as a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def relative(value, wanted):
    """Largest |value / wanted - 1| of two arrays."""
    return float(np.max(np.abs(np.asarray(value) / np.asarray(wanted) - 1.0)))


def frames(folder):
    """The frames of the run in `folder`, in order of time."""
    for path in sorted((Path(folder) / "results").glob("frame_*.h5")):
        yield read_frame(path, with_state=False)


def nearest(folder, times, origin=0.0):
    """Frames nearest to `times` [s] of a run that begins at `origin` [s]; the last one of two equally near."""
    found = {}
    for frame in frames(folder):
        for wanted in times:
            apart = abs(origin + frame.time - wanted)
            if wanted not in found or apart <= found[wanted][0]:
                found[wanted] = apart, frame
    return [found[wanted][1] for wanted in times]


def loads(folder, *names):
    """float64[frames] of each named column of the loads on the barrier of a run, in its last stage."""
    with open(sorted((Path(folder) / "results").glob("barriers*.csv"))[-1], newline="") as file:
        rows = list(csv.DictReader(file))
    return [np.array([float(row.get(name) or 0.0) for row in rows]) for name in names]


def placed(frame):
    """float64[n, 3] [m]: positions of the particles of a frame in map coordinates."""
    return frame.particles.position + np.asarray(frame.origin)
