"""A session of tests stops after a signal; its workers share the cores.

The verbs that tests call in this process handle Ctrl+C and SIGTERM before pytest: they clean up and return 130 or 143.
Without this file a session that reached a time limit would continue, with one failed test that is correct.
"""

import os
import signal
import sys

import hypothesis
import pytest

ENDING = {signal.SIGINT: 130, signal.SIGTERM: 143}
HEARD, HEAR = os.pipe()
IS_WORKER = "PYTEST_XDIST_WORKER" in os.environ
# If nothing is compiled yet, one worker compiles the 3D solver and the other one the solver of columns, each for a
# minute. In any other order both workers compile the same solver. Notebooks take minutes in one file: last in the
# order, they would keep one worker while the other one has nothing left.
EARLY = (
    "test_points_integration.py",
    "test_columns_exact.py",
    "test_columns_step.py",
    "test_spatial_features_command.py",
    "test_notebooks.py",
)


# A busy machine must not cause failures: by default hypothesis allows 200 ms per example.
hypothesis.settings.register_profile("busy", deadline=None)
hypothesis.settings.load_profile("busy")


def pytest_configure():
    """Write the number of every signal to a pipe, whichever handler it has. Windows has no such pipe."""
    if IS_WORKER:
        os.environ.setdefault("MPMGIS_COMPILE_PROCESSES", "1")
    if os.name != "posix":
        return
    for end in (HEARD, HEAR):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(HEAR, warn_on_full_buffer=False)


@pytest.hookimpl(optionalhook=True)  # without pytest-xdist there is no such hook
def pytest_xdist_auto_num_workers():
    """`-n auto` is a worker for each core that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def pytest_collection_modifyitems(items):
    """Files that compile kernels of many other files or take long come first; the order within a file stays."""
    if IS_WORKER:
        items.sort(key=lambda item: EARLY.index(item.path.name) if item.path.name in EARLY else len(EARLY))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup():
    """Every test of a worker begins on one thread: the other cores have their own workers."""
    numba = sys.modules.get("numba")
    if IS_WORKER and hasattr(numba, "set_num_threads"):
        numba.set_num_threads(1)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """End the session if a test failed and a signal arrived during it; tests that send a signal do not fail."""
    report = yield
    noted = _noted()
    for number, code in ENDING.items():
        if report.failed and number in noted:
            pytest.exit(f"{number.name} arrived during {item.nodeid}: the session ends", code)
    return report


def _noted():
    """Numbers of the signals since the last call."""
    if os.name != "posix":
        return b""
    try:
        return os.read(HEARD, 4096)
    except BlockingIOError:
        return b""
