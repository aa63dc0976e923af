"""Files of every driver of GDAL behind the suffix of another: on the list, or refused before anything is done.

A driver that is not on the list could follow a name in the file to other files or to a server, and write (MRF does).
"""

import contextlib
import hashlib
import json
import logging
import os
import shutil
import threading
import warnings
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import ClassVar

import geopandas
import numpy as np
import pyogrio
import pytest
import rasterio.shutil
import shapely
from rasterio.env import Env
from rasterio.transform import from_origin

from mpmgis.commands.shell.main import main
from mpmgis.system.errors import MpmgisError
from mpmgis.system.trusted_files import trusting
from mpmgis.terrain.allowed_drivers import RASTER_DRIVERS, VECTOR_DRIVERS, vector_library
from mpmgis.terrain.raster_input import open_raster
from mpmgis.terrain.spatial_inputs import is_raster
from mpmgis.terrain.vector_table import open_vector, read_table

WEST, NORTH, SIDE = 4e5, 5.1002e6, 20
PLACE = {"width": SIDE, "height": SIDE, "count": 1, "crs": "EPSG:32632", "transform": from_origin(WEST, NORTH, 10, 10)}
SUFFIXES = (".tif", pytest.param(".gpkg", marks=pytest.mark.thorough))
SCENE = """[terrain]
dem = "{dem}"
[release]
source = "{release}"
thickness = "no_such_column"
density = 1000
[friction]
law = "Coulomb"
mu = 0.3
[output]
end_time = 1
frame_interval = 1
"""
# Files of drivers that create none. {url} is a server here, {other} a raster in another folder, {victim} a file there.
HEADS = {
    "MRF": "<MRF_META><CachedSource><Source>{other}</Source></CachedSource><Raster><Size x='20' y='20' c='1'/>"
    "<PageSize x='20' y='20' c='1'/><Compression>NONE</Compression><DataType>Float32</DataType>"
    "<DataFile>{victim}</DataFile><IndexFile>{victim}.idx</IndexFile></Raster></MRF_META>",
    "MRF of a server": "<MRF_META><CachedSource><Source>/vsicurl/{url}</Source></CachedSource><Raster>"
    "<Size x='20' y='20' c='1'/><PageSize x='20' y='20' c='1'/><DataType>Byte</DataType></Raster></MRF_META>",
    "WMS": "<GDAL_WMS><Service name='WMS'><ServerUrl>{url}</ServerUrl><Layers>a</Layers></Service><DataWindow>"
    "<UpperLeftX>0</UpperLeftX><UpperLeftY>9</UpperLeftY><LowerRightX>9</LowerRightX><LowerRightY>0</LowerRightY>"
    "<SizeX>20</SizeX><SizeY>20</SizeY></DataWindow></GDAL_WMS>",
    "TMS": "<TileMap version='1.0.0'><SRS>EPSG:32632</SRS><BoundingBox minx='0' miny='0' maxx='9' maxy='9'/>"
    "<Origin x='0' y='0'/><TileFormat width='256' height='256' extension='png'/><TileSets>"
    "<TileSet href='{url}/0' units-per-pixel='4' order='0'/></TileSets></TileMap>",
    "TMS list": "<TileMapService version='1.0.0'><TileMaps><TileMap href='{url}'/></TileMaps></TileMapService>",
    "WCS": "<WCS_GDAL><ServiceURL>{url}</ServiceURL><CoverageName>a</CoverageName></WCS_GDAL>",
    "WMTS": "<GDAL_WMTS><GetCapabilitiesUrl>{url}</GetCapabilitiesUrl></GDAL_WMTS>",
    "OGCAPI": "<OGCAPI></OGCAPI>",
    "GTI": "<GDALTileIndexDataset><IndexDataset>/vsicurl/{url}</IndexDataset></GDALTileIndexDataset>",
    "STACIT": '{{"type":"FeatureCollection","stac_version":"1.0.0","features":[{{"type":"Feature","stac_version":'
    '"1.0.0","collection":"c","properties":{{"proj:epsg":32632}},"assets":{{"d":{{"href":"{url}","type":"image/tiff; '
    'application=geotiff","proj:transform":[10,0,0,0,-10,0],"proj:shape":[20,20]}}}}}}]}}',
    "STACTA": '{{"stac_version":"1.0.0","stac_extensions":["tiled-assets"],"asset_templates":{{"b":{{"href":"{url}"}}'
    "}}}}",
    "VRT": "<VRTDataset rasterXSize='20' rasterYSize='20'><VRTRasterBand dataType='Byte' band='1'><SimpleSource>"
    "<SourceFilename relativeToVRT='0'>{other}</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>",
    "PDS": 'PDS_VERSION_ID = PDS3\nRECORD_BYTES = 80\n^IMAGE = "/vsicurl/{url}"\nOBJECT = IMAGE\n LINES = 20\n '
    "LINE_SAMPLES = 20\n SAMPLE_TYPE = PC_REAL\n SAMPLE_BITS = 32\nEND_OBJECT = IMAGE\nEND\n",
    "ISIS3": "Object = IsisCube\n Object = Core\n ^Core = /vsicurl/{url}\n Format = BandSequential\n Group = "
    "Dimensions\n Samples = 20\n Lines = 20\n Bands = 1\n End_Group\n Group = Pixels\n Type = Real\n End_Group\n "
    "End_Object\n"
    "End_Object\nEnd\n",
    "DIMAP": "<Dimap_Document><Raster_Dimensions><NCOLS>20</NCOLS><NROWS>20</NROWS><NBANDS>1</NBANDS>"
    "</Raster_Dimensions><Data_Access><Data_File><DATA_FILE_PATH href='/vsicurl/{url}'/></Data_File></Data_Access>"
    "</Dimap_Document>",
    "ERS": 'DatasetHeader Begin\n DataFile = "/vsicurl/{url}"\n DataType = Raster\n RasterInfo Begin\n CellType = '
    "IEEE4ByteReal\n NrOfLines = 20\n NrOfCellsPerLine = 20\n NrOfBands = 1\n RasterInfo End\nDatasetHeader End\n",
    "KMLSUPEROVERLAY": "<kml><Document><GroundOverlay><Icon><href>{url}</href></Icon><LatLonBox><north>1</north>"
    "<south>0</south><east>1</east><west>0</west></LatLonBox></GroundOverlay></Document></kml>",
    "GDALG": '{{"type":"gdal_streamed_alg","command_line":"gdal vector pipeline ! read /vsicurl/{url}"}}',
    "GDALG here": '{{"type":"gdal_streamed_alg","command_line":"gdal vector pipeline ! read {other}.geojson"}}',
    "OGR_VRT": "<OGRVRTDataSource><OGRVRTLayer name='x'><SrcDataSource>/vsicurl/{url}</SrcDataSource></OGRVRTLayer>"
    "</OGRVRTDataSource>",
    "WFS": "<OGRWFSDataSource><URL>{url}</URL></OGRWFSDataSource>",
    "WFS capabilities": "<WFS_Capabilities version='1.1.0' xmlns:xlink='http://www.w3.org/1999/xlink'>"
    "<OperationsMetadata><Operation name='GetFeature'><DCP><HTTP><Get xlink:href='{url}?'/></HTTP></DCP></Operation>"
    "</OperationsMetadata><FeatureTypeList><FeatureType><Name>a</Name></FeatureType></FeatureTypeList>"
    "</WFS_Capabilities>",
    "OAPIF": '{{"links":[{{"rel":"data","href":"{url}/collections","type":"application/json"}}],"conformsTo":'
    '["http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core"]}}',
    "CSW": "<OGRCSWDataSource><URL>{url}</URL></OGRCSWDataSource>",
    "GML with a schema": "<a:FeatureCollection xmlns:gml='http://www.opengis.net/gml' xmlns:a='http://a' xmlns:xsi="
    "'http://www.w3.org/2001/XMLSchema-instance' xsi:schemaLocation='http://a {url}/a.xsd'><gml:featureMember>"
    "<a:b gml:id='1'><a:g><gml:Point srsName='EPSG:32632'><gml:pos>1 2</gml:pos></gml:Point></a:g></a:b>"
    "</gml:featureMember></a:FeatureCollection>",
}


class _Server(BaseHTTPRequestHandler):
    asked: ClassVar = []

    def do_GET(self):
        self.asked.append(self.path)
        self.send_error(404)

    do_HEAD = do_GET

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def url():
    """Address of a server that notes who asks."""
    server = HTTPServer(("127.0.0.1", 0), _Server)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/x"
    server.shutdown()
    server.server_close()


@pytest.fixture
def asked():
    """What the server was asked during a test."""
    _Server.asked.clear()
    yield _Server.asked
    _Server.asked.clear()


def listing(folder):
    """Size, time and digest of all files."""
    found = {}
    for path in sorted(Path(folder).rglob("*")):
        about = path.stat()
        content = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        found[str(path)] = about.st_size, about.st_mtime_ns, content
    return found


@contextlib.contextmanager
def silent():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.disable(logging.CRITICAL)
        try:
            yield
        finally:
            logging.disable(logging.NOTSET)


def created_rasters(folder):
    """Create a file of each raster driver that can; name of the driver -> its folder, with the file x."""
    with Env() as env, silent():
        names = sorted(env.drivers())
        for name in names:
            place = folder / name.replace(" ", "_")
            place.mkdir()
            for kind in ("float32", "int16", "uint8"):
                with contextlib.suppress(Exception):  # a driver that does not create, or not this type
                    with rasterio.open(folder / "source.tif", "w", driver="GTiff", dtype=kind, **PLACE) as target:
                        target.write(np.full((SIDE, SIDE), 50, kind), 1)
                    rasterio.shutil.copy(str(folder / "source.tif"), str(place / "x"), driver=name)
                    break
        (folder / "source.tif").unlink()
    return {name: folder / name.replace(" ", "_") for name in names if any((folder / name.replace(" ", "_")).iterdir())}


def created_vectors(folder):
    """Create a file of each vector driver that can, as `created_rasters`."""
    table = geopandas.GeoDataFrame(
        {"name": ["a"], "thickness": [1.5]}, geometry=[shapely.box(WEST + 50, NORTH - 90, WEST + 90, NORTH - 50)]
    ).set_crs(32632)
    found = {}
    with silent():
        for name, modes in pyogrio.list_drivers().items():
            place = folder / name.replace(" ", "_")
            place.mkdir()
            if "w" in modes and name not in ("Elasticsearch", "NGW", "Carto", "AmigoCloud", "GPSBabel", "MEM"):
                suffix = {"ESRI Shapefile": ".shp", "MapInfo File": ".tab", "CSV": ".csv"}.get(name, "")
                with contextlib.suppress(Exception):
                    pyogrio.write_dataframe(table, place / f"x{suffix}", driver=name)
            if any(place.iterdir()):
                found[name] = place
    return found


def named(place, folder, suffix):
    """Copy the files in `place` to `folder`; x becomes x.tif. Returns the path."""
    shutil.copytree(place, folder)
    if (folder / "x").exists():
        (folder / "x").rename(folder / f"x{suffix}")
        return folder / f"x{suffix}"
    main_file = min(folder.iterdir(), key=lambda path: (path.suffix in (".prj", ".hdr", ".aux.xml"), path.name))
    return main_file.rename(folder / f"x{suffix}")


def driver_of_raster(path):
    """Name of the driver that opens a raster and reads its pixels; the message where none does."""
    try:
        with open_raster(path) as source:
            source.read(1)
            source.read_masks(1)
            return source.driver
    except MpmgisError as error:
        assert "\n" not in str(error)
        return str(error)


def driver_of_vector(path):
    try:
        with open_vector(path) as (library, place):
            library.list_layers(place)
            name = library.read_info(place, layer=0)["driver"]
        read_table(path)
        return name
    except MpmgisError as error:
        assert "\n" not in str(error)
        return str(error)
    except Exception as error:
        return f"refused: {error}"


def check(path, listed):
    """What the doors, `info` and a scene do with a file; nothing on the disk may change."""
    with silent():
        raster, vector = driver_of_raster(path), driver_of_vector(path)
        assert raster in RASTER_DRIVERS or " " in raster
        assert vector in VECTOR_DRIVERS or " " in vector
        with contextlib.suppress(MpmgisError):
            is_raster(path)
        main(["info", str(path), "-q"])
        for key in ("dem", "release"):
            names = {"dem": "good.tif", "release": "gone.gpkg"} | {key: os.path.relpath(path)}
            Path("scene.toml").write_text(SCENE.format(**names))
            assert main(["run", "scene.toml", "-o", "out", "-q"]) == 2
            Path("scene.toml").unlink()
    assert listing(".") == listed, path
    return raster, vector


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with rasterio.open("good.tif", "w", driver="GTiff", dtype="float32", **PLACE) as target:
        target.write(np.full((SIDE, SIDE), 50, "float32"), 1)
    return tmp_path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_raster_driver_is_on_the_list_or_refused(here, asked, suffix):
    (here / "made").mkdir()
    places = created_rasters(here / "made")
    assert len(places) > 30
    paths = {name: named(place, here / name.replace(" ", "_"), suffix) for name, place in places.items()}
    listed, opened = listing("."), {}
    for name, path in paths.items():
        opened[name] = check(path, listed)[0]
    wrong = {name: by for name, by in opened.items() if name not in RASTER_DRIVERS and by == name}
    assert not wrong
    for name in ("GTiff", "AAIGrid", "HFA", "GPKG", "XYZ", "PNG"):
        assert opened[name] == name
    assert not asked


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_vector_driver_is_on_the_list_or_refused(here, asked, suffix):
    (here / "made").mkdir()
    places = created_vectors(here / "made")
    assert len(places) > 20
    paths = {name: named(place, here / name.replace(" ", "_"), suffix) for name, place in places.items()}
    listed, opened = listing("."), {}
    for name, path in paths.items():
        opened[name] = check(path, listed)[1]
    for name in ("GPKG", "GeoJSON", "FlatGeobuf", "GML"):
        assert opened[name] == name
    assert not asked


@pytest.mark.parametrize("suffix", (".tif", ".gpkg", ".json", ".xml", ".vrt"))
@pytest.mark.parametrize("kind", HEADS)
def test_lists_of_files_and_services_are_refused(here, url, asked, kind, suffix):
    """From the doors, the command and a scene: nothing is asked in the network, nothing written."""
    elsewhere = here / "elsewhere"
    elsewhere.mkdir()
    shutil.copy("good.tif", elsewhere / "other.tif")
    (elsewhere / "victim.txt").write_text("precious\n")
    table = geopandas.GeoDataFrame({"thickness": [1.0]}, geometry=[shapely.box(0, 0, 9, 9)], crs=32632)
    table.to_file(elsewhere / "other.tif.geojson", driver="GeoJSON")
    inside = here / "in"
    inside.mkdir()
    path = inside / f"x{suffix}"
    path.write_text(HEADS[kind].format(url=url, other=elsewhere / "other.tif", victim=elsewhere / "victim.txt"))
    raster, vector = check(path, listing("."))
    assert " " in raster
    assert " " in vector or kind in ("STACIT", "GML with a schema", "KMLSUPEROVERLAY")
    if kind == "MRF":
        assert "points at" in raster and "other.tif" in raster and "--trust" in raster
    assert not asked


def test_all_drivers_are_there_before_and_after_a_file_is_read(here):
    everything = set(pyogrio.list_drivers())
    with vector_library() as library:
        assert set(library.list_drivers()) <= {*RASTER_DRIVERS, *VECTOR_DRIVERS, "VRT", "MEM", "Memory"}
        with vector_library():
            pass
        assert "WFS" not in library.list_drivers()
    assert set(pyogrio.list_drivers()) == everything
    with pytest.raises(ZeroDivisionError), vector_library():
        raise ZeroDivisionError
    assert set(pyogrio.list_drivers()) == everything
    with trusting(), vector_library() as library:
        assert set(library.list_drivers()) == everything
    for name in ("GDAL_PAM_ENABLED", "OGR_SKIP", "CPL_VSIL_CURL_ALLOWED_EXTENSIONS", "GDAL_HTTP_PROXY"):
        assert pyogrio.get_gdal_config_option(name) is None


def test_sidecars_are_read(here):
    """Overviews, masks, world files, projections and .aux.xml beside a raster."""
    with rasterio.open("a.tif", "w", driver="GTiff", dtype="float32", **PLACE) as target:
        target.write(np.full((SIDE, SIDE), 50, "float32"), 1)
    with Env(TIFF_USE_OVR=True), rasterio.open("a.tif", "r+") as target:
        target.build_overviews([2])
    with Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open("a.tif", "r+") as target:
        target.write_mask(np.arange(SIDE * SIDE).reshape(SIDE, SIDE) % 2 == 0)
    Path("a.tif.aux.xml").write_text(
        "<PAMDataset><PAMRasterBand band='1'><Scale>2</Scale><Offset>1</Offset></PAMRasterBand></PAMDataset>"
    )
    assert Path("a.tif.ovr").exists() and Path("a.tif.msk").exists()
    listed = listing(".")
    with open_raster("a.tif") as source:
        assert source.overviews(1) == [2] and source.scales == (2.0,)
        assert (source.read_masks(1) == 0).sum() == SIDE * SIDE / 2
        assert {Path(name).name for name in source.files} >= {"a.tif.ovr", "a.tif.msk", "a.tif.aux.xml"}
    assert listing(".") == listed


@pytest.mark.parametrize("changes", ["-wal", "-journal"])
def test_changes_that_wait_beside_a_geopackage_are_read_and_stay_there(here, changes):
    """SQLite would write them into the file when it is opened."""
    import sqlite3
    import subprocess
    import sys

    table = geopandas.GeoDataFrame({"thickness": [1.5]}, geometry=[shapely.box(WEST, NORTH - 90, WEST + 90, NORTH)])
    table.set_crs(32632).to_file("a.gpkg")
    mode = {"-wal": "wal", "-journal": "delete"}[changes]
    end = "connection.commit()" if changes == "-wal" else "connection.execute('pragma cache_spill = 1')"
    program = (
        "import os, sqlite3\nconnection = sqlite3.connect('a.gpkg', isolation_level=None)\n"
        f"connection.execute('pragma journal_mode = {mode}')\nconnection.execute('pragma cache_size = 1')\n"
        "connection.execute('begin')\nconnection.execute('create table b(x)')\n"
        "connection.executemany('insert into b values(zeroblob(?))', [(9000,)] * 50)\n"
        f"{end}\nos._exit(0)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
    assert Path(f"a.gpkg{changes}").stat().st_size > 0
    listed = listing(".")
    assert len(read_table("a.gpkg")) == 1
    with open_vector("a.gpkg") as (library, place):
        names = [name for name, _ in library.list_layers(place)]
    assert ("b" in names) == (changes == "-wal")  # committed, or to be rolled back
    assert listing(".") == listed
    with sqlite3.connect("a.gpkg") as connection:
        connection.execute("select 1")


def test_overviews_in_other_files(here, url, asked):
    for place in (f"/vsicurl/{url}.tif", str(here / "good.tif")):
        shutil.copy("good.tif", "a.tif")
        with rasterio.open("a.tif", "r+") as target:
            target.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=place)
        assert f"a.tif points at {place}" in driver_of_raster("a.tif")
    shutil.copy("good.tif", "b.tif")
    Path("b.tif.aux.xml").write_text(
        f"<PAMDataset><Metadata domain='OVERVIEWS'><MDI key='OVERVIEW_FILE'>{url}</MDI></Metadata></PAMDataset>"
    )
    assert "b.tif points at" in driver_of_raster("b.tif")
    assert not asked


def test_values_of_netcdf_in_other_files(here):
    """NetCDF 4 is HDF5: a link leads to any file that can be read."""
    import h5py

    with h5py.File("other.h5", "w") as file:
        file["dem"] = np.ones((SIDE, SIDE))
    with h5py.File("a.nc", "w") as file:
        file["dem"] = h5py.ExternalLink("other.h5", "dem")
    for name in ("a.nc", "NETCDF:a.nc:dem"):
        assert "is an external link" in driver_of_raster(name)


@pytest.mark.parametrize("text", ["Type LINKED", "create view x as select * from a", '  "\\IsSeamless" = "TRUE"'])
def test_tables_of_mapinfo_that_show_others(here, text):
    folder = here / "tables"
    folder.mkdir()
    (folder / "a.tab").write_text(f"!table\n!version 300\n{text}\n")
    for path in (folder / "a.tab", folder):
        assert "shows other files" in driver_of_vector(path)


def test_a_seamless_list_is_json(here):
    """A file of a name that looks like a list but holds its own features."""
    Path("a.json").write_text(json.dumps({"type": "FeatureCollection", "features": []}))
    assert driver_of_vector("a.json") == "GeoJSON"
