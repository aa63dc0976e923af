"""Names that are no paths: subdatasets, members of archives, layer strings of QGIS, addresses."""

import os
import zipfile
from pathlib import Path

import geopandas
import netCDF4
import numpy as np
import pytest
import rasterio
import shapely
from hypothesis import given
from hypothesis import strategies as st
from rasterio.transform import from_origin

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.system.errors import FormatError, InputError
from mpmgis.system.source_names import file_of, joined, moved, source_of
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.raster_input import file_sha256, open_raster
from mpmgis.terrain.spatial_inputs import is_raster
from mpmgis.terrain.vector_table import read_table

WEST, NORTH, SIDE = 4e5, 5.1002e6, 20
SHAPE = {
    "width": SIDE,
    "height": SIDE,
    "count": 1,
    "dtype": "float32",
    "crs": "EPSG:32632",
    "transform": from_origin(WEST, NORTH, 10, 10),
}
HEIGHTS = (np.arange(SIDE * SIDE).reshape(SIDE, SIDE) + 100).astype("float32")
NAMES = ("NETCDF:two.nc:dem", "netcdf:two.nc:dem", 'NETCDF:"two.nc":dem', "GPKG:r.gpkg:dem", "GTIFF_DIR:1:dtm.tif")
ARCHIVES = ("d.zip", "/vsizip/d.zip/in/dtm.tif", "/vsizip/{d.zip}/in/dtm.tif")
CHARACTERS = st.characters(blacklist_characters='/\\|:{}"\0', blacklist_categories=("Cs", "Cc"))
letters = st.text(CHARACTERS, min_size=1, max_size=60)  # a name has at most 255 bytes


@pytest.fixture
def site(tmp_path, monkeypatch):
    """The same heights in several containers, and a GeoPackage of two layers."""
    monkeypatch.chdir(tmp_path)
    with rasterio.open("dtm.tif", "w", driver="GTiff", **SHAPE) as target:
        target.write(HEIGHTS, 1)
    with rasterio.open("r.gpkg", "w", driver="GPKG", RASTER_TABLE="dem", **SHAPE) as target:
        target.write(HEIGHTS, 1)
    with netCDF4.Dataset("two.nc", "w") as file:
        for name, values in (("x", WEST + 5 + 10 * np.arange(SIDE)), ("y", NORTH - 5 - 10 * np.arange(SIDE))):
            file.createDimension(name, SIDE)
            file.createVariable(name, "f8", (name,))[:] = values
            file[name].standard_name = f"projection_{name}_coordinate"
        for name in ("dem", "slope"):
            file.createVariable(name, "f4", ("y", "x"))[:] = HEIGHTS
    with zipfile.ZipFile("d.zip", "w") as archive:
        archive.write("dtm.tif", "in/dtm.tif")
        archive.writestr("readme.txt", "x")
    boxes = [shapely.box(WEST + 50, NORTH - 90, WEST + 90, NORTH - 50), shapely.box(WEST, NORTH - 9, WEST + 9, NORTH)]
    table = geopandas.GeoDataFrame({"name": ["a", "b"], "thickness": [1.0, 2.0]}, geometry=boxes, crs=32632)
    table.to_file("a.gpkg", layer="a")
    table[1:].to_file("a.gpkg", layer="b|c=d")
    return tmp_path


@pytest.mark.parametrize("name", (*NAMES, *ARCHIVES))
def test_a_raster_of_any_name_is_read(site, name):
    for given_name in (name, Path(name)):  # a path has lost slashes
        assert is_raster(given_name)
        with open_raster(given_name) as source:
            assert (source.read(1) == HEIGHTS).all()
    terrain = read_terrain(name, crs="EPSG:32632" if "two.nc" in name else None)
    assert (terrain.elevation == HEIGHTS).all()
    assert terrain.sha256 == file_sha256(file_of(name)) != ""


@pytest.mark.parametrize("name", (*NAMES, *ARCHIVES, "a.gpkg|layername=a", "a.gpkg", "dtm.tif"))
@pytest.mark.parametrize("place", ["inside", "beside"])
def test_names_are_relative_to_a_folder_by_their_file(site, monkeypatch, name, place):
    """As a scene writes them, and as a frame keeps them."""
    folder = site / place
    folder.mkdir()
    kept = moved(name, folder)
    assert file_of(joined(folder, kept)).samefile(file_of(name))
    monkeypatch.chdir(folder)
    assert file_of(kept).samefile(site / file_of(name).name)
    assert source_of(joined(site, name)).options == source_of(name).options


def test_an_absolute_archive(site):
    inner = f"/vsizip/{site}/d.zip/in/dtm.tif"
    for name in (f"/vsizip/{site}/d.zip/in/dtm.tif".replace("/vsizip/", "/vsizip//").replace("///", "//"), inner):
        with open_raster(Path(name)) as source:
            assert (source.read(1) == HEIGHTS).all()


def test_an_archive_of_several_rasters(site):
    with zipfile.ZipFile("two.zip", "w") as archive:
        archive.write("dtm.tif", "a.tif")
        archive.write("dtm.tif", "b.tif")
    with pytest.raises(FormatError, match=r"contains 2 rasters \(a\.tif, b\.tif\).*/vsizip/two\.zip/a\.tif"):
        read_terrain("two.zip")
    assert read_terrain("/vsizip/two.zip/b.tif").elevation[0, 0] == 100
    with zipfile.ZipFile("none.zip", "w") as archive:
        archive.writestr("a.txt", "x")
    with pytest.raises(FormatError, match="contains no raster"):
        read_terrain("none.zip")


def test_the_subdatasets_are_listed_as_they_are_read(site):
    with pytest.raises(FormatError, match=r"one of its subdatasets: NETCDF:two\.nc:dem, NETCDF:two\.nc:slope"):
        read_terrain("two.nc")


@pytest.mark.parametrize(
    "name", ["NETCDF:../two.nc:dem", "GPKG:../r.gpkg:dem", "/vsizip/../d.zip/in/dtm.tif", "../d.zip"]
)
def test_a_scene_and_its_frames_name_them(site, name, capsys):
    """The frame of a seed names the DTM relative to its own folder, and the export reads it."""
    (site / "scenes").mkdir()
    (site / "out").mkdir()
    from mpmgis.scene import read_scene

    (site / "scenes" / "s.toml").write_text(
        f'[terrain]\ndem = "{name}"\ncrs = "EPSG:32632"\n[release]\nsource = "../a.gpkg|layername=a"\nthickness = 1\n'
        'density = 1000\n[friction]\nlaw = "Coulomb"\nmu = 0.3\n[output]\nend_time = 1\nframe_interval = 1\n'
    )
    scene = read_scene(site / "scenes" / "s.toml")
    here = os.path.relpath(file_of(scene.path(name)))
    assert file_of(here).exists()
    given_name = str(scene.path(name))
    crs = ("--crs", "EPSG:32632") if "two.nc" in name else ()
    words = ("seed", "--dem", given_name, "--release", "a.gpkg|layername=a", "-o", "out/s.h5", *crs, "-q")
    assert main(list(words)) == 0
    kept = read_frame(site / "out" / "s.h5").dem
    assert file_of(joined(site / "out", kept)).samefile(here)
    assert main(["export-raster", "out/s.h5", "-o", "maps", "--no-qgis", "-q"]) == 0
    with rasterio.open(next((site / "maps").glob("dtm.tif"))) as source:
        assert (source.read(1) == HEIGHTS).all()


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ("|layername=a", ["a", "b"]),
        ("|layerid=0", ["a", "b"]),
        ("|layerid=1", ["b"]),
        ("|layername=b|c=d", None),
        ("|layername=a|geometrytype=Polygon", ["a", "b"]),
        ("|layername=a|geometrytype=MultiPolygonZ", ["a", "b"]),
        ('|layername=a|subset="thickness" > 1', ["b"]),
        ("|layername=a|subset=name = 'a' OR name = 'x|y'", ["a"]),
        ("|layername=a|subset=thickness < 2|geometrytype=Polygon|uniqueGeometryType=yes", ["a"]),
    ],
)
def test_layer_strings_of_qgis(site, options, names):
    if names is None:
        with pytest.raises(InputError, match=r"\|c= is not understood, expected \|layername="):
            read_table(f"a.gpkg{options}")
        return
    assert read_table(f"a.gpkg{options}").columns["name"].tolist() == names
    assert not is_raster(f"a.gpkg{options}")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("|layername=x", "has no layer 'x'"),
        ("|layerid=7", "no layer of the number 7; it has 2"),
        ("|layerid=-1", "no layer of the number"),
        ("|layername=a|geometrytype=Point", "no feature is of the type Point"),
        ("|layername=a|geometrytype=Blob", "is not understood, expected Polygon"),
        ("|layername=a|subset=SELECT * FROM a", "whole query"),
        ("|layername=a|subset=((", "not a condition"),
    ],
)
def test_layer_strings_that_are_refused_by_name(site, options, says):
    with pytest.raises(InputError, match=says):
        read_table(f"a.gpkg{options}")


@pytest.mark.parametrize(
    "name", ["/vsitar/a.tar/b.tif", "/vsigzip/a.gz", "/vsistdin/", "HDF5:a.h5://dem", "vrt://dtm.tif"]
)
def test_other_names_are_refused_by_name(site, name):
    for open_it in (read_terrain, read_table):
        with pytest.raises(FormatError, match="--trust"):
            open_it(name)
    assert main(["info", name, "-q"]) == 2


@given(letters, letters)
def test_any_file_name_is_a_plain_name(first, second):
    """Of a folder and a file, whatever the letters."""
    name = f"./{first}/{second}.tif"
    found = source_of(name)
    assert found.is_plain and not found.options and found.file == Path(name)
    assert joined("x", name) == Path("x") / name


@given(letters, letters, st.booleans())
def test_names_of_subdatasets_and_members_are_kept(file, part, by_path):
    """A name is the same after it was a path of Python, and after it was written and read again."""
    for name in (f"NETCDF:{file}.nc:{part}", f"/vsizip/{file}.zip/{part}"):
        found = source_of(Path(name) if by_path else name)
        if Path(part).name != part or part.strip(".") == "" or file.strip(".") == "":  # dots are no names
            continue
        assert found.part == part and found.file.name in (f"{file}.nc", f"{file}.zip")
        assert source_of(str(found)) == found


@pytest.mark.parametrize(
    "name", ["~nobody_of_this_name/a.tif", "NETCDF:~x.nc:dem", "/vsizip/~x.zip/a.tif", "~x|layername=a"]
)
def test_homes_of_unknown_users_are_names(name):
    assert "~" in str(source_of(name).file)


def test_existing_files_of_any_name_are_paths(site):
    for name in ("NETCDF:x.nc:dem", "a|layername=b.tif", "http:", "PG:host=1"):
        Path("dtm.tif").rename(name)
        assert source_of(name).is_plain
        with open_raster(name) as source:
            assert source.driver == "GTiff"
        Path(name).rename("dtm.tif")
