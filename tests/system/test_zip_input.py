"""Archives of anybody: what unpacks to more than memory or a project holds ends in one line, before it is."""

import io
import os
import tracemalloc
import zipfile

import geopandas
import numpy as np
import pytest
import shapely

from mpmgis.commands.shell.main import main
from mpmgis.exchange.readers.npz import open_file, read_members
from mpmgis.results.reports.file_facts import inspect
from mpmgis.system import memory
from mpmgis.system.errors import FormatError
from mpmgis.terrain.vector_table import read_table

PROJECT = """<!DOCTYPE qgis><qgis version="3.40.1"><projectCrs><spatialrefsys><authid>EPSG:2056</authid></spatialrefsys>
</projectCrs><projectlayers><maplayer type="raster"><datasource>a.tif</datasource><layername>a &amp; b</layername>
<provider>gdal</provider></maplayer><maplayer type="vector"/></projectlayers></qgis>"""
LAYERS = [{"name": "a & b", "type": "raster", "source": "a.tif"}, {"name": "", "type": "vector", "source": None}]


def write_zip(path, members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


@pytest.fixture
def little_memory(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 1e6)


def refused(capfd, path):
    """The only line on stderr of `mpmgis info`, which took at most 100 MB for it."""
    capfd.readouterr()
    tracemalloc.start()
    try:
        assert main(["info", str(path), "-q"]) == 2
        assert tracemalloc.get_traced_memory()[1] < 1e8
    finally:
        tracemalloc.stop()
    out, err = capfd.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


@pytest.mark.parametrize("suffix", ["qgz", "qgs"])
def test_a_project_lists_its_layers(tmp_path, suffix):
    path = tmp_path / f"p.{suffix}"
    path.write_text(PROJECT)
    if suffix == "qgz":
        write_zip(path, {"styles.db": b"", "p.qgs": PROJECT})
    facts = inspect(path)
    assert (facts["qgis"], facts["crs"], facts["layers"]) == ("3.40.1", "EPSG:2056", LAYERS)


def test_a_project_that_unpacks_to_too_much(tmp_path, capfd):
    path = write_zip(tmp_path / "p.qgz", {"p.qgs": bytes(101_000_000)})
    assert path.stat().st_size < 200_000
    assert "p.qgs has 101 MB uncompressed, expected at most 100 MB" in refused(capfd, path)


def test_a_directory_that_lies_about_the_size(tmp_path, capfd):
    """The directory says 1000 bytes, the stream holds 150 MB: no more than 1000 are taken."""
    size = 150_000_000
    path = write_zip(tmp_path / "p.qgz", {"p.qgs": b"<qgis>" + b" " * size})
    raw = path.read_bytes().replace((size + 6).to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    path.write_bytes(raw)
    assert "not a readable QGIS project" in refused(capfd, path)


def test_many_small_elements_take_no_memory(tmp_path):
    """XML of 6 MB, of which a tree would take 100 MB and more."""
    text = "<qgis version='3'><x>" + "<a/>" * 300_000 + "</x></qgis>"
    path = write_zip(tmp_path / "p.qgz", {"p.qgs": text})
    tracemalloc.start()
    try:
        assert inspect(path)["layers"] == []
        assert tracemalloc.get_traced_memory()[1] < 1.5e7
    finally:
        tracemalloc.stop()


def test_more_layers_than_any_project(tmp_path):
    path = tmp_path / "p.qgs"
    path.write_text("<qgis>" + "<maplayer/>" * 10_001 + "</qgis>")
    with pytest.raises(FormatError, match="more than 10000 layers"):
        inspect(path)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_methods_that_unpack_without_end(tmp_path, capfd, method):
    path = write_zip(tmp_path / "p.qgz", {"p.qgs": bytes(50_000_000)}, method)
    assert "p.qgs is not compressed by deflate" in refused(capfd, path)


@pytest.mark.parametrize("name", ["p.qgs", "p.qgz", "p.npz"])
def test_a_pipe_is_no_project(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(FormatError, match="device or pipe"):
        (read_members if name == "p.npz" else inspect)(tmp_path / name)


def test_arrays_are_held_against_memory(tmp_path, little_memory):
    np.savez_compressed(tmp_path / "p.npz", position=np.zeros((20_000, 3)), velocity=np.zeros((20_000, 3)))
    assert (tmp_path / "p.npz").stat().st_size < 5000
    frame = open_file(tmp_path / "p.npz")
    with pytest.raises(FormatError, match=r"p.npz: position.npy uncompressed needs about 0\.00144 GB of memory"):
        frame.read(("position.x",))


def test_a_header_with_a_wrong_length(tmp_path):
    """NumPy reads as many bytes as a header says to have before it holds them against its limit."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_2_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (1,)})
    raw = stream.getvalue()
    size = 200_000_000
    raw = raw[:8] + size.to_bytes(4, "little") + raw[12:].rstrip(b"\n") + b" " * size
    path = write_zip(tmp_path / "p.npz", {"position.npy": raw})
    del raw
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match="is not an array of NumPy"):
            read_members(path)
        assert tracemalloc.get_traced_memory()[1] < 1e7
    finally:
        tracemalloc.stop()


def test_more_members_than_any_archive(tmp_path, monkeypatch):
    monkeypatch.setattr("mpmgis.system.zip_archives.MOST_MEMBERS", 3)
    path = write_zip(tmp_path / "p.npz", {f"{k}.npy": b"" for k in range(4)})
    with pytest.raises(FormatError, match="holds 4 files, expected at most 3"):
        read_members(path)


def test_zipped_shapes_are_read_and_held_against_memory(tmp_path, monkeypatch):
    table = geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 9, 9)], crs="EPSG:32632")
    table.to_file(tmp_path / "a.geojson")
    path = write_zip(tmp_path / "a.zip", {"a.geojson": (tmp_path / "a.geojson").read_bytes()})
    assert len(read_table(path)) == 1
    monkeypatch.setattr(memory, "available_memory", lambda: 100)
    with pytest.raises(FormatError, match=r"a\.zip uncompressed needs"):
        read_table(path)
