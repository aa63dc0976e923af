"""The Python functions do what the commands do, with the options that they have, and gives results as xarray does."""

import logging
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
import rioxarray
import xarray
from slope_site import SCENE, write_site

import mpmgis
from mpmgis.commands.verb import verb_names
from mpmgis.system.errors import InputError


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A slope with a run on it, made through the face from a dictionary, and its export."""
    folder = tmp_path_factory.mktemp("face")
    write_site(folder)
    (folder / "scene.toml").write_text(SCENE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        tables = tomllib.loads(SCENE)
        mpmgis.run(tables)
    mpmgis.export_raster(folder / "results", products=("t_vol", "mass"))
    return folder


def test_import_alone_loads_nothing():
    code = "import mpmgis, sys; print([m for m in ('numpy', 'numba', 'xarray') if m in sys.modules], mpmgis.seed)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("[] <function seed")


def test_the_index_of_names_is_complete():
    folders = {path.parent.name for path in Path(mpmgis.__file__).parent.glob("*/__init__.py")}
    assert not folders & set(mpmgis.__all__)  # an imported package would take the place of the function
    functions = [getattr(mpmgis, name) for name in mpmgis.__all__]
    assert all(function.__doc__ for function in functions)
    assert set(mpmgis.__all__) <= set(dir(mpmgis))
    verbs = {verb.replace("-", "_") for verb in verb_names()}
    assert verbs - {"completion", "effects", "release"} <= set(mpmgis.__all__)
    assert {"scene_effects", "release_areas"} <= set(mpmgis.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = mpmgis.nonsense


def test_a_run_of_tables_is_the_run_of_the_file(site):
    summary = mpmgis.run(site / "scene.toml", site / "again")
    assert summary.result_digest == mpmgis.run(site / "scene.toml", site / "again", resume=True).result_digest
    assert summary.frames == len(list((site / "results").glob("*.h5")))
    ours, theirs = (mpmgis.read_frame(sorted((site / name).glob("*.h5"))[-1]) for name in ("results", "again"))
    assert np.array_equal(ours.particles.position, theirs.particles.position)
    with pytest.raises(mpmgis.MpmgisError, match="terrain"):
        mpmgis.run({"output": {"end_time": 1}})


def test_seed_takes_what_the_command_takes(site, caplog):
    with caplog.at_level(logging.INFO, "mpmgis"):
        seeded = mpmgis.seed(site / "dtm.tif", site / "release.geojson", site / "s.h5", thickness=2.0, count=500)
    assert abs(seeded.count - 500) <= 5 and seeded.path.exists()
    with pytest.raises(InputError, match=r"no option 'thicknes'; it takes .*thickness"):
        mpmgis.seed(site / "dtm.tif", site / "release.geojson", site / "x.h5", thicknes=2.0)
    with pytest.raises(InputError, match="no option 'cs_e'"):
        mpmgis.export_raster(site / "results", site / "x", cs_e=1)


def test_an_export_is_opened_lazily_with_all_that_is_in_it(site):
    results = mpmgis.open_results(site / "results_gis")
    assert results.rio.crs == pyproj.CRS.from_epsg(32632) and results.attrs["Conventions"] == "CF-1.8"
    assert {"h", "t", "Un", "Ut", "t_vol", "mass", "h_max", "t_arrival", "h_last", "elevation"} <= set(results)
    assert all(hasattr(results[name].data, "dask") for name in results)
    assert results.h.dims == ("time", "y", "x") and results.h.attrs["units"] == "m"
    assert results.time.values.tolist() == [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0]
    with rasterio.open(site / "results_gis" / "rasters" / "results_0003.tif") as source:
        stored, x, y = source.read(4), *source.xy(7, 11)
    step = results.Ut.sel(time=15.0)
    assert np.array_equal(step.fillna(-9999.0).values, stored)
    assert float(results.x[11]) == x and float(results.y[7]) == y
    assert float(results.h_max.max()) >= float(results.h.max())
    assert np.array_equal(results.h_last, results.h.isel(time=-1)) and results.attrs["came_to_rest"] == "false"


def test_stacks_are_opened_as_steps_are(site):
    mpmgis.export_raster(site / "results", site / "stacked", layout="stacks", qgis=False)
    xarray.testing.assert_equal(
        mpmgis.open_results(site / "stacked").Ut.compute(), mpmgis.open_results(site / "results_gis").Ut.compute()
    )


def test_frames_are_averaged_as_the_export_does(site):
    exported = mpmgis.open_results(site / "results_gis")
    averaged = mpmgis.open_results(site / "results", products=("t_vol", "mass"))
    for name in ("h", "t", "Un", "Ut", "t_vol", "mass", "elevation"):
        assert np.array_equal(exported[name], averaged[name], equal_nan=True), name
    every_second = mpmgis.open_results(site / "results", cell_size=20.0, time_step=10.0, extent="flow")
    assert every_second.time.values.tolist() == [0.0, 10.0, 20.0, 30.0] and every_second.rio.resolution() == (20, -20)
    coarse = mpmgis.open_results(site / "results", cell_size=20.0, products=("mass",)).mass.sum(("x", "y")) * 400.0
    assert np.allclose(coarse, averaged.mass.sum(("x", "y")) * 100.0, rtol=1e-6)


def test_the_folder_of_a_run_has_the_maxima_that_its_solver_kept(site):
    scene = (site / "scene.toml").read_text() + "maxima = true\n"
    (site / "peaks.toml").write_text(scene)
    mpmgis.run(site / "peaks.toml", site / "peaks")
    mpmgis.export_raster(site / "peaks", site / "peaks_gis", qgis=False)
    ours, exported = mpmgis.open_results(site / "peaks"), mpmgis.open_results(site / "peaks_gis")
    for name in ("h_max", "t_max", "Ut_max", "p_max", "t_arrival"):
        assert hasattr(ours[name].data, "dask") and ours[name].dims == ("y", "x")
        assert ours[name].attrs["units"] == exported[name].attrs["units"]
    both = ours.h_max.notnull() & exported.h_max.notnull()
    assert float((exported.h_max - ours.h_max).where(both).min()) >= -1e-6  # frames may add, never take away
    assert float((exported.h_max == ours.h_max).where(both).mean()) > 0.3
    assert {"Ut_max", "t_arrival"}.isdisjoint(mpmgis.open_results(site / "peaks", min_depth=0.2))
    assert "h_max" not in mpmgis.open_results(site / "results")
    assert "h_max" not in mpmgis.depth_average(sorted((site / "peaks").glob("*.h5"))[-1])


def test_a_frame_in_memory(site):
    path = sorted((site / "results").glob("*.h5"))[3]
    at_once = mpmgis.depth_average(path, products=("mass",))
    assert "time" not in at_once.dims and float(at_once.time) == 15.0
    frame = mpmgis.read_frame(path)
    dem = rioxarray.open_rasterio(site / "dtm.tif")
    given = mpmgis.depth_average(frame, dem, products=("mass",))
    assert np.array_equal(at_once.mass, given.mass) and np.array_equal(at_once.Ut, given.Ut, equal_nan=True)
    total = float((given.mass * 100.0).sum(dtype="float64"))
    assert total == pytest.approx(frame.particles.mass.sum(), rel=1e-6)
    with pytest.raises(mpmgis.MpmgisError, match=r"EPSG:32632.*EPSG:32633.*reproject"):
        mpmgis.depth_average(frame, dem.rio.write_crs("EPSG:32633"))
    with pytest.raises(InputError, match="expected a path, a Terrain or"):
        mpmgis.depth_average(frame, np.zeros((3, 3)))
    with pytest.raises(InputError, match="contains 7 frames"):
        mpmgis.depth_average(site / "results")


def test_what_does_nothing_is_refused(site, tmp_path):
    with pytest.raises(InputError, match="fixed cells; cell_size requires frames"):
        mpmgis.open_results(site / "results_gis", cell_size=5.0)
    with pytest.raises(InputError, match="no option 'cog'"):
        mpmgis.open_results(site / "results", cog=True)
    with pytest.raises(InputError, match=r"\.max\('time'\)"):
        mpmgis.open_results(site / "results", products=("maxima",))
    with pytest.raises(mpmgis.MpmgisError, match="no frame"):
        mpmgis.open_results(tmp_path)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("bed", "foo", "`bed` is 'foo', expected bilinear or plane"),
        ("extent", "foo", "expected flow or dtm"),
        ("percentile", 500, "a number above 0 and up to 100"),
        ("percentile", 0, "above 0 and up to 100"),
        ("min_depth", -1, "a number of at least 0"),
        ("time_step", 0, "above 0"),
        ("cell_size", float("nan"), "a number above 0 or auto"),
        ("cell_size", "x", "`cell_size` is 'x', expected a number above 0 or auto"),
        ("standoff", "x", "a number of at least -100 and up to 100 or auto"),
        ("products", "t_vol", "names NAME,.. with commas between them"),
        ("origin", (1, 2), "three numbers E,N,H"),
        ("dem_band", 1.5, "a whole number above 0"),
        ("dem_band", True, "a whole number above 0"),
    ],
)
def test_values_that_a_command_refuses_are_refused(site, name, value, words):
    for call in (mpmgis.open_results, mpmgis.export_raster):
        with pytest.raises(InputError, match=re.escape(words)):
            call(site / "results", **{name: value})
    mpmgis.open_results(site / "results", cell_size=np.float32(20), products=["mass"], standoff="auto", bed="plane")


def test_results_are_one_path_or_an_iterable_of_paths(site, tmp_path):
    frames = sorted((site / "results").glob("frame_*.h5"))
    for given in (frames, tuple(frames), iter(frames)):
        files = mpmgis.export_raster(given, tmp_path / "maps", qgis=False, overwrite=True)
        assert len([file for file in files if file.parent.name == "rasters"]) == len(frames) + 2
    for given, words in (
        ([], "no results are given"),
        (3, "`frames` is (3,), expected one path or several"),
        ([None], "expected one path or several"),
    ):
        with pytest.raises(InputError, match=re.escape(words)):
            mpmgis.export_raster(given, tmp_path / "none")
    for given in ([frames[0]], 3):
        with pytest.raises(InputError, match=r"open_results got .* expected one path"):
            mpmgis.open_results(given)
    assert not (tmp_path / "none").exists()


def test_a_dtm_in_memory_is_looked_at_as_a_file_is(site):
    dtm = rioxarray.open_rasterio(site / "dtm.tif").squeeze()
    frame = mpmgis.read_frame(site / "results" / "frame_000001.h5")
    own = mpmgis.Frame(frame.particles, dimension=2, origin=frame.origin)
    for dem, words in (
        (dtm.rio.reproject("EPSG:4326"), "mpmgis needs metres"),
        (dtm[:1], "expected y and x"),
        (dtm + 20_000.0, "elevations are from"),
    ):
        with pytest.raises(mpmgis.MpmgisError, match=words):
            mpmgis.depth_average(own, dem)
    holes = dtm.astype("float32").rio.write_nodata(None)
    holes[:2, :2] = -9999.0  # that nobody declared
    assert np.isnan(mpmgis.depth_average(own, holes).elevation[:2, :2]).all()


def test_what_is_neither_scene_nor_velocity_is_refused(site):
    with pytest.raises(InputError, match="`velocity` is 3, expected two numbers E,N"):
        mpmgis.seed(site / "dtm.tif", site / "release.shp", velocity=3)
    with pytest.raises(InputError, match="scene is 5, expected a path or a mapping"):
        mpmgis.run(5)


def test_netcdf_keeps_place_time_and_units(site, tmp_path):
    results = mpmgis.open_results(site / "results_gis")
    results.to_netcdf(tmp_path / "r.nc")
    with xarray.open_dataset(tmp_path / "r.nc", decode_coords="all") as again:
        assert again.rio.crs == results.rio.crs and again.rio.transform() == results.rio.transform()
        assert again.Ut.attrs["units"] == "m s-1" and again.time.attrs["units"] == "s"
        assert np.array_equal(again.Ut, results.Ut, equal_nan=True)
        assert again.y.attrs["standard_name"] == "projection_y_coordinate"


def test_zarr_keeps_place_time_and_units(site, tmp_path):
    pytest.importorskip("zarr")
    results = mpmgis.open_results(site / "results_gis")
    results.to_zarr(tmp_path / "r.zarr")
    again = xarray.open_zarr(tmp_path / "r.zarr", decode_coords="all")
    assert again.rio.crs == results.rio.crs and np.array_equal(again.h, results.h)


def test_cogs_in_one_line(site, tmp_path):
    results = mpmgis.open_results(site / "results_gis")
    results.h_max.rio.to_raster(tmp_path / "h.tif", driver="COG")
    with rasterio.open(tmp_path / "h.tif") as cog:
        assert cog.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG" and cog.crs == results.rio.crs
        assert np.array_equal(cog.read(1), results.h_max, equal_nan=True)


def test_tables_of_particles_and_cells(site):
    frame = mpmgis.read_frame(sorted((site / "results").glob("*.h5"))[-1])
    points = mpmgis.to_geodataframe(frame)
    assert len(points) == len(frame.particles) and points.crs == frame.crs
    assert {"x", "y", "z", "u", "v", "w", "mass", "thickness"} <= set(points.columns)
    results = mpmgis.open_results(site / "results_gis")
    cells = mpmgis.to_geodataframe(results.isel(time=-1))
    wet = int((results.h.isel(time=-1) > 0).sum())
    assert len(cells) == wet and cells.area.sum() == pytest.approx(100.0 * wet)
    highest = cells.loc[cells.h.idxmax()]
    at = results.h.isel(time=-1).sel(x=highest.geometry.centroid.x, y=highest.geometry.centroid.y)
    assert float(at) == pytest.approx(highest.h)
    with pytest.raises(InputError, match="isel"):
        mpmgis.to_geodataframe(results)
    with pytest.raises(InputError, match="expected a Frame or"):
        mpmgis.to_geodataframe([1, 2])
