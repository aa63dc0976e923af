"""Input of com1DFA of AvaFrame, and its result on the cells of a case; com1DFA itself does not run."""

import configparser

import avaframe_case
import geopandas
import numpy as np
import pytest
import rasterio
import study as shipped


@pytest.fixture(params=["slope", "cap"])
def case(request):
    return shipped.CASES[request.param].avaframe()


@pytest.mark.parametrize("kernel", [2.0, 3.0])
def test_com1dfa_is_given_the_same_terrain_release_friction_and_end(case, kernel, tmp_path):
    avaframe_case.prepare(tmp_path, case, "random", kernel)
    with rasterio.open(tmp_path / "Inputs" / "terrain.asc") as source:
        x, y = source.xy(*np.indices(source.shape))
        assert source.res == (kernel, kernel)
        assert source.read(1).ravel() == pytest.approx(case.bed(np.ravel(x), np.ravel(y)), abs=1e-4)
        cos = np.cos(np.radians(case.slope))
        assert -np.diff(source.read(1), axis=1).mean() / kernel == pytest.approx(np.sqrt(1 / cos**2 - 1), rel=1e-4)
    given = configparser.ConfigParser()
    given.read(tmp_path / "Inputs" / "settings.ini")
    given = given["GENERAL"]
    steps = case.end / given.getfloat("dt")
    assert steps == pytest.approx(round(steps)) and given.getfloat("dt") <= case.courant * kernel * (1 + 1e-12)
    assert given.getfloat("mucoulomb") == case.mu and given.getfloat("sphKernelRadius") == kernel


def test_the_block_that_slides_is_drawn_and_the_cap_a_raster(tmp_path):
    avaframe_case.prepare(tmp_path / "slope", shipped.avaframe_slope(), "random", 5.0)
    (block,) = geopandas.read_file(tmp_path / "slope" / "Inputs" / "REL" / "release.shp").geometry
    assert block.area == 60 * 60 and block.bounds == (-60, -30, 0, 30)
    avaframe_case.prepare(tmp_path / "cap", shipped.avaframe_cap(), "random", 2.0)
    with rasterio.open(tmp_path / "cap" / "Inputs" / "REL" / "release.asc") as source:
        volume = source.read(1).sum() * 2.0**2
    assert volume == pytest.approx(np.pi / 2 * 4 * 80 * 80 * np.cos(np.radians(35)), rel=1e-3)


def test_what_lies_between_nodes_is_put_on_the_cells_as_means(tmp_path):
    """A linear thickness stays linear; it is vertical on level ground and on slopes."""
    shipped.write_raster(tmp_path / "exact.tif", lambda x, y: 0 * x, 0, 0, 24, 12, 4.0)
    east, north = np.arange(-3.0, 31.0, 3.0), np.arange(-3.0, 16.0, 3.0)
    thickness = 2.0 + 0.1 * east[None, :] + 0.05 * north[:, None]
    found = {"thickness": thickness, "east": east, "north": north}
    avaframe_case.write_on_cells(tmp_path / "out.tif", found, tmp_path / "exact.tif", 0.5)
    with rasterio.open(tmp_path / "out.tif") as source:
        x, y = source.xy(*np.indices(source.shape))
        expected = 2.0 * (2.0 + 0.1 * np.ravel(x) + 0.05 * np.ravel(y))
        assert source.read(1).ravel() == pytest.approx(expected, rel=1e-12)


def test_a_python_without_avaframe_is_refused_with_its_log(tmp_path):
    with pytest.raises(SystemExit, match=r"com1DFA failed; see .*com1DFA\.log"):
        avaframe_case.ran("/bin/false", tmp_path, 5.0, 1)
