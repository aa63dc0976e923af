"""The folder of a run: frames, the resolved scene, the terrain it used, and a record of what happened."""

import contextlib
import json
import platform
from importlib import metadata
from pathlib import Path

import numpy as np
import rasterio

from .. import __version__
from ..errors import OutputError
from .atomic import output_error, refuse_existing, whole_file
from .frames import write_frame
from .raster import file_sha256

FRAME_PATTERN = "frame_*.h5"
SCENE_FILE, RECORD_FILE, TERRAIN_FILE = "scene.toml", "run.json", "terrain.tif"


class RunFolder:
    """Writes one run; every file in it appears whole or not at all.

    Parameters
    ----------
    path : str or Path
        Made if it is not there; refused if it holds anything, unless `overwrite`, which removes the files of an
        earlier run and nothing else.
    """

    def __init__(self, path, overwrite=False):
        self.path = Path(path)
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path} is a file, wanted a folder for the run; give another -o")
        refuse_existing(self.path, overwrite)
        self._overwrite = overwrite
        self.frames = 0

    def open(self):
        """Make the folder, or clear it of an earlier run's files."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if self._overwrite:
                for name in (FRAME_PATTERN, SCENE_FILE, RECORD_FILE, TERRAIN_FILE):
                    for old in self.path.glob(name):
                        old.unlink()
        except OSError as error:
            raise output_error(self.path, error) from error

    def write_scene(self, text):
        """The resolved scene, as TOML text."""
        with whole_file(self.path / SCENE_FILE) as part:
            part.write_text(text, encoding="utf-8")

    def write_terrain(self, terrain):
        """The terrain in the frame's words: float64 GeoTIFF with the source's transform; answers its digest."""
        path = self.path / TERRAIN_FILE
        rows, columns = terrain.elevation.shape
        profile = {
            "driver": "GTiff", "height": rows, "width": columns, "count": 1, "dtype": "float64",
            "crs": terrain.grid.crs.to_wkt() if terrain.grid.crs is not None else None,
            "transform": terrain.grid.transform, "nodata": np.nan, "compress": "deflate", "predictor": 3,
            "tiled": True, "blockxsize": 256, "blockysize": 256,
        }  # fmt: skip
        with whole_file(path) as part, rasterio.open(part, "w", **profile) as target:
            target.write(terrain.elevation, 1)
            target.set_band_description(1, "elevation [m]")
            target.set_band_unit(1, "m")
        return file_sha256(path)

    def write_frame(self, frame):
        """The next frame, numbered in the order of writing."""
        write_frame(self.path / f"frame_{self.frames:06d}.h5", frame)
        self.frames += 1

    def write_record(self, **record):
        """`run.json`: versions, effects and why, balances, timings, and the state of the run."""
        whole = {"format": "mpmgis-run", "format_version": 1, "versions": versions(), **record}
        with whole_file(self.path / RECORD_FILE) as part:
            part.write_text(json.dumps(whole, indent=1, allow_nan=False, default=float) + "\n", encoding="utf-8")

    def remove_if_empty(self):
        """Leave nothing behind where nothing was written."""
        with contextlib.suppress(OSError):
            self.path.rmdir()


def versions():
    """What computed the result."""
    return {"mpmgis": __version__, "python": platform.python_version(), "numpy": np.__version__,
            "numba": metadata.version("numba"), "machine": platform.machine()}  # fmt: skip
