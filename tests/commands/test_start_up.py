"""What `seed` and `export-raster` import: every call pays for each library that is not needed."""

import json
import subprocess
import sys

import pytest
from slope_site import write_site

WITH_NAMES = """
import json, sys
from mpmgis.commands.shell.main import main
code = main(sys.argv[2:])
with open(sys.argv[1], "w") as file:
    json.dump(sorted(sys.modules), file)
sys.exit(code)
"""
# of the libraries that we depend on, and of what they can bring, by what a call needed before: tenths of a second each
HEAVY = {
    *("dask", "distributed", "geopandas", "matplotlib", "netCDF4", "pandas", "pyarrow", "rich", "rioxarray", "xarray"),
    *("zarr", "scipy.ndimage", "scipy.linalg", "scipy.sparse", "scipy.spatial", "scipy.optimize", "scipy.special"),
    *("scipy.stats", "numpy.f2py", "numpy.testing", "sympy", "IPython", "boto3"),
}
SEED = {"commands", "compiled", "conversion", "frames", "laws", "seeding", "system", "terrain"}
EXPORT = SEED - {"conversion", "seeding"} | {"exchange", "maps"}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("start"))
    (folder / "frames").mkdir()
    return folder


def imported(site, *words):
    """Names of the modules that are there when the command has ended."""
    command = [sys.executable, "-c", WITH_NAMES, str(site / "names.json"), *words]
    done = subprocess.run(command, cwd=site, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr
    return set(json.loads((site / "names.json").read_text()))


def units(names):
    """The parts of the house among the names of modules."""
    return {name.split(".")[1] for name in names if name.startswith("mpmgis.")}


def test_seeding_and_exporting_import_no_more_than_they_need(site):
    given = ("--dem", "dtm.tif", "--release", "release.geojson", "--thickness", "2")
    names = imported(site, "seed", *given, "-o", "frames/frame_000000.h5")
    assert not names & HEAVY
    assert units(names) == SEED and "mpmgis.solvers.columns.column_loop" not in names

    names = imported(site, "export-raster", "frames", "-o", "rasters_alone", "--no-qgis")
    assert not names & (HEAVY | {"pyogrio"})
    assert units(names) == EXPORT

    names = imported(site, "export-raster", "frames", "-o", "with_qgis")
    assert names & HEAVY == {"netCDF4"}  # the mesh
    assert units(names) == EXPORT and "mpmgis.solvers.columns.column_loop" not in names


def test_pyogrio_comes_without_pandas_and_geopandas_still_reads_with_it(site):
    code = f"""
import sys
from mpmgis.system.optional_libraries import DETECTED_BY_PYOGRIO, pyogrio
library = pyogrio()
assert library is pyogrio() and not set(DETECTED_BY_PYOGRIO) & set(sys.modules)
import geopandas, pandas
table = geopandas.read_file({str(site / "release.geojson")!r}, engine="pyogrio")
assert isinstance(table, geopandas.GeoDataFrame) and pandas.DataFrame and len(table) == 1
table.to_file("again.gpkg", engine="pyogrio")
assert len(library.read_dataframe("again.gpkg")) == 1
assert len(geopandas.read_file("again.gpkg", engine="pyogrio", use_arrow=True)) == 1
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=site, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr


def test_pyogrio_is_imported_as_usual_beside_other_threads(site):
    code = """
import sys, threading
from mpmgis.system.optional_libraries import pyogrio
end = threading.Event()
threading.Thread(target=end.wait).start()
try:
    pyogrio()
    assert "pandas" in sys.modules and sys.modules["pandas"].DataFrame
finally:
    end.set()
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=site, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
