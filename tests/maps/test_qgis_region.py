"""The project of a region in QGIS: maps by scenario, areas and footprints over the terrain."""

import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from test_qgis_open import look

from mpmgis.frames.region_layers import AREAS
from mpmgis.frames.region_maps import AreaRaster, write_region_maps
from mpmgis.laws.quantities import BAND, MEMBER_BANDS
from mpmgis.maps.qgis.region_footprints import write_footprints
from mpmgis.maps.qgis.region_project import RegionProject, terrain_path, write_region_project
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

SHAPE = (120, 160)
EXTENT = (10, 60, 20, 140)
SHOWN = ["release areas", "h max [m]: largest flow depth (normal)", "contours every 10 m", "hillshade"]


def region_of(folder, lengths, least=None):
    """A region of an area for each of `lengths` [cells], which overlap; the second half is scenario 100.

    Depths begin at `least` [m]; None: at the number of the area.
    """
    grid = Grid.north_up(CRS.from_epsg(32632), 686000.0, 5212000.0, 5.0, SHAPE)
    row, column = np.indices(SHAPE)
    write_geotiff(folder / "dtm.tif", grid, [(BAND["surface_new"], 2000.0 - 2.0 * column + 0.5 * row)], {})
    areas = []
    for number, length in enumerate(lengths, 1):
        flow = (np.abs(row - 35) < 20) & (column > 20) & (column < 20 + length)
        values = {
            name: np.where(flow, (number if least is None else least) + 0.01 * column, np.nan) for name in MEMBER_BANDS
        }
        write_geotiff(folder / f"{number}.tif", grid, [(BAND[name], values[name]) for name in MEMBER_BANDS], {})
        areas.append(AreaRaster(number, folder / f"{number}.tif", 0, 0, EXTENT, 0.01 * number))
    maps = folder / "region" / "maps"
    maps.mkdir(parents=True)
    half = len(areas) // 2
    named = {"all": areas, "scenario_30": areas[:half], "scenario_100": areas[half:]} if areas else {}
    for name, own in named.items():
        write_region_maps(maps, name, grid, own, 0.05, {}, frequency=True)
    write_footprints(maps / "all_footprints.gpkg", areas, [None] * len(areas), grid, 0.05)
    shapes = [shapely.box(686100, 5211800, 686150, 5211850 + k) for k in range(max(len(areas), 1))]
    geopandas.GeoDataFrame(geometry=shapes, crs=grid.crs).to_file(maps.parent / "areas.gpkg", layer=AREAS)
    terrain = terrain_path(folder / "dtm.tif", None, maps)
    return RegionProject(maps, grid, named, 0.05, True, terrain)


@pytest.mark.thorough
@pytest.mark.qgis
def test_the_project_opens_with_the_largest_depth_over_the_terrain(tmp_path):
    project = region_of(tmp_path, (60, 80, 100, 110))
    assert {path.suffix for path in write_region_project(project)[1:]} == {".qml"}
    report = look(
        project, *(f"{name}_{key}.tif" for name in project.areas for key in ("h_max", "areas", "probability"))
    )
    found = report["project"]
    assert found["read"] and found["crs"] == "EPSG:32632" and not found["lost"]
    assert all(valid and placed for _, valid, placed in found["layers"])
    assert len(found["layers"]) == 3 * 6 + 4
    assert found["visible"] == SHOWN
    assert found["map_title"][0] == "region: largest values of 4 release areas"
    page = found["layouts"]["region: A4"]
    assert page["pdf"] and page["over_map"] == page["outside"] == 0
    assert page["layers"] == SHOWN and page["legend"] == SHOWN[:2]
    for file, (facts,) in report["files"].items():
        assert facts["valid"] and facts["styled"], file
    assert report["files"]["all_areas.tif"][0]["colours"] > 1


def test_a_region_without_flow_has_a_project_of_its_areas(tmp_path):
    project = region_of(tmp_path, ())
    (path,) = write_region_project(project)
    assert path.is_file() and project.view() == project.grid.bounds and project.typical["h_max"] == 0.0


@pytest.mark.parametrize("moving", [0, 1, 3])
def test_groups_name_the_areas_whose_flow_still_moved(tmp_path, moving):
    project = region_of(tmp_path, (60, 80, 100))
    areas = [area._replace(came_to_rest=k >= moving) for k, area in enumerate(project.areas["all"])]
    (path, *_) = write_region_project(replace(project, areas={"all": areas}))
    with zipfile.ZipFile(path) as archive:
        text = archive.read("region.qgs").decode()
    assert "all areas (3 with flow" in text and (f"{moving} of them not at rest" in text) == (moving > 0)


def test_scenarios_are_in_the_order_of_their_numbers(tmp_path):
    project = region_of(tmp_path, (60, 80, 100))
    named = dict.fromkeys(("scenario_100", "scenario_30", "all", "scenario_300"), project.areas["all"])
    for name in named:
        write_region_maps(project.folder, name, project.grid, named[name], 0.05, {}, frequency=True)
    (path, *_) = write_region_project(replace(project, areas=named, classes={"h": (1.0, 2.5)}))
    root = ElementTree.fromstring(zipfile.ZipFile(path).read("region.qgs"))
    groups = [group.get("name").partition(" (")[0] for group in root.find("layer-tree-group")]
    assert groups == ["areas", "all areas", "scenario 30", "scenario 100", "scenario 300", "terrain"]
    depths = [layer for layer in root.iter("maplayer") if layer.findtext("layername").startswith("h max")]
    assert len(depths) == 4
    for layer in depths:
        assert [item.get("value") for item in layer.iter("item")] == ["0.05", "1", "2.5", "inf"]


def test_depths_that_crowd_have_balanced_classes_unless_some_are_chosen(tmp_path):
    project = region_of(tmp_path, (60, 80, 100), least=6.05)
    assert len(project.limits["h"]) >= 3 and project.limits["h"][0] > 6
    (path, *_) = write_region_project(project)
    root = ElementTree.fromstring(zipfile.ZipFile(path).read("region.qgs"))
    drawn = next(layer for layer in root.iter("maplayer") if layer.findtext("layername").startswith("h max"))
    limits = [float(item.get("value")) for item in drawn.iter("item")]
    assert tuple(limits[1:-1]) == project.limits["h"]
    assert replace(project, classes={"h": (1.0, 2.5)}).limits == {"h": (1.0, 2.5)}


def test_a_dtm_that_qgis_would_show_otherwise_is_left_out(tmp_path):
    (tmp_path / "dtm.tif").touch()
    (tmp_path / "dtm.zip").touch()
    assert terrain_path(tmp_path / "dtm.tif", 1, tmp_path / "region" / "maps") == "../../dtm.tif"
    for name, band in (("dtm.tif", 2), ("dtm.zip", 1), ("missing.tif", 1)):
        assert terrain_path(tmp_path / name, band, tmp_path) is None
