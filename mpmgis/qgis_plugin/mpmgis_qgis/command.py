"""Find the command `mpmgis`, make its environment, and read its messages: lines, progress, errors."""

from __future__ import annotations

import os
import re
import shutil

COMMAND = "mpmgis"
ENDS_WITH = "MPMGIS_ENDS_WITH"  # variable with the process with which the command ends
SETTING = "MPMGIS_COMMAND"  # name in the settings of QGIS
SETTING_PLACE = "Settings > Options > Processing > Providers > mpmgis"
INSTALL_PLACE = "Plugins > mpmgis > Install mpmgis"
RECOMMENDS = "recommended"  # word of an answer that the user should read first
KEPT_BLANK = "\u00a0"
# QGIS sets these for its own Python and libraries; they break another Python with other versions of PROJ and GDAL.
OF_QGIS = (
    *("PYTHONHOME", "PYTHONPATH", "PYTHONEXECUTABLE", "PYTHONSTARTUP"),
    *("PROJ_LIB", "PROJ_DATA", "GDAL_DATA", "GDAL_DRIVER_PATH"),
)

_TIME, _FRAME = re.compile(r"t = ([\d.]+) of ([\d.]+)"), re.compile(r"frame (\d+) of (\d+)")
_BLOCK = re.compile(r"block (\d+) of (\d+)")
_MEMBER = re.compile(r"run (\d+) of (\d+)")
_SETTING = re.compile(r"(\d+) of (\d+): ")  # printed at its start: one less is done
# progress lines by verb: (pattern, offset of the first number, share of the progress bar)
_USUAL = ((_TIME, 0, (0.0, 1.0)), (_FRAME, 0, (0.0, 1.0)))
_OF_VERB = {
    "demo": ((_TIME, 0, (0.0, 0.7)), (_FRAME, 0, (0.7, 1.0))),
    "ensemble": ((_MEMBER, 0, (0.0, 1.0)),),
    "calibrate": ((_MEMBER, 0, (0.0, 1.0)),),
    "release": ((_BLOCK, 0, (0.0, 1.0)),),
    "region": ((_MEMBER, 0, (0.0, 1.0)),),
    "study": ((_SETTING, 1, (0.0, 1.0)),),
}


class CommandMissing(Exception):
    """The command was not found; the message is one line with the fix."""


def find_command(setting: str, own: str | None = None) -> str:
    """Return the absolute path of the command: from the setting, else of the toolbox, on PATH, in the folder of pipx.

    Parameters
    ----------
    setting : str
        Path in the settings of QGIS; "" if not set.
    own : str, optional
        The command that the toolbox has installed.

    Returns
    -------
    str

    Raises
    ------
    CommandMissing
    """
    named = (setting or "").strip().strip('"')
    if named:
        found = shutil.which(os.path.expanduser(named))
        if found is None:
            raise CommandMissing(
                f"the command mpmgis is not at {named}; correct its path in {SETTING_PLACE}, or clear it and open "
                f"{INSTALL_PLACE}"
            )
        return os.path.abspath(found)
    pipx = os.path.join(os.path.expanduser("~"), ".local", "bin")
    found = own or shutil.which(COMMAND) or shutil.which(COMMAND, path=pipx)
    if found is None:
        raise CommandMissing(
            f"mpmgis is not installed; open {INSTALL_PLACE} (it has an environment of its own, never in QGIS' Python), "
            f"or set the path of a command in {SETTING_PLACE}"
        )
    return os.path.abspath(found)


def environment(of_qgis: dict[str, str]) -> dict[str, str]:
    """Return the environment of QGIS without the variables for its own Python and libraries.

    The command ends when this process has ended.

    Parameters
    ----------
    of_qgis : mapping of str to str

    Returns
    -------
    dict of str to str
    """
    kept = {name: value for name, value in of_qgis.items() if name not in OF_QGIS}
    return {**kept, "PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1", ENDS_WITH: str(os.getpid())}


class Lines:
    """Splits a stream of bytes into complete lines of text."""

    def __init__(self):
        self._rest = b""

    def add(self, data: bytes) -> list[str]:
        """Return the lines that the next bytes complete; a carriage return also ends a line.

        Parameters
        ----------
        data : bytes

        Returns
        -------
        list of str
        """
        *whole, self._rest = (self._rest + data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        return [line.decode("utf-8", "replace") for line in whole if line.strip()]

    def end(self) -> list[str]:
        """Return the remaining text without an end of line: at most one line."""
        return self.add(b"\n")


def progress(line: str, verb: str) -> float | None:
    """Return the share of the work of a verb that a progress line reports.

    Parameters
    ----------
    line, verb : str

    Returns
    -------
    float or None [1]
        None for another line.
    """
    for pattern, earlier, (begin, end) in _OF_VERB.get(verb, _USUAL):
        found = pattern.match(line)
        if found is not None and float(found[2]) > 0:
            return begin + min((float(found[1]) - earlier) / float(found[2]), 1.0) * (end - begin)
    return None


def shown_answer(line: str) -> tuple[str, bool]:
    """Return a line of an answer as the log of QGIS shows it, and whether it recommends something.

    The log draws several blanks as one, which a table does not survive: they become blanks that are kept.

    Parameters
    ----------
    line : str

    Returns
    -------
    (str, bool)
    """
    kept = re.sub(" {2,}", lambda blanks: " " + KEPT_BLANK * (len(blanks[0]) - 1), line)
    return kept, RECOMMENDS in line


def is_error_line(line: str, verb: str) -> bool:
    """Return whether a line is an error of the command.

    Parameters
    ----------
    line, verb : str
    """
    return line.startswith(f"mpmgis {verb}: ")


def error_line(lines: list[str], verb: str, code: int) -> str:
    """Return the error of the command: its last error line, else its last line, else the exit code.

    Parameters
    ----------
    lines : list of str
    verb : str
    code : int
        Exit code.

    Returns
    -------
    str
    """
    own = [line for line in lines if is_error_line(line, verb)]
    return (own or lines or [f"mpmgis {verb}: ended with exit code {code} without a message"])[-1]
