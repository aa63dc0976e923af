"""Rasters from other people read by GDAL: no network, no list of files with another suffix, no pipe."""

import os
import shutil

import h5py
import numpy as np
import pytest
from refusals import refusal
from slope_site import SCENE, write_site

from mpmgis.commands.shell.main import main
from mpmgis.simulation.preparation import scene_to_prepare
from mpmgis.system.errors import FormatError, SceneError
from mpmgis.system.file_references import require_local
from mpmgis.system.trusted_files import trusting
from mpmgis.terrain.raster_input import open_raster
from mpmgis.terrain.spatial_inputs import is_raster
from mpmgis.terrain.vector_table import read_table

VRT = """<VRTDataset rasterXSize="20" rasterYSize="20"><SRS>EPSG:32632</SRS>
<GeoTransform>4e5, 10, 0, 5.1e6, 0, -10</GeoTransform><VRTRasterBand dataType="Float32" band="1"><SimpleSource>
<SourceFilename relativeToVRT="{relative}">{source}</SourceFilename><SourceBand>1</SourceBand></SimpleSource>
</VRTRasterBand></VRTDataset>"""
OGR = '<OGRVRTDataSource><OGRVRTLayer name="a"><SrcDataSource>{}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>'
REMOTE = (
    "/vsicurl/http://127.0.0.1:9/a.tif",
    "/vsis3/bucket/a.tif",
    "/VSICURL/http://127.0.0.1:9/a.tif",
    "/vsizip//vsicurl/http://127.0.0.1:9/a.zip/a.tif",
    "/vsicurl?url=http%3A%2F%2F127.0.0.1",
    "/vsicurl_streaming/http://127.0.0.1:9/a.tif",
    "http://127.0.0.1:9/a.tif",
    "WMS:http://127.0.0.1:9/",
    "PG:host=127.0.0.1",
)


@pytest.fixture
def site(tmp_path):
    return write_site(tmp_path)


@pytest.mark.parametrize("source", REMOTE)
def test_a_scene_names_no_raster_in_the_network(site, capfd, source):
    (site / "dtm.vrt").write_text(VRT.format(relative=0, source=source))
    (site / "scene.toml").write_text(SCENE.replace("dtm.tif", "dtm.vrt"))
    err = refusal(capfd, "run", site / "scene.toml", "-o", site / "out")
    assert "in the network or in a database" in err and str(site / "dtm.vrt") in err
    assert not (site / "out").exists()


@pytest.mark.parametrize("source", [name for name in REMOTE if name.startswith("/")])
def test_a_scene_names_nothing_in_the_network(site, capfd, source):
    (site / "scene.toml").write_text(SCENE.replace("dtm.tif", source))
    assert "is in the network" in refusal(capfd, "run", site / "scene.toml", "-o", site / "out")


def test_what_leads_to_the_network_over_another_file(site):
    (site / "inner.vrt").write_text(VRT.format(relative=0, source=REMOTE[0]))
    (site / "outer.vrt").write_text(VRT.format(relative=1, source="inner.vrt"))
    with pytest.raises(FormatError, match=r"inner\.vrt refers to, is in the network"):
        require_local(site / "outer.vrt", "scene.toml")
    (site / "inner.vrt").rename(site / "inner.tif")
    (site / "outer.vrt").write_text(VRT.format(relative=1, source="inner.tif"))
    with pytest.raises(FormatError, match=r"refers to inner\.tif, which is a virtual raster"):
        require_local(site / "outer.vrt", "scene.toml")


@pytest.mark.parametrize(
    ("hidden", "says"),
    [
        ("&#47;vsicurl/http://a/b", "is in the network"),
        ("\n  /vsicurl/http://a/b ", "is in the network"),
        ("<![CDATA[/vsicurl/http://a/b]]>", "contains a comment, CDATA"),
        ("dtm<!-- -->.tif", "contains a comment, CDATA"),
        ("<b/>dtm.tif", "is more than a mosaic .<b>"),
        ("&lt;VRTDataset/&gt;", "is no path"),
        ("{}", "is no path"),
        ("vrt://dtm.tif", "GDAL's driver vrt"),
    ],
)
def test_names_that_the_text_hides(site, hidden, says):
    (site / "dtm.vrt").write_text(VRT.format(relative=0, source=hidden))
    with pytest.raises(FormatError, match=says):
        require_local(site / "dtm.vrt", "scene.toml")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<VRTDataset ", '<VRTDataset subClass="VRTWarpedDataset" '),
        ("<VRTDataset ", '<VRTDataset SourceFilename="a" '),
        ('band="1">', 'band="1" subClass="VRTRawRasterBand">'),
        ("<SimpleSource>", "<SimpleSource><OpenOptions><OOI key='LISTFILES'>a</OOI></OpenOptions>"),
        ("<GeoTransform>", "<Metadata domain='OVERVIEWS'><MDI key='OVERVIEW_FILE'>a</MDI></Metadata><GeoTransform>"),
        ("<GeoTransform>", "<Metadata domain='GEOLOCATION'><MDI key='X_DATASET'>a</MDI></Metadata><GeoTransform>"),
        ("<SimpleSource>", "<sourcefilename>/etc/hostname</sourcefilename><SimpleSource>"),
    ],
)
def test_a_virtual_raster_that_is_more_than_a_mosaic(site, old, new):
    text = VRT.format(relative=1, source="dtm.tif")
    (site / "dtm.vrt").write_text(text)
    require_local(site / "dtm.vrt")
    assert old in text
    (site / "more.vrt").write_text(text.replace(old, new, 1))
    with pytest.raises(FormatError, match="is more than a mosaic"), open_raster(site / "more.vrt"):
        pass


@pytest.mark.parametrize("place", ["..", "link", "absolute"])
def test_sources_outside_the_folder(site, place):
    """Whatever leads there: dots, a link, an absolute path."""
    (site / "inside").mkdir()
    name = {"..": "../dtm.tif", "absolute": str(site / "dtm.tif"), "link": "link.tif"}[place]
    (site / "inside" / "link.tif").symlink_to(site / "dtm.tif")
    (site / "inside" / "dtm.vrt").write_text(VRT.format(relative=int(place != "absolute"), source=name))
    with pytest.raises(FormatError, match="not in its folder"), open_raster(site / "inside" / "dtm.vrt"):
        pass
    with trusting(), open_raster(site / "inside" / "dtm.vrt") as source:
        assert source.count == 1


def test_a_source_that_is_missing_is_named(site):
    (site / "dtm.vrt").write_text(VRT.format(relative=1, source="gone.tif"))
    with pytest.raises(FormatError, match=r"refers to gone\.tif, which does not exist"), open_raster(site / "dtm.vrt"):
        pass


@pytest.mark.parametrize(
    "words", [b"<MRF_META>", b"PDS_VERSION_ID = PDS3", b"\x01\x02 PDS_VERSION_ID", b"<Dimap_Document>"]
)
def test_a_tile_without_a_beginning_that_another_driver_reads(site, words):
    """A .bil has any bytes: GDAL would try other drivers first."""
    (site / "tile.hdr").write_text("NROWS 20\nNCOLS 20\nNBANDS 1\nNBITS 16\nBYTEORDER I\nLAYOUT BIL\n")
    raw = np.full(400, 1500, "<i2").tobytes()
    for start, fits in ((b"", True), (words, False)):
        (site / "tile.bil").write_bytes((start + raw)[: len(raw)])
        (site / f"{fits}.vrt").write_text(VRT.format(relative=1, source="tile.bil"))
        if fits:
            with open_raster(site / f"{fits}.vrt") as source:
                assert (source.read(1) == 1500).all()
        else:
            with pytest.raises(FormatError, match=r"refers to tile\.bil, which is"):
                require_local(site / f"{fits}.vrt")


def test_damaged_xml(site):
    (site / "dtm.vrt").write_text(VRT.format(relative=0, source="/vsi&curl/x"))
    with pytest.raises(FormatError, match="not a readable list of files"):
        require_local(site / "dtm.vrt", "scene.toml")


def test_shapes_in_the_network(site):
    (site / "release.vrt").write_text(OGR.format("/vsicurl/http://127.0.0.1:9/a.gpkg"))
    (site / "scene.toml").write_text(SCENE.replace("release.geojson", "release.vrt"))
    with pytest.raises(FormatError, match=r"a virtual vector file \(VRT\), which points at /vsicurl/"):
        scene_to_prepare(site / "scene.toml")


def test_a_web_service_that_a_scene_names(site):
    (site / "dtm.xml").write_text("<GDAL_WMS><Service name='TMS'/></GDAL_WMS>")
    with pytest.raises(FormatError, match="is a web service"), open_raster(site / "dtm.xml"):
        pass


def test_a_scene_with_virtual_rasters_that_lie_beside_it(site):
    (site / "inner.vrt").write_text(VRT.format(relative=1, source="dtm.tif"))
    (site / "outer.vrt").write_text(VRT.format(relative=1, source="inner.vrt").replace("SRS>", "SRS>http://a/b "))
    (site / "round.vrt").write_text(VRT.format(relative=0, source=site / "round.vrt"))
    for name in ("outer.vrt", "round.vrt", "inner.vrt"):
        (site / "scene.toml").write_text(SCENE.replace("dtm.tif", name))
        scene_to_prepare(site / "scene.toml")
    (site / "vsites").mkdir()
    require_local(shutil.copy(site / "dtm.tif", site / "vsites" / "a:b.tif"), "scene.toml")


@pytest.mark.parametrize("suffix", ["", ".ovr", ".msk"])
def test_a_list_of_files_behind_another_suffix(site, capfd, suffix):
    """A mask or an overview beside a raster is opened as any dataset is."""
    (site / f"dtm.tif{suffix}").write_text(VRT.format(relative=0, source="/etc/hostname"))
    assert f"dtm.tif{suffix} is a virtual raster (VRT), which points at /etc/hostname" in refusal(
        capfd, "info", site / "dtm.tif"
    )
    (site / "scene.toml").write_text(SCENE)
    assert "give --trust" in refusal(capfd, "run", site / "scene.toml", "-o", site / "out")


def test_shapes_behind_another_suffix(site):
    (site / "release.gpkg").write_text(OGR.format("/etc/hostname"))
    for read in (read_table, is_raster):
        with pytest.raises(FormatError, match="is a virtual vector file"):
            read(site / "release.gpkg")


def test_what_the_user_types_lies_anywhere_only_with_trust(site, capfd):
    """With it, GDAL answers."""
    (site / "dtm.vrt").write_text(VRT.format(relative=0, source=REMOTE[0]))
    with trusting(), open_raster(site / "dtm.vrt") as source:
        assert source.count == 1
    seed = ("seed", "--release", site / "release.geojson", "--thickness", "2", "-o", site / "seed.h5", "--dem")
    for name in REMOTE:
        assert "in the network" in refusal(capfd, *seed, name)
    assert "not a raster that GDAL can read" in refusal(capfd, *seed, REMOTE[0], "--trust")


def test_a_dtm_that_frames_name(site, capfd):
    release = ("--release", site / "release.geojson", "--thickness", "2", "-o", site / "seed.h5", "-q")
    assert main([*map(str, ("seed", "--dem", site / "dtm.tif", *release))]) == 0
    (site / "dtm.tif").unlink()
    (site / "inner.vrt").write_text(VRT.format(relative=0, source=REMOTE[0]))
    with h5py.File(site / "seed.h5", "r+") as file:
        file.attrs["dem"] = "inner.vrt"
    err = refusal(capfd, "export-raster", site / "seed.h5", "-o", site / "maps")
    assert "in the network" in err and "inner.vrt" in err


@pytest.mark.parametrize("name", ["dtm.tif", "release.geojson", "scene.toml"])
def test_pipes_are_not_waited_for(site, capfd, name):
    (site / "scene.toml").write_text(SCENE)
    (site / name).unlink()
    os.mkfifo(site / name)
    err = refusal(capfd, "run", site / "scene.toml", "-o", site / "out")
    assert name in err and "pipe" in err


def test_pipes_that_are_typed(site):
    os.mkfifo(site / "a.gpkg")
    for read in (read_table, is_raster):
        with pytest.raises(FormatError, match="device or pipe"):
            read(site / "a.gpkg")
    with pytest.raises(FormatError, match="device or pipe"), open_raster(site / "a.gpkg"):
        pass
    with pytest.raises(SceneError, match="pipe or a device"):
        scene_to_prepare(site / "a.gpkg")
