"""The command `mpmgis`: its path, its environment, and its messages: lines, progress, errors.

Writes files of the toolbox atomically, and restores earlier ones if the command refuses the new ones.
"""

from __future__ import annotations

import os
import re
import shutil
from contextlib import contextmanager


@contextmanager
def kept_unless(paths, undoes):
    """A block that writes files at `paths`, all in one folder.

    If it raises an error for which `undoes(error)` is true, or cannot write, the earlier files are restored. A new
    folder is removed if it is empty.
    """
    folder = os.path.dirname(paths[0])
    made = not os.path.isdir(folder)
    before = {path: _read(path) for path in paths}
    try:
        os.makedirs(folder, exist_ok=True)
        yield
    except Exception as error:
        if not (isinstance(error, OSError) or undoes(error)):
            raise
        for path, data in before.items():
            if data is not None:
                write_whole(path, data)
            elif os.path.exists(path):
                os.remove(path)
        if made and not os.listdir(folder):
            os.rmdir(folder)
        raise


def write_whole(path, data):
    """Write the bytes `data` to `path` atomically, through a temporary file in the same folder."""
    with _part_of(path) as part, open(part, "wb") as file:
        file.write(data)


def copy_whole(source, path):
    """Copy the file `source` to `path` in the same way."""
    with _part_of(path) as part:
        shutil.copyfile(source, part)


@contextmanager
def _part_of(path):
    if os.path.islink(path):
        raise OSError(f"{path} is a link; links are not followed when writing")
    part = f"{path}.part{os.urandom(8).hex()}"  # a random name, so that no link can exist there
    try:
        yield part
        os.replace(part, path)
    finally:
        if os.path.exists(part):
            os.remove(part)


def _read(path):
    if not os.path.exists(path):
        return None
    with open(path, "rb") as file:
        return file.read()


COMMAND = "mpmgis"
SETTING = "MPMGIS_COMMAND"
SETTING_PLACE = "Settings > Options > Processing > Providers > mpmgis"
# QGIS sets these for its own Python and libraries; they break another Python with other versions of PROJ and GDAL.
OF_QGIS = (
    *("PYTHONHOME", "PYTHONPATH", "PYTHONEXECUTABLE", "PYTHONSTARTUP"),
    *("PROJ_LIB", "PROJ_DATA", "GDAL_DATA", "GDAL_DRIVER_PATH"),
)

_TIME, _FRAME = re.compile(r"t = ([\d.]+) of ([\d.]+)"), re.compile(r"frame (\d+) of (\d+)")
_MEMBER = re.compile(r"run (\d+) of (\d+)")
_SETTING = re.compile(r"(\d+) of (\d+): ")  # printed at its start: one less is done
# progress lines by verb: (pattern, offset of the first number, share of the progress bar)
_USUAL = ((_TIME, 0, (0.0, 1.0)), (_FRAME, 0, (0.0, 1.0)))
_OF_VERB = {
    "demo": ((_TIME, 0, (0.0, 0.7)), (_FRAME, 0, (0.7, 1.0))),
    "ensemble": ((_MEMBER, 0, (0.0, 1.0)),),
    "calibrate": ((_MEMBER, 0, (0.0, 1.0)),),
    "region": ((_MEMBER, 0, (0.0, 1.0)),),
    "study": ((_SETTING, 1, (0.0, 1.0)),),
}


class CommandMissing(Exception):
    """The command was not found; the message is one line with the fix."""


def find_command(setting):
    """Absolute path of the command: from `setting`, else on PATH, else in the folder of pipx.

    Raises
    ------
    CommandMissing
    """
    named = (setting or "").strip().strip('"')
    if named:
        found = shutil.which(os.path.expanduser(named))
        if found is None:
            raise CommandMissing(
                f"the command mpmgis is not at {named}; set its path in {SETTING_PLACE} (empty: search PATH)"
            )
        return os.path.abspath(found)
    found = shutil.which(COMMAND) or shutil.which(COMMAND, path=os.path.join(os.path.expanduser("~"), ".local", "bin"))
    if found is None:
        raise CommandMissing(
            "the command mpmgis is not on PATH; install it in a separate environment, never in QGIS' Python "
            f"(pipx install mpmgis, or pip install in a virtual environment), and set its path in {SETTING_PLACE}"
        )
    return os.path.abspath(found)


def environment(of_qgis):
    """Dictionary: the environment of QGIS without the variables for its own Python and libraries."""
    kept = {name: value for name, value in of_qgis.items() if name not in OF_QGIS}
    return {**kept, "PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1"}


class Lines:
    """Splits a stream of bytes into complete lines of text."""

    def __init__(self):
        self._rest = b""

    def add(self, data):
        """List of the lines that `data` completes; a carriage return also ends a line."""
        *whole, self._rest = (self._rest + data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        return [line.decode("utf-8", "replace") for line in whole if line.strip()]

    def end(self):
        """List of the remaining text without an end of line: at most one line."""
        return self.add(b"\n")


def progress(line, verb):
    """Share (0 to 1) of the work of `verb` that is done by the progress line `line`; None for another line."""
    for pattern, earlier, (begin, end) in _OF_VERB.get(verb, _USUAL):
        found = pattern.match(line)
        if found is not None and float(found[2]) > 0:
            return begin + min((float(found[1]) - earlier) / float(found[2]), 1.0) * (end - begin)
    return None


def is_error_line(line, verb):
    """Whether `line` is an error of the command `verb`."""
    return line.startswith(f"mpmgis {verb}: ")


def error_line(lines, verb, code):
    """The error of the command `verb`: its last error line, else its last line, else the exit code."""
    own = [line for line in lines if is_error_line(line, verb)]
    return (own or lines or [f"mpmgis {verb}: ended with exit code {code} without a message"])[-1]
