"""Find Pythons that can make the environment of mpmgis: that of QGIS first, then others on the machine."""

from __future__ import annotations

import glob
import ntpath
import os
import posixpath
import re
import sys
from dataclasses import dataclass

from .own_environment import BEYOND, OLDEST

MINORS = range(BEYOND[1] - 1, OLDEST[1] - 1, -1)  # of Python 3, the newest first
PIP_FOR_OTHERS = (22, 3)  # first pip with the option --python
STORE = "windowsapps"  # Pythons of Windows' Store there write to a folder of their own instead of the profile
# what a Python is asked: its version, bits, pip, and the modules that make an environment
QUESTION = (
    "import sys, importlib.util as u\n"
    "pip = __import__('pip').__version__ if u.find_spec('pip') else '0'\n"
    "print('PYTHON', sys.version_info[0], sys.version_info[1], sys.maxsize.bit_length() + 1, pip, "
    "bool(u.find_spec('venv')), bool(u.find_spec('ensurepip')))"
)
_ANSWER = re.compile(r"PYTHON (\d+) (\d+) (\d+) (\d+)(?:\.(\d+))?\S* (True|False) (True|False)")
_FOLDERS = {  # of Pythons, for a minor version; besides those on PATH
    "windows": (
        r"{LOCALAPPDATA}\Programs\Python\Python3{minor}",
        r"{LOCALAPPDATA}\Python\pythoncore-3.{minor}-64",
        r"{PROGRAMFILES}\Python3{minor}",
        r"C:\Python3{minor}",
        r"C:\OSGeo4W\apps\Python3{minor}",
        r"{PROGRAMFILES}\QGIS *\apps\Python3{minor}",
    ),
    "posix": (
        "/usr/bin",
        "/usr/local/bin",
        "/opt/homebrew/bin",
        "/opt/local/bin",
        "/Library/Frameworks/Python.framework/Versions/3.{minor}/bin",
    ),
}


@dataclass(frozen=True)
class Python:
    """A Python that can make the environment.

    `of_qgis` is whether QGIS brings it; `has_pip` whether its pip can install into another environment.
    """

    path: str
    version: tuple[int, int]
    has_pip: bool
    of_qgis: bool = False

    @property
    def label(self) -> str:
        """Version, owner and path, for a list."""
        owner = " of QGIS" if self.of_qgis else ""
        return f"Python {self.version[0]}.{self.version[1]}{owner}: {self.path}"


def of_qgis(
    prefix: str = sys.base_prefix, executable: str = sys.executable or "", windows: bool = os.name == "nt"
) -> list[str]:
    """Return the places where the Python of the running QGIS may be, the likeliest first.

    Parameters
    ----------
    prefix, executable : str
        `sys.base_prefix` and `sys.executable`; on Windows and macOS the executable is QGIS itself.
    windows : bool

    Returns
    -------
    list of str
    """
    if windows:  # not python3.exe in QGIS' folder bin, which finds no library once it stands in an environment
        return [ntpath.join(prefix, "python.exe"), ntpath.join(prefix, "python3.exe")]
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    beside = posixpath.join(posixpath.dirname(executable), "bin")  # QGIS.app/Contents/MacOS/bin
    folders = [posixpath.join(prefix, "bin"), beside]
    named = [executable] if posixpath.basename(executable).startswith("python") else []
    return [posixpath.join(folder, name) for folder in folders for name in (version, "python3")] + named


def elsewhere(environment: dict[str, str], windows: bool = os.name == "nt") -> list[str]:
    """Return the places of other Pythons, the newest versions first; places of Windows may have a `*`.

    Parameters
    ----------
    environment : dict of str to str
        Variables of the process.
    windows : bool

    Returns
    -------
    list of str
    """
    given = {"PROGRAMFILES": r"C:\Program Files", "LOCALAPPDATA": "", **environment}
    if windows:
        places = [f.format(minor=minor, **given) for minor in MINORS for f in _FOLDERS["windows"]]
        places += [folder for folder in given.get("PATH", "").split(";") if folder and STORE not in folder.lower()]
        return [ntpath.join(place, "python.exe") for place in places if not place.startswith("\\")]
    folders = [folder for folder in given.get("PATH", "").split(":") if folder]
    places = []
    for minor in MINORS:
        listed = [folder.format(minor=minor) for folder in _FOLDERS["posix"]]
        places += [posixpath.join(folder, f"python3.{minor}") for folder in (*folders, *listed)]
    return places + [posixpath.join(folder, "python3") for folder in folders]


def existing(places: list[str]) -> list[str]:
    """Return the files among places, each once, with links and `*` resolved.

    Parameters
    ----------
    places : list of str
    """
    found = {}
    for place in places:
        for path in sorted(glob.glob(place), reverse=True) if "*" in place else [place]:
            if os.path.isfile(path):
                found.setdefault(os.path.realpath(path), path)
    return list(found.values())


def python_of(path: str, answer: str, of_qgis: bool = False) -> Python | str:
    """Return the Python that gave an answer to QUESTION, or why it cannot be used.

    Parameters
    ----------
    path, answer : str
    of_qgis : bool

    Returns
    -------
    Python or str
    """
    found = _ANSWER.search(answer)
    if found is None:
        return f"{path} is not a Python that starts"
    version, pip = (int(found[1]), int(found[2])), (int(found[4]), int(found[5] or 0))
    if not OLDEST <= version < BEYOND:
        return f"{path} is Python {version[0]}.{version[1]}; mpmgis needs 3.{OLDEST[1]} to 3.{BEYOND[1] - 1}"
    if found[3] != "64":
        return f"{path} has {found[3]} bits; mpmgis needs a Python of 64 bits"
    has_pip = pip >= PIP_FOR_OTHERS
    if found[6] == "False" or not (has_pip or found[7] == "True"):
        return f"{path} has neither pip nor ensurepip; on Debian or Ubuntu: sudo apt install python3-venv"
    return Python(path, version, has_pip, of_qgis)
