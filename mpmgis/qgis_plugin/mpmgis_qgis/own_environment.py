"""Lay out the environment that the toolbox makes for mpmgis in the QGIS profile, and the commands that make it.

`PROFILE/mpmgis/installed.json` names the environment in use, a folder with a number beside it. An update makes the next
one and changes the record at its end, so that an interrupted update leaves the earlier one in use.
"""

from __future__ import annotations

import json
import ntpath
import os
import posixpath
import re
import shutil
from dataclasses import dataclass

from .restored_files import write_whole

FILMS, PLAYER = "animation", "player"  # optional parts: films, player of the flow in reports
HOME = "mpmgis"  # folder in the profile
RECORD = "installed.json"
LOG = "install.log"
OLDEST, BEYOND = (3, 11), (3, 15)  # versions of Python on which mpmgis runs; `requires-python` of the package
PACKAGES = 49  # that pip collects, for the progress bar
REDIRECTING = ("PIP_TARGET", "PIP_PREFIX", "PIP_ROOT", "PIP_REQUIRE_VIRTUALENV")  # would install to another place
UNPACKING = "Installing collected packages"  # begin of pip's last line but one
_WHEEL = re.compile(r"mpmgis-([0-9][^-]*)-py3-none-any\.whl", re.IGNORECASE)
MAKING = "Making the environment"  # title of the first step
_PIP = ("-m", "pip")


@dataclass(frozen=True)
class Source:
    """What is installed: a version from the package index, or a wheel; libraries from the index, or from a folder.

    `parts` are optional parts of the package.
    """

    version: str
    wheel: str = ""
    folder: str = ""
    parts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Step:
    """A program that is run: its title, arguments, and part of the progress bar [1]."""

    title: str
    program: str
    arguments: tuple[str, ...]
    begin: float
    end: float


def home_in(profile: str) -> str:
    """Return the folder of mpmgis in a profile of QGIS.

    Parameters
    ----------
    profile : str
    """
    return os.path.join(os.path.abspath(profile), HOME)


def programs(environment: str, windows: bool = os.name == "nt") -> tuple[str, str]:
    """Return the paths of Python and of the command in an environment.

    Parameters
    ----------
    environment : str
    windows : bool
    """
    if windows:
        return tuple(ntpath.join(environment, "Scripts", name) for name in ("python.exe", "mpmgis.exe"))
    return tuple(posixpath.join(environment, "bin", name) for name in ("python", "mpmgis"))


def record_of(home: str) -> dict[str, str]:
    """Return the record of the environment in use: its folder, version and Python; {} without one that is whole.

    Parameters
    ----------
    home : str
    """
    try:
        with open(os.path.join(home, RECORD), encoding="utf-8") as file:
            record = json.load(file)
        folder = record["folder"]
        whole = folder.isdigit() and os.path.isfile(programs(os.path.join(home, folder))[1])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return record if whole else {}


def own_command(home: str) -> str | None:
    """Return the path of the command in the environment in use; None without one.

    Parameters
    ----------
    home : str
    """
    record = record_of(home)
    return programs(os.path.join(home, record["folder"]))[1] if record else None


def write_record(home: str, environment: str, version: str, python: str) -> None:
    """Put an environment to use.

    Parameters
    ----------
    home, environment : str
    version : str
        Of mpmgis.
    python : str
        Path of the Python that the environment was made with.
    """
    record = {"folder": os.path.basename(environment), "version": version, "python": python}
    write_whole(os.path.join(home, RECORD), (json.dumps(record, indent=1) + "\n").encode())


def next_environment(home: str) -> str:
    """Return the path of a new environment: a short name, because Windows limits paths to 260 characters.

    Parameters
    ----------
    home : str
    """
    return os.path.join(home, str(max(map(int, _environments(home)), default=0) + 1))


def remove_unused(home: str) -> None:
    """Remove all environments but that in use, as far as no program keeps files of them open.

    Parameters
    ----------
    home : str
    """
    used = record_of(home).get("folder")
    for name in _environments(home):
        if name != used:
            shutil.rmtree(os.path.join(home, name), ignore_errors=True)


def remove_all(home: str) -> bool:
    """Remove everything that was installed, and return whether nothing is left.

    Parameters
    ----------
    home : str
    """
    if os.path.exists(os.path.join(home, RECORD)):
        os.remove(os.path.join(home, RECORD))
    shutil.rmtree(home, ignore_errors=True)
    return not os.path.exists(home)


def _environments(home):
    return [name for name in os.listdir(home) if name.isdigit()] if os.path.isdir(home) else []


def trouble_of(source: Source) -> str:
    """Return why a source cannot be installed, in one line; "" for one that can.

    Parameters
    ----------
    source : Source
    """
    if source.folder and not os.path.isdir(source.folder):
        return f"{source.folder} is not a folder; choose the folder with the wheels of the libraries"
    if not source.wheel:
        return ""
    found = _WHEEL.fullmatch(os.path.basename(source.wheel))
    if found is None:
        return f"{source.wheel} is not a wheel of mpmgis; its name is mpmgis-{source.version}-py3-none-any.whl"
    if found[1] != source.version:
        return f"{source.wheel} has version {found[1]}; this toolbox needs {source.version}: take both from one release"
    return "" if os.path.isfile(source.wheel) else f"{source.wheel} does not exist"


def steps(python: str, has_pip: bool, environment: str, source: Source, windows: bool = os.name == "nt") -> list[Step]:
    """Return the programs that make an environment and install mpmgis there, in their order.

    Where Python has pip, it installs into the environment from outside: the environment has no pip of its own, which
    fails to be made with the Python of some versions of QGIS.

    Parameters
    ----------
    python : str
    has_pip : bool
        Whether that Python has a pip from 22.3 on.
    environment : str
        Folder that does not exist yet.
    source : Source
    windows : bool

    Returns
    -------
    list of Step
    """
    own_python, command = programs(environment, windows)
    made = ("-m", "venv", *(("--without-pip",) if has_pip else ()), environment)
    pip = (python, (*_PIP, "--python", own_python)) if has_pip else (own_python, _PIP)
    return [
        Step(MAKING, python, made, 0.0, 0.05),
        Step("Installing mpmgis and its libraries", pip[0], (*pip[1], *pip_words(source)), 0.05, 0.95),
        Step("Checking the command", command, ("--version",), 0.95, 1.0),
    ]


def pip_words(source: Source) -> tuple[str, ...]:
    """Return the arguments of pip: wheels only, so that nothing is compiled; Python compiles what it uses later.

    Parameters
    ----------
    source : Source
    """
    usual = ("--no-input", "--disable-pip-version-check", "--progress-bar=off", "--retries=2")
    places = (f"--find-links={source.folder}", "--no-index") if source.folder else ()
    parts = f"[{','.join(source.parts)}]" if source.parts else ""
    what = f"{source.wheel}{parts}" if source.wheel else f"mpmgis{parts}=={source.version}"
    return ("install", *usual, "--only-binary=:all:", "--no-compile", *places, what)


def installing_environment(of_qgis: dict[str, str], proxy: dict[str, str]) -> dict[str, str]:
    """Return the environment variables for pip: those of QGIS, its proxy, and none that redirect an installation.

    Parameters
    ----------
    of_qgis : dict
        Already without variables for QGIS' own Python.
    proxy : dict
    """
    kept = {name: value for name, value in of_qgis.items() if name.upper() not in REDIRECTING}
    return {**kept, **proxy, "PIP_USER": "0"}


def pip_share(collected: int, line: str) -> float:
    """Return the share of pip's work that is done when it prints a line.

    Parameters
    ----------
    collected : int
        Lines about a package before it.
    line : str

    Returns
    -------
    float [1]
    """
    if line.startswith("Successfully installed"):
        return 1.0
    if line.startswith(UNPACKING):
        return 0.7
    return 0.65 * min(collected / PACKAGES, 1.0)


def is_about_package(line: str) -> bool:
    """Return whether pip begins with another package in this line.

    Parameters
    ----------
    line : str
    """
    return line.startswith(("Collecting ", "Processing "))


def failure(title: str, lines: list[str], source: Source) -> str:
    """Return why a step failed, in one line with a remedy.

    Parameters
    ----------
    title : str
        Of the step.
    lines : list of str
        That it printed.
    source : Source
    """
    text = "\n".join(lines)
    if "No module named" in text and ("ensurepip" in text or "venv" in text):
        return f"{title}: this Python has no module venv; on Debian or Ubuntu: sudo apt install python3-venv"
    if re.search(r"No space left|not enough space|Errno 28", text):
        return f"{title}: the disk is full; mpmgis and its libraries need 1 GB"
    if "407 " in text or "ProxyError" in text:
        return f"{title}: the proxy refused; check it in Settings > Options > Network"
    if re.search(r"Temporary failure|getaddrinfo|NewConnectionError|ConnectTimeout|SSLError|Network is unreach", text):
        return f"{title}: the package index cannot be reached; check network and proxy, or give a wheel and a folder"
    missing = re.search(r"No matching distribution found for (\S+)", text)
    if missing is not None:
        place = source.folder or "the package index"
        return f"{title}: {place} has no {missing[1]} for this Python; choose another Python or another source"
    errors = [line for line in lines if line.startswith(("ERROR: ", "Error: "))]
    said = (errors or lines or ["it ended without a message"])[0 if errors else -1]
    return f"{title}: {said}" + ("; choose another Python" if title == MAKING else "")
