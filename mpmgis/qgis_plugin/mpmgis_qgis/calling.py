"""Call the command, print its messages in the log of QGIS, and stop it when the user cancels.

It uses QProcess, not QgsBlockingProcess, because only QProcess accepts an environment in every QGIS from 3.22 on, and
with the environment of QGIS (PYTHONHOME, PROJ_LIB) another Python does not start.
"""

from __future__ import annotations

import os
import time

from qgis.core import QgsProcessingException, QgsProcessingFeedback
from qgis.PyQt.QtCore import QProcess, QProcessEnvironment

from .command import Lines, environment, error_line, is_error_line, progress, shown_answer

LOOK_MILLISECONDS = 100  # [ms] between looks at messages and at the cancel button
BAD_INPUT = 2  # exit code of the command for refused input; no file was changed
STOP_MILLISECONDS = (10_000, 20_000)  # [ms] to stop after the current step; after a second signal, immediately
PREPARING_MILLISECONDS = 1_500  # [ms] until the second signal before the first step, when nothing can be lost
PREPARING = "preparing: "  # begin of a line about kernels that are compiled
SILENT_SECONDS = 20.0  # [s] without a line after which the log says that the command works; then after twice as long


def call(
    command: str,
    verb: str,
    arguments: list[str],
    feedback: QgsProcessingFeedback,
    begin: float = 0.0,
    end: float = 100.0,
) -> list[str]:
    """Run `command verb arguments`, and return the lines on its stdout.

    Parameters
    ----------
    command : str
        Absolute path.
    verb : str
    arguments : list of str
    feedback : QgsProcessingFeedback
        Gets the messages and the progress.
    begin, end : float [%]
        Part of the progress bar for this call.

    Returns
    -------
    list of str

    Raises
    ------
    QgsProcessingException
        The command failed (its error line is the message), or the user cancelled. Not a class of this plugin, because
        QGIS 3.22 shows those as a traceback.
    """
    feedback.pushCommandInfo(" ".join(_quoted(word) for word in (command, verb, *arguments)))
    feedback.setProgressText(f"mpmgis {verb} starts")
    feedback.setProgress(begin)
    process = _started(command, [verb, *arguments])
    try:
        printed, answers = _followed(process, verb, feedback, begin, end)
    finally:
        if _is_running(process):
            _stop(process, verb, feedback)
    code = process.exitCode()
    if process.exitStatus() != QProcess.ExitStatus.NormalExit or code != 0:
        error = error_line(printed, verb, code)
        for line in printed:
            if is_error_line(line, verb) and line != error:
                feedback.pushInfo(line)
        ended = QgsProcessingException(error)
        ended.exit_code = code
        raise ended
    feedback.setProgress(end)
    return answers


def _followed(process, verb, feedback, begin, end):
    """(lines on stderr, lines on stdout) of the process, until it ends or the user cancels.

    Error lines are not shown: the exception of a failed command has the error, and QGIS prints it.
    """
    messages, results, printed, answers = Lines(), Lines(), [], []
    heard, patience = time.monotonic(), SILENT_SECONDS
    while True:
        running = not process.waitForFinished(LOOK_MILLISECONDS) and _is_running(process)
        for line in messages.add(_bytes(process.readAllStandardError())):
            heard, patience = time.monotonic(), SILENT_SECONDS
            printed.append(line)
            if not is_error_line(line, verb):
                _show(line, verb, feedback, begin, end)
        answers += results.add(_bytes(process.readAllStandardOutput()))
        if running and feedback.isCanceled():
            process.setProperty("prepares", bool(printed) and printed[-1].startswith(PREPARING))
            raise QgsProcessingException(f"mpmgis {verb}: cancelled")
        if running and time.monotonic() - heard > patience:
            feedback.setProgressText(f"mpmgis {verb} works; its last line is {patience:.0f} s old")
            patience *= 2
        if not running:
            return printed + messages.end(), answers + results.end()


def is_refusal(error: BaseException) -> bool:
    """Return whether `call` raised an error because the command refused its input and changed no file.

    Parameters
    ----------
    error : Exception
    """
    return getattr(error, "exit_code", None) == BAD_INPUT


def process_with(variables: dict[str, str]) -> QProcess:
    """Return a process, not yet started, with exactly these environment variables.

    Parameters
    ----------
    variables : dict of str to str
    """
    process, kept = QProcess(), QProcessEnvironment()
    for name, value in variables.items():
        kept.insert(name, value)
    process.setProcessEnvironment(kept)
    return process


def _started(command, arguments):
    process = process_with(environment(dict(os.environ)))
    process.start(command, arguments)
    if not process.waitForStarted(-1):
        raise QgsProcessingException(f"{command} does not start: {process.errorString()}")
    process.closeWriteChannel()  # the command must not wait for input
    return process


def _is_running(process):
    return process.state() != QProcess.ProcessState.NotRunning


def _stop(process, verb, feedback):
    """Stop it as Ctrl+C does where that is possible (not on Windows), so that all frames are complete."""
    feedback.setProgressText(f"cancelling: mpmgis {verb} ends after its current step")
    first = PREPARING_MILLISECONDS if process.property("prepares") else STOP_MILLISECONDS[0]
    for patience in (first, STOP_MILLISECONDS[1]) if os.name == "posix" else ():
        process.terminate()
        if process.waitForFinished(patience):
            return
    process.kill()
    process.waitForFinished(STOP_MILLISECONDS[-1])


def _show(line, verb, feedback, begin, end):
    share = progress(line, verb)
    if share is not None:
        feedback.setProgress(begin + share * (end - begin))
    if line.startswith(PREPARING):
        feedback.setProgressText(line)  # which also stands in the log
        return
    shown, recommends = shown_answer(line)
    (feedback.pushWarning if recommends else feedback.pushInfo)(shown)


def _bytes(data):
    return bytes(data.data())


def _quoted(word):
    return f'"{word}"' if " " in word else word
