"""Verbs that are stopped by signals: exit code for shells, one line, and no incomplete files."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import rasterio

from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.shell.main import main
from mpmgis.commands.shell.progress import Interrupted, ended_by_signals

# the verb itself, sent its signal twice (as `timeout` does) where its file is written but has no name yet, or where
# the first frame is exported
STOPPED = """
import os, sys
from mpmgis.commands.shell import answers
from mpmgis.commands.shell.main import main

def stop():
    for _ in range(2):
        os.kill(os.getpid(), int(sys.argv[1]))

def replace(source, target):
    if ".part" in str(source):
        assert os.path.exists(source)
        stop()
    name(source, target)

name, os.replace = os.replace, replace
answers.show_count = lambda what, done, total: stop()
raise SystemExit(main(sys.argv[2:]))
"""
DEM, RELEASE = (sample_folder() / f"lava_falls_{name}" for name in ("dem_utm12n_10m.tif", "release_small.shp"))
VERBS = {
    "seed": "seed --dem {dem} --release {release} -o {to}.gpkg",
    "convert": "convert {columns} --to points -o {to}.h5",
    "export-raster": "export-raster {columns} --dem {dem} -o {to}",
    "compare": "compare {raster} {release} -o {to}.csv",
}


@pytest.fixture(scope="module")
def columns(tmp_path_factory):
    """Columns that `mpmgis seed` wrote on the sample site."""
    path = tmp_path_factory.mktemp("columns") / "columns.h5"
    assert main(["seed", "--dem", str(DEM), "--release", str(RELEASE), "-o", str(path), "-q"]) == 0
    return path


@pytest.fixture(scope="module")
def raster(tmp_path_factory):
    """A raster of depths on the sample site."""
    path = tmp_path_factory.mktemp("raster") / "depth.tif"
    with rasterio.open(DEM) as dtm, rasterio.open(path, "w", **dtm.profile) as depth:
        depth.write(np.where(dtm.read(1) > 1000.0, 2.0, 0.0).astype(dtm.dtypes[0]), 1)
    return path


@pytest.mark.parametrize("verb", ["seed", *(pytest.param(verb, marks=pytest.mark.thorough) for verb in [*VERBS][1:])])
def test_sigterm_ends_a_verb_as_ctrl_c_does(verb, columns, raster, tmp_path):
    files = {"dem": DEM, "release": RELEASE, "columns": columns, "raster": raster, "to": tmp_path / "new" / "result"}
    words = [word.format(**files) for word in VERBS[verb].split()]
    command = [sys.executable, "-c", STOPPED, str(int(signal.SIGTERM)), *words]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 143, ended.stderr
    assert ended.stderr.splitlines()[-1] == f"mpmgis {verb}: interrupted" and ended.stdout == ""
    assert list(tmp_path.iterdir()) == []
    assert list(columns.parent.iterdir()) == [columns]


@pytest.fixture
def hearing():
    """SIGINT as a terminal's foreground job has it: a shell starts what it puts into the background deaf to it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_signal_ends_the_run_and_its_repetition_has_no_effect(hearing):
    """While the first is being obeyed; and the handlers come back."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        tidied = False
        with pytest.raises(Interrupted) as stopped, ended_by_signals():
            try:
                signal.raise_signal(number)
                pytest.fail("the signal came and went")
            finally:
                signal.raise_signal(number)
                time.sleep(0)
                tidied = True
        assert stopped.value.exit_code == code and tidied
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_job_that_is_deaf_to_ctrl_c_stays_so():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with ended_by_signals():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
