"""The main verbs work without Arrow and Dask; options that need one of them report how to install it."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from slope_site import SCENE, write_site

from mpmgis.commands.shell.main import main
from mpmgis.exchange.readers.record_parsing import Form, read_by_python, read_rows
from mpmgis.frames.text_rows import append_rows, as_text

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


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("few"))
    (folder / "scene.toml").write_text(SCENE.replace("end_time = 30", "end_time = 2").replace("= 5\n", "= 1\n"))
    (folder / "blocked").mkdir()
    (folder / "blocked" / "sitecustomize.py").write_text(BLOCKER)
    return folder


def without(site, *words):
    """The command in a process, and in those that it starts, where these libraries cannot be imported."""
    environment = os.environ | {"PYTHONPATH": str(site / "blocked")}
    return subprocess.run(
        [sys.executable, "-m", "mpmgis", *map(str, words)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=site,
        timeout=280,
    )


def test_the_blocker_blocks(site):
    environment = os.environ | {"PYTHONPATH": str(site / "blocked")}
    trial = f"""
import importlib
for name in {FEW_NEED!r}:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        print(name)
"""
    tried = subprocess.run([sys.executable, "-c", trial], capture_output=True, text=True, env=environment)
    assert tried.stdout.split() == list(FEW_NEED)


@pytest.mark.parametrize("suffix", ["csv", "gpkg"])
def test_seeds_are_the_same_without_arrow(site, suffix, tmp_path, capsys):
    words = ("seed", "--dem", site / "dtm.tif", "--release", site / "release.geojson", *SEED[5:])
    done = without(site, *words, "-o", tmp_path / f"few.{suffix}")
    assert done.returncode == 0, done.stderr
    assert main([*map(str, words), "-q", "-o", str(tmp_path / f"all.{suffix}")]) == 0
    capsys.readouterr()
    told = [without(site, "info", "--json", tmp_path / f"few.{suffix}").stdout]
    assert main(["info", "--json", str(tmp_path / f"all.{suffix}")]) == 0
    told.append(capsys.readouterr().out)
    few, everything = ({**json.loads(some), "file": "", "bytes": 0} for some in told)
    assert few == everything and few["n"] > 100


@pytest.mark.thorough
def test_a_run_and_its_export_and_an_ensemble_need_none_of_them(site):
    for words in (
        ("run", "scene.toml", "-o", "results", "--overwrite"),
        ("export-raster", "results", "-o", "results_gis", "--overwrite"),
        ("ensemble", "scene.toml", "--vary", "friction.mu=0.1:0.3", "--samples", 2, "--workers", 2, "-o", "many"),
    ):
        done = without(site, *words)
        assert done.returncode == 0, done.stderr
    assert list((site / "results_gis").glob("*.qgz")) and list((site / "many").rglob("*.qgz"))


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        ((*SEED, "-o", "a.parquet"), "parquet"),
        (("seed", "--dem", "dtm.tif", "--release", "area.parquet", "--thickness", "2"), "parquet"),
        (("info", "area.parquet"), "parquet"),
        (("export-raster", "frames", "--dask", "tcp://127.0.0.1:9"), "cluster"),
        (("ensemble", "scene.toml", "--vary", "friction.mu=0.1:0.3", "--dask", "tcp://127.0.0.1:9"), "cluster"),
    ],
)
def test_what_needs_one_reports_how_to_install_it(site, words, extra):
    if "area.parquet" in words:
        import geopandas

        geopandas.read_file(site / "release.geojson").to_parquet(site / "area.parquet")
    if "frames" in words:
        (site / "frames").mkdir(exist_ok=True)
        assert without(site, *SEED, "-o", "frames/frame_000000.h5").returncode == 0
    done = without(site, *words)
    assert done.returncode == 2, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("mpmgis ")]
    assert f'pip install "mpmgis[{extra}]"' in line and done.stderr.splitlines()[-1] == line
    assert not (site / "a.parquet").exists()


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
