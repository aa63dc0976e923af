"""Rasters that a run writes from a million points in memory, against a frame of all points: time and bytes."""

import tempfile
import time
from pathlib import Path

import numpy as np
import rasterio
from affine import Affine

from mpmgis.frames.run_folder import TERRAIN_FILE, RunFolder
from mpmgis.maps.export.run_rasters import RasterWriter
from mpmgis.simulation.preparation import prepare
from mpmgis.system.messages import muted

CELLS, PIXEL = 250, 2.0  # pixels of the DTM along a side, and their side [m]
FRAMES = 5
SCENE = {
    "solver": "points",
    "terrain": {"dem": "dtm.tif"},
    "release": {"source": "release.tif", "thickness": 3.0},
    "material": {"law": "Elastic", "bulk_modulus": 4e6, "shear_modulus": 2e6},
    "friction": {"law": "Coulomb", "mu": 0.4},
    "numerics": {"cell_size": 1.0},
    "output": {"end_time": 10.0, "frame_interval": 1.0, "rasters": True, "maxima": True},
}


def _write(path, values):
    profile = {
        "driver": "GTiff",
        "height": CELLS,
        "width": CELLS,
        "count": 1,
        "dtype": values.dtype.name,
        "crs": "EPSG:32632",
        "transform": Affine(PIXEL, 0, 4e5, 0, -PIXEL, 5.1e6),
    }
    with rasterio.open(path, "w", **profile) as target:
        target.write(values, 1)


def rows():
    """Time of a step, with rasters and with a frame; bytes on the disk."""
    with tempfile.TemporaryDirectory() as name:
        site = Path(name)
        _write(site / "dtm.tif", np.tile(300.0 - 0.5 * PIXEL * np.arange(CELLS), (CELLS, 1)))
        area = np.zeros((CELLS, CELLS), np.uint8)
        area[75:-75, 75:-75] = 1
        _write(site / "release.tif", area)
        tables = SCENE | {"terrain": {"dem": str(site / "dtm.tif")}}
        tables["release"] = SCENE["release"] | {"source": str(site / "release.tif")}
        with muted():
            prepared = prepare(tables)
        solver = prepared.solver()
        solver.advance(np.inf, max_steps=2)
        frames = [solver.frame() for _ in range(FRAMES)]
        points = len(frames[0].particles)
        seconds, size = {}, {}
        for kind in ("frame", "rasters"):
            folder = RunFolder(site / kind)
            with folder.held():
                folder.open()
                folder.write_terrain(prepared.terrain)
                writer = RasterWriter(folder, prepared, prepared.terrain, False)
                if kind == "rasters":
                    writer.add(frames[0])  # the first frame keeps its particles
                before = {path for path in folder.path.rglob("*") if path.is_file()}
                each = []
                for frame in frames[1:]:
                    began = time.perf_counter()
                    writer.add(frame) if kind == "rasters" else folder.write_frame(frame)
                    each.append(time.perf_counter() - began)
            new = [path for path in folder.path.rglob("*") if path.is_file() and path not in before]
            seconds[kind] = float(np.median(each))
            largest = [path.stat().st_size for path in new if path.name != TERRAIN_FILE]
            size[kind] = max(largest)
    reference = f"a frame of {points} points with its state"
    yield "step of a run with rasters", seconds["rasters"], "s", reference, seconds["rasters"] / seconds["frame"]
    yield "the same, on the disk", size["rasters"] / 1e6, "MB", reference, size["rasters"] / size["frame"]
    yield "a frame of all points", seconds["frame"], "s", None, None
    yield "the same, on the disk", size["frame"] / 1e6, "MB", None, None
