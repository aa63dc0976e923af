"""H36: from a DTM of 1e8 pixels only the part that a seed or a window needs is read, with the bits of the whole DTM."""

import subprocess
import sys

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.seeding import seeded_file as seeding
from mpmgis.simulation import preparation
from mpmgis.system import memory
from mpmgis.system.errors import InputError, SceneError
from mpmgis.system.messages import collected
from mpmgis.terrain import dtm
from mpmgis.terrain.dtm import TerrainFile, read_terrain

SIDE, PIXEL, WEST, NORTH = 10_000, 5.0, 400_000.0, 5_200_000.0
MIDDLE = WEST + 0.5 * SIDE * PIXEL, NORTH - 0.5 * SIDE * PIXEL
TILTED = Affine.translation(WEST, NORTH) * Affine.rotation(20) * Affine.scale(5, -4)
UPRIGHT = Affine(PIXEL, 0, WEST, 0, PIXEL, NORTH)  # south-up

# Peak memory [MB] of a child after its imports, after a seed on the DTM, and after reading a window of 2000 x 2000
CHILD = """
import resource, sys
from mpmgis.commands.shell.main import main
from mpmgis.terrain.dtm import TerrainFile
from mpmgis.seeding import raster_values
def peak():
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
dem, release, small, x, y = sys.argv[1:]
main(["seed", "--dem", small, "--release", release, "-q", "-o", "small.h5"])
peak()
main(["seed", "--dem", dem, "--release", release, "-q", "-o", "seed.h5"])
peak()
x, y = float(x), float(y)
assert TerrainFile(dem).cropped((x - 5000, y - 5000, x + 5000, y + 5000), 0).elevation.shape == (2000, 2000)
peak()
"""


def written(path, shape, transform, first=(0, 0), extent=None, nodata=-9999.0):
    """A tiled GeoTIFF of `shape` with heights in `extent` pixels from `first` on; the rest is nodata without tiles."""
    extent = extent or shape
    row, column = np.mgrid[first[0] : first[0] + extent[0], first[1] : first[1] + extent[1]]
    heights = (4000.0 - 0.3 * column + 20.0 * np.sin(row / 40.0) * np.cos(column / 30.0)).astype("float32")
    profile = {
        "driver": "GTiff",
        "height": shape[0],
        "width": shape[1],
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:32632",
        "transform": transform,
        "nodata": nodata,
        "tiled": True,
        "blockxsize": 256,
        "blockysize": 256,
    }
    with rasterio.open(path, "w", sparse_ok=True, compress="DEFLATE", **profile) as file:
        file.write(heights, 1, window=rasterio.windows.Window(first[1], first[0], extent[1], extent[0]))
    return path


def release_at(path, x, y, radius=60.0):
    """A disc of 2 m thickness."""
    disc = shapely.Point(x, y).buffer(radius)
    geopandas.GeoDataFrame({"d0": [2.0]}, geometry=[disc], crs="EPSG:32632").to_file(path)
    return path


@pytest.fixture(scope="module")
def huge(tmp_path_factory):
    """A DTM of 1e8 pixels, of which 1024 x 1024 around its middle have heights."""
    first = SIDE // 2 - 512
    transform = Affine(PIXEL, 0, WEST, 0, -PIXEL, NORTH)
    path = tmp_path_factory.mktemp("huge") / "dtm.tif"
    return written(path, (SIDE, SIDE), transform, (first, first), (1024, 1024))


def test_memory_follows_what_is_needed(huge, tmp_path):
    """The whole DTM takes 0.8 GB, 1.9 GB with derived arrays; a seed on it takes no more than one on a small DTM."""
    release = release_at(tmp_path / "area.gpkg", *MIDDLE)
    small = written(tmp_path / "small.tif", (200, 200), Affine(5, 0, MIDDLE[0] - 500, 0, -5, MIDDLE[1] + 500))
    arguments = [str(huge), str(release), str(small), *map(str, MIDDLE)]
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    few, seeded, window = (int(line) for line in done.stdout.split() if line.isdigit())
    assert seeded - few <= 60 and window - few <= 250  # measured 0 and 109 MB
    assert len(read_frame(tmp_path / "seed.h5").particles) > 1000


@pytest.mark.parametrize("transform", [TILTED, UPRIGHT], ids=["rotated", "south-up"])
@pytest.mark.parametrize("how", ["column", "surface"])
def test_a_seed_has_the_bits_that_the_whole_gives(transform, how, tmp_path, monkeypatch):
    dem = written(tmp_path / "dtm.tif", (300, 400), transform, (20, 30), (250, 320))
    x, y = transform * (200.3, 150.7)
    release, options = release_at(tmp_path / "area.gpkg", x, y), {}
    if how == "surface":
        options["surface"] = tmp_path / "surface.tif"
        with rasterio.open(dem) as file, rasterio.open(options["surface"], "w", **file.profile) as target:
            heights = file.read(1)
            target.write(np.where(heights > 0, heights + 1.5, heights), 1)
    frames, messages = [], []
    for limit in (dtm.READ_WHOLE, 0):
        monkeypatch.setattr(dtm, "READ_WHOLE", limit)
        path = tmp_path / f"{limit}.h5"
        with collected() as said:
            seeding.seed_file(dem, release, path, velocity=(1.0, 2.0), refine_slope=1.0, **options)
        messages += said
        frames.append(read_frame(path))
    whole, part = frames
    for name, values in whole.particles.arrays().items():
        np.testing.assert_array_equal(values, getattr(part.particles, name), err_msg=name)
    assert str(whole.header) == str(part.header) and whole.origin == part.origin
    assert whole.dem_sha256 == part.dem_sha256 != ""
    assert sum("only those around the release are read and checked" in text for text in messages) == 1


def test_cells_without_heights_are_named_as_in_the_whole(huge, tmp_path):
    beside = MIDDLE[0] - 510 * PIXEL, MIDDLE[1]
    with pytest.raises(InputError, match=r"no elevation under release .* in cell \(row, column\) \(49\d\d, 44"):
        seeding.seed_file(huge, release_at(tmp_path / "area.gpkg", *beside), tmp_path / "out.h5")
    with pytest.raises(InputError, match=r"every cell in the needed rows 985 to .* is nodata"):
        far = WEST + 1000 * PIXEL, NORTH - 1000 * PIXEL
        seeding.seed_file(huge, release_at(tmp_path / "far.gpkg", *far), tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()


@pytest.mark.parametrize("transform", [TILTED, UPRIGHT], ids=["rotated", "south-up"])
def test_a_window_has_the_bits_that_the_whole_has(transform, tmp_path):
    dem = written(tmp_path / "dtm.tif", (300, 400), transform, (20, 30), (250, 320))
    x, y = transform * (200.0, 150.0)
    window = x - 300.0, y - 200.0, x + 250.0, y + 300.0
    whole, part = read_terrain(dem).cropped(window, 0), TerrainFile(dem).cropped(window, 0)
    np.testing.assert_array_equal(whole.elevation, part.elevation)
    assert (whole.grid, whole.path, whole.sha256) == (part.grid, part.path, part.sha256)


def scene_on(dem, folder, window=""):
    """A scene file on `dem` with a release in its middle."""
    release_at(folder / "area.gpkg", *MIDDLE)
    (folder / "scene.toml").write_text(
        f'[terrain]\ndem = "{dem}"\n{window}\n[release]\nsource = "area.gpkg"\n[friction]\nlaw = "Coulomb"\nmu = 0.3\n'
        "[numerics]\ncell_size = 20.0\nparticles_per_cell = 4\n[output]\nend_time = 1\nframe_interval = 1\n"
    )
    return folder / "scene.toml"


def test_a_run_reports_what_a_huge_terrain_takes_before_it_is_read(huge, tmp_path, monkeypatch, capsys):
    """14 GB with 8 GB free: refused in one line that suggests `window`; with a window it runs."""
    monkeypatch.setattr(memory, "available_memory", lambda: 8e9)
    monkeypatch.setattr(TerrainFile, "whole", lambda file: pytest.fail("it was read"))
    assert main(["run", str(scene_on(huge, tmp_path)), "-q"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "10000 x 10000 cells, which need about 14 GB of memory, 8 GB are free; [terrain] window = [west" in line
    with monkeypatch.context() as patch:  # a window as large as the DTM saves nothing
        patch.setattr(TerrainFile, "part", lambda file, rows, columns: pytest.fail("it was read"))
        with pytest.raises(SceneError, match=r"window of .* has 10000 x 10000 cells, .* 8 GB are free"):
            preparation.prepare(scene_on(huge, tmp_path, "window = [0, 0, 9e6, 9e6]"))
    x, y = MIDDLE
    window = f"window = [{x - 500}, {y - 500}, {x + 500}, {y + 500}]"
    prepared = preparation.prepare(scene_on(huge, tmp_path, window))
    assert prepared.terrain.elevation.shape == (200, 200)


def test_a_run_that_has_the_memory_prints_its_need(tmp_path, monkeypatch):
    dem = written(tmp_path / "dtm.tif", (200, 200), Affine(5, 0, MIDDLE[0] - 500, 0, -5, MIDDLE[1] + 500))
    scene = scene_on(dem, tmp_path)
    monkeypatch.setattr(preparation, "READ_WHOLE", 10_000)
    with collected() as said:
        preparation.prepare(scene)
    assert any("200 x 200 cells, which need up to 0.0056 GB; [terrain] window" in text for text in said)
    monkeypatch.setattr(memory, "available_memory", lambda: 5e6)
    with pytest.raises(SceneError, match=r"0\.005 GB are free"):
        preparation.prepare(scene)
