"""`mpmgis seed` as a user types it, on the sample site (a small one of its own where that is not there)."""

import subprocess
import sys
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from seed_sites import ring, write_dtm

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.terrain.dtm import read_terrain

ROOT = Path(__file__).parents[2]
PLACES = [ROOT / "sample_data/lava_falls", ROOT / "../shared/data/lava_falls"]
SITE = next((place for place in PLACES if list(place.glob("*dem*.tif"))), None)
FORMATS = ["h5", "csv", "json", "gpkg", "parquet", "vtp"]


@pytest.fixture
def site(tmp_path):
    """(DTM, release, plan area, normal thickness) of lava_falls, or of a plane."""
    if SITE is not None:
        dem = next(SITE.glob("*dem*.tif"))
        release = next(path for path in SITE.glob("*release*.shp") if "small" not in path.stem)
        return dem, release, 20_970.0, 5.0
    geopandas.GeoDataFrame({"d0": [5.0]}, geometry=[ring()], crs="EPSG:32632").to_file(tmp_path / "area.shp")
    return write_dtm(tmp_path / "dtm.tif"), tmp_path / "area.shp", ring().area, 5.0


def seed(*arguments):
    return main(["seed", *map(str, arguments)])


def test_default_name_and_talk(site, tmp_path, monkeypatch, capsys):
    dem, release, area, _ = site
    monkeypatch.chdir(tmp_path)
    assert seed("--dem", dem, "--release", release) == 0
    out, err = capsys.readouterr()
    assert out.strip() == f"{release.stem}_particles.h5"
    assert "density: 1000" in err and "column 'thickness'" in err.replace("'d0'", "'thickness'")
    assert "closure factor k" in err
    frame = read_frame(tmp_path / out.strip())
    assert frame.particles.area.sum() == pytest.approx(area, rel=1e-9)
    assert (tmp_path / out.strip()).parent.joinpath(frame.dem).resolve() == dem.resolve()
    assert frame.header["release_area"] == pytest.approx(area, rel=1e-9)


def test_volume_is_the_slope_normal_integral(site, tmp_path):
    """Issue 2: within 0.2 % of the slope-normal integral on real terrain, done here by a fine sum over the bed."""
    dem, release, area, thickness = site
    assert seed("--dem", dem, "--release", release, "-o", tmp_path / "p.h5", "-q") == 0
    terrain = read_terrain(dem)
    polygon = geopandas.read_file(release).union_all()
    west, south, east, north = polygon.bounds
    step = 0.5
    x, y = np.meshgrid(np.arange(west, east, step), np.arange(south, north, step))
    inside = shapely.contains_xy(polygon, x, y)
    x, y = x[inside], y[inside]
    reach = terrain.grid.cell_size / 2
    slope_x = (terrain.sample(x + reach, y) - terrain.sample(x - reach, y)) / (2 * reach)
    slope_y = (terrain.sample(x, y + reach) - terrain.sample(x, y - reach)) / (2 * reach)
    exact = area * thickness * np.sqrt(1 + slope_x**2 + slope_y**2).mean()
    assert read_frame(tmp_path / "p.h5").particles.volume.sum() == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("suffix", FORMATS)
def test_formats(site, tmp_path, suffix, capsys):
    dem, release, *_ = site
    path = tmp_path / f"out.{suffix}"
    assert seed("--dem", dem, "--release", release, "-o", path, "--count", 300) == 0
    assert capsys.readouterr().out.strip() == str(path)
    assert path.stat().st_size > 10_000
    assert sorted(p.name for p in tmp_path.glob("out*")) == [path.name]
    assert seed("--dem", dem, "--release", release, "-o", path) == 2
    assert "exists already" in capsys.readouterr().err
    assert seed("--dem", dem, "--release", release, "-o", path, "--overwrite", "-q") == 0


def test_options_reach_the_columns(site, tmp_path, capsys):
    dem, release, area, _ = site
    path = tmp_path / "p.h5"
    options = ["--thickness", 2, "--thickness-mode", "vertical", "--density", 300, "--count", 5000]
    options += ["--points", "jittered", "--seed", 4]
    assert seed("--dem", dem, "--release", release, "-o", path, "--velocity=-1,2.5", *options) == 0
    frame = read_frame(path)
    assert abs(len(frame.particles) - 5000) <= 50
    assert frame.particles.volume.sum() == pytest.approx(2 * area, rel=1e-9)
    assert frame.particles.mass.sum() == pytest.approx(600 * area, rel=1e-9)
    np.testing.assert_allclose(frame.particles.velocity[:, :2], np.tile([-1.0, 2.5], (len(frame.particles), 1)))
    header = frame.header
    assert (header["points"], header["seed"], header["thickness_mode"]) == ("jittered", 4, "vertical")
    assert "vertical" in capsys.readouterr().err


@pytest.mark.parametrize("mass", ["equal", "paper"])
def test_mass_modes(site, tmp_path, mass, capsys):
    dem, release, *_ = site
    assert seed("--dem", dem, "--release", release, "-o", tmp_path / "p.h5", "--mass", mass, "--spacing", 4) == 0
    assert np.ptp(read_frame(tmp_path / "p.h5").particles.mass) == 0.0
    assert ("relative error of the thickness field" in capsys.readouterr().err) == (mass == "paper")


def test_a_release_raster(site, tmp_path, capsys):
    """The polygon burnt on the DTM's grid: a mask with a number, and the same with metres in it."""
    dem, release, *_ = site
    with rasterio.open(dem) as source:
        profile = source.profile | {"dtype": "float32", "nodata": None}
        shape, transform = source.shape, source.transform
    polygon = geopandas.read_file(release).union_all()
    mask = rasterio.features.geometry_mask([polygon], shape, transform, invert=True)
    for name, value in (("mask", 1), ("metres", 2.5)):
        with rasterio.open(tmp_path / f"{name}.tif", "w", **profile) as sink:
            sink.write((mask * value).astype("float32"), 1)
    volumes = []
    for name, extra in (("mask", ["--thickness", 2.5]), ("metres", [])):
        path = tmp_path / f"{name}.h5"
        assert seed("--dem", dem, "--release", tmp_path / f"{name}.tif", "-o", path, *extra) == 0
        volumes.append(read_frame(path).particles.volume.sum())
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-6)
    assert seed("--dem", dem, "--release", tmp_path / "mask.tif", "-o", tmp_path / "x.h5") == 2
    assert "--thickness" in capsys.readouterr().err


def test_stdout_is_data_only_in_a_process_of_its_own(site, tmp_path):
    """No library's warnings among the lines, help is quick and imports nothing heavy."""
    dem, release, *_ = site
    command = [sys.executable, "-m", "mpmgis", "seed", "--dem", dem, "--release", release, "-q"]
    done = subprocess.run([*command, "-o", "p.h5"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "p.h5\n", "")
    code = (
        "import sys; sys.argv = ['mpmgis', 'seed', '--help']\n"
        "from mpmgis.commands.shell.main import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print(sorted(set(sys.modules) & {'numpy', 'numba', 'rasterio', 'geopandas', 'h5py'}))"
    )
    text = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert text.strip().endswith("[]")
    assert "mpmgis seed --dem dtm.tif --release area.shp" in text
