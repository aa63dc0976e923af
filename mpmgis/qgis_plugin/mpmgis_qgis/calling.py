"""Calls the command: its talk goes to QGIS' log as it comes, and a cancelled one is stopped.

By QProcess itself, not by QgsBlockingProcess: only the former can be given an environment in every QGIS from 3.22 on,
and QGIS' own (PYTHONHOME, PROJ_LIB) keeps another Python from starting.
"""

from __future__ import annotations

import os

from qgis.core import QgsProcessingException
from qgis.PyQt.QtCore import QProcess, QProcessEnvironment

from .finding import environment
from .talk import Lines, error_line, progress

LOOK_MILLISECONDS = 100
BAD_INPUT = 2  # the command's exit code where it refused, and left everything as it was
STOP_MILLISECONDS = (10_000, 20_000)  # to end well: after its step; asked again, at once, tidying up


def call(command, verb, arguments, feedback, begin=0.0, end=100.0):
    """Run `command verb arguments`; returns the lines on its stdout.

    Parameters
    ----------
    command : str
        Absolute path.
    feedback : QgsProcessingFeedback
        Gets the talk, and progress from `begin` to `end` [%].

    Raises
    ------
    QgsProcessingException
        With the command's own one line where it fails; where it was cancelled. No class of our own: QGIS 3.22 shows
        one as a traceback.
    """
    feedback.pushCommandInfo(" ".join(_quoted(word) for word in (command, verb, *arguments)))
    process = _started(command, [verb, *arguments])
    talk, results, said = Lines(), Lines(), []
    answers = []
    while True:
        running = not process.waitForFinished(LOOK_MILLISECONDS) and _is_running(process)
        for line in talk.add(_bytes(process.readAllStandardError())):
            said.append(line)
            _tell(line, verb, feedback, begin, end)
        answers += results.add(_bytes(process.readAllStandardOutput()))
        if running and feedback.isCanceled():
            _stop(process)
            raise QgsProcessingException(f"mpmgis {verb}: cancelled")
        if not running:
            break
    said += talk.end()
    answers += results.end()
    code = process.exitCode()
    if process.exitStatus() != QProcess.ExitStatus.NormalExit or code != 0:
        ended = QgsProcessingException(error_line(said, verb, code))
        ended.exit_code = code
        raise ended
    feedback.setProgress(end)
    return answers


def is_refusal(error):
    """Whether `call` raised `error` because the command refused its input, and left everything as it was."""
    return getattr(error, "exit_code", None) == BAD_INPUT


def _started(command, arguments):
    process = QProcess()
    kept = QProcessEnvironment()
    for name, value in environment(dict(os.environ)).items():
        kept.insert(name, value)
    process.setProcessEnvironment(kept)
    process.start(command, arguments)
    if not process.waitForStarted(-1):
        raise QgsProcessingException(f"{command} does not start: {process.errorString()}")
    process.closeWriteChannel()  # nobody answers questions here
    return process


def _is_running(process):
    return process.state() != QProcess.ProcessState.NotRunning


def _stop(process):
    """End it as Ctrl+C does where that is possible (not on Windows), so that every frame stays whole."""
    for patience in STOP_MILLISECONDS if os.name == "posix" else ():
        process.terminate()
        if process.waitForFinished(patience):
            return
    process.kill()
    process.waitForFinished(STOP_MILLISECONDS[-1])


def _tell(line, verb, feedback, begin, end):
    share = progress(line, verb)
    if share is not None:
        feedback.setProgress(begin + share * (end - begin))
    feedback.pushInfo(line)


def _bytes(data):
    return bytes(data.data())


def _quoted(word):
    return f'"{word}"' if " " in word else word
