"""`mpmgis demo` that is stopped during the export: exit code for shells, and no incomplete files."""

import signal
import subprocess
import sys
import time

import pytest

from mpmgis.commands.shell.progress import Interrupted, interruptible

# the demo itself, told to stop by its own signal when the first frame of the export is done
STOPPED_WHILE_EXPORTING = """
import os, sys
from mpmgis.commands.shell import simulation_verbs as verb
from mpmgis.commands.shell.main import main
from mpmgis.commands import demo_site as workflow

def short_run(scene, output, **options):
    text = scene.read_text()
    lines = [("end_time = 3" if line.startswith("end_time") else line) for line in text.splitlines()]
    lines = [("frame_interval = 1" if line.startswith("frame_interval") else line) for line in lines]
    scene.write_text("\\n".join(lines))
    return run(scene, output, **options)

def progress(what, done, total):
    if done == 1:
        os.kill(os.getpid(), int(sys.argv[2]))

run, workflow.run, verb.show_count = workflow.run, short_run, progress
raise SystemExit(main(["demo", "-o", sys.argv[1]]))
"""


@pytest.mark.thorough
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stopped_while_it_exports(tmp_path, number, code):
    command = [sys.executable, "-c", STOPPED_WHILE_EXPORTING, str(tmp_path / "demo"), str(int(number))]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == code, ended.stderr
    assert ended.stderr.splitlines()[-1] == "mpmgis demo: interrupted" and ended.stdout == ""
    assert sorted(path.name for path in (tmp_path / "demo").iterdir()) == ["lava_falls", "site"]  # no export, no part


def test_a_signal_after_the_last_look():
    """Where all is done then it changes nothing; where it is not it counts at the end. The handlers come back."""
    before = signal.getsignal(signal.SIGTERM)
    with interruptible(lambda: None) as watch:
        watch()
        signal.raise_signal(signal.SIGTERM)
        time.sleep(0)
    with pytest.raises(Interrupted) as stopped, interruptible(lambda: 1, lambda: 2, done=False) as (first, second):
        assert (first(), second()) == (1, 2)
        signal.raise_signal(signal.SIGTERM)
        time.sleep(0)
    assert stopped.value.exit_code == 143
    assert signal.getsignal(signal.SIGTERM) is before


def test_the_second_signal_stops_at_once_and_the_first_at_the_next_look():
    with pytest.raises(Interrupted), interruptible(lambda: None) as watch:
        signal.raise_signal(signal.SIGINT)
        watch()
    with pytest.raises(Interrupted), interruptible(lambda: None):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        pytest.fail("the second signal came and went")
