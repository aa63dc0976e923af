"""The folder of a run: frames, the resolved scene, the terrain it used, and a record of what happened."""

import contextlib
import json
import platform
from importlib import metadata
from pathlib import Path

import numpy as np
import rasterio

from .. import __version__
from ..errors import FormatError, OutputError, one_line
from .atomic import output_error, refuse_existing, whole_file
from .frames import drop_state, read_frame, write_frame
from .raster import file_sha256

FRAME_PATTERN = "frame_*.h5"
FRAMES_WITH_STATE = 2
SCENE_FILE, RECORD_FILE, TERRAIN_FILE = "scene.toml", "run.json", "terrain.tif"
BARRIER_FILE = "barriers.csv"
STAGE_BARRIER_FILE = "barriers_{}.csv"  # of a run in several stages, whose solvers sum up different things
FILES = (FRAME_PATTERN, SCENE_FILE, RECORD_FILE, TERRAIN_FILE, BARRIER_FILE, STAGE_BARRIER_FILE.format("*"))


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

    @classmethod
    def resumed(cls, path):
        """The folder of an earlier run, to go on in; an empty or missing one starts at the beginning."""
        path = Path(path)
        if path.is_dir() and (path / RECORD_FILE).is_file():
            folder = cls(path, overwrite=True)
            folder._overwrite = False
            return folder
        return cls(path)

    def record(self):
        """The record of the run so far; {} where there is none.

        Raises
        ------
        FormatError
            `run.json` cannot be read.
        """
        file = self.path / RECORD_FILE
        if not file.is_file():
            return {}
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            reason = one_line(error)[:80]
            raise FormatError(f"{file} cannot be read ({reason}); start again with --overwrite") from error
        return record if isinstance(record, dict) else {}

    def last_frame(self):
        """The newest whole frame with its state, None where there is none; `frames` then counts up to it.

        Newer frames without state, which no run leaves, are not trusted: they are written again.
        """
        for path in sorted(self.path.glob(FRAME_PATTERN), reverse=True):
            frame = read_frame(path)
            if frame.state:
                self.frames = int(path.stem.rpartition("_")[2]) + 1
                return frame
        return None

    def open(self):
        """Make the folder, clear it of an earlier run's files, or of what a kill left half done."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if self._overwrite:
                self._remove(*FILES)
            self._remove(*(f".{Path(name).stem}.part[0-9]*" for name in FILES))  # never got their names, for a kill
            self._drop_older_state()
        except OSError as error:
            raise output_error(self.path, error) from error

    def _remove(self, *patterns):
        for pattern in patterns:
            for old in self.path.glob(pattern):
                old.unlink()

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
        """The next frame, numbered in the order of writing; only the newest two keep what a restart needs."""
        write_frame(self._frame_path(self.frames), frame)
        self.frames += 1
        self._drop_older_state()

    def _drop_older_state(self):
        """Take the state out of the newest frame that need not keep it any more."""
        if self.frames > FRAMES_WITH_STATE:
            drop_state(self._frame_path(self.frames - 1 - FRAMES_WITH_STATE))

    def _frame_path(self, number):
        return self.path / f"frame_{number:06d}.h5"

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
