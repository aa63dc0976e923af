"""Facts about every type of file, and one-line errors for unknown files."""

import dataclasses
import json
import shutil
import zipfile

import geopandas
import netCDF4
import numpy as np
import pyproj
import pytest
import rasterio
import shapely

from mpmgis.commands.demo_site import sample_folder
from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particle_files import write_columns
from mpmgis.frames.particles import Frame, Particles
from mpmgis.results.reports.file_facts import inspect
from mpmgis.system.errors import FormatError, MpmgisError

CRS = pyproj.CRS.from_epsg(32612)


def frame(time=0.0, speed=3.0):
    particles = Particles(
        position=np.array([[0.0, 0.0, 10.0], [100.0, 50.0, 20.0]]),
        velocity=np.array([[speed, 4.0, 0.0], [0.0, 0.0, -1.0]]),
        mass=np.array([1000.0, 3000.0]),
        volume=np.array([1.0, 3.0]),
        thickness=np.array([1.0, 1.5]),
        area=np.array([1.0, 2.0]),
    )
    return Frame(particles, time=time, step=7, solver="columns", crs=CRS, origin=(5e5, 4e6, 0.0), dem="terrain.tif")


def write_raster(path, values, transform=(10, 0, 5e5, 0, -10, 4e6), crs="EPSG:32612", names=None, **tags):
    """A GeoTIFF of `values` [bands, rows, columns], or of one band."""
    values = np.asarray(values, "f4").reshape(-1, *np.shape(values)[-2:])
    count, height, width = values.shape
    path.parent.mkdir(parents=True, exist_ok=True)
    size = {"count": count, "height": height, "width": width, "dtype": "float32", "nodata": -9999}
    with rasterio.open(path, "w", "GTiff", transform=rasterio.Affine(*transform), crs=crs, **size) as target:
        target.write(values)
        target.descriptions = names or [None] * count
        target.update_tags(ns="mpmgis", **tags)


SAMPLE = sample_folder()
DEM = "lava_falls_dem_utm12n_10m.tif"
RECORD = {"format": "mpmgis-run", "format_version": 1, "state": "finished", "reason": "at rest", "steps": 90}
PROJECT = """<qgis version="3.38.0"><projectCrs><spatialrefsys><authid>EPSG:32612</authid></spatialrefsys></projectCrs>
<projectlayers><maplayer type="raster"><layername>depth</layername><datasource>./a.vrt</datasource></maplayer>
</projectlayers></qgis>"""


def run_folder(folder):
    for number in range(3):
        write_frame(folder / f"frame_{number:06d}.h5", frame(time=2.0 * number))
    (folder / "run.json").write_text(json.dumps(RECORD | {"balances": {"mass": 1.5}, "scene": {}}))
    return folder


def export_folder(folder):
    for step in range(3):
        file = folder / "rasters" / f"run_{step:04d}.tif"
        write_raster(file, np.full((2, 4, 4), step), names=["h [m]", "Ut [m s-1]"], time=str(2.0 * step))
    peaks = ["h_max [m]", "Ut_max [m s-1]"]
    write_raster(folder / "rasters" / "run_max.tif", np.arange(32.0).reshape(2, 4, 4), names=peaks)
    project_file(folder / "run.qgz")
    return folder


def project_file(path):
    if path.suffix == ".qgz":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("a.qgs", PROJECT)
    else:
        path.write_text(PROJECT)
    return path


def mesh_file(path):
    with netCDF4.Dataset(path, "w") as data:
        data.Conventions = "CF-1.8 UGRID-1.0"
        data.createDimension("time", 3)
        for name, values in (("time", [0, 60, 120]), ("t_s", [0.0, 1.0, 2.0])):
            data.createVariable(name, "f8", ("time",))[:] = values
        data["t_s"].units = "s"
    return path


def square_file(path):
    square = geopandas.GeoDataFrame({"d0": [2.0]}, geometry=[shapely.box(5e5, 4e6, 5e5 + 10, 4e6 + 10)], crs=CRS)
    square.to_parquet(path) if path.suffix == ".parquet" else square.to_file(path)
    return path


def layers_file(path):
    for name, shape in (("release", shapely.box(0, 0, 1, 1)), ("path", shapely.LineString([(0, 0), (3, 4)]))):
        geopandas.GeoDataFrame(geometry=[shape], crs=CRS).to_file(path, layer=name)
    return path


def frame_file(path, written):
    write_frame(path, written)
    return path


def raster_file(path, values=((0, 1), (2, 3)), *more):
    write_raster(path, np.asarray(values, float), *more)
    return path


def text_file(path, text):
    path.write_text(text)
    return path


def moved_scene(path):
    return shutil.copy(SAMPLE / "scene.toml", path)


OF_A_FRAME = {"reader": "mpmgis", "n": 2, "mass": 4000.0, "bbox": [5e5, 4e6, 5e5 + 100, 4e6 + 50], "crs": "EPSG:32612"}
A_SQUARE = {"geometry": "Polygon", "columns": ["d0"], "thickness_column": "d0", "area": 100}
A_PROJECT = {
    "kind": "QGIS project",
    "qgis": "3.38.0",
    "crs": "EPSG:32612",
    "layers": [{"name": "depth", "type": "raster", "source": "./a.vrt"}],
}
FACTS = {  # kind of file: function that writes it, facts that it must have
    "frame": (
        lambda folder: frame_file(folder / "a.h5", frame(time=2.5)),
        {
            "kind": "particles",
            "time": 2.5,
            "elevation": [10.0, 20.0],
            "max_speed": 5.0,
            "volume": 4.0,
            "density": 1000.0,
        }
        | {"thickness": [1.0, 1.5]}
        | OF_A_FRAME,
    ),
    "frame without a CRS": (lambda folder: frame_file(folder / "a.h5", Frame(frame().particles)), {"crs": None}),
    "results": (
        lambda folder: run_folder(folder / "run"),
        {"kind": "results", "frames": 3, "first_time": 0.0, "time": 4.0, "state": "finished", "reason": "at rest"}
        | {"steps": 90, "files": {"scene.toml": False, "run.json": True, "terrain.tif": False}}
        | OF_A_FRAME,
    ),
    "run record": (
        lambda folder: run_folder(folder / "run") / "run.json",
        {"kind": "run record", "steps": 90, "balances": {"mass": 1.5}},
    ),
    "DTM": (
        lambda folder: SAMPLE / DEM,
        {"kind": "raster", "cells": [280, 260], "cell_size": [10.0, 10.0], "orientation": "north-up"}
        | {"bbox": [311600.0, 4007400.0, 314200.0, 4010200.0], "crs": "EPSG:32612", "as_terrain": "usable"}
        | {"bands": [{"min": 501.1, "max": 1551.0, "valid_share": 1.0, "nodata": -9999.0}]},
    ),
    **{
        f"raster, {orientation}": (
            lambda folder, at=at: raster_file(folder / "a.tif", np.arange(12.0).reshape(3, 4), at),
            {"orientation": orientation, "cell_size": cell},
        )
        for orientation, cell, at in (
            ("south-up", [10.0, 10.0], (10, 0, 5e5, 0, 10, 4e6)),
            ("rotated", [10.0, 10.0], (8, 6, 5e5, 6, -8, 4e6)),
            ("north-up", [5.0, 20.0], (5, 0, 5e5, 0, -20, 4e6)),
            ("mirrored", [5.0, 5.0], (-5, 0, 5e5, 0, -5, 4e6)),
        )
    },
    "raster without a value": (
        lambda folder: raster_file(folder / "a.tif", np.full((4, 4), -9999.0)),
        {"bands": [{"min": None, "max": None, "valid_share": 0.0}]},
    ),
    "raster of a step": (
        lambda folder: export_folder(folder / "run_gis") / "rasters" / "run_0002.tif",
        {"tags": {"time": "4.0"}}
        | {"bands": [{"name": "h", "unit": "m", "max": 2.0}, {"name": "Ut", "unit": "m s-1", "max": 2.0}]},
    ),
    "export": (
        lambda folder: export_folder(folder / "run_gis"),
        {"kind": "export", "name": "run", "steps": 3, "times": [0.0, 4.0], "step_bands": ["h", "Ut"]}
        | {"maxima": {"h_max": [0.0, 15.0], "Ut_max": [16.0, 31.0]}, "project": "run.qgz"},
    ),
    "release": (
        lambda folder: SAMPLE / "lava_falls_release.shp",
        {"layers": [{"geometry": "Polygon", "features": 1, "crs": "EPSG:32612", "area": 20970.0, "thickness": [5.0]}]},
    ),
    **{
        f"vector file, {suffix}": (
            lambda folder, suffix=suffix: square_file(folder / f"a.{suffix}"),
            {"kind": "vector", "layers": [A_SQUARE]},
        )
        for suffix in ("gpkg", "geojson", "fgb", "parquet")
    },
    "several layers": (
        lambda folder: layers_file(folder / "a.gpkg"),
        {"layers": [{"name": "release", "geometry": "Polygon"}, {"name": "path", "geometry": "LineString"}]},
    ),
    "scene": (lambda folder: SAMPLE / "scene.toml", {"kind": "scene", "files": {DEM: True}}),
    "scene without its files": (lambda folder: moved_scene(folder / "scene.toml"), {"files": {DEM: False}}),
    "mesh": (
        lambda folder: mesh_file(folder / "a.nc"),
        {"kind": "mesh", "times": [0.0, 2.0], "dimensions": {"time": 3}, "variables": {"time": "", "t_s": "s"}},
    ),
    "project, zipped": (lambda folder: project_file(folder / "a.qgz"), A_PROJECT),
    "project": (lambda folder: project_file(folder / "a.qgs"), A_PROJECT),
    "declarations": (
        lambda folder: text_file(
            folder / "p.georef.json",
            '{"format": "mpmgis-georeference", "format_version": 1, "axes": ["e", "u", "-n"], "density": 1500}',
        ),
        {"kind": "georeference", "axes": ["e", "u", "-n"], "density": 1500.0},
    ),
    "ensemble": (
        lambda folder: text_file(folder / "ensemble.json", '{"state": "finished", "plan": {"samples": 4}}').parent,
        {"kind": "ensemble", "state": "finished", "samples": 4},
    ),
}


def require_within(wanted, found, where=""):
    """Raise unless `found` has all entries of `wanted`."""
    if isinstance(wanted, dict):
        for key, value in wanted.items():
            require_within(value, found[key], f"{where} {key}")
    elif isinstance(wanted, list):
        assert len(found) == len(wanted), where
        for some, value in zip(wanted, found, strict=True):
            require_within(some, value, where)
    else:
        assert found == (pytest.approx(wanted, rel=1e-3) if isinstance(wanted, float) else wanted), where


@pytest.mark.parametrize("kind", FACTS)
def test_facts_of_each_kind_of_file(tmp_path, kind):
    write, wanted = FACTS[kind]
    facts = inspect(write(tmp_path))
    require_within(wanted, facts)
    json.dumps(facts, allow_nan=False)


def test_lines_have_no_area(tmp_path):
    assert "area" not in inspect(layers_file(tmp_path / "a.gpkg"))["layers"][1]


COLUMNS = "x,y,z_bed,mass,volume,u,v,w\n"
WRONG = {  # file: what it contains, what the error says
    "a.csv": ("x,y,z_bed,mass,volume,u,v\n1,2,3,4,5,6,7\n", "has no column 'w'"),
    "b.csv": (f"{COLUMNS}1,2,3,4,5,6,7,nan\n", "column 'w' has 1 NaN or infinite values, the first in row 0"),
    "c.csv": (f"{COLUMNS}1,2,3,4,5,6,7,fast\n", "column 'w' has values"),
    "run.json": ('{"format": "mpmgis-run", "format_version": 9}', "update mpmgis"),
    "folder/notes.txt": ("x", "neither frames"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_is_a_one_line_error(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    text_file(tmp_path / name, WRONG[name][0])
    with pytest.raises(FormatError, match=WRONG[name][1]) as caught:
        inspect(tmp_path / name.partition("/")[0])
    assert "\n" not in str(caught.value)


def test_a_damaged_raster_is_a_one_line_error(tmp_path):
    (tmp_path / "a.tif").write_bytes((SAMPLE / DEM).read_bytes()[:20_000])
    with pytest.raises(FormatError, match=r"a\.tif") as caught:
        inspect(tmp_path / "a.tif")
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """The same particles in every format of a seed."""
    folder, wrote = tmp_path_factory.mktemp("seeds"), frame()
    wrote.particles.id = np.arange(2, dtype=np.uint64)
    wrote = dataclasses.replace(wrote, header={"density": 1000.0, "mass_mode": "thickness"})
    for suffix in ("h5", "csv", "json", "gpkg", "parquet", "vtp"):
        write_columns(folder / f"seed.{suffix}", wrote, 2, [wrote.particles])
    return folder


@pytest.mark.parametrize("suffix", ["csv", "json", "gpkg", "parquet", "vtp"])
def test_facts_of_a_seed_table_equal_those_of_its_frame(seeds, suffix):
    facts, wanted = inspect(seeds / f"seed.{suffix}"), inspect(seeds / "seed.h5")
    for name in ("kind", "reader", "dimension", "time", "n", "mass", "volume", "bbox", "elevation", "max_speed"):
        assert facts[name] == pytest.approx(wanted[name]), name
    assert (facts["thickness"], facts["column_area"]) == (wanted["thickness"], wanted["column_area"])
    if suffix != "csv":  # which has nowhere to say it
        assert facts["crs"] == "EPSG:32612"
        assert facts["header"]["mass_mode"] == "thickness"


def test_info_writes_nothing(seeds):
    before = sorted(seeds.iterdir())
    for path in before:
        inspect(path)
    assert sorted(seeds.iterdir()) == before


@pytest.mark.parametrize("suffix", ["csv", "json", "gpkg", "parquet", "vtp"])
def test_a_truncated_table_is_a_one_line_error(seeds, tmp_path, suffix):
    content = (seeds / f"seed.{suffix}").read_bytes()
    path = tmp_path / f"cut.{suffix}"
    path.write_bytes(content[: len(content) // 3])
    with pytest.raises(FormatError, match="cut") as caught:
        inspect(path)
    assert "\n" not in str(caught.value)


def test_a_raster_that_is_not_a_terrain_has_the_reason(tmp_path):
    write_raster(tmp_path / "a.tif", np.ones((4, 4)), (0.001, 0, 7.0, 0, -0.001, 46.0), "EPSG:4326")
    said = inspect(tmp_path / "a.tif")["as_terrain"]
    assert "EPSG:4326" in said and "metres" in said and "\n" not in said


def test_degrees_have_no_area(tmp_path):
    geopandas.GeoDataFrame(geometry=[shapely.box(7, 46, 8, 47)], crs=4326).to_file(tmp_path / "a.gpkg")
    assert "area" not in inspect(tmp_path / "a.gpkg")["layers"][0]


SUFFIXES = [
    "h5",
    "csv",
    "json",
    "gpkg",
    "parquet",
    "vtp",
    "tif",
    "vrt",
    "asc",
    "nc",
    "shp",
    "geojson",
    "toml",
    "qgz",
    "qml",
]
CONTENTS = {
    "empty": b"",
    "words": b"neither fish nor fowl\n",
    "bytes": bytes(range(256)) * 20,
    "json list": b"[1, 2, 3]",
    "xml": b"<a><b/></a>",
    "zip": b"PK\x03\x04 torn off",
    "number": b"7\n",
    "deep": b"[" * 100_000,
}


@pytest.mark.parametrize("suffix", [*SUFFIXES, "txt"])
@pytest.mark.parametrize("content", CONTENTS)
def test_junk_with_any_suffix_is_a_one_line_error(tmp_path, suffix, content):
    path = tmp_path / f"junk.{suffix}"
    path.write_bytes(CONTENTS[content])
    with pytest.raises(MpmgisError, match="junk") as caught:
        inspect(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_missing_file_is_a_one_line_error(tmp_path, suffix):
    with pytest.raises(FormatError, match="no such file or folder"):
        inspect(tmp_path / f"none.{suffix}")
