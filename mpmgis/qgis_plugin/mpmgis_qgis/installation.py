"""Install mpmgis in its own environment, one program after the other, without blocking QGIS."""

from __future__ import annotations

import os
import re
import threading

from qgis.PyQt.QtCore import QObject, QProcess, pyqtSignal

from . import own_environment, python_search
from .calling import process_with
from .command import Lines, environment
from .network_proxy import proxy_of_qgis

ANSWER_MILLISECONDS = 10_000  # [ms] within which a Python says its version
_BEHIND_VERSION = re.compile(r"-(cp|py)\d.*| \(.*")  # of a wheel's name and of what requires it
KILL_MILLISECONDS = 5_000  # [ms] to end after it was killed


class Installation(QObject):
    """The installation into one environment.

    `said` has a line of the log; `progressed` the share done [1] and what is done now; `ended` "" or the error.
    """

    said = pyqtSignal(str)
    progressed = pyqtSignal(float, str)
    ended = pyqtSignal(str)

    def __init__(self, home: str, python: python_search.Python, source: own_environment.Source):
        super().__init__()
        self.home, self.python, self.source = home, python, source
        self.environment = own_environment.next_environment(home)
        self._process = self._log = None
        self._ended = []  # processes; one must not be deleted while it emits a signal
        self._steps, self._lines, self._collected, self._cancelled = [], [], 0, False

    def start(self) -> None:
        """Run the steps; the signals tell the rest."""
        try:
            os.makedirs(self.home, exist_ok=True)
            own_environment.remove_unused(self.home)
            self._log = open(os.path.join(self.home, own_environment.LOG), "w", encoding="utf-8", newline="\n")  # noqa: SIM115
        except OSError as error:
            self._end(f"{self.home}: cannot be written ({error.strerror})")
            return
        self._variables, about_proxy = proxy_of_qgis()
        self._say(f"mpmgis {self.source.version} into {self.environment}, with {self.python.label}")
        if about_proxy:
            self._say(about_proxy)
        self._steps = own_environment.steps(self.python.path, self.python.has_pip, self.environment, self.source)
        self._next()

    def cancel(self) -> None:
        """Stop at once; what was made is removed, and an earlier environment stays in use."""
        self._cancelled = True
        if self._process is not None:
            self._process.kill()

    def is_running(self) -> bool:
        """Return whether a program of it runs."""
        return self._process is not None

    def _next(self):
        if not self._steps:
            version = self._lines[-1].split()[-1] if self._lines else ""
            if version != self.source.version:
                self._end(f"the installed command says version {version!r}, expected {self.source.version}; try again")
                return
            own_environment.write_record(self.home, self.environment, version, self.python.path)
            self._end("")
            return
        step, self._lines = self._steps[0], []
        self.progressed.emit(step.begin, step.title)
        self._say("> " + " ".join([step.program, *step.arguments]))
        self._output = Lines()
        process = self._process = process_with(
            own_environment.installing_environment(environment(dict(os.environ)), self._variables)
        )
        process.setProcessChannelMode(QProcess.ProcessChannelMode.MergedChannels)
        process.readyReadStandardOutput.connect(self._read)
        process.errorOccurred.connect(self._failed_to_start)
        process.finished.connect(self._finished)
        process.start(step.program, list(step.arguments))
        process.closeWriteChannel()  # on Windows a failed start has already ended the installation here

    def _read(self):
        for line in self._output.add(bytes(self._process.readAllStandardOutput().data())):
            self._take(line)

    def _take(self, line):
        step = self._steps[0]
        self._lines.append(line)
        self._say(line)
        self._collected += own_environment.is_about_package(line)
        share = own_environment.pip_share(self._collected, line)
        self.progressed.emit(step.begin + share * (step.end - step.begin), _shown(step, line))

    def _failed_to_start(self, error):
        if error == QProcess.ProcessError.FailedToStart:
            reason = self._released().errorString()
            self._end(f"{self._steps[0].program} does not start: {reason}")

    def _finished(self, code, status):
        self._read()
        for line in self._output.end():
            self._take(line)
        step = self._steps.pop(0)
        self._released()
        if self._cancelled:
            self._end("cancelled")
        elif code != 0 or status != QProcess.ExitStatus.NormalExit:
            self._end(own_environment.failure(step.title, self._lines, self.source))
        else:
            self._next()

    def _released(self):
        self._ended.append(self._process)
        self._process = None
        return self._ended[-1]

    def _end(self, error):
        self._say(error or f"mpmgis {self.source.version} is installed")
        if self._log is not None:
            self._log.close()
            self._log = None
        if not error:
            self.progressed.emit(1.0, "")
        cleaning = threading.Thread(target=own_environment.remove_unused, args=(self.home,), daemon=True)
        cleaning.start()  # takes seconds
        self.ended.emit(error)

    def _say(self, line):
        if self._log is not None:
            self._log.write(line + "\n")
            self._log.flush()
        self.said.emit(line)


def _shown(step, line):
    if line.startswith(own_environment.UNPACKING):
        return f"{step.title}: unpacking, about a minute"
    return f"{step.title}: {_BEHIND_VERSION.sub('', os.path.basename(line.strip()))}"


def usable_pythons(places: list[str], of_qgis: bool = False) -> tuple[list[python_search.Python], list[str]]:
    """Ask the Pythons at some places, all at once, and return those that can be used, and why the others cannot.

    Parameters
    ----------
    places : list of str
    of_qgis : bool
        Whether QGIS brings them.

    Returns
    -------
    (list of Python, list of str)
    """
    asked = []
    for path in python_search.existing(places):
        process = process_with(environment(dict(os.environ)))
        process.start(path, ["-I", "-c", python_search.QUESTION])
        asked.append((path, process))
    answers = [python_search.python_of(path, _answer_of(process), of_qgis) for path, process in asked]
    return (
        [answer for answer in answers if isinstance(answer, python_search.Python)],
        [answer for answer in answers if isinstance(answer, str)],
    )


def _answer_of(process):
    if not process.waitForFinished(ANSWER_MILLISECONDS):
        process.kill()
        process.waitForFinished(KILL_MILLISECONDS)
    return bytes(process.readAllStandardOutput().data()).decode("utf-8", "replace")
