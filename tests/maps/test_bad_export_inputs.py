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


def refused(capsys, folder, *words, says):
    """Run the command with `words`: it must fail with one line that contains `says`, and change no files."""
    before = listing(folder.parent)
    try:
        code = main(["export-raster", *map(str, words)])
    except SystemExit as stop:  # argparse
        code = stop.code
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    lines = [line for line in err.strip().splitlines() if not line.startswith("frame ")]  # progress, on a slow machine
    assert len(lines) == 1, err
    for word in says:
        assert word in err, err
    assert "Traceback" not in err and "internal error" not in err
    assert listing(folder.parent) == before


def edit(change, every=False):
    """A damage: `change(file)` to the second frame, or to every one."""

    def damage(run):
        for path in sorted(run.glob("*.h5")) if every else [run / FRAME]:
            with h5py.File(path, "r+") as file:
                change(file)

    return damage


def again(every=False, **changes):
    """A damage: the second frame, or every one, is written again with other fields."""

    def damage(run):
        for path in run.glob("*.h5") if every else [run / FRAME]:
            write_frame(path, replace(read_frame(path), **changes))

    return damage


def put(name, content):
    """A damage: a file beside the frames, or in place of one."""
    return lambda run: (run / name).write_bytes(content)


def cut(name, share):
    return lambda run: (run / name).write_bytes((run / name).read_bytes()[: int(share * (run / name).stat().st_size)])


def no_damage(run):
    pass


def foreign(run):
    """HDF5 of another program in place of a frame."""
    with h5py.File(run / FRAME, "w") as file:
        file["x"] = np.ones(3)


def others(run):
    """A folder with a file of someone else where the output goes."""
    (run.parent / "slide_gis").mkdir()
    (run.parent / "slide_gis" / "mine.txt").write_text("precious")


def other_terrain(name, epsg=32632, elevation=None, **placed):
    """A damage: a terrain of the frames' cells in another CRS, of other heights or elsewhere."""

    def damage(run):
        ground = terrain()
        heights = ground.elevation if elevation is None else np.full_like(ground.elevation, elevation)
        grid = replace(ground.grid, crs=pyproj.CRS.from_epsg(epsg), **placed)
        write_geotiff(run / name, grid, [(Quantity("elevation", "m", ""), heights)], {})

    return damage


AWAY = (400000.0, 5000000.0, 0.0)
DEGREES = rasterio.Affine(0.01, 0, 10, 0, -0.01, 46)
SIZES = [-3.0, float("nan"), "[[]]", np.array([1.0, 2.0])]
REFUSED = {  # damage, words of the command after the folder (which {run} is, too), what the line says
    # frames: damage within one is refused by `read_frame`, see tests/frames/test_frames.py
    "missing file": (no_damage, "{run}/frame_000007.h5", "no such file"),
    "folder without frames": (lambda run: (run.parent / "empty").mkdir(), "{run}/../empty", "no frame"),
    "pattern without match": (no_damage, "{run}/step_*.h5", "matches"),
    "text instead of a frame": (put("notes.txt", b"hello"), "{run}/notes.txt", "notes.txt"),
    "raster instead of a frame": (no_damage, "{run}/terrain.tif", "terrain.tif"),
    "empty frame": (put(FRAME, b""), "{run}", FRAME),
    "truncated frame": (cut(FRAME, 0.6), "{run}", FRAME),
    "other HDF5": (foreign, "{run}", "of hdf5", FRAME),
    "value that is not finite": (
        edit(lambda file: file["particles/velocity"].write_direct(np.full((40, 3), np.nan))),
        "{run}",
        FRAME,
        "velocity",
        "row 0",
    ),
    "unreadable CRS of a frame": (edit(lambda file: file.attrs.update(crs="PROJCRS[no")), "{run}", "crs"),
    "two frames of one time": (edit(lambda file: file.attrs.update(time=0.0)), "{run}", "same time"),
    "frames of two scenes": (edit(lambda file: file.attrs.update(digest="e" * 64)), "{run}", "different scenes"),
    "frames of two folders": (
        lambda run: write_run(run.parent / "other", times=(5.0,), dimension=3, count=5),
        "{run} {run}/../other",
        "different folders",
    ),
    "frames in two CRSs": (again(crs=pyproj.CRS.from_epsg(32633)), "{run}", "EPSG:32633", "EPSG:32632"),
    **{
        f"{name} {value} in the frames": (
            edit(lambda file, name=name, value=value: file["particles"].attrs.update({name: value}), every=True),
            "{run}",
            name,
        )
        for name in ("density", "cell_size", "converted_spacing")
        for value in SIZES
    },
    # terrain
    "terrain in another CRS than the frames": (
        other_terrain("other.tif", 32633),
        "{run} --dem {run}/other.tif",
        "EPSG:32633",
        "EPSG:32632",
    ),
    **{
        f"no particle on the terrain{options}": (
            again(every=True, origin=AWAY),
            f"{{run}}{options}",
            "none of its 40 particles",
            "terrain.tif",
        )
        for options in ("", " --cs-e 2", " --cs-e auto", " --dt-e auto")
    },
    "one frame off the terrain": (again(origin=AWAY), "{run}", FRAME, "none of its 40 particles"),
    "terrain of the frames gone": (lambda run: (run / "terrain.tif").unlink(), "{run}", "terrain.tif", "--dem"),
    "no terrain named": (edit(lambda file: file.attrs.update(dem=""), every=True), "{run}", "--dem"),
    "terrain missing": (no_damage, "{run} --dem {run}/nowhere.tif", "nowhere.tif"),
    "terrain junk": (put("junk.tif", b"II*\0" + bytes(range(256)) * 8), "{run} --dem {run}/junk.tif", "junk.tif"),
    "terrain truncated": (cut("terrain.tif", 0.5), "{run}", "terrain.tif"),
    "terrain of nodata": (other_terrain("terrain.tif", elevation=np.nan), "{run}", "nodata"),
    "terrain in degrees": (
        other_terrain("degrees.tif", 4326, 1.0, transform=DEGREES),
        "{run} --dem {run}/degrees.tif",
        "degrees",
    ),
    "CRS that contradicts the terrain": (no_damage, "{run} --dem {run}/terrain.tif --crs EPSG:2056", "EPSG:2056"),
    "CRS of no code": (no_damage, "{run} --crs EPSG:mountain", "--crs"),
    "band that the terrain has not": (no_damage, "{run} --dem-band 3", "band 3"),
    # options
    **{
        option: (no_damage, f"{{run}} {option}", option.partition("=")[0])
        for option in (
            *["--cs-e=0", "--cs-e=-1", "--cs-e=nan", "--cs-e=wide", "--cs-e=inf", "--cs-e=1e-320"],
            *["--dt-e=0", "--dt-e=-0.2", "--dt-e=inf", "--dt-e=often"],
            *["--percentile=0", "--percentile=101", "--percentile=half", "--min-depth=-1", "--min-depth=nan"],
            *["--density=0", "--density=-5", "--standoff=high", "--standoff=nan", "--standoff=1e9"],
            *["--workers=0", "--workers=-2", "--workers=two", "--bed=cubic", "--extent=world", "--layout=pile"],
            *["--naming=mine", "--qgis-min=1.8", "--dem-band=0", "--products=t_vol,,p", "--cell-size=3"],
        )
    },
    "cells too fine": (no_damage, "{run} --cs-e 1e-5 --extent dtm", "--cs-e"),
    **{
        f"product {name}": (no_damage, f"{{run}} --products={name}", repr(name), "t_vol")
        for name in ("depth", "H", "h_max", "t_vol+p")
    },
    "no frame at all": (no_damage, "--cs-e 2", "RESULTS"),
    # output
    "output exists": (others, "{run}", "exists", "--overwrite"),
    "output that is no export": (others, "{run} --overwrite", "slide_gis"),
    "output over the frames": (no_damage, "{run} --overwrite -o {run}", "slide"),
    "output over the folder of the frames": (no_damage, "{run} --overwrite -o {run}/..", "{run.parent.name}"),
    "output is a file": (put("file", b"x"), "{run} -o {run}/file", "file"),
    "output is a file to overwrite": (put("file", b"x"), "{run} --overwrite -o {run}/file", "file"),
    "output below a file": (put("file", b"x"), "{run} -o {run}/file/out", "file"),
    "output without permission": (no_damage, "{run} -o /proc/slide_gis", "/proc/slide_gis"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(run, capsys, case):
    damage, words, *says = REFUSED[case]
    damage(run)
    refused(capsys, run, *words.format(run=run).split(), says=[word.format(run=run) for word in says])


def test_ascii_grids_of_a_rotated_terrain(tmp_path, capsys):
    folder = tmp_path / "slide"
    write_run(folder, times=(0.0,), dimension=3, count=40, ground=terrain(AFFINES["rotated"]))
    refused(capsys, folder, folder, "--naming", "iseesnow", says=[f"{folder}/terrain.tif terrain_warped.tif"])


@pytest.mark.thorough
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://"])
def test_dask_without_answer(run, capsys, address):
    refused(capsys, run, run, "--dask", address, says=["--dask"])


def test_disk_full(run, capsys, monkeypatch):
    """A failure during the export leaves no files."""
    from mpmgis.terrain import raster_output, raster_series

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(raster_output, "write_rows", full)
    monkeypatch.setattr(raster_series, "write_rows", full)
    refused(capsys, run, run, says=["disk is full"])


def test_valid_run_is_accepted(run, capsys):
    """The unchanged fixture."""
    assert main(["export-raster", str(run), "--no-qgis", "--list-files"]) == 0
    assert "slide_0001.tif" in capsys.readouterr().out
