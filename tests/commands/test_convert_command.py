"""`mpmgis convert` through the command line: files, messages, refusals, and the export of its results."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from scipy import ndimage

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import Quantity
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

ROOT = Path(__file__).parents[2]
SITE = ROOT / "sample_data/lava_falls"
WEST, SOUTH, DENSITY = 600_000.0, 5_170_000.0, 1200.0


def run(*arguments):
    return main(["convert", *map(str, arguments)])


def write_scene(folder, thickness=2.0, velocity=(6.0, 0.0), crs="EPSG:32632"):
    """A slope of 0.5 eastwards and a frame of columns on it, 1 m apart."""
    import pyproj

    folder.mkdir(parents=True, exist_ok=True)
    grid = Grid(pyproj.CRS(crs), Affine(2, 0, WEST, 0, -2, SOUTH + 80), (40, 50))
    x, _ = grid.xy(*np.indices(grid.shape))
    ground = Terrain(grid, 900 - 0.5 * (x - WEST))
    write_geotiff(folder / "dtm.tif", grid, [(Quantity("elevation", "m", ""), ground.elevation)], {})
    j, i = np.mgrid[0:20, 0:30]
    x, y = 30.5 + i.ravel(), 30.5 + j.ravel()
    one = np.ones(len(x))
    particles = Particles(
        np.column_stack([x, y, 900 - 0.5 * x]),
        np.column_stack([velocity[0] * one, velocity[1] * one, -0.5 * velocity[0] * one]),
        DENSITY * thickness * one,
        thickness * one,
        thickness * one,
        one,
        np.arange(len(x), dtype=np.uint64),
    )
    frame = Frame(
        particles,
        time=3.0,
        step=7,
        dimension=2,
        crs=grid.crs,
        origin=(WEST, SOUTH, 0.0),
        dem="dtm.tif",
        header={"density": DENSITY},
    )
    write_frame(folder / "frame.h5", frame)
    return folder / "frame.h5"


def test_there_and_back_through_files(tmp_path, monkeypatch, capsys):
    source = write_scene(tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    assert run(source, "--cell", 1) == 0
    out, err = capsys.readouterr()
    assert out.strip() == "frame_points.h5"
    assert "600 columns became" in err and "are kept to" in err and "vertical momentum" in err
    points, columns = read_frame(tmp_path / "frame_points.h5"), read_frame(source)
    assert points.dimension == 3 and points.time == 3.0 and points.step == 7
    assert (tmp_path / points.dem).resolve() == tmp_path / "run/dtm.tif"
    assert points.header["cell_size"] == 1 and points.header["converted_outside_mass"] == 0
    assert points.particles.mass.sum() == pytest.approx(columns.particles.mass.sum(), rel=1e-6)
    assert set(points.particles.parent) == set(columns.particles.id)
    assert points.state["vertical_stress"].max() < 0
    assert run("frame_points.h5", "-o", "back.h5") == 0
    assert capsys.readouterr().out.strip() == "back.h5"
    back = read_frame(tmp_path / "back.h5").particles
    for name in ("mass", "thickness", "area"):
        assert getattr(back, name) == pytest.approx(getattr(columns.particles, name), rel=1e-4)
    assert back.velocity == pytest.approx(columns.particles.velocity, abs=1e-5)
    assert main(["info", "--json", "frame_points.h5"]) == 0
    assert json.loads(capsys.readouterr().out)["dimension"] == 3


def test_printed_algorithm_names_its_defects(tmp_path, monkeypatch, capsys):
    source = write_scene(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert run(source, "--paper", "--spacing", 0.3) == 0
    err = capsys.readouterr().err
    for word in (
        "Eq (2) puts points on the bed",
        "40 % too large",
        "floor in Eq (1)",
        "not along the slope",
        "no initial stress",
        "not split sideways",
        "eps_m",
        "scatter of particle masses",
    ):
        assert word in err
    assert "takes off at up to 2.68 m/s" in err and "0/0" not in err
    assert "cell_size" not in read_frame(tmp_path / "frame_points.h5").header
    assert run(source, "--paper", "--spacing", 1.5, "-o", "x.h5") == 2
    assert "0/0" in capsys.readouterr().err and not (tmp_path / "x.h5").exists()


def test_detached_mass_is_refused_or_kept(tmp_path, monkeypatch, capsys):
    source = write_scene(tmp_path, velocity=(20.0, 0.0))
    monkeypatch.chdir(tmp_path)
    assert run(source, "--cell", 1, "-q") == 0
    frame = read_frame("frame_points.h5")
    up = frame.particles.position[:, 0] > 0
    frame.particles.velocity[up, 2] += 12.0
    write_frame("flying.h5", frame)
    capsys.readouterr()
    assert run("flying.h5") == 2
    assert "moving across it" in one_line(capsys)
    assert not (tmp_path / "flying_columns.h5").exists()
    assert run("flying.h5", "--detached", "keep", "--by", "cell", "-o", "c.gpkg") == 0
    assert capsys.readouterr().out.split() == ["c.gpkg", "c_points.h5"]
    kept = read_frame("c_points.h5").particles
    assert kept.mass.sum() == pytest.approx(frame.particles.mass[up].sum(), rel=0.1)  # cells have both
    assert kept.velocity[:, 2].max() == frame.particles.velocity[:, 2].max()
    before = sorted(path.name for path in tmp_path.iterdir())
    assert run("flying.h5", "--detached", "keep", "-o", "c.h5") == 2  # c_points.h5 is there
    assert "c_points.h5 exists already" in one_line(capsys)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def one_line(capsys):
    err = capsys.readouterr().err.strip()
    assert "\n" not in err and "Traceback" not in err
    return err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.h5"], "no such file"),
        (["frame.h5", "--spacing", "0"], "expected a number above 0"),
        (["frame.h5", "--spacing", "nan"], "expected a finite number"),
        (["frame.h5", "--spacing", "1e-9"], "wider --spacing"),
        (["frame.h5", "--cell", "1e9"], "--cell got cells of 1e+09 m, expected at most the longer side of the DTM"),
        (["points.h5", "--cell", "1e9"], "--cell got cells of 1e+09 m, expected at most the longer side of the DTM"),
        (["points.h5", "--cell", "1e-9"], "expected a number of at least 1e-06"),
        (["frame.h5", "--relevel"], "relevel requires"),
        (["frame.h5", "--paper", "--cell", "1"], "--cell contradicts --paper"),
        (["frame.h5", "--paper", "--vertical-velocity", "tangent"], "--vertical-velocity contradicts"),
        (["frame.h5", "--vertical-velocity", "up"], "invalid choice"),
        (["frame.h5", "--by", "parent"], "--by requires --to columns"),
        (["frame.h5", "--to", "columns"], "already contains columns"),
        (["frame.h5", "--to", "columns", "--paper"], "--paper requires --to points"),
        (["points.h5", "--to", "points"], "already contains points"),
        (["points.h5", "--spacing", "1"], "--spacing requires --to points"),
        (["frame.h5", "-o", "points.csv"], "points are written as frames"),
        (["points.h5", "-o", "columns.xyz"], "format .xyz is unknown"),
        (["frame.h5", "-o", "."], "exists already"),
        (["frame.h5", "-o", "frame.h5"], "exists already"),
        (["frame.h5", "-o", "frame.h5", "--overwrite"], "is an input and would be replaced"),
        (["frame.h5", "-o", "dtm.tif.h5", "--dem", "gone.tif"], "no such file"),
        (["frame.h5", "--dem", "other.tif"], "give the DTM that the run used"),
        (["junk.h5"], "neither a frame of mpmgis"),
        (["far.h5"], "none of the 600 columns"),
        (["thin.h5"], "thickness is -2"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_refusals(tmp_path, monkeypatch, capsys, arguments, message):
    write_scene(tmp_path)
    write_scene(tmp_path / "elsewhere", crs="EPSG:32633")
    shutil.copy(tmp_path / "elsewhere/dtm.tif", tmp_path / "other.tif")
    monkeypatch.chdir(tmp_path)
    assert run("frame.h5", "-o", "points.h5", "-q") == 0
    (tmp_path / "junk.h5").write_bytes(b"junk")
    frame = read_frame("frame.h5")
    frame.particles.position[:, 0] += 5000
    write_frame("far.h5", frame)
    frame.particles.thickness[:] = -2
    write_frame("thin.h5", frame)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    capsys.readouterr()
    try:
        code = run(*arguments)
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert message in one_line(capsys)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_a_third_party_frame_without_mass_or_parents(tmp_path, monkeypatch, capsys):
    """Points of another code: volume only, no parents; density is said, cells of the DTM are the columns."""
    source = write_scene(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert run(source, "--cell", 1, "-o", "p.h5", "-q") == 0
    import h5py

    with h5py.File("p.h5", "r+") as file:
        for name in ("mass", "parent", "id"):
            del file["particles"][name]
        del file["particles"].attrs["density"]
    assert run("p.h5", "-o", "c.h5") == 0
    assert "a density of 1000 kg m-3 is assumed" in capsys.readouterr().err
    columns = read_frame("c.h5").particles
    assert (columns.area == 4.0).all() and columns.thickness.max() == pytest.approx(2.0, rel=1e-3)


def exported(folder, capsys):
    """Bands of the exported step by name."""
    assert main(["export-raster", str(folder), "--no-qgis", "-q", "--extent", "dtm", "--cs-e", "10"]) == 0
    capsys.readouterr()
    step = next((folder.parent / f"{folder.name}_gis/rasters").glob("*_0000.tif"))
    with rasterio.open(step) as raster:
        return dict(zip(raster.descriptions, raster.read(), strict=True))


@pytest.mark.skipif(not SITE.exists(), reason="no sample data")
def test_export_gives_the_thickness_back(tmp_path, capsys):
    """The demo's release as points: depth within 1 % where points are fine, volume thickness at any spacing."""
    seed = tmp_path / "columns/seed.h5"
    dem, release = next(SITE.glob("*dem*.tif")), SITE / "lava_falls_release.shp"
    assert main(["seed", "--dem", str(dem), "--release", str(release), "--spacing", "2.5", "-o", str(seed), "-q"]) == 0
    columns = exported(tmp_path / "columns", capsys)
    depth = columns["h [m]"]
    inside = ndimage.binary_erosion((depth > 1) & (columns["t_vol [m]"] > 0.99 * depth))  # cells that are all covered
    assert inside.sum() > 100
    for spacing, cell in ((0.1, None), (0.5, 2.0)):
        points = tmp_path / f"points_{spacing}/seed.h5"
        more = [] if cell is None else ["--cell", cell]
        assert run(seed, "--spacing", spacing, "-o", points, "-q", *more) == 0
        back = exported(points.parent, capsys)
        assert np.abs(back["t_vol [m]"][inside] / depth[inside] - 1).max() < 1e-6
        slices = 1 - 0.5 * spacing / 5.9  # the topmost point is half a slice under the surface
        ratio = back["h [m]"][inside] / depth[inside]
        assert ratio == pytest.approx(np.full(ratio.shape, slices), abs=0.01)
        if spacing == 0.1:
            assert np.abs(ratio - 1).max() < 0.01
