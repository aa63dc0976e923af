"""Files of CB-Geo MPM: `particles<step>.h5`, of a parallel run `particles-<rank>_<size>-<step>.h5`; `mpm.json`.

HDF5 with one dataset `table`, one record per particle, read by field names: 53, 74 or 87 fields in different branches
of the code. `volume` is the current volume, which grows in expansion; the released volume is mass over density. Time is
step * analysis.dt of `mpm.json`, which also has the density.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ...system.errors import FormatError, one_line
from ...system.hdf5_reading import opened, reason_elsewhere, require_memory
from ..declarations import Declarations
from .reader_interface import (
    Reader,
    ThirdPartyFrame,
    frames_of_pieces,
    number_of,
    read_settings,
    require_readable,
    same_density,
    setting,
    setting_above_zero,
)

COLUMN_MAP = {
    **{axis: f"coord_{axis}" for axis in "xyz"},
    **{f"v{axis}": f"velocity_{axis}" for axis in "xyz"},
    "mass": "mass",
    "id": "id",
}
NEEDED = (*(f"coord_{axis}" for axis in "xyz"), *(f"velocity_{axis}" for axis in "xyz"), "mass")
ROWS_AT_ONCE = 100_000  # read at once, of 416 bytes and more each
SETTINGS_FOLDERS = 3  # searched upwards from the files: results/<uuid>/ is next to mpm.json
MAGIC = b"\x89HDF\r\n\x1a\n"
_PIECE = re.compile(r"(.*)-(\d{1,9})_(\d{1,9})-(\d{1,15})")


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is HDF5 with a table that has coord_x.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not head.startswith(MAGIC):
        return False
    try:
        with _table(path) as table:
            return "coord_x" in table.dtype.names
    except FormatError:
        return False


@contextmanager
def _table(path: Path) -> Iterator[h5py.Dataset]:
    """Open the dataset `table` of the file at `path`, with values in the file itself."""
    require_readable(path)
    try:
        with opened(path) as file:
            link = file.get("table", getlink=True)
            table = file["table"] if isinstance(link, h5py.HardLink) else None
            if not isinstance(table, h5py.Dataset) or table.ndim != 1 or table.dtype.names is None:
                raise FormatError(f"{path} has no table of records; it is not a particle file of CB-Geo MPM")
            if reason_elsewhere(table.id, path):
                raise FormatError(f"{path}: its table is in other files; expected values in the file itself")
            yield table
    except FormatError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path} is not a readable HDF5 file ({one_line(error)[:100]}); it is damaged") from error


def frames(paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    """Describe the frames in files; the other pieces of a parallel run are included.

    Parameters
    ----------
    paths : iterable of Path
    terms : Declarations

    Raises
    ------
    FormatError
    """
    return frames_of_pieces(paths, _pieces, open_file)


def _pieces(path: Path) -> list[Path]:
    """Return all files of a step, in the order of their ranks."""
    match = _PIECE.fullmatch(path.stem)
    if match is None:
        return [path]
    stem, size, step = match[1], int(match[3]), match[4]
    found = {
        int(piece[2]): other
        for other in path.parent.glob("*.h5")
        if (piece := _PIECE.fullmatch(other.stem)) and (piece[1], int(piece[3]), piece[4]) == (stem, size, step)
    }
    lacking = [rank for rank in range(min(size, len(found) + 1)) if rank not in found]
    if lacking or len(found) != size:
        raise FormatError(
            f"{path}: {len(found)} of {size} pieces of step {int(step)} are there"
            f"{f', rank {lacking[0]} is missing' if lacking else ''}; put them into one folder"
        )
    return [found[rank] for rank in sorted(found)]


def open_file(path: str | Path) -> ThirdPartyFrame:
    """Describe the frame, or the piece of a frame, in a file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No HDF5, damaged, no table, or no position, velocity and mass.
    """
    path = Path(path)
    with _table(path) as table:
        kinds = {name: table.dtype[name] for name in table.dtype.names}
        columns = tuple(name for name, kind in kinds.items() if kind.kind in "fiu" and kind.shape == ())
        lacking = [name for name in NEEDED if name not in columns]
        if lacking:
            raise FormatError(f"{path}: its table lacks {', '.join(lacking)}; it is damaged or not a CB-Geo file")
        count = len(table)
    if count == 0 and _PIECE.fullmatch(path.stem) is None:  # a rank may be empty
        raise FormatError(f"{path}: contains no particle")
    settings, number = _settings(path), number_of(path)
    step = setting_above_zero(settings, "analysis", "dt")
    return ThirdPartyFrame(
        path=path,
        count=count,
        columns=columns,
        read=partial(_read, path, count),
        column_map=COLUMN_MAP,
        number=number,
        time=number * step if step is not None and number is not None else None,
        density=_density(settings),
        density_hint=", or mpm.json in its folder; its volumes are current ones",
    )


def _settings(path: Path) -> dict[str, Any]:
    """Return `mpm.json` in the folder of the file, or in a parent folder if its uuid fits; {} where there is none."""
    folder = path.resolve().parent
    for up, place in enumerate((folder, *folder.parents[:SETTINGS_FOLDERS])):
        settings = read_settings(place / "mpm.json")
        if settings and (up == 0 or setting(settings, "analysis", "uuid") == folder.name):
            return settings
    return {}


def _density(settings):
    materials = setting(settings, "materials")
    return same_density(setting_above_zero(m, "density") for m in materials) if isinstance(materials, list) else None


def _read(path: Path, count: int, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    with _table(path) as table:
        if len(table) != count or not set(names) <= set(table.dtype.names):
            raise FormatError(f"{path} has changed since it was opened; repeat when its code has finished writing")
        require_memory(f"{path}: table", count, 8 * len(names), table)
        found = {name: np.empty(count) for name in names}
        for start in range(0, count, ROWS_AT_ONCE):
            rows = table[start : start + ROWS_AT_ONCE]
            for name in names:
                found[name][start : start + len(rows)] = rows[name]
    return found


READER = Reader("cbgeo", recognises, frames)
