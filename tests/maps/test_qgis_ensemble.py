"""Ensemble maps in QGIS: they open with styles, and a probability is shown first."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from pyproj import CRS
from test_qgis_open import look

from mpmgis.frames.member_stack import MemberStack
from mpmgis.laws.quantities import BAND, MEMBER_BANDS
from mpmgis.maps.qgis.raster_styles import value_pipe
from mpmgis.studies.ensemble_maps import EnsembleMaps, write_maps
from mpmgis.studies.ensemble_statistics import Products
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

SHAPE = (120, 160)


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Six members on a slope: stripes of increasing length."""
    folder = tmp_path_factory.mktemp("ensemble")
    grid = Grid.north_up(CRS.from_epsg(32632), 686000.0, 5212000.0, 5.0, SHAPE)
    row, column = np.indices(SHAPE)
    paths = []
    for k in range(6):
        flow = (np.abs(row - 60) < 20) & (column > 20) & (column < 60 + 15 * k)
        values = {name: np.where(flow, 1.0 + k + 0.01 * column, np.nan) for name in MEMBER_BANDS}
        paths.append(folder / f"{k}.tif")
        write_geotiff(paths[-1], grid, [(BAND[name], values[name]) for name in MEMBER_BANDS], {})
    (folder / "maps").mkdir()
    facts = [("Varied", "friction.mu uniform(0.1, 0.3)"), ("Friction", "Voellmy mu 0.2")]
    made = EnsembleMaps(folder / "maps", "ensemble", grid, (41, 80, 21, 135), 0.05, Products.of().rasters(), facts)
    release = [shapely.box(686120, 5211660, 686160, 5211740)]
    terrain = Terrain(grid, 2000.0 - 2.0 * column + 0.5 * row)
    write_maps(made, MemberStack(paths, grid, made.extent, MEMBER_BANDS), terrain, {"members": 6}, release, "six runs")
    return made


@pytest.mark.thorough
@pytest.mark.qgis
def test_the_project_opens_with_a_probability_over_the_terrain(maps):
    report = look(maps, *(maps.file(raster) for raster in maps.bands))
    project = report["project"]
    assert project["read"] and project["crs"] == "EPSG:32632" and not project["lost"]
    assert all(valid and placed for _, valid, placed in project["layers"])
    assert len(project["layers"]) == sum(map(len, maps.bands.values())) + 3
    assert [name for name in project["visible"] if "P(" in name or "largest" in name] == [
        "P(h >= 0.5 m): probability that the largest flow depth (normal) is at least 0.5 m"
    ]
    assert project["map_title"][0] == "ensemble: 6 runs"
    page = project["layouts"]["ensemble: A4"]
    assert page["pdf"] and page["over_map"] == page["outside"] == 0
    assert page["legend"][0] == "release area" and page["layers"][2:] == ["contours every 10 m", "hillshade"]
    assert any("Varied: friction.mu uniform(0.1, 0.3)" in text for text in page["texts"])
    assert "h max [m]: largest flow depth (normal), largest of all members" in " ".join(
        name for name, *_ in project["layers"]
    )
    for raster, bands in maps.bands.items():
        (file,) = report["files"][f"ensemble_{raster}.tif"]
        assert file["valid"] and file["styled"] and file["colours"] > 1
        assert [words.split(": ")[1] for words in file["bands"]] == [band.quantity.band for band in bands]


def test_all_statistics_have_the_chosen_classes(maps):
    chosen = replace(maps, classes={"h": (1.0, 2.5)})
    for band in maps.bands["h"]:
        items = value_pipe(band.quantity, chosen, 1).iter("item")
        assert [item.get("value") for item in items] == ["0.05", "1", "2.5", "inf"]


def test_picture_and_rasters(maps):
    from matplotlib.image import imread

    shown = imread(maps.folder / maps.picture_file)
    assert shown.shape[0] > 500 and len(np.unique(shown.reshape(-1, shown.shape[-1]), axis=0)) > 50
    shares = maps.read("probability", 0)
    assert shares.shape == (39, 114)
    np.testing.assert_allclose(np.unique(shares), np.arange(1, 7) / 6, rtol=1e-6)
    assert maps.typical["P_h_1"] == 1.0 and maps.typical["h_mean"] == maps.typical["h_max"]
