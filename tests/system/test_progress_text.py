"""Progress is a text that the next one replaces: shown by the command, logged now and then by Python."""

import sys

import pytest

from mpmgis.commands.shell import progress, terminal
from mpmgis.system import messages
from mpmgis.system.messages import collected, details, muted, progress_shown, show_progress


@pytest.fixture
def clock(monkeypatch):
    """A list with the time [s] that messages and lines of the command read."""
    now = [1000.0]
    monkeypatch.setattr(messages.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(messages, "_logged", [0.0])
    return now


def test_python_logs_a_text_at_most_every_ten_seconds(clock):
    with collected() as notes:
        for clock[0] in (1000.0, 1001.0, 1009.9, 1010.0, 1015.0):
            show_progress(f"{clock[0]:g}")
    assert notes == ["1000", "1010"]


def test_no_text_is_logged_where_messages_are_muted(clock):
    with collected() as notes, muted():
        show_progress("3 of 4 left")
    assert notes == []


def test_a_display_has_every_text_and_the_log_none(clock):
    shown = []
    with collected() as notes:
        with progress_shown(shown.append), details():
            show_progress("3 of 4 left")
            show_progress("2 of 4 left")
        show_progress("1 of 4 left")
    assert shown == ["3 of 4 left", "2 of 4 left"] and notes == ["1 of 4 left"]


@pytest.mark.parametrize(("volume", "count"), [(-1, 0), (0, 1), (1, 1)])
def test_a_log_of_the_command_has_a_line_now_and_then(monkeypatch, capsys, volume, count):
    monkeypatch.setattr(terminal, "volume", volume)
    monkeypatch.setattr(progress, "LINE_SECONDS", 0.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False, raising=False)
    with progress.run_progress():
        show_progress("3 of 4 left")
        monkeypatch.setattr(progress, "LINE_SECONDS", 1e9)
        show_progress("2 of 4 left")
    assert capsys.readouterr().err.splitlines() == ["3 of 4 left"] * count
