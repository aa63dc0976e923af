"""Check at the start of QGIS that the command exists and has the version of the plugin, and offer what is missing."""

from __future__ import annotations

import configparser
import os
from collections.abc import Callable

from qgis.PyQt.QtCore import QObject, pyqtSignal

from .calling import process_with
from .command import CommandMissing, environment, find_command

NOT_INSTALLED = "the forms need the program mpmgis, which is not installed yet"
METADATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), "metadata.txt")


def plugin_version(path: str = METADATA) -> str:
    """Return the version of the plugin; "" in a checkout, where only the zip has one.

    Parameters
    ----------
    path : str
    """
    parser = configparser.ConfigParser(interpolation=None)
    parser.read(path, encoding="utf-8")
    return parser.get("general", "version", fallback="")


def misfit(version: str, command: str, answer: str) -> str:
    """Return why a command does not fit the plugin, in one line; "" if it does.

    Parameters
    ----------
    version : str
        Of the plugin.
    command : str
        Its path.
    answer : str
        To `mpmgis --version`.
    """
    words = answer.split()
    if len(words) != 2 or words[0] != "mpmgis":
        return f"{command} does not start; install mpmgis again"
    if words[1] != version:
        return f"{command} is mpmgis {words[1]}, and this toolbox needs {version}"
    return ""


class FitCheck(QObject):
    """Asks the command for its version without blocking QGIS; `checked` has "" or the reason why it does not fit."""

    checked = pyqtSignal(str)

    def __init__(self, setting: str, own: Callable[[], str | None]):
        super().__init__()
        self._setting, self._own, self._process = setting, own, None

    def start(self) -> None:
        """Ask the command; the signal has the answer."""
        version = plugin_version()
        try:
            self._command = find_command(self._setting, self._own())
        except CommandMissing as missing:
            self.checked.emit(str(missing) if self._setting else NOT_INSTALLED)
            return
        if not version:
            self.checked.emit("")
            return
        self._process = process_with(environment(dict(os.environ)))
        self._process.finished.connect(lambda *_: self._answered(version))
        self._process.errorOccurred.connect(lambda *_: self.checked.emit(misfit(version, self._command, "")))
        self._process.start(self._command, ["--version"])

    def _answered(self, version):
        answer = bytes(self._process.readAllStandardOutput().data()).decode("utf-8", "replace")
        self.checked.emit(misfit(version, self._command, answer))
