"""The folder written by `mpmgis export-raster`, from frames on disk."""

import hashlib
import re
import threading
import weakref
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from exporting import AFFINES, sheet_frames, terrain, write_frames, write_run

from mpmgis.commands.export_raster import export_raster
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.system.messages import collected


def export(frames, **options):
    """Export, by default without QGIS files; returns the folder."""
    options = {"qgis": False, "overwrite": True} | options
    with collected() as said:
        paths = export_raster(list(frames), **options)
    folder = next(path for path in paths if path.name == "dtm.tif").parent
    assert sorted(paths) == sorted(p for p in folder.rglob("*") if p.is_file() and p.name[0] != ".")
    return folder, said


def bands(path):
    """Name -> float64[rows, columns] with NaN, and the tags."""
    with rasterio.open(path) as source:
        names = [text.split(" ")[0] for text in source.descriptions]
        values = np.where(source.read() == source.nodata, np.nan, source.read())
        return dict(zip(names, values.astype(float), strict=True)), source.tags(ns="mpmgis")


def digests(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".tif", ".asc", ".vrt")
    }


@pytest.fixture(scope="module")
def run2(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("columns") / "slide", dimension=2)


@pytest.fixture(scope="module")
def run3(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("points") / "slide", dimension=3)


def test_default_folder_names_and_bands(run2):
    folder, _ = export(run2)
    assert folder == run2[0].parent.parent / "slide_gis"
    assert sorted(p.name for p in (folder / "rasters").iterdir()) == [
        "slide_0000.tif",
        "slide_0001.tif",
        "slide_0002.tif",
        "slide_last.tif",
        "slide_max.tif",
    ]
    with rasterio.open(folder / "rasters" / "slide_0001.tif") as source:
        assert source.descriptions == ("h [m]", "t [m]", "Un [m s-1]", "Ut [m s-1]", "t_vol [m]")
        tags = source.tags(ns="mpmgis")
    assert (tags["time"], tags["frame"], tags["bed"], tags["min_depth"]) == (
        "1.0",
        "frame_000001.h5",
        "bilinear",
        "0.05",
    )
    assert {
        "cs_e",
        "dt_e",
        "percentile",
        "thickness",
        "digest",
        "version",
        "frames",
        "particles_outside",
    } <= tags.keys()
    with rasterio.open(folder / "rasters" / "slide_max.tif") as source:
        assert source.descriptions == (
            "h_max [m]",
            "t_max [m]",
            "Un_max [m s-1]",
            "Un_min [m s-1]",
            "Ut_max [m s-1]",
            "p_max [Pa]",
            "t_arrival [s]",
        )
    with rasterio.open(folder / "rasters" / "slide_last.tif") as source:
        assert source.descriptions == ("h [m]", "t [m]", "t_vol [m]")


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("cell_size", [None, 3.0, 7.5])
def test_mass_is_in_the_file(run2, run3, dimension, cell_size, tmp_path):
    frames = run2 if dimension == 2 else run3
    folder, _ = export(frames, products=("mass", "n", "t_vol"), cell_size=cell_size, output=tmp_path / "out")
    for step, path in enumerate(frames):
        values, tags = bands(folder / "rasters" / f"slide_{step:04d}.tif")
        with rasterio.open(folder / "rasters" / f"slide_{step:04d}.tif") as source:
            area = source.transform.a * -source.transform.e
        particles = read_frame(path).particles
        assert values["mass"].sum() * area + float(tags["mass_outside"]) == pytest.approx(
            particles.mass.sum(), rel=1e-6
        )
        assert values["n"].sum() + int(tags["particles_outside"]) == len(particles)


def test_empty_cells_have_zero_depth_and_nodata_velocity(run2):
    folder, _ = export(run2, products=("t_vol", "mass", "n", "p", "detached", "Ut_E", "Ut_N"))
    values, _ = bands(folder / "rasters" / "slide_0000.tif")
    dry = values["h"] == 0
    assert dry.any() and not dry.all()
    for name in ("h", "t", "t_vol", "mass", "n"):
        assert np.isfinite(values[name]).all() and (values[name][dry] == 0).all(), name
    for name in ("Un", "Ut", "p", "Ut_E", "Ut_N", "detached"):
        assert np.isnan(values[name][dry]).all(), name
    assert np.isnan(values["Ut"][values["h"] < 0.05]).all() and np.isfinite(values["Ut"][values["h"] >= 0.05]).all()


def test_maxima_include_frames_that_are_not_steps(run3):
    every, _ = export(run3, output=run3[0].parent.parent / "every", products=("p", "n"))
    few, _ = export(run3, output=run3[0].parent.parent / "few", time_step=2.0)
    assert len(list((few / "rasters").glob("slide_0*.tif"))) == 2
    assert digests(few)["rasters/slide_max.tif"] != digests(every)["rasters/slide_max.tif"]  # dt_e is in the tags
    peaks, _ = bands(few / "rasters" / "slide_max.tif")
    steps = [bands(every / "rasters" / f"slide_{k:04d}.tif")[0] for k in range(3)]
    ever = np.any([step["n"] > 0 for step in steps], axis=0)
    assert np.isnan(peaks["h_max"][~ever]).all()
    for name in ("h_max", "t_max", "Un_max", "Un_min", "Ut_max", "p_max"):
        band, best = name[:-4], np.fmin if name.endswith("min") else np.fmax
        expected = best.reduce([step[band] for step in steps])
        assert np.array_equal(peaks[name][ever], expected[ever], equal_nan=True), name
    arrival = np.fmin.reduce([np.where(step["h"] >= np.float32(0.05), k, np.nan) for k, step in enumerate(steps)])
    assert np.array_equal(peaks["t_arrival"], arrival, equal_nan=True)


def test_running_maxima_in_the_steps(run3, tmp_path):
    folder, _ = export(run3, products=("maxima",), output=tmp_path / "out")
    peaks, _ = bands(folder / "rasters" / "slide_max.tif")
    last, _ = bands(folder / "rasters" / "slide_0002.tif")
    first, _ = bands(folder / "rasters" / "slide_0000.tif")
    assert list(last)[5:] == ["h_max", "t_max", "Un_max", "Ut_max"]
    for name in list(last)[5:]:
        assert np.array_equal(last[name], peaks[name], equal_nan=True)
    assert np.array_equal(first["h_max"][first["h"] > 0], first["h"][first["h"] > 0])
    assert np.isnan(first["h_max"]).sum() > np.isnan(last["h_max"]).sum()


def test_the_last_step_is_that_of_the_last_frame(run3, tmp_path):
    folder, _ = export(run3, products=("t_vol",), output=tmp_path / "out")
    end, tags = bands(folder / "rasters" / "slide_last.tif")
    last, _ = bands(folder / "rasters" / "slide_0002.tif")
    assert tags["time"] == "2.0"
    for name in ("h", "t", "t_vol"):
        assert np.array_equal(end[name], last[name])


def test_same_bytes_for_any_number_of_workers(run2, run3, tmp_path):
    for frames in (run2, run3):
        options = {"products": ("t_vol", "p", "maxima"), "percentile": 80.0, "naming": "iseesnow", "cell_size": 2.0}
        one, _ = export(frames, workers=1, output=tmp_path / "one", **options)
        three, _ = export(frames, workers=3, output=tmp_path / "three", **options)
        assert digests(one) == digests(three) and len(digests(one)) == 9


def test_stacks_equal_the_steps(run2, tmp_path):
    steps, _ = export(run2, output=tmp_path / "steps", products=("t_vol",))
    stacks, _ = export(run2, output=tmp_path / "stacks", products=("t_vol",), layout="stacks")
    assert not list((stacks / "rasters").glob("slide_0*.tif"))
    for step in range(3):
        expected, tags = bands(steps / "rasters" / f"slide_{step:04d}.tif")
        through_vrt, same_tags = bands(stacks / "rasters" / f"slide_{step:04d}.vrt")
        assert expected.keys() == through_vrt.keys()
        assert {k: v for k, v in tags.items() if v} == {k: v for k, v in same_tags.items() if v}
        for name, values in expected.items():
            assert np.array_equal(through_vrt[name], values, equal_nan=True)
            with rasterio.open(stacks / "rasters" / f"slide_{name}.tif") as source:
                assert np.array_equal(
                    np.where(source.read(step + 1) == -9999, np.nan, source.read(step + 1)), values, equal_nan=True
                )


def test_flow_extent_is_a_part_of_the_terrain(run3, tmp_path):
    whole, _ = export(run3, output=tmp_path / "dtm", cell_size=5.0, extent="dtm")
    part, _ = export(run3, output=tmp_path / "flow", cell_size=5.0)
    with rasterio.open(whole / "rasters/slide_0002.tif") as a, rasterio.open(part / "rasters/slide_0002.tif") as b:
        row, column = (round(v) for v in ((a.transform.f - b.transform.f) / 5, (b.transform.c - a.transform.c) / 5))
        window = a.read()[:, row : row + b.height, column : column + b.width]
        assert b.width < a.width and np.array_equal(window, b.read())
        assert (a.read(1) > 0).sum() == (b.read(1) > 0).sum()


@pytest.mark.parametrize("affine", ["south-up", "rotated", "sheared", "oblong"])
def test_any_terrain_gives_a_north_up_raster_on_request(affine, tmp_path):
    ground = terrain(AFFINES[affine])
    frames = write_run(tmp_path / "slide", ground=ground, dimension=3)
    folder, _ = export(frames, products=("mass",), north_up=True)
    with rasterio.open(folder / "rasters/slide_0000.tif") as source:
        t = source.transform
        assert t.a > 0 > t.e and t.b == t.d == 0
        assert (t.c, t.f) == pytest.approx((ground.grid.bounds[0], ground.grid.bounds[3]))
        mass = source.read(source.descriptions.index("mass [kg m-2]") + 1).astype(float).sum() * t.a * -t.e
    assert mass == pytest.approx(read_frame(frames[0]).particles.mass.sum(), rel=1e-6)


def test_terrain_on_the_export_grid(run2, tmp_path):
    same, _ = export(run2, output=tmp_path / "same")
    with rasterio.open(same / "dtm.tif") as copy, rasterio.open(run2[0].parent / "terrain.tif") as source:
        assert np.array_equal(copy.read(1), source.read(1)) and copy.transform == source.transform
        assert copy.descriptions == ("elevation [m]",)
    fine, _ = export(run2, output=tmp_path / "fine", cell_size=2.0)
    with rasterio.open(fine / "dtm.tif") as copy, rasterio.open(fine / "rasters/slide_0000.tif") as step:
        assert (copy.transform, copy.shape) == (step.transform, step.shape)


def test_terrain_beside_nodata_keeps_its_pixels(tmp_path):
    ground = terrain(holes=[(3, 3), (30, 30)])
    folder, _ = export(write_run(tmp_path / "slide", ground=ground))
    with rasterio.open(folder / "dtm.tif") as copy:
        assert np.count_nonzero(copy.read(1) == -9999) == 2


def test_iseesnow_names_and_values(run2, tmp_path):
    folder, _ = export(run2, naming="iseesnow", products=("t_vol", "p"), output=tmp_path / "out")
    names = sorted(path.name for path in (folder / "rasters").glob("*.asc"))
    assert names == [f"slide_dddddddddd_null_mpmgis_{kind}.asc" for kind in ("pft", "pfv", "ppr")]
    steps = [bands(folder / "rasters" / f"slide_{k:04d}.tif")[0] for k in range(3)]
    for kind, band, factor in (("pft", "t_vol", 1), ("pfv", "Ut", 1), ("ppr", "p", 1e-3)):
        with rasterio.open(folder / "rasters" / f"slide_dddddddddd_null_mpmgis_{kind}.asc") as source:
            expected = np.nan_to_num(np.fmax.reduce([step[band] for step in steps])) * factor
            assert source.read(1) == pytest.approx(expected, abs=1e-3, rel=1e-4)
            assert source.nodata == -9999


def test_iseesnow_is_on_the_terrains_grid_whatever_the_cells(run3, tmp_path):
    coarse, _ = export(run3, naming="iseesnow", cell_size=11.0, output=tmp_path / "coarse")
    own, _ = export(run3, naming="iseesnow", output=tmp_path / "own")
    a, b = (next((f / "rasters").glob("*_pfv.asc")).read_bytes() for f in (coarse, own))
    assert a == b


def test_automatic_cells_and_steps_report_the_reason(run3, tmp_path):
    folder, said = export(run3, cell_size="auto", time_step="auto", standoff="auto", output=tmp_path / "out")
    words = " ".join(said)
    assert "Eq 15 gives" in words and "Eq 17" in words and "`standoff=auto`" in words
    _, tags = bands(folder / "rasters" / "slide_max.tif")
    assert f"`cell_size=auto`: {float(tags['cs_e']):.4g} m" in words
    assert f"`time_step=auto`: {float(tags['dt_e']):.4g} s" in words


def uniform_run(folder, speed, interval):
    return write_frames(folder, terrain(), sheet_frames(speed, [0.0, interval, 2 * interval]))


def warnings_of(said):
    return [text for text in said if text.startswith("warning:")]


@pytest.mark.parametrize("options", [{}, {"time_step": 0.1}, {"time_step": 4.0}, {"time_step": "auto"}])
def test_frames_too_far_apart_for_eq_17_are_reported(tmp_path, options):
    """5 m cells at 10 m/s: Eq 17 requires 0.5 s. Frames 2 s apart are reported for any --dt-e."""
    far = uniform_run(tmp_path / "far", speed=10.0, interval=2.0)
    _, said = export(far, output=tmp_path / "far_gis", cell_size=5.0, **options)
    (warning,) = warnings_of(said)
    assert "up to 2 s apart" in warning and "dt_e = 0.5 s" in warning and "crosses 4 cells" in warning
    assert ("uses each of them once" in warning) == (options.get("time_step", 9.0) in (0.1, "auto"))


@pytest.mark.parametrize("options", [{}, {"time_step": 0.1}, {"time_step": 4.0}])
def test_frames_close_enough_for_eq_17_are_not(tmp_path, options):
    near = uniform_run(tmp_path / "near", speed=10.0, interval=0.5)
    _, said = export(near, output=tmp_path / "near_gis", cell_size=5.0, **options)
    assert not warnings_of(said) and not any("Eq 17" in text for text in said)
    _, said = export(near, output=tmp_path / "finer_gis", cell_size=2.5, **options)  # the same frames, half the cell
    assert len(warnings_of(said)) == 1 and "dt_e = 0.25 s" in warnings_of(said)[0]


def test_eq_17_has_the_largest_speed_of_all_frames_where_they_are_uneven(tmp_path):
    """Fast in the first second, slow in the next twenty: Eq 17 requires 5 m / 10 m/s, not 5 m / 2 m/s."""
    first, second = sheet_frames(10.0, [0.0, 1.0])
    far = write_frames(tmp_path / "far", terrain(), [first, second, *sheet_frames(2.0, [2.0, 22.0])])
    _, said = export(far, output=tmp_path / "far_gis", cell_size=5.0)
    (warning,) = warnings_of(said)
    assert "up to 20 s apart" in warning and "dt_e = 0.5 s" in warning and "mean speed up to 10 m/s" in warning
    assert "crosses 8 cells" in warning


def test_cells_below_eq_15_are_reported_with_its_size(tmp_path):
    """Points of 1 m3: cells under 1 m are too fine; columns never are, by this equation."""
    frames = uniform_run(tmp_path / "run", speed=0.0, interval=1.0)
    _, said = export(frames, output=tmp_path / "fine", cell_size=0.9)
    (warning,) = warnings_of(said)
    assert "required by Eq 15, 1 m" in warning and "cells of 0.9 m" in warning
    _, said = export(frames, output=tmp_path / "enough", cell_size=1.0)
    assert not warnings_of(said)
    columns = write_run(tmp_path / "columns", times=(0.0,))
    _, said = export(columns, output=tmp_path / "of_columns", cell_size=0.9)
    assert not any("Eq 15" in text for text in said)


def test_cells_finer_than_the_columns_are_reported(run2, tmp_path):
    _, said = export(run2, cell_size=0.9, output=tmp_path / "out")
    assert any("add no detail" in text for text in said)


def test_particles_outside_are_counted_and_reported(tmp_path):
    frames = write_run(tmp_path / "slide", times=(0.0, 12.0), dimension=3)
    folder, said = export(frames)
    _, tags = bands(folder / "rasters" / "slide_0001.tif")
    assert int(tags["particles_outside"]) > 0 and float(tags["mass_outside"]) > 0
    assert any(f"{tags['particles_outside']} particles" in text and "frame_000001.h5" in text for text in said)


def test_particles_below_the_bed_are_reported_and_corrected_by_standoff(tmp_path):
    frames = write_run(tmp_path / "slide", times=(0.0,), dimension=3)
    sunk = read_frame(frames[0])
    sunk.particles.position[:, 2] -= 1.2
    write_frame(frames[0], sunk)
    _, said = export(frames)
    assert any("is below the DTM" in text for text in said)
    plain, _ = bands(tmp_path / "slide_gis/rasters/slide_0000.tif")
    _, said = export(frames, standoff="auto")
    lifted, tags = bands(tmp_path / "slide_gis/rasters/slide_0000.tif")
    assert float(tags["standoff"]) < -0.5 and not any("below the DTM" in text for text in said)
    wet = plain["h"] > 0
    assert (lifted["h"] - plain["h"])[wet] == pytest.approx(-float(tags["standoff"]), abs=1e-4)


def test_density_of_the_frames_and_of_the_command(run3, tmp_path):
    t_vol = {}
    for name, header, options in (
        ("frames", {"density": 600.0}, {}),
        ("both", {"density": 600.0}, {"density": 300.0}),
        ("command", {}, {"density": 300.0}),
        ("neither", {}, {}),
    ):
        frames = write_run(tmp_path / name / "slide", times=(0.0,), dimension=3, header=header)
        folder, said = export(frames, products=("t_vol",), **options)
        t_vol[name] = bands(folder / "rasters/slide_0000.tif")[0]["t_vol"].sum()
        assert any("density" in text for text in said) == (name in ("both", "neither"))
    assert t_vol["both"] == pytest.approx(t_vol["frames"])
    assert t_vol["command"] == pytest.approx(2 * t_vol["frames"])
    assert t_vol["neither"] == pytest.approx(t_vol["frames"] / 2)  # 1200 kg m-3: mass over volume


def test_overwrite_replaces_the_whole_folder(run2, tmp_path):
    folder, _ = export(run2, output=tmp_path / "out", products=("mass",))
    export(run2[:1], output=tmp_path / "out")
    assert not (folder / "rasters" / "slide_0001.tif").exists()


def test_memory_follows_the_flow_and_not_the_number_of_frames(tmp_path, monkeypatch):
    """The values of only a few frames are in memory at a time."""
    from mpmgis.maps.export import step_rasters

    frames = write_run(tmp_path / "slide", times=np.arange(24) * 0.1, dimension=3, count=50)
    alive, most, lock, usual = [0], [0], threading.RLock(), step_rasters.average_frame

    def gone():
        with lock:
            alive[0] -= 1

    def watched(frame, averaging):
        values = usual(frame, averaging)
        with lock:
            alive[0] += 1
            most[0] = max(most[0], alive[0])
            weakref.finalize(values, gone)
        return values

    monkeypatch.setattr(step_rasters, "average_frame", watched)
    export(frames, workers=2)
    assert 1 <= most[0] <= 10


def test_dask_gives_the_same_bytes(run3, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        there, _ = export(run3, output=tmp_path / "there", dask=cluster.scheduler_address, cell_size=3.0)
    here, _ = export(run3, output=tmp_path / "here", cell_size=3.0)
    assert digests(there) == digests(here)


def test_command_prints_the_project_and_the_number_of_files(run2, tmp_path, capsys):
    assert main(["export-raster", str(run2[0].parent), "-o", str(tmp_path / "out")]) == 0
    out, said = capsys.readouterr()
    assert out.splitlines() == [str(tmp_path / "out" / "slide.qgz")]
    assert re.search(rf"^wrote \d+ files to {re.escape(str(tmp_path / 'out'))} \(--list-files ", said, re.MULTILINE)


def test_command_lists_paths_where_asked_and_nothing_else(run2, tmp_path, capsys):
    words = ["export-raster", str(run2[0].parent), "-o", str(tmp_path / "out"), "--products", "p,maxima"]
    assert main([*words, "--list-files"]) == 0
    out, _ = capsys.readouterr()
    paths = out.splitlines()
    assert paths[0] == str(tmp_path / "out" / "slide.qgz")
    assert all((tmp_path / "out").joinpath(path).exists() for path in paths)
    for name in ("slide.nc", "slide.gpkg", "slide_h.vrt", "slide_Ut.vrt", "dtm.tif", "rasters/slide_max.qml"):
        assert str(tmp_path / "out" / name) in paths


def test_folder_or_pattern_name_the_same_frames(run2, tmp_path):
    a, _ = export([run2[0].parent], output=tmp_path / "a")
    b, _ = export([run2[0].parent / "frame_*.h5", run2[1]], output=tmp_path / "b")
    assert digests(a) == digests(b)


def test_local_frame_without_crs(tmp_path):
    ground = terrain()
    ground = type(ground)(type(ground.grid)(None, ground.grid.transform, ground.grid.shape), ground.elevation)
    frames = write_run(tmp_path / "slide", ground=ground, crs=None)
    folder, _ = export(frames)
    with rasterio.open(folder / "rasters/slide_0000.tif") as source:
        assert source.crs is None and source.transform == ground.grid.transform


def test_both_dimensions_in_one_run(tmp_path):
    """Columns that are converted to points (a scene in stages)."""
    frames = write_run(tmp_path / "slide", times=(0.0,), dimension=2)
    other = write_run(tmp_path / "other", times=(0.0,), dimension=3, digest="d" * 64)
    later = read_frame(other[0])
    write_frame(frames[0].with_name("frame_000001.h5"), replace(later, time=1.0))
    folder, _ = export([tmp_path / "slide"], products=("mass",))
    for k in range(2):
        assert bands(folder / "rasters" / f"slide_{k:04d}.tif")[0]["mass"].sum() > 0
