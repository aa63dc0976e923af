"""A user's own friction law with `mpmgis run --law`: the flow of the same shipped law, restarts, refusals."""

import subprocess
import sys

import numpy as np
import pytest
from slope_site import LAW, SCENE, contents, record, write_site

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame

TEXT = SCENE.replace('"Voellmy"', '"my_law.py:Mine"').replace("end_time = 30", "end_time = 15")


def own(site, *options):
    """A run with the law, in a separate process: kernels with such a law have a cache of their own."""
    command = [sys.executable, "-m", "mpmgis", "run", "own.toml", "-q", "--law", "my_law.py", *options]
    return subprocess.run(command, cwd=site, capture_output=True, text=True, timeout=900)


@pytest.mark.slow
def test_a_user_law_moves_the_flow_as_defined(tmp_path):
    """Voellmy written again, whose parts the solver finds by chord: Voellmy's flow (0.05 m off after 15 s)."""
    site = write_site(tmp_path)
    (site / "my_law.py").write_text(LAW)
    (site / "own.toml").write_text(TEXT)
    (site / "scene.toml").write_text(TEXT.replace("my_law.py:Mine", "Voellmy"))
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "shipped")]) == 0
    done = own(site, "-o", "own")
    assert done.returncode == 0, done.stderr
    for k in range(4):
        mine, shipped = (read_frame(site / name / f"frame_{k:06d}.h5").particles for name in ("own", "shipped"))
        apart = mine.position[np.argsort(mine.id)] - shipped.position[np.argsort(shipped.id)]
        assert np.linalg.norm(apart, axis=1).max() < 0.2
    assert np.average(mine.position[:, 0]) > 200.0  # from 110 m
    friction = {d["effect"]: d for d in record(site, "own")["effects"]}["friction"]
    assert friction["state"] == "on" and "my_law.py:Mine: mu = 0.2, xi = 1000" in friction["reason"]
    whole = contents(site / "own")
    (site / "own" / "frame_000003.h5").unlink()  # as if it had been stopped before its last frame
    record_file = site / "own" / "run.json"
    record_file.write_text(record_file.read_text().replace('"state": "finished"', '"state": "running"'))
    (site / "my_law.py").write_text(LAW.replace("self.mu *", "1.1 * self.mu *"))
    done = own(site, "-o", "own", "--resume")
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "another scene" in done.stderr
    (site / "my_law.py").write_text(LAW)
    done = own(site, "-o", "own", "--resume")
    assert done.returncode == 0, done.stderr
    assert contents(site / "own") == whole
