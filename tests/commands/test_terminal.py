"""What only a user at a terminal meets: the bar of a run that moves, and the question before a long one."""

import os
import re
import select
import subprocess
import sys

import pytest
from slope_site import SCENE, write_site

pty = pytest.importorskip("pty", reason="needs a POSIX terminal")
WAIT = 300.0  # [s] the longest a child may be silent: compiling on a busy machine


@pytest.fixture
def site(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return write_site(tmp_path)


class Typed:
    """`mpmgis` typed with `arguments` in `folder`, on a terminal of its own."""

    def __init__(self, folder, *arguments):
        self._end, terminal = pty.openpty()
        self.shown = ""
        command = [sys.executable, "-m", "mpmgis", *arguments]
        environment = os.environ | {"TERM": "xterm", "COLUMNS": "300", "PYTHONPATH": os.pathsep.join(sys.path)}
        self._child = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=terminal, stdout=terminal, stderr=terminal
        )
        os.close(terminal)

    def until(self, words):
        """Wait until `words` are shown; False if the command ends without them."""
        while words not in self.shown:
            if not self._more():
                return False
        return True

    def answer(self, text):
        """Type a line."""
        os.write(self._end, text.encode() + b"\n")

    def ended(self):
        """Exit code; all that was shown is then in `shown`."""
        while self._more():
            pass
        os.close(self._end)
        return self._child.wait(timeout=WAIT)

    def _more(self):
        ready, _, _ = select.select([self._end], [], [], WAIT)
        if not ready:
            self._child.kill()
            raise AssertionError(f"silent for {WAIT:g} s after\n{self.shown}")
        try:
            raw = os.read(self._end, 65536)
        except OSError:  # Linux: the other end is closed
            raw = b""
        self.shown += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", raw.decode(errors="replace"))
        return bool(raw)


def test_a_run_shows_its_time_and_ends_well(site):
    typed = Typed(site, "run", "scene.toml")
    assert typed.ended() == 0, typed.shown
    assert "before the first step" in typed.shown and re.search(r"t = \d+\.\d of 30 s", typed.shown), typed.shown
    assert "ended: " in typed.shown and (site / "results" / "run.json").exists()


@pytest.mark.thorough
def test_a_long_run_asks_first_and_takes_no_for_an_answer(site):
    (site / "scene.toml").write_text(SCENE.replace("= 30", "= 1e9\nstop_at_rest = false").replace("= 5\n", "= 1e8\n"))
    typed = Typed(site, "run", "scene.toml")
    assert typed.until("[y/N]"), typed.shown
    typed.answer("n")
    assert typed.ended() == 2, typed.shown
    assert not (site / "results").exists()


@pytest.mark.thorough
def test_an_export_counts_its_frames(site):
    assert Typed(site, "run", "-q", "scene.toml").ended() == 0
    typed = Typed(site, "export-raster", "results")
    assert typed.ended() == 0, typed.shown
    assert re.search(r"frame (\d+) of \1\r?\n", typed.shown), typed.shown
