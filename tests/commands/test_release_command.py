"""`mpmgis release`: file, columns and messages of the command and of the Python function."""

import numpy as np
import pytest
import rasterio

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.seeding.snow_slabs.slab_thickness import slope_factor
from mpmgis.terrain.vector_table import read_table


@pytest.fixture(scope="module")
def dem(tmp_path_factory):
    """A slope of 35 degrees to the south, of 60 x 60 cells."""
    path = tmp_path_factory.mktemp("dtm") / "dtm.tif"
    heights = 2000.0 - 5.0 * np.tan(np.radians(35)) * np.arange(60)[:, None] + np.zeros((60, 60))
    transform = rasterio.transform.from_origin(500_000, 5_200_000, 5, 5)
    with rasterio.open(path, "w", "GTiff", 60, 60, 1, "EPSG:32632", transform, "float64") as file:
        file.write(heights, 1)
    return path


def test_the_command_writes_areas_with_thickness(dem, tmp_path, capsys):
    output = tmp_path / "areas.gpkg"
    assert main(["release", "--dem", str(dem), "--snow-depth", "30=0.9,100=1.2", "-o", str(output)]) == 0
    printed = capsys.readouterr()
    assert printed.out.strip() == str(output)
    assert "1 release areas of 8.41e+04 to 8.41e+04 m2" in printed.err
    table = read_table(output)
    factor = slope_factor(np.array([35.0]))[0]
    assert table.columns["thickness_30"] == pytest.approx([0.9 * factor])
    assert table.columns["thickness"] == pytest.approx([1.2 * factor])
    assert table.columns["aspect"] == pytest.approx([180.0], abs=0.01)
    assert table.crs.to_epsg() == 32632


def test_python_has_the_same_options(dem, tmp_path):
    areas = mpmgis.release_areas(
        dem, tmp_path / "areas.gpkg", scenario="frequent", snow_depth=1.2, wind=0.3, min_area=1000.0
    )
    assert areas.columns["thickness"] == pytest.approx([1.5 * slope_factor(np.array([35.0]))[0]])
    assert areas.files == [tmp_path / "areas.gpkg"]
    with pytest.raises(mpmgis.MpmgisError, match="`snow_depth` is 120"):
        mpmgis.release_areas(dem, tmp_path / "b.gpkg", snow_depth=120.0)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--snow-depth", "90"], "--snow-depth is 90 (0.9 m if it is in cm), expected metres above 0, at most 10"),
        (["--snow-depth", "30:1"], "expected metres, or years and metres such as 30=0.9"),
        (["--slope-min", "40", "--slope-max", "50"], "no cell has a slope of --slope-min 40 to --slope-max 50 degrees"),
        (["--min-area", "1e6"], "none of their units has 1e+06 m2 (--min-area)"),
        (["--forest", "nowhere.gpkg"], "nowhere.gpkg: no such file"),
        (["-o", "areas.shp"], "give a name that ends with .gpkg"),
        (["--dask", "tcp://127.0.0.1:1"], "no scheduler answers"),
    ],
)
def test_bad_input_gets_one_line_and_no_file(dem, tmp_path, monkeypatch, capsys, options, says):
    monkeypatch.chdir(tmp_path)
    assert main(["release", "--dem", str(dem), *options]) == 2
    printed = capsys.readouterr()
    line = printed.err.strip().splitlines()[-1]
    assert line.startswith("mpmgis release: ")
    assert says in line
    assert printed.out == ""
    assert not list(tmp_path.iterdir())
