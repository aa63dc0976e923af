"""The public functions of mpmgis are typed for users of `mypy --strict`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import mpmgis

pytestmark = pytest.mark.thorough
SCRIPT = """
from pathlib import Path

import mpmgis

seeded = mpmgis.seed("dtm.tif", Path("release.shp"), "particles.h5", thickness=1.5, count=20_000)
written: Path = seeded.path
summary = mpmgis.run({"terrain": {"dem": "dtm.tif"}}, "results", confirm=lambda question: False)
files: list[Path] = mpmgis.export_raster("results", cell_size="auto", time_step=0.2, products=("t_vol",))
found = mpmgis.runout(["a.h5", Path("b.h5")], line="line.gpkg", threshold=0.5)
series = mpmgis.timeseries("results", at=((1.0, 2.0),))
depth = mpmgis.open_results("results", cell_size=2.0, extent="flow")
page: Path = mpmgis.report("results", title="A")
site: Path = mpmgis.sample_site()
frame: mpmgis.Frame = mpmgis.read_frame("frame.h5")
start = mpmgis.solver_start("particles.h5", "kratos", cell=1.0)
try:
    mpmgis.compare("a", "b", band="h_max")
except mpmgis.MpmgisError as error:
    print(error)
"""
WRONG = """
import mpmgis

mpmgis.export_raster("results", cell_sise=2.0)
mpmgis.runout("results", threshold="deep")
mpmgis.hydrograph("results")
mpmgis.seed("dtm.tif", "release.shp", mass="none")
"""
SIGNATURES = """
import mpmgis

{lines}
"""


def checked(folder, text):
    pytest.importorskip("mypy", reason="the extra `test` is not installed")
    script = folder / "script.py"
    script.write_text(text)
    options = ["--strict", "--follow-imports=silent", "--ignore-missing-imports", f"--cache-dir={folder / 'cache'}"]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, str(script)],
        capture_output=True,
        text=True,
        cwd=folder,
        timeout=280,
        env=os.environ | {"MYPYPATH": str(Path(mpmgis.__file__).parents[1])},
    )
    return done.stdout + done.stderr


def test_a_users_script_passes_and_mistakes_are_found(tmp_path):
    assert "Success" in checked(tmp_path, SCRIPT), checked(tmp_path, SCRIPT)
    found = checked(tmp_path, WRONG)
    for words in ("cell_sise", '"threshold"', '"section"', '"mass"'):
        assert words in found
    assert found.count(": error: ") == 4


def test_no_function_returns_or_takes_any(tmp_path):
    names = sorted(set(mpmgis.__all__) - {"Frame", "Particles", "to_geodataframe"})  # GeoPandas has no types
    lines = "\n".join(f"reveal_type(mpmgis.{name})" for name in names)
    revealed = [line for line in checked(tmp_path, SIGNATURES.format(lines=lines)).splitlines() if "Revealed" in line]
    assert len(revealed) == len(names)
    assert not [line for line in revealed if line.rstrip('"').endswith("-> Any") or ": Any" in line]
