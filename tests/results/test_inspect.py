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
PARTICLE_FACTS = {"reader", "time", "n", "mass", "bbox", "crs"}


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


def test_a_frame(tmp_path):
    write_frame(tmp_path / "a.h5", frame(time=2.5))
    facts = inspect(tmp_path / "a.h5")
    assert set(facts) >= PARTICLE_FACTS
    assert (facts["reader"], facts["time"], facts["n"], facts["mass"]) == ("mpmgis", 2.5, 2, 4000.0)
    assert facts["bbox"] == [5e5, 4e6, 5e5 + 100, 4e6 + 50]
    assert facts["elevation"] == [10.0, 20.0]
    assert facts["crs"] == "EPSG:32612"
    assert facts["max_speed"] == pytest.approx(5.0)
    assert (facts["volume"], facts["density"], facts["thickness"]) == (4.0, 1000.0, [1.0, 1.5])


def test_a_frame_without_crs(tmp_path):
    particles = frame().particles
    write_frame(tmp_path / "a.h5", Frame(particles))
    assert inspect(tmp_path / "a.h5")["crs"] is None


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


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("1,2,3,4,5,6,7", "has no column 'w'"),
        ("1,2,3,4,5,6,7,nan", "column 'w' has 1 NaN or infinite values, the first in row 0"),
        ("1,2,3,4,5,6,7,fast", "column 'w' has values"),
    ],
)
def test_a_table_with_a_wrong_column_is_a_one_line_error(tmp_path, row, says):
    columns = ["x", "y", "z_bed", "mass", "volume", "u", "v", "w"][: row.count(",") + 1]
    (tmp_path / "a.csv").write_text(",".join(columns) + "\n" + row + "\n")
    with pytest.raises(FormatError, match=says):
        inspect(tmp_path / "a.csv")


def test_a_folder_of_results(tmp_path):
    for number in range(3):
        write_frame(tmp_path / "run" / f"frame_{number:06d}.h5", frame(time=2.0 * number))
    (tmp_path / "run" / "run.json").write_text(
        json.dumps({"format": "mpmgis-run", "format_version": 1, "state": "finished", "reason": "at rest", "steps": 90})
    )
    facts = inspect(tmp_path / "run")
    assert (facts["kind"], facts["frames"], facts["first_time"], facts["time"]) == ("results", 3, 0.0, 4.0)
    assert (facts["state"], facts["reason"], facts["steps"]) == ("finished", "at rest", 90)
    assert facts["files"] == {"scene.toml": False, "run.json": True, "terrain.tif": False}
    assert set(facts) >= PARTICLE_FACTS


def test_a_run_record(tmp_path):
    (tmp_path / "run.json").write_text(
        json.dumps({"format": "mpmgis-run", "format_version": 1, "steps": 5, "balances": {"mass": 1.5}, "scene": {}})
    )
    facts = inspect(tmp_path / "run.json")
    assert (facts["kind"], facts["steps"], facts["balances"]) == ("run record", 5, {"mass": 1.5})


def test_a_dtm():
    facts = inspect(sample_folder() / "lava_falls_dem_utm12n_10m.tif")
    assert (facts["kind"], facts["cells"], facts["cell_size"]) == ("raster", [280, 260], [10.0, 10.0])
    assert facts["bbox"] == [311600.0, 4007400.0, 314200.0, 4010200.0]
    assert (facts["crs"], facts["orientation"], facts["as_terrain"]) == ("EPSG:32612", "north-up", "usable")
    (band,) = facts["bands"]
    assert (round(band["min"]), round(band["max"]), band["valid_share"], band["nodata"]) == (501, 1551, 1.0, -9999.0)


@pytest.mark.parametrize(
    ("transform", "orientation", "cell"),
    [
        ((10, 0, 5e5, 0, 10, 4e6), "south-up", [10.0, 10.0]),
        ((8, 6, 5e5, 6, -8, 4e6), "rotated", [10.0, 10.0]),
        ((5, 0, 5e5, 0, -20, 4e6), "north-up", [5.0, 20.0]),
        ((-5, 0, 5e5, 0, -5, 4e6), "mirrored", [5.0, 5.0]),
    ],
)
def test_rasters_of_any_orientation(tmp_path, transform, orientation, cell):
    write_raster(tmp_path / "a.tif", np.arange(12.0).reshape(3, 4), transform)
    facts = inspect(tmp_path / "a.tif")
    assert (facts["orientation"], facts["cell_size"]) == (orientation, cell)


def test_a_raster_that_is_not_a_terrain_has_the_reason(tmp_path):
    write_raster(tmp_path / "a.tif", np.ones((4, 4)), (0.001, 0, 7.0, 0, -0.001, 46.0), "EPSG:4326")
    said = inspect(tmp_path / "a.tif")["as_terrain"]
    assert "EPSG:4326" in said and "metres" in said and "\n" not in said


def test_a_raster_without_any_value(tmp_path):
    write_raster(tmp_path / "a.tif", np.full((4, 4), -9999.0))
    (band,) = inspect(tmp_path / "a.tif")["bands"]
    assert (band["min"], band["max"], band["valid_share"]) == (None, None, 0.0)


def test_band_rasters_and_the_folder_of_an_export(tmp_path):
    folder, bands = tmp_path / "run_gis", ["h [m]", "Ut [m s-1]"]
    for step in range(3):
        file = folder / "rasters" / f"run_{step:04d}.tif"
        write_raster(file, np.full((2, 4, 4), step), names=bands, time=str(2.0 * step))
    peaks = ["h_max [m]", "Ut_max [m s-1]"]
    write_raster(folder / "rasters" / "run_max.tif", np.arange(32.0).reshape(2, 4, 4), names=peaks)
    with zipfile.ZipFile(folder / "run.qgz", "w") as archive:
        archive.writestr("run.qgs", "<qgis version='3.38'/>")
    step = inspect(folder / "rasters" / "run_0002.tif")
    about = [(band["name"], band["unit"], band["max"]) for band in step["bands"]]
    assert about == [("h", "m", 2.0), ("Ut", "m s-1", 2.0)]
    assert step["tags"] == {"time": "4.0"}
    facts = inspect(folder)
    assert (facts["kind"], facts["name"], facts["steps"], facts["times"]) == ("export", "run", 3, [0.0, 4.0])
    assert facts["maxima"] == {"h_max": [0.0, 15.0], "Ut_max": [16.0, 31.0]}
    assert (facts["step_bands"], facts["project"]) == (["h", "Ut"], "run.qgz")


def test_a_release():
    (layer,) = inspect(sample_folder() / "lava_falls_release.shp")["layers"]
    assert (layer["geometry"], layer["features"], layer["crs"]) == ("Polygon", 1, "EPSG:32612")
    assert (layer["area"], layer["thickness_column"], layer["thickness"]) == (20970.0, "thickness", [5.0])


@pytest.mark.parametrize("suffix", ["gpkg", "geojson", "fgb", "parquet"])
def test_any_vector_file(tmp_path, suffix):
    square = geopandas.GeoDataFrame({"d0": [2.0]}, geometry=[shapely.box(5e5, 4e6, 5e5 + 10, 4e6 + 10)], crs=CRS)
    path = tmp_path / f"a.{suffix}"
    square.to_parquet(path) if suffix == "parquet" else square.to_file(path)
    (layer,) = inspect(path)["layers"]
    assert layer["geometry"] == "Polygon"
    assert layer["columns"] == ["d0"]
    assert (layer["thickness_column"], layer["area"]) == ("d0", pytest.approx(100))


def test_a_file_of_several_layers(tmp_path):
    for name, shape in (("release", shapely.box(0, 0, 1, 1)), ("path", shapely.LineString([(0, 0), (3, 4)]))):
        geopandas.GeoDataFrame(geometry=[shape], crs=CRS).to_file(tmp_path / "a.gpkg", layer=name)
    layers = inspect(tmp_path / "a.gpkg")["layers"]
    assert [(layer["name"], layer["geometry"]) for layer in layers] == [("release", "Polygon"), ("path", "LineString")]
    assert "area" not in layers[1]


def test_degrees_have_no_area(tmp_path):
    geopandas.GeoDataFrame(geometry=[shapely.box(7, 46, 8, 47)], crs=4326).to_file(tmp_path / "a.gpkg")
    assert "area" not in inspect(tmp_path / "a.gpkg")["layers"][0]


def test_a_scene(tmp_path):
    facts = inspect(sample_folder() / "scene.toml")
    assert facts["kind"] == "scene"
    assert set(facts["files"].values()) == {True}
    shutil.copy(sample_folder() / "scene.toml", tmp_path)
    assert set(inspect(tmp_path / "scene.toml")["files"].values()) == {False}


def test_a_mesh(tmp_path):
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as data:
        data.Conventions = "CF-1.8 UGRID-1.0"
        data.createDimension("time", 3)
        for name, values in (("time", [0, 60, 120]), ("t_s", [0.0, 1.0, 2.0])):
            data.createVariable(name, "f8", ("time",))[:] = values
        data["t_s"].units = "s"
    facts = inspect(tmp_path / "a.nc")
    assert (facts["kind"], facts["times"], facts["dimensions"]) == ("mesh", [0.0, 2.0], {"time": 3})
    assert facts["variables"] == {"time": "", "t_s": "s"}


PROJECT = """<qgis version="3.38.0"><projectCrs><spatialrefsys><authid>EPSG:32612</authid></spatialrefsys></projectCrs>
<projectlayers><maplayer type="raster"><layername>depth</layername><datasource>./a.vrt</datasource></maplayer>
</projectlayers></qgis>"""


@pytest.mark.parametrize("suffix", ["qgz", "qgs"])
def test_a_project(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    if suffix == "qgz":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("a.qgs", PROJECT)
    else:
        path.write_text(PROJECT)
    facts = inspect(path)
    assert (facts["qgis"], facts["crs"]) == ("3.38.0", "EPSG:32612")
    assert facts["layers"] == [{"name": "depth", "type": "raster", "source": "./a.vrt"}]


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


def test_a_damaged_raster_is_a_one_line_error(tmp_path):
    shutil.copy(sample_folder() / "lava_falls_dem_utm12n_10m.tif", tmp_path / "a.tif")
    content = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(content[:20_000])
    with pytest.raises(FormatError, match=r"a\.tif") as caught:
        inspect(tmp_path / "a.tif")
    assert "\n" not in str(caught.value)


def test_an_unknown_folder_is_a_one_line_error(tmp_path):
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(FormatError, match="neither frames"):
        inspect(tmp_path)


def test_a_newer_run_record_is_a_one_line_error(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps({"format": "mpmgis-run", "format_version": 9}))
    with pytest.raises(FormatError, match="update mpmgis"):
        inspect(tmp_path / "run.json")
