"""What every scene of this folder needs around `mpmgis`: rasters and polygons written, commands run, results found.

A scene's folder holds `make.py`, which writes its inputs and runs the chain, and `scene.toml` as a user would write it.
"""

import contextlib
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

from mpmgis.cli.main import main
from mpmgis.io.frames import read_frame

SCENES = Path(__file__).parent


def scene_module(name, program="make"):
    """The module of a `program` of the scene `name`; scenes have programs of the same names."""
    key = f"scene_{name}_{program}"
    if key not in sys.modules:
        spec = importlib.util.spec_from_file_location(key, SCENES / name / f"{program}.py")
        sys.modules[key] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[key])
    return sys.modules[key]


def write_raster(path, values, west, north, cell, crs=None):
    """float[rows, columns], the first row in the north, as float64 GeoTIFF."""
    rows, columns = values.shape
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": 1, "dtype": "float64", "nodata": -9999.0,
               "crs": crs, "transform": Affine(cell, 0.0, west, 0.0, -cell, north)}  # fmt: skip
    with rasterio.open(path, "w", **profile) as target:
        target.write(values, 1)


def write_polygons(path, shapes, crs, **columns):
    """Polygons [map coordinates] with `columns` of values, in the format that the path's suffix says."""
    geopandas.GeoDataFrame(columns, geometry=list(shapes), crs=crs).to_file(path)


def write_scene(scene, folder, **changed):
    """Copy the scene's `scene.toml` to `folder`, lines `key = ...` of `changed` keys replaced; answers the path.

    A key stands once in the file, so that what is changed is what was meant.
    """
    lines = (SCENES / scene / "scene.toml").read_text().splitlines()
    for key, value in changed.items():
        at = [k for k, line in enumerate(lines) if line.split("=")[0].strip() == key]
        if len(at) != 1:
            raise ValueError(f"{scene}/scene.toml has {key} {len(at)} times, wanted once")
        lines[at[0]] = f"{key} = {value}"
    path = Path(folder) / "scene.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def mpmgis(*arguments):
    """Run the command `mpmgis` with `arguments`, shown as one would type it; answers the seconds it took.

    What it prints, paths and data, is not shown.
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
    """`mpmgis run` of the scene in `folder`; answers (its run.json, seconds)."""
    seconds = mpmgis("run", Path(folder) / "scene.toml", "--overwrite", "--yes", *options)
    return record(folder), seconds


def record(folder):
    """run.json of the run in `folder`."""
    return json.loads((Path(folder) / "results" / "run.json").read_text())


def export(folder, *options, products=()):
    """`mpmgis export-raster` of the run in `folder` to its `gis`; answers (that folder, seconds)."""
    folder = Path(folder)
    more = ["--products", ",".join(products)] if products else []
    seconds = mpmgis("export-raster", folder / "results", "-o", folder / "gis", "--overwrite", *more, *options)
    return folder / "gis", seconds


def fresh(folder):
    """`folder`, emptied of an earlier making, or refused where it holds anything else."""
    folder = Path(folder)
    if folder.exists() and any(folder.iterdir()) and not (folder / ".scene").exists():
        raise SystemExit(f"{folder} holds something that no make.py wrote; name another folder")
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


def placed(frame):
    """float64[n, 3] [m]: where its particles are on the map."""
    return frame.particles.position + np.asarray(frame.origin)
