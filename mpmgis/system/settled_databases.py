"""SQLite databases (GeoPackage) with changes that another program has not yet written into them.

SQLite writes such changes into the database when it is opened, also for reading. Inputs are not changed: a copy of
database and changes is read instead, after SQLite has applied or undone them there.
"""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from .errors import FormatError
from .file_references import head_of

_MAGIC = b"SQLite format 3\0"
_CHANGES = ("-wal", "-journal")
_TRIES = 3  # to copy a database that another program writes


@contextmanager
def settled(path: Path) -> Iterator[Path]:
    """Yield `path`, or that of a copy for this block where opening a database would change it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FormatError
        Another program changes the database all the time.
    """
    if not (head_of(path).startswith(_MAGIC) and _changes(path)):
        yield path
        return
    import sqlite3

    with tempfile.TemporaryDirectory(prefix="mpmgis_") as folder:
        for _ in range(_TRIES):
            before = _state(path)
            for file in (path, *_changes(path)):
                shutil.copyfile(file, Path(folder) / file.name)
            if _state(path) == before:
                break
        else:
            raise FormatError(f"{path} is being written by another program; save and close it there")
        copy = Path(folder) / path.name
        with suppress(sqlite3.Error), closing(sqlite3.connect(copy)) as connection:  # a damaged one is refused later
            connection.execute("SELECT COUNT(*) FROM sqlite_master")
        yield copy


def _changes(path):
    """Files with changes that are not in the database yet."""
    places = (Path(f"{path}{suffix}") for suffix in _CHANGES)
    return [place for place in places if place.is_file() and place.stat().st_size]


def _state(path):
    return [(file.stat().st_size, file.stat().st_mtime_ns) for file in (path, *_changes(path))]
