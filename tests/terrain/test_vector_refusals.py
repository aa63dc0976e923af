"""Vector files that cannot be used as they are: the message names the cause, or they are read and that is said."""

import subprocess
import sys
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import from_origin

from mpmgis.system.errors import FormatError, InputError, MpmgisError
from mpmgis.system.messages import log
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.raster_input import open_raster, read_raster
from mpmgis.terrain.undeclared_nodata import MASK
from mpmgis.terrain.vector_table import read_table

WEST, NORTH = 4e5, 5.1002e6
BOX = shapely.box(WEST, NORTH - 40, WEST + 50, NORTH)
RASTER = {
    "driver": "GTiff",
    "width": 20,
    "height": 20,
    "count": 1,
    "crs": "EPSG:32632",
    "transform": from_origin(WEST, NORTH, 10, 10),
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def said(monkeypatch):
    lines = []
    monkeypatch.setattr(log, "info", lines.append)
    return lines


def write(path, names=("a",), **options):
    table = geopandas.GeoDataFrame({"name": list(names), "h": [1.5] * len(names)}, geometry=[BOX] * len(names))
    table.set_crs(32632).to_file(path, **options)


def test_a_locked_geopackage(here):
    """Locks hold between processes only."""
    write("a.gpkg")
    program = (
        "import sqlite3, sys\nconnection = sqlite3.connect('a.gpkg', isolation_level=None)\n"
        "connection.execute('BEGIN EXCLUSIVE')\nprint('locked', flush=True)\nsys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "locked\n"
        for read in (read_table, read_terrain):
            with pytest.raises(FormatError, match=r"a\.gpkg is locked by another program"):
                read("a.gpkg")
        other.stdin.close()
    assert len(read_table("a.gpkg")) == 1


@pytest.mark.parametrize(("letter", "name"), [(b"\xfc", "Hang Süd"), (b"\x80", "Hang S€d")])
@pytest.mark.parametrize("declared", ["UTF-8", "utf8"])
def test_a_wrong_code_page(here, said, letter, name, declared):
    """Bytes of Windows under a .cpg that says UTF-8."""
    write("a.shp", ["Hang Sud"])
    raw = Path("a.dbf").read_bytes()
    Path("a.dbf").write_bytes(raw.replace(b"Hang Sud", b"Hang S" + letter + b"d"))
    Path("a.cpg").write_text(declared)
    table = read_table("a.shp")
    assert table.columns["name"].tolist() == [name] and table.columns["h"].tolist() == [1.5]
    assert len(said) == 1 and "as a.cpg says; read as" in said[0]


def test_a_right_code_page_is_not_mentioned(here, said):
    for encoding in ("UTF-8", "cp1252"):
        write(f"{encoding}.shp", ["Süd"], encoding=encoding)
        assert read_table(f"{encoding}.shp").columns["name"].tolist() == ["Süd"]
    assert not said


@pytest.mark.parametrize("place", [1, 2, 3])
def test_the_feature_with_an_open_ring(here, place):
    ring = [list(point) for point in BOX.exterior.coords]
    rings = [ring, ring, ring]
    rings[place - 1] = ring[:-1]
    features = ",".join(
        f'{{"type":"Feature","properties":{{}},"geometry":{{"type":"Polygon","coordinates":[{some}]}}}}'
        for some in rings
    )
    Path("a.geojson").write_text(f'{{"type":"FeatureCollection","features":[{features}]}}')
    with pytest.raises(InputError, match=rf"feature {place} is invalid \(Points of LinearRing.*Fix geometries"):
        read_table("a.geojson")


@pytest.mark.parametrize("kind", ["CurvePolygon", "MultiSurface"])
def test_shapes_with_arcs_in_a_table(here, kind):
    Path("a.csv").write_text(f'WKT,h\n"{kind} ((0 0, 9 0, 0 9, 0 0))",1\n"POLYGON ((0 0, 9 0, 0 9, 0 0))",1\n')
    with pytest.raises(InputError, match=rf"feature 1 is a {kind}, expected a polygon; convert it: ogr2ogr -nlt"):
        read_table("a.csv")


@pytest.mark.parametrize("kind", ["TIN", "POLYHEDRALSURFACE"])
@pytest.mark.parametrize("dimension", ["", " Z"])
def test_surfaces_of_triangles(here, kind, dimension):
    z = " 1" if dimension else ""
    ring = ",".join(f"{x} {y}{z}" for x, y in ((0, 0), (9, 0), (0, 9), (0, 0)))
    Path("a.csv").write_text(f'WKT,h\n"POLYGON (({ring}))",1\n"{kind}{dimension} ((({ring})))",1\n')
    word = {"TIN": "TIN", "POLYHEDRALSURFACE": "PolyhedralSurface"}[kind]
    with pytest.raises(InputError, match=rf"feature 2 is a {word}, expected a polygon; convert it: ogr2ogr -nlt"):
        read_table("a.csv")


@pytest.mark.parametrize(
    ("mark", "code"), [(b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")]
)
def test_text_grids_with_a_byte_order_mark(here, mark, code):
    text = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4\n"
    Path("a.asc").write_bytes(mark + text.encode(code))
    with pytest.raises(FormatError, match=rf"a text in {code[:6].upper().rstrip('-')} with a byte-order mark"):
        read_terrain("a.asc", crs="local")
    Path("a.asc").write_text(text)
    assert read_terrain("a.asc", crs="local").elevation.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("kind", ["uint8"])
def test_a_palette_is_a_mask_and_no_terrain(here, kind):
    mask = np.zeros((20, 20), kind)
    mask[3:6, 4:9] = 1
    with rasterio.open("m.tif", "w", dtype=kind, **RASTER) as target:
        target.write(mask, 1)
        target.write_colormap(1, {0: (0, 0, 0, 0), 1: (255, 0, 0, 255)})
    values, _ = read_raster("m.tif", MASK)
    assert (np.nan_to_num(values) == mask).all()
    with pytest.raises(InputError, match="a palette, whose values are classes, expected numbers in metres"):
        read_terrain("m.tif")


def test_the_reason_is_that_of_the_library(here):
    """A file that is cut, and tiles that are: not "see previous exception"."""
    with rasterio.open("a.tif", "w", dtype="float32", tiled=True, blockxsize=16, blockysize=16, **RASTER) as target:
        target.write(np.ones((20, 20), "float32"), 1)
    raw = Path("a.tif").read_bytes()
    Path("a.tif").write_bytes(raw[: len(raw) - 500])
    Path("a.asc").write_text("ncols 9\nnrows 9\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2 3\n")
    for name in ("a.tif", "a.asc"):
        with pytest.raises(MpmgisError) as caught:
            read_terrain(name, crs=None if name == "a.tif" else "local")
        assert "previous exception" not in str(caught.value) and name in str(caught.value)


@pytest.mark.parametrize("suffix", [".tif", ".gpkg", ".shp", ".json", ".nc", ".vrt", ".zip", ""])
@pytest.mark.parametrize(
    "content",
    [b"\0" * 100, b"hello", b"{}", b"<a/>", b"SQLite format 3\0", b"PK\x03\x04", b"II*\0", b"\x89HDF\r\n\x1a\n"],
)
def test_any_content_is_refused_in_one_line(here, suffix, content):
    path = Path(f"a{suffix}")
    path.write_bytes(content)
    for read in (read_table, lambda path: read_raster(path, MASK), lambda path: open_raster(path).__enter__()):
        with pytest.raises(MpmgisError) as caught:
            read(path)
        assert "\n" not in str(caught.value) and "a" in str(caught.value)
    assert [entry.name for entry in here.iterdir()] == [path.name]
