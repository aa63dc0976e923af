"""Folder of a run: frames, the resolved scene, the terrain, and the record of the run."""

import contextlib
import json
import platform
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rasterio

from .. import __version__
from ..system import operating_system
from ..system.errors import FormatError, MpmgisError, OutputError, one_line
from ..system.folder_lock import LOCK_FILE, sole_writer
from ..system.links import input_at, refuse_links, remove, require_free, status
from ..system.whole_files import MARK, is_left_over, output_error, refuse_existing, whole_file
from ..system.writer_process import new_token
from ..terrain.raster_input import file_sha256
from .frame_digest import require_restartable, result_after, stored_digests
from .frame_files import FRAMES_WITH_STATE, content_digest, drop_state, read_frame, set_digest, write_frame
from .run_maps import map_files, move_maps, refuse_other_maps, remove_maps, set_digest_of_maps

if TYPE_CHECKING:
    from ..terrain.elevation import Terrain
    from .particles import Frame


FRAME_PATTERN = "frame_*.h5"
SCENE_FILE, RECORD_FILE, TERRAIN_FILE = "scene.toml", "run.json", "terrain.tif"
_LISTS = ("effects", "stages", "troubles", "unusable")  # entries of a record that are lists
_TABLES = (
    "balances",
    "companion",
    "mass",
    "numbers",
    "resolution",
    "scene",
    "versions",
    "volume",
)  # and those that are tables
BARRIER_FILE = "barriers.csv"
STAGE_BARRIER_FILE = "barriers_{}.csv"  # of a run in several stages, whose solvers sum different quantities
FILES = (FRAME_PATTERN, SCENE_FILE, RECORD_FILE, TERRAIN_FILE, BARRIER_FILE, STAGE_BARRIER_FILE.format("*"))
LEFT_OVER = tuple(f".{Path(name).stem}.part[0-9]*" for name in FILES)  # temporary files of a killed process
_FORMAT = "mpmgis-run"


class RunFolder:
    """Writer of one run; every file is written atomically.

    Parameters
    ----------
    path : str or Path
        Created if missing; refused if it is not empty, unless `overwrite`. Refused if it is a link, or contains a link
        under the name of a file of a run.
    overwrite : bool
        Replace only the files of an earlier run, after the first frame of the new run is complete.

    Raises
    ------
    OutputError
        The folder is refused.

    Attributes
    ----------
    frames : int
        Number of frames.
    result : str or None
        Digest of all frames, '' while there is none; None in the folder of a version without digests.
    """

    def __init__(self, path: str | Path, overwrite: bool = False):
        self.path = Path(path)
        self._refuse_links()
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path} is a file, expected a folder for the run; give another -o")
        self._overwrite, self._resumed, self._hold, self._stage = overwrite, False, None, None
        self._refuse_other_content()
        self._refuse_filled()
        self.frames, self.result, self._passed = 0, "", None

    @classmethod
    def resumed(cls, path: str | Path) -> "RunFolder":
        """Return the folder of an earlier run to continue; an empty or missing folder starts at the beginning.

        Parameters
        ----------
        path : str or Path
        """
        path = Path(path)
        if path.is_dir() and (path / RECORD_FILE).is_file():
            folder = cls(path, overwrite=True)
            folder._overwrite = False
        else:
            folder = cls(path)
        folder._resumed = True
        return folder

    @property
    def place(self) -> Path:
        """Folder of new files: a hidden folder in `path` as long as an earlier run is there."""
        return self._stage or self.path

    def _refuse_links(self):
        refuse_links(self.path, (LOCK_FILE, *FILES, *LEFT_OVER))

    def _refuse_other_content(self):
        """Refuse to replace files with these names that were not written by a run, and to write into other results."""
        if self.path.is_dir() and status(self.path / MARK) is not None and not _is_of_a_run(self.path / RECORD_FILE):
            raise OutputError(
                f"{self.path} contains other results of mpmgis (an export, for example), which a run would mix with "
                "its own; give another -o"
            )
        if self.path.is_dir() and next(self._entries(*FILES), None) and not _is_of_a_run(self.path / RECORD_FILE):
            record = self.path / RECORD_FILE
            found = f"{record.name} is not the record of a run" if record.is_file() else f"there is no {record.name}"
            raise OutputError(f"{self.path} contains {next(self._entries(*FILES)).name}, but {found}; give another -o")
        if self.path.is_dir():
            record = {}
            with contextlib.suppress(FormatError):  # a damaged record is replaced
                record = read_record(self.path)
            refuse_other_maps(self.path, record)

    def refuse_inputs(self, inputs: Iterable[Path]) -> None:
        """Refuse a folder where one of the `inputs`, under any name, would be replaced or removed.

        Parameters
        ----------
        inputs : iterable of Path

        Raises
        ------
        OutputError
            A file of the run is an input.
        """
        entries = [*self._entries(*FILES, LOCK_FILE), *map_files(self.path)] if self.path.is_dir() else []
        inputs = list(inputs) if entries else []
        for entry in entries:
            given = input_at(entry, inputs)
            if given is not None:
                name = entry if given == entry else f"{entry}, which is {given},"
                raise OutputError(f"{name} is an input of the run and would be replaced; give another -o")

    def _entries(self, *patterns: str) -> Iterator[Path]:
        """Return the entries of the folder that match one of the `patterns`, links and other types included."""
        return (path for path in sorted(self.path.iterdir()) if any(path.match(pattern) for pattern in patterns))

    def _refuse_filled(self):
        """Refuse a folder that contains more than temporary files of a killed run, unless it is overwritten."""
        if self.path.is_dir() and all(self._is_left_over(path) for path in self.path.iterdir()):
            return
        refuse_existing(self.path, self._overwrite)

    @staticmethod
    def _is_left_over(path):
        return path.name == LOCK_FILE or any(path.match(pattern) for pattern in LEFT_OVER)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Create the folder and lock it for this block, so that no other run writes to it; removed again if empty.

        Raises
        ------
        OutputError
            Another run has locked it, or wrote it first.
        """
        try:
            with contextlib.ExitStack() as block:
                try:
                    self.path.mkdir(parents=True, exist_ok=True)
                    self._hold = block.enter_context(sole_writer(self.path))
                except OSError as error:
                    raise output_error(self.path, error) from error
                self._refuse_links()
                if not self._resumed:
                    self._refuse_filled()
                    self._refuse_other_content()
                self._sweep()
                yield
        finally:
            self._drop_stage()
            self._remove_if_empty()

    def _sweep(self):
        """Remove incomplete files of ended processes."""
        for path in self._entries(*LEFT_OVER):
            if is_left_over(path.name.rpartition(".part")[2]):
                remove(path)

    def require(self) -> None:
        """Raise OutputError if the locked folder was removed, moved or replaced."""
        self._hold.require_folder()

    def record(self) -> dict:
        """Return the record of the run so far; {} where there is none.

        Raises
        ------
        FormatError
            `run.json` cannot be read.
        """
        return read_record(self.path, "start again with --overwrite")

    def last_frame(self, digest: str) -> "Frame | None":
        """Return the newest complete frame with its state; `frames` then counts up to it.

        Newer frames without state, which no run leaves, are written again.

        Parameters
        ----------
        digest : str
            Digest of the scene.

        Returns
        -------
        Frame or None
            None where there is no such frame.
        """
        for number, frame in self.restartable(digest):
            self._go_on_after(number)
            return frame
        return None

    def restartable(self, *digests: str) -> Iterator[tuple[int, "Frame"]]:
        """Yield each complete frame with state, newest first.

        Parameters
        ----------
        *digests : str
            Digests of scenes; frames of other scenes are left out.

        Yields
        ------
        number : int
        frame : Frame

        Raises
        ------
        FormatError
            A frame with state was changed.
        """
        for path in sorted(self.path.glob(FRAME_PATTERN), reverse=True):
            if path.is_dir():
                raise FormatError(
                    f"{path} is a folder, not a frame; remove it, and --resume continues from the frame before it"
                )
            try:
                digest = read_frame(path, with_state=False, with_particles=False).digest
            except FormatError as error:
                raise FormatError(f"{error}; remove it, and --resume continues from the frame before it") from error
            if digest not in digests:
                continue  # of an earlier run
            number = int(path.stem.rpartition("_")[2])
            if require_restartable(path, self._frame_path(number - 1)):
                yield number, read_frame(path)

    def missing_frames(self) -> list[int]:
        """Return the numbers of the frames before the next one that are not in the folder."""
        return [number for number in range(self.frames) if not self._frame_path(number).is_file()]

    def go_back_to(self, number: int, digest: str) -> None:
        """Remove the frames after `number`; the others get the digest of another scene.

        Parameters
        ----------
        number : int
        digest : str
            Digest of the other scene.

        Raises
        ------
        OutputError
            A file cannot be removed or written.
        """
        self._require_free()
        try:
            for path in sorted(self.path.glob(FRAME_PATTERN), reverse=True):
                if int(path.stem.rpartition("_")[2]) > number:
                    path.unlink()
                else:
                    set_digest(path, digest)
            set_digest_of_maps(self.path, digest)
        except OSError as error:
            raise output_error(self.path, error) from error
        self._go_on_after(number)

    def _go_on_after(self, number):
        self.frames = number + 1
        self.result = stored_digests(self._frame_path(number))[1] or None

    def open(self, anew: bool = True) -> None:
        """Prepare the locked folder for a run.

        The files of an earlier run are kept until the new run has its first frame.

        Parameters
        ----------
        anew : bool
            The run begins; otherwise it continues.

        Raises
        ------
        OutputError
            The files of an earlier run cannot be replaced; the folder cannot be written.
        """
        if anew:
            self._require_free()
        try:
            if anew and next(self._entries(*FILES), None):
                stage = self.path / f".{Path(RECORD_FILE).stem}.part{new_token()}"
                stage.mkdir()
                self._stage = stage
            if not anew:
                self._drop_older_state()
        except OSError as error:
            raise output_error(self.path, error) from error

    def _take_over(self):
        """Replace the files of the earlier run by the new ones; the record first.

        If this is interrupted, the record and the frames still identify their run.
        """
        stage = self._stage
        self._require_free("the earlier run is complete")
        try:
            operating_system.replace(stage / RECORD_FILE, self.path / RECORD_FILE)
            for path in sorted(self._entries(*FILES), reverse=True):
                if path.name != RECORD_FILE:
                    path.unlink()
            remove_maps(self.path)
            move_maps(stage, self.path)
            for path in sorted(stage.iterdir(), key=lambda path: path.match(FRAME_PATTERN)):
                if path.is_file():
                    operating_system.replace(path, self.path / path.name)
        except OSError as error:
            raise output_error(self.path, error) from error
        self._drop_stage()

    def _require_free(self, still="nothing has changed"):
        """Refuse to replace the files where one of them is open in another program."""
        for path in (*self._entries(*FILES), *map_files(self.path)):
            require_free(path, still)

    def _drop_stage(self):
        """Remove the hidden folder of new files."""
        if self._stage is not None:
            remove(self._stage)
            self._stage = None

    def write_scene(self, text: str) -> None:
        """Write the resolved scene.

        Parameters
        ----------
        text : str
            The scene as TOML.
        """
        with whole_file(self.place / SCENE_FILE) as part:
            part.write_text(text, encoding="utf-8", newline="\n")

    def write_terrain(self, terrain: "Terrain") -> str:
        """Write the terrain as float64 GeoTIFF with the transform of its source.

        Parameters
        ----------
        terrain : Terrain

        Returns
        -------
        str
            Digest (SHA-256) of the file.
        """
        path = self.place / TERRAIN_FILE
        rows, columns = terrain.elevation.shape
        profile = {
            "driver": "GTiff",
            "height": rows,
            "width": columns,
            "count": 1,
            "dtype": "float64",
            "crs": terrain.grid.crs.to_wkt() if terrain.grid.crs is not None else None,
            "transform": terrain.grid.transform,
            "nodata": np.nan,
            "compress": "deflate",
            "predictor": 3,
            "tiled": True,
            "blockxsize": 256,
            "blockysize": 256,
        }
        with whole_file(path) as part, rasterio.open(part, "w", **profile) as target:
            target.write(terrain.elevation, 1)
            target.set_band_description(1, "elevation [m]")
            target.set_band_unit(1, "m")
            if terrain.reprojection is not None:
                target.update_tags(**{name: str(value) for name, value in terrain.reprojection.facts().items()})
        return file_sha256(path)

    def write_frame(self, frame: "Frame") -> None:
        """Write the next frame, numbered in the order of writing; only the newest two keep the restart state.

        Parameters
        ----------
        frame : Frame
        """
        content = write_frame(self._frame_path(self.frames), frame, self.result)
        self.frames += 1
        if self.result is not None:
            self.result = result_after(self.result, content)
        if self._stage is not None:
            self._take_over()
        self._drop_older_state()

    def newest_frame(self) -> Path:
        """Return the path of the frame that a run continues from."""
        return self._frame_path(self.frames - 1)

    def pass_frame(self, frame: "Frame") -> None:
        """Count the next frame and add it to the digest of the result, without writing it.

        Parameters
        ----------
        frame : Frame
        """
        before, self._passed = self.result, (self.frames, frame, self.result)
        self.frames += 1
        if before is not None:
            self.result = result_after(before, content_digest(frame))

    def keep_frame(self, frame: "Frame | None" = None) -> None:
        """Write the next frame; keep the first and the newest two.

        Parameters
        ----------
        frame : Frame, optional
            Default: the newest one that was passed.
        """
        if frame is not None:
            self.write_frame(frame)
        elif self._passed is not None:
            number, passed, before = self._passed
            write_frame(self._frame_path(number), passed, before)
        self._passed = None
        older = sorted(self.place.glob(FRAME_PATTERN))[:-FRAMES_WITH_STATE]
        for path in (path for path in older if operating_system.held_open(path) is None):
            drop_state(path) if path == self._frame_path(0) else path.unlink()

    def _drop_older_state(self):
        """Remove the state from the newest frame that no longer needs it, unless a program has it open."""
        older = self._frame_path(self.frames - 1 - FRAMES_WITH_STATE)
        if self.frames > FRAMES_WITH_STATE and older.is_file() and operating_system.held_open(older) is None:
            drop_state(older)

    def _frame_path(self, number):
        return self.place / f"frame_{number:06d}.h5"

    def write_record(self, **record: object) -> None:
        """Write `run.json`: versions, effects and reasons, balances, timings, state, digest of the result.

        Parameters
        ----------
        **record
            Entries of the record, values that JSON can hold.
        """
        whole = {"format": _FORMAT, "format_version": 1, "versions": versions(), **record}
        if record.get("state") != "running":
            whole["result_digest"] = self.result
        with whole_file(self.place / RECORD_FILE) as part:
            text = json.dumps(whole, indent=1, allow_nan=False, default=float) + "\n"
            part.write_text(text, encoding="utf-8", newline="\n")
        if self._stage is not None and record.get("state") == "finished":  # a run without any frame
            self._take_over()

    def _remove_if_empty(self):
        """Remove the folder if nothing was written."""
        with contextlib.suppress(OSError):
            self.path.rmdir()


def _is_of_a_run(file: Path) -> bool:
    """Return whether a run wrote the record `file`; an unreadable file counts as a damaged record."""
    if status(file) is None:
        return False
    if not file.is_file():
        return True
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return True
    return isinstance(record, dict) and record.get("format") == _FORMAT


def record_of(folder: str | Path, digest: str) -> dict:
    """Return the record of the run in `folder`; empty if it is damaged, missing, or of another scene.

    Parameters
    ----------
    folder : str or Path
    digest : str
        Of the scene.
    """
    try:
        record = read_record(folder)
    except MpmgisError:
        return {}
    return record if record.get("digest") == digest else {}


def read_record(folder: str | Path, fix: str = "remove it") -> dict:
    """Read the record of the run in `folder`.

    Parameters
    ----------
    folder : str or Path
    fix : str
        Advice in the message of an error.

    Returns
    -------
    dict
        Empty where there is no record.

    Raises
    ------
    FormatError
        `run.json` cannot be read, or a run did not write it.
    """
    file = Path(folder) / RECORD_FILE
    if not file.is_file():
        return {}
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FormatError(f"{file} cannot be read ({one_line(error)[:80]}); {fix}") from error
    wrong = f"{file} was not written by a run"
    if not isinstance(record, dict) or not record:
        raise FormatError(f"{wrong}: it is {'empty' if record in ([], {}) else 'not a table'}; {fix}")
    _require_shape(record, wrong, fix)
    return record


def _require_shape(record, wrong, fix):
    """Refuse a record in which a list or a table has another type."""
    for key in (*_LISTS, *_TABLES):
        if not isinstance(record.get(key), (list if key in _LISTS else dict, type(None))):
            raise FormatError(f"{wrong}: {key} is not a {'list' if key in _LISTS else 'table'}; {fix}")
    for key in ("effects", "stages"):
        if not all(isinstance(entry, dict) for entry in record.get(key) or ()):
            raise FormatError(f"{wrong}: {key} has an entry that is not a table; {fix}")
    for stage in record.get("stages") or ():
        _require_shape(stage, wrong, fix)


def versions() -> dict[str, str]:
    """Return the versions of the software that computes a result."""
    return {
        "mpmgis": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": metadata.version("numba"),
        "machine": platform.machine(),
    }
