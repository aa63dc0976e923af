"""A session of tests that is reported to stop stops; its workers share the cores.

The verbs that tests call in this process hear Ctrl+C and SIGTERM before pytest does: they tidy up and answer 130 or
143. A session that ran into a time limit then went on, with one test failed for no reason of its own.
"""

import os
import signal
import sys

import hypothesis
import pytest

ENDING = {signal.SIGINT: 130, signal.SIGTERM: 143}
HEARD, HEAR = os.pipe()
IS_WORKER = "PYTEST_XDIST_WORKER" in os.environ
# Where nothing is compiled yet, one worker compiles the 3D solver and the other that of columns, each for a minute. In
# any other order both compile the same.
EARLY = (
    "test_points_integration.py",
    "test_columns_exact.py",
    "test_columns_step.py",
    "test_spatial_features_command.py",
)


# A machine that is busy is no failure: hypothesis allows 200 ms an example where nothing else is said.
hypothesis.settings.register_profile("busy", deadline=None)
hypothesis.settings.load_profile("busy")


def pytest_configure():
    """Let the interpreter note every signal, whoever handles it. Windows notes them in no pipe."""
    if os.name != "posix":
        return
    for end in (HEARD, HEAR):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(HEAR, warn_on_full_buffer=False)


@pytest.hookimpl(optionalhook=True)  # where pytest-xdist is not installed, nobody asks
def pytest_xdist_auto_num_workers():
    """`-n auto` is a worker for each core that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def pytest_collection_modifyitems(items):
    """Files that compile what many others use come first; the order within a file stays."""
    if IS_WORKER:
        items.sort(key=lambda item: EARLY.index(item.path.name) if item.path.name in EARLY else len(EARLY))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup():
    """Every test of a worker begins on one thread: the other cores have workers of their own."""
    numba = sys.modules.get("numba")
    if IS_WORKER and hasattr(numba, "set_num_threads"):
        numba.set_num_threads(1)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """End the session where a test failed while a signal came; tests that send themselves one expect it."""
    report = yield
    noted = _noted()
    for number, code in ENDING.items():
        if report.failed and number in noted:
            pytest.exit(f"{number.name} came during {item.nodeid}: the session was told to stop", code)
    return report


def _noted():
    """Numbers of the signals since the last look."""
    if os.name != "posix":
        return b""
    try:
        return os.read(HEARD, 4096)
    except BlockingIOError:
        return b""
