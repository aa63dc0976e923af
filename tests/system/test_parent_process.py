"""A process ends when the program that started it has ended."""

import os
import subprocess
import sys
import time

import pytest

from mpmgis.system import parent_process

WAITS = """
import sys
import time
from mpmgis.commands.shell.progress import Interrupted, interruptible
try:
    with interruptible(lambda: None) as watch:
        print("works", flush=True)
        while True:
            watch()
            time.sleep(0.02)
except Interrupted as ended:
    with open(sys.argv[1], "w") as file:
        file.write(f"ended {ended.exit_code}")
"""


@pytest.mark.skipif(os.name == "nt", reason="a signal ends the parent at once there")
def test_the_work_ends_after_its_parent(tmp_path):
    parent = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    environment = {**os.environ, parent_process.VARIABLE: str(parent.pid)}
    command = [sys.executable, "-c", WAITS, str(tmp_path / "told")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout.readline() == "works\n"
        parent.kill()
        parent.wait()
        assert process.wait(timeout=30) == 0 and (tmp_path / "told").read_text() == "ended 143"
    finally:
        for one in (parent, process):
            one.kill()
            one.communicate()


def test_without_the_variable_nothing_is_watched(monkeypatch):
    monkeypatch.delenv(parent_process.VARIABLE, raising=False)
    monkeypatch.setattr(parent_process.threading, "Thread", None)
    parent_process.end_with_parent()
    monkeypatch.setenv(parent_process.VARIABLE, "x")
    parent_process.end_with_parent()


def test_another_process_of_the_same_number_is_not_the_parent(monkeypatch):
    signals = []
    monkeypatch.setattr(parent_process._thread, "interrupt_main", signals.append)
    monkeypatch.setattr(parent_process, "PATIENCE_SECONDS", 0.0)
    monkeypatch.setattr(parent_process, "STREAMS", ())
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    parent_process._watch(os.getpid(), -5)
    assert len(signals) == parent_process.SIGNALS
