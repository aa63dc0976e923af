"""Invalid input of `mpmgis export-raster`: a one-line error, exit code 2, and no files."""

from dataclasses import replace

import h5py
import numpy as np
import pyproj
import pytest
import rasterio
from exporting import AFFINES, terrain, write_run

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.laws.quantities import Quantity
from mpmgis.terrain.raster_output import write_geotiff

FRAME = "frame_000001.h5"


@pytest.fixture
def run(tmp_path):
    """A folder `slide` with two good frames and their terrain."""
    write_run(tmp_path / "slide", times=(0.0, 1.0), dimension=3, count=40)
    return tmp_path / "slide"


def listing(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def refused(capsys, folder, *words, says=()):
    """Run the command on `folder`: it must fail with one line that contains `says`, and change no files."""
    before = listing(folder.parent)
    try:
        code = main(["export-raster", *map(str, words or [folder])])
    except SystemExit as stop:  # argparse
        code = stop.code
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    lines = [line for line in err.strip().splitlines() if not line.startswith("frame ")]  # progress, on a slow machine
    assert len(lines) == 1, err
    for word in (says,) if isinstance(says, str) else says:
        assert word in err, err
    assert "Traceback" not in err and "internal error" not in err
    assert listing(folder.parent) == before


def edit(run, change):
    """Open the second frame for `change(file)`."""
    with h5py.File(run / FRAME, "r+") as file:
        change(file)


def set_particles(name, change):
    """A change that replaces particles/`name` by `change(values)`."""

    def apply(file):
        values = change(file["particles"][name][()])
        del file["particles"][name]
        file["particles"][name] = values

    return apply


def with_value(value, *where):
    def apply(values):
        values[where or 0] = value
        return values

    return apply


# --- frames ----------------------------------------------------------------------------------------------------------


def test_missing_file(run, capsys):
    refused(capsys, run, run / "frame_000007.h5", says="no such file")


def test_folder_without_frames(run, capsys):
    (run.parent / "empty").mkdir()
    refused(capsys, run, run.parent / "empty", says="no frame")


def test_pattern_without_match(run, capsys):
    refused(capsys, run, run / "step_*.h5", says="matches")


def test_empty_file(run, capsys):
    (run / FRAME).write_bytes(b"")
    refused(capsys, run, says=FRAME)


def test_junk(run, capsys):
    (run / FRAME).write_bytes(np.random.default_rng(0).bytes(5000))
    refused(capsys, run, says=FRAME)


def test_text_instead_of_a_frame(run, capsys):
    (run / "notes.txt").write_text("hello")
    refused(capsys, run, run / "notes.txt", says="notes.txt")


def test_raster_instead_of_a_frame(run, capsys):
    refused(capsys, run, run / "terrain.tif", says="terrain.tif")


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_truncated(run, capsys, share):
    content = (run / FRAME).read_bytes()
    (run / FRAME).write_bytes(content[: int(share * len(content))])
    refused(capsys, run, says=FRAME)


def test_other_hdf5(run, capsys):
    with h5py.File(run / FRAME, "w") as file:
        file["x"] = np.ones(3)
    refused(capsys, run, says=("of hdf5", FRAME))


def test_newer_format(run, capsys):
    edit(run, lambda file: file.attrs.update(format_version=99))
    refused(capsys, run, says=("version 99", "update"))


@pytest.mark.parametrize("name", ["position", "velocity", "mass", "volume"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_finite(run, capsys, name, value):
    edit(run, set_particles(name, with_value(value, 3)))
    refused(capsys, run, says=(name, "row 3"))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("position", lambda v: v[:, :2]),
        ("velocity", lambda v: v[:-1]),
        ("mass", lambda v: v[:5]),
        ("mass", lambda v: v.reshape(2, -1)),
        ("volume", lambda v: v.astype("S8")),
        ("position", lambda v: v[:0]),
    ],
)
def test_wrong_shapes(run, capsys, name, change):
    edit(run, set_particles(name, change))
    refused(capsys, run, says=FRAME)


@pytest.mark.parametrize("name", ["position", "velocity"])
def test_missing_data(run, capsys, name):
    edit(run, lambda file: file["particles"].pop(name))
    refused(capsys, run, says=name)


def test_neither_mass_nor_volume(run, capsys):
    edit(run, lambda file: [file["particles"].pop(name) for name in ("mass", "volume")])
    refused(capsys, run, says="mass")


@pytest.mark.parametrize("value", [0.0, -1.0])
@pytest.mark.parametrize("name", ["mass", "volume"])
def test_impossible_mass(run, capsys, name, value):
    edit(run, set_particles(name, with_value(value, 2)))
    refused(capsys, run, says=(name, "row 2"))


@pytest.mark.parametrize("value", [np.nan, "soon"])
def test_impossible_time(run, capsys, value):
    edit(run, lambda file: file.attrs.update(time=value))
    refused(capsys, run, says="time")


def test_impossible_dimension(run, capsys):
    edit(run, lambda file: file.attrs.update(dimension=4))
    refused(capsys, run, says="dimension")


@pytest.mark.parametrize("value", [-3.0, float("nan"), "[[]]", np.array([1.0, 2.0])], ids=str)
@pytest.mark.parametrize("name", ["density", "cell_size", "converted_spacing"])
def test_impossible_sizes_in_the_frames(run, capsys, name, value):
    for frame in run.glob("*.h5"):
        with h5py.File(frame, "r+") as file:
            file["particles"].attrs[name] = value
    refused(capsys, run, says=name)


def test_unreadable_crs_of_a_frame(run, capsys):
    edit(run, lambda file: file.attrs.update(crs="PROJCRS[no"))
    refused(capsys, run, says="crs")


def test_two_frames_of_one_time(run, capsys):
    edit(run, lambda file: file.attrs.update(time=0.0))
    refused(capsys, run, says="same time")


def test_frames_of_two_scenes(run, capsys):
    edit(run, lambda file: file.attrs.update(digest="e" * 64))
    refused(capsys, run, says="different scenes")


def test_frames_of_two_folders(run, capsys):
    write_run(run.parent / "other", times=(5.0,), dimension=3, count=5)
    refused(capsys, run, run, run.parent / "other", says="different folders")


def test_frames_in_two_crss(run, capsys):
    frame = read_frame(run / FRAME)
    write_frame(run / FRAME, replace(frame, crs=pyproj.CRS.from_epsg(32633)))
    refused(capsys, run, says=("EPSG:32633", "EPSG:32632"))


# --- terrain ---------------------------------------------------------------------------------------------------------


def test_frames_in_another_crs_than_the_terrain(run, capsys):
    ground = terrain()
    grid = replace(ground.grid, crs=pyproj.CRS.from_epsg(32633))
    write_geotiff(run / "other.tif", grid, [(Quantity("elevation", "m", ""), ground.elevation)], {})
    refused(capsys, run, run, "--dem", run / "other.tif", says=("EPSG:32633", "EPSG:32632"))


@pytest.mark.parametrize("options", [(), ("--cs-e", "2"), ("--cs-e", "auto"), ("--dt-e", "auto")])
def test_no_particle_on_the_terrain(run, capsys, options):
    for path in run.glob("*.h5"):
        frame = read_frame(path)
        write_frame(path, replace(frame, origin=(400000.0, 5000000.0, 0.0)))
    refused(capsys, run, run, *options, says=("none of its 40 particles", "terrain.tif"))


def test_one_frame_off_the_terrain(run, capsys):
    frame = read_frame(run / FRAME)
    write_frame(run / FRAME, replace(frame, origin=(400000.0, 5000000.0, 0.0)))
    refused(capsys, run, says=(FRAME, "none of its 40 particles"))


def test_terrain_that_the_frames_name_is_gone(run, capsys):
    (run / "terrain.tif").unlink()
    refused(capsys, run, says=("terrain.tif", "--dem"))


def test_frames_that_name_no_terrain(run, capsys):
    for path in run.glob("*.h5"):
        with h5py.File(path, "r+") as file:
            file.attrs["dem"] = ""
    refused(capsys, run, says="--dem")


def test_terrain_missing(run, capsys):
    refused(capsys, run, run, "--dem", run / "nowhere.tif", says="nowhere.tif")


def test_terrain_junk(run, capsys):
    (run / "junk.tif").write_bytes(b"II*\0" + np.random.default_rng(0).bytes(2000))
    refused(capsys, run, run, "--dem", run / "junk.tif", says="junk.tif")


def test_terrain_truncated(run, capsys):
    content = (run / "terrain.tif").read_bytes()
    (run / "terrain.tif").write_bytes(content[: len(content) // 2])
    refused(capsys, run, says="terrain.tif")


def test_terrain_of_nodata(run, capsys):
    ground = terrain()
    nothing = np.full_like(ground.elevation, np.nan)
    write_geotiff(run / "terrain.tif", ground.grid, [(Quantity("elevation", "m", ""), nothing)], {})
    refused(capsys, run, says="nodata")


def test_terrain_in_degrees(run, capsys):
    with rasterio.open(
        run / "degrees.tif",
        "w",
        driver="GTiff",
        width=9,
        height=9,
        count=1,
        dtype="float32",
        crs="EPSG:4326",
        transform=rasterio.Affine(0.01, 0, 10, 0, -0.01, 46),
    ) as target:
        target.write(np.ones((9, 9), "f4"), 1)
    refused(capsys, run, run, "--dem", run / "degrees.tif", says="degrees")


def test_crs_that_contradicts_the_terrain(run, capsys):
    refused(capsys, run, run, "--dem", run / "terrain.tif", "--crs", "EPSG:2056", says="EPSG:2056")


def test_invalid_crs(run, capsys):
    refused(capsys, run, run, "--crs", "EPSG:mountain", says="--crs")


def test_band_that_the_terrain_does_not_have(run, capsys):
    refused(capsys, run, run, "--dem-band", "3", says="band 3")


def test_ascii_grids_of_a_rotated_terrain(tmp_path, capsys):
    folder = tmp_path / "slide"
    write_run(folder, times=(0.0,), dimension=3, count=40, ground=terrain(AFFINES["rotated"]))
    refused(capsys, folder, folder, "--naming", "iseesnow", says=f"{folder}/terrain.tif terrain_warped.tif")


# --- options ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--cs-e", "0"),
        ("--cs-e", "-1"),
        ("--cs-e", "nan"),
        ("--cs-e", "wide"),
        ("--cs-e", "inf"),
        ("--dt-e", "0"),
        ("--dt-e", "-0.2"),
        ("--dt-e", "inf"),
        ("--dt-e", "often"),
        ("--percentile", "0"),
        ("--percentile", "101"),
        ("--percentile", "half"),
        ("--min-depth", "-1"),
        ("--min-depth", "nan"),
        ("--density", "0"),
        ("--density", "-5"),
        ("--standoff", "high"),
        ("--standoff", "nan"),
        ("--standoff", "1e9"),
        ("--workers", "0"),
        ("--workers", "-2"),
        ("--workers", "two"),
        ("--bed", "cubic"),
        ("--extent", "world"),
        ("--layout", "pile"),
        ("--naming", "mine"),
        ("--qgis-min", "1.8"),
        ("--dem-band", "0"),
        ("--products", "t_vol,,p"),
    ],
)
def test_impossible_option(run, capsys, option, value):
    refused(capsys, run, run, f"{option}={value}", says=option)


@pytest.mark.parametrize("name", ["depth", "H", "h_max", "t_vol p"])
def test_unknown_product(run, capsys, name):
    refused(capsys, run, run, "--products", name, says=(repr(name), "t_vol"))


def test_unknown_option(run, capsys):
    refused(capsys, run, run, "--cell-size", "3", says="--cell-size")


def test_no_frame_at_all(run, capsys):
    refused(capsys, run, "--cs-e", "2", says="RESULTS")


def test_cells_too_fine(run, capsys):
    refused(capsys, run, run, "--cs-e", "1e-5", "--extent", "dtm", says="--cs-e")
    refused(capsys, run, run, "--cs-e", "1e-320", says="--cs-e")


@pytest.mark.thorough
def test_dask_without_answer(run, capsys):
    refused(capsys, run, run, "--dask", "tcp://127.0.0.1:1", says="--dask")
    refused(capsys, run, run, "--dask", "nonsense://", says="--dask")


# --- output ----------------------------------------------------------------------------------------------------------


def test_output_exists(run, capsys):
    (run.parent / "slide_gis").mkdir()
    (run.parent / "slide_gis" / "mine.txt").write_text("precious")
    refused(capsys, run, says=("exists", "--overwrite"))


def test_overwrite_keeps_folders_that_are_not_exports(run, capsys):
    (run.parent / "slide_gis").mkdir()
    (run.parent / "slide_gis" / "mine.txt").write_text("precious")
    refused(capsys, run, run, "--overwrite", says="slide_gis")


def test_overwrite_keeps_the_frames(run, capsys):
    refused(capsys, run, run, "--overwrite", "-o", run, says="slide")
    refused(capsys, run, run, "--overwrite", "-o", run.parent, says=run.parent.name)


def test_output_is_a_file(run, capsys):
    (run.parent / "file").write_text("x")
    refused(capsys, run, run, "-o", run.parent / "file", says="file")
    refused(capsys, run, run, "--overwrite", "-o", run.parent / "file", says="file")
    refused(capsys, run, run, "-o", run.parent / "file" / "out", says="file")


def test_output_without_write_permission(run, capsys):
    refused(capsys, run, run, "-o", "/proc/slide_gis", says="/proc/slide_gis")


def test_disk_full(run, capsys, monkeypatch):
    """A failure during the export leaves no files."""
    from mpmgis.terrain import raster_output, raster_series

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(raster_output, "write_rows", full)
    monkeypatch.setattr(raster_series, "write_rows", full)
    refused(capsys, run, says="disk is full")


def test_valid_run_is_accepted(run, capsys):
    """The unchanged fixture."""
    assert main(["export-raster", str(run), "--no-qgis", "--list-files"]) == 0
    assert "slide_0001.tif" in capsys.readouterr().out
