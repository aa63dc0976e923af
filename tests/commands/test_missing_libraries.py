"""The main verbs work without Arrow and Dask; options that need one of them report how to install it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import geopandas
import numpy as np
import pytest
from slope_site import SCENE, write_site

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.exchange.readers.record_parsing import Form, read_by_python, read_rows
from mpmgis.frames.text_rows import append_rows, as_text

PACKAGE = Path(mpmgis.__file__).parent
FEW_NEED = ("pyarrow", "dask", "distributed", "zarr", "IPython", "pytest", "hypothesis", "psutil")
SEED = ("seed", "--dem", "dtm.tif", "--release", "release.geojson", "--thickness", "2", "--overwrite")
BLOCKER = f"""
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {FEW_NEED!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocked())
"""


WITHOUT = """
import contextlib, io, json, os, sys
import mpmgis
from mpmgis.commands.shell.main import main

told = []
for words in json.load(sys.stdin):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    told.append((code, out.getvalue(), err.getvalue()))
json.dump(told, sys.stdout)
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("few"))
    (folder / "scene.toml").write_text(SCENE.replace("end_time = 30", "end_time = 2").replace("= 5\n", "= 1\n"))
    geopandas.read_file(folder / "release.geojson").to_parquet(folder / "area.parquet")
    (folder / "blocked").mkdir()
    (folder / "blocked" / "sitecustomize.py").write_text(BLOCKER)
    for name in ("frames", "whole"):
        (folder / name).mkdir()
    return folder


def python(site, code, given=""):
    """Standard output of `code` in a process, and in those that it starts, where these libraries are not there."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(site / "blocked"), str(PACKAGE.parent)])}
    done = subprocess.run(
        [sys.executable, "-c", code], input=given, capture_output=True, text=True, env=environment, cwd=site
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def without(site, commands):
    """(exit code, stdout, stderr) of each of the commands, one after the other in such a process."""
    return json.loads(python(site, WITHOUT, json.dumps([[*map(str, words)] for words in commands])))


def test_the_blocker_blocks(site):
    trial = f"""
import importlib
for name in {FEW_NEED!r}:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        print(name)
"""
    assert python(site, trial).split() == list(FEW_NEED)


NEED = [
    ((*SEED, "-o", "a.parquet"), "parquet"),
    (("seed", "--dem", "dtm.tif", "--release", "area.parquet", "--thickness", "2"), "parquet"),
    (("info", "area.parquet"), "parquet"),
    (("export-raster", "frames", "--dask", "tcp://127.0.0.1:9"), "cluster"),
    (("ensemble", "scene.toml", "--vary", "friction.mu=0.1:0.3", "--dask", "tcp://127.0.0.1:9"), "cluster"),
]


def test_seeds_are_the_same_without_them_and_what_needs_one_reports_how_to_install_it(site, capsys):
    """One process for all commands: its start is most of what they cost."""
    seeds = [f"frames/{name}" for name in ("frame_000000.h5", "few.csv", "few.gpkg")]
    seed = ("seed", "--dem", site / "dtm.tif", "--release", site / "release.geojson", *SEED[5:])
    commands = [(*seed, "-o", name) for name in seeds]
    commands += [("info", "--json", name) for name in seeds] + [words for words, _ in NEED]
    told = without(site, commands)
    for name, (code, _, err), (_, facts, _) in zip(seeds, told, told[3:], strict=False):
        assert code == 0, err
        whole = site / name.replace("frames", "whole")
        assert main([*map(str, seed), "-q", "-o", str(whole)]) == 0
        capsys.readouterr()
        assert main(["info", "--json", str(whole)]) == 0
        few, everything = ({**json.loads(some), "file": "", "bytes": 0} for some in (facts, capsys.readouterr().out))
        assert few == everything and few["n"] > 100
    for (words, extra), (code, _, err) in zip(NEED, told[6:], strict=True):
        assert code == 2, (words, err)
        (line,) = [line for line in err.splitlines() if line.startswith("mpmgis ")]
        assert f'pip install "mpmgis[{extra}]"' in line and err.splitlines()[-1] == line
    assert not (site / "a.parquet").exists()


@pytest.mark.thorough
def test_a_run_and_its_export_and_an_ensemble_need_none_of_them(site):
    commands = [
        ("run", "scene.toml", "-o", "results", "--overwrite"),
        ("export-raster", "results", "-o", "results_gis", "--overwrite"),
        ("ensemble", "scene.toml", "--vary", "friction.mu=0.1:0.3", "--samples", 2, "--workers", 2, "-o", "many"),
    ]
    for words, (code, _, err) in zip(commands, without(site, commands), strict=True):
        assert code == 0, (words, err)
    assert list((site / "results_gis").glob("*.qgz")) and list((site / "many").rglob("*.qgz"))


# ------------------------------------------------------------------------------------------- text by Python and Arrow


def test_rows_as_text_give_every_digit_back_with_arrow_and_without(tmp_path):
    random = np.random.default_rng(1)
    columns = [
        np.arange(1000, dtype=np.uint64) + 2**60,
        random.normal(size=1000) * 10.0 ** random.integers(-300, 300, 1000),
        np.linspace(-5.0, 5.0, 1000).astype(np.float32),
    ]
    with open(tmp_path / "by_arrow.csv", "wb") as sink:
        append_rows(sink, columns, ",")
    (tmp_path / "by_python.csv").write_bytes(as_text(columns, ","))
    form = Form(("id", "x", "y"), ",")
    for name in ("by_arrow.csv", "by_python.csv"):
        for values in (
            read_rows(tmp_path / name, 0, None, form, ("x", "y")),
            read_by_python(tmp_path / name, (tmp_path / name).read_bytes(), form, ("x", "y")),
        ):
            assert np.array_equal(values["x"], columns[1])
            assert np.array_equal(values["y"].astype(np.float32), columns[2])


@pytest.mark.parametrize(
    "text",
    ["1,2\n3,4\n", '"a, b",2\n\nc,NaN\n', "1,\n2,-3e5\r\n", "1,2,3\n1,2\n", "1\n", "1,2_0\n", "1,0x10\n", "1,inf\n"],
)
def test_python_reads_what_arrow_reads_and_refuses_what_it_refuses(tmp_path, text):
    from mpmgis.system.errors import FormatError

    path, form = tmp_path / "rows.csv", Form(("a", "b"), ",")
    path.write_bytes(text.encode())
    got = []
    for read in (read_rows, lambda path, start, stop, form, names: read_by_python(path, text.encode(), form, names)):
        try:
            got.append(read(path, 0, None, form, ("b",))["b"])
        except FormatError:
            got.append(None)
    assert (got[0] is None) == (got[1] is None)
    assert got[0] is None or np.array_equal(got[0], got[1], equal_nan=True)


def test_a_decimal_comma_is_read_without_arrow(tmp_path):
    form = Form(("a", "b"), ";", decimal=",")
    assert read_by_python(tmp_path, b"1,5;2\n-3,25;1e3\n", form, ("a", "b"))["a"].tolist() == [1.5, -3.25]
