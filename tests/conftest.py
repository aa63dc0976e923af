"""A session of tests that is told to stop stops.

The verbs that tests call in this process hear Ctrl+C and SIGTERM before pytest does: they tidy up and answer 130 or
143. A session that ran into a time limit then went on, with one test failed for no reason of its own.
"""

import os
import signal

import pytest

ENDING = {signal.SIGINT: 130, signal.SIGTERM: 143}
HEARD, HEAR = os.pipe()


def pytest_configure():
    """Let the interpreter note every signal, whoever handles it. Windows notes them in no pipe."""
    if os.name != "posix":
        return
    for end in (HEARD, HEAR):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(HEAR, warn_on_full_buffer=False)


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
