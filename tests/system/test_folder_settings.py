"""Files in the current folder that libraries read as settings have no effect, in any process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mpmgis.system.folder_settings import SETTINGS

VICTIM = "precious\n"
HOSTILE = {  # file: what it would do
    ".numba_config.yaml": (
        "chrome_trace: victim.txt\n",
        "num_threads: 0\n",
        "a: [",
        "5: 5\n",
        "threading_layer: none\n",
    ),
    "matplotlibrc": ("text.usetex: True\n", "path.effects: x\n", "image.cmap: gray\n", b"\xff\xfe: \xff"),
    "dask.yaml": ("distributed: {worker: {preload: victim.py}}\n",),
    "distributed.yaml": ("distributed: {logging: {distributed: debug}}\n",),
    "proj.db": ("no database",),
    "proj.ini": ("[general]\nnetwork = on\ncdn_endpoint = http://127.0.0.1:9\n",),
    ".ncrc": ("HTTP.VERBOSE=1\n",),
}
# What libraries have taken from files: numba's and matplotlib's settings, Dask's configuration.
PROBE = """
import json, sys
{first}
import mpmgis.compiled.jit
from numba.core import config
config.reload_config()
import matplotlib
import dask.config
print(json.dumps([config.CHROME_TRACE, config.NUMBA_NUM_THREADS, config.THREADING_LAYER,
    matplotlib.rcParams["text.usetex"], matplotlib.rcParams["image.cmap"],
    matplotlib.rcParams["savefig.bbox"], str(dask.config.get("distributed.worker.preload", []))]))
"""
WORKERS = """
from mpmgis.system import worker_processes
import folder_settings_probe
with worker_processes.started(1) as workers:
    ((_, found),) = workers.worked(folder_settings_probe.settings, [folder_settings_probe.Piece()])
    print(found)
"""
MODULE = """
class Piece:
    number = 0
def settings(_):
    import mpmgis.compiled.jit
    from numba.core import config
    import matplotlib
    return [config.CHROME_TRACE, config.NUMBA_NUM_THREADS, matplotlib.rcParams["text.usetex"]]
"""


def fill(folder, number):
    """Write a hostile file of each name."""
    (folder / "victim.txt").write_text(VICTIM)
    for name, contents in HOSTILE.items():
        content = contents[number % len(contents)]
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def said(program, folder, path=()):
    """What a program prints that is started in a folder."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *map(str, path)])}
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and not done.stderr, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """The settings in a folder without such files."""
    return said(PROBE.format(first=""), tmp_path_factory.mktemp("clean"))


@pytest.mark.parametrize(
    ("number", "first"),
    [
        (0, ""),
        pytest.param(1, "import mpmgis.compiled.called_kernels", marks=pytest.mark.thorough),
        pytest.param(2, "import mpmgis.system, numba", marks=pytest.mark.thorough),
        pytest.param(3, "import mpmgis.system, matplotlib", marks=pytest.mark.thorough),
        pytest.param(4, "import mpmgis.solvers.gpu", marks=pytest.mark.thorough),
    ],
)
def test_libraries_take_no_settings_from_the_current_folder(tmp_path, usual, number, first):
    """Also where another module than the compiler interface imports numba, and at each compilation."""
    fill(tmp_path, number)
    assert said(PROBE.format(first=first), tmp_path) == usual
    assert (tmp_path / "victim.txt").read_text() == VICTIM


@pytest.mark.thorough
def test_workers_take_none_either(tmp_path):
    clean, hostile, code = (tmp_path / name for name in ("clean", "hostile", "code"))
    for folder in (clean, hostile, code):
        folder.mkdir()
    fill(hostile, 0)
    (code / "folder_settings_probe.py").write_text(MODULE)
    assert said(WORKERS, hostile, [code]) == said(WORKERS, clean, [code])
    assert (hostile / "victim.txt").read_text() == VICTIM


def test_the_libraries_still_look_for_these_files():
    """A new version that looks for another name would need another line in SETTINGS."""
    import matplotlib
    from numba.core import config

    assert config._config_fname == os.devnull
    source = Path(config.__file__).read_text(encoding="utf-8")
    assert f"_config_fname = '{SETTINGS['numba.core.config']}'" in source
    assert "os.path.exists(_config_fname)" in source
    source = Path(matplotlib.__file__).read_text(encoding="utf-8")
    assert f"yield '{SETTINGS['matplotlib']}'" in source and "os.path.exists(fname)" in source


def test_no_library_asks_for_a_setting_in_the_current_folder(tmp_path, monkeypatch):
    """The vector library with SpatiaLite looked for PROJ's database there."""
    import geopandas
    import shapely

    from mpmgis.terrain.vector_table import read_table

    monkeypatch.chdir(tmp_path)
    geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 9, 9)], crs=32632).to_file("a.gpkg")
    fill(tmp_path, 0)
    os.utime("proj.db", (0, 0))
    assert read_table("a.gpkg").crs.to_epsg() == 32632
    assert Path("proj.db").stat().st_atime == 0
