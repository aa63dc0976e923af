"""KMZ of outlines and maxima, read back by GDAL: WGS 84, classes of the largest depth, times of the steps."""

import zipfile

import numpy as np
import pyogrio
import pyproj
import pytest
import qgis_run
import shapely

from mpmgis.maps.qgis.kml import require_kml, write_kml
from mpmgis.system.errors import GeoreferenceError

UTM = pyproj.CRS.from_epsg(32632)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    if "LIBKML" not in pyogrio.list_drivers():
        pytest.skip("this GDAL has no LIBKML driver")
    run = qgis_run.make_run(tmp_path_factory.mktemp("kml"), UTM, times=[0.0, 0.5, 1.0])
    write_kml(run, [shapely.Point(686160, 5211880).buffer(40)])
    return run


def test_layers(run):
    layers = dict(pyogrio.list_layers(run.folder / "slide.kmz"))
    assert list(layers) == ["release", "maxima", "outline"]


def test_the_release_lies_where_it_is(run):
    table = pyogrio.read_dataframe(run.folder / "slide.kmz", layer="release")
    assert table.crs.to_epsg() == 4326
    (shape,) = table.to_crs(UTM).geometry
    assert abs(shape.centroid.x - 686160) < 0.01 and abs(shape.centroid.y - 5211880) < 0.01


def test_maxima_cover_what_the_raster_covers(run):
    table = pyogrio.read_dataframe(run.folder / "slide.kmz", layer="maxima").to_crs(UTM)
    (peak,) = run.read(run.maxima_file, ("h_max",))
    assert table.geometry.area.sum() == pytest.approx(25.0 * np.count_nonzero(peak > run.min_depth), rel=1e-3)
    assert all(name.startswith("largest flow depth") for name in table["Name"])


def test_outlines_have_times(run):
    table = pyogrio.read_dataframe(run.folder / "slide.kmz", layer="outline")
    assert list(table["Name"]) == ["t = 0.0 s", "t = 0.5 s", "t = 1.0 s"]
    assert [str(time)[11:19] for time in table["begin"]] == ["00:00:00", "00:00:30", "00:01:00"]
    assert np.all(table.geometry.area > 0)


def test_polygons_have_colours(run):
    with zipfile.ZipFile(run.folder / "slide.kmz") as archive:
        text = "".join(archive.read(name).decode() for name in archive.namelist() if name.endswith(".kml"))
    assert text.count("<PolyStyle>") >= 3 and "<TimeSpan>" in text


def test_a_local_frame_is_refused():
    with pytest.raises(GeoreferenceError, match="--kml needs a CRS"):
        require_kml(None)
