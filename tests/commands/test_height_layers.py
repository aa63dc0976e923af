"""`export-raster --layers`: density and pressure by height over the bed of a uniform block, and what is conserved."""

import numpy as np
import pytest
import rasterio
from block_frames import DENSITY, MIDDLE, SIDE, block, write_block_run
from slope_site import SOUTH, WEST

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.maps.averaging.height_layers import frame_layers, height_layers
from mpmgis.maps.averaging.placement import Bed, place
from mpmgis.terrain.dtm import read_terrain

PLACES, SPEED = (150.0, 600.0), 10.0  # on the slope of 0.5, on the flat


@pytest.fixture
def run(tmp_path):
    folder = write_block_run(tmp_path, PLACES, (0.0, 1.0), (SPEED, SPEED), dimension=3)
    for path, x in zip(sorted(folder.glob("*.h5")), PLACES, strict=True):  # layers of 0.5 m, points 0.5 m apart
        frame = read_frame(path)
        object.__setattr__(frame, "particles", block(x, SPEED, 3, spacing=0.5))
        write_frame(path, frame)
    return folder


def inside(path, x):
    """Bands of the cells in the middle of the block, float[bands, cells], by name."""
    with rasterio.open(path) as source:
        row, column = source.index(WEST + x, SOUTH + MIDDLE)
        half = int(SIDE / source.res[0] / 2) - 1
        values = source.read()[:, row - half : row + half, column - half : column + half]
        return dict(zip(source.descriptions, values.reshape(source.count, -1), strict=True))


@pytest.mark.parametrize(("step", "x", "speed2"), [(0, 150.0, 125.0), (1, 600.0, 100.0)])
def test_a_uniform_block_has_its_density_and_pressure_in_every_full_layer(tmp_path, run, step, x, speed2):
    assert main(["export-raster", str(run), "--no-qgis", "--layers", "0,1,1.5,4"]) == 0
    bands = inside(tmp_path / "run_gis" / "layers" / f"run_{step:04d}.tif", x)
    assert list(bands) == [
        "rho_0_1 [kg m-3]",
        "p_0_1 [Pa]",
        "rho_1_1.5 [kg m-3]",
        "p_1_1.5 [Pa]",
        "rho_1.5_4 [kg m-3]",
        "p_1.5_4 [Pa]",
        "mass_outside [kg m-2]",
    ]
    for name in ("0_1", "1_1.5"):
        assert bands[f"rho_{name} [kg m-3]"] == pytest.approx(DENSITY, rel=1e-6)
        assert bands[f"p_{name} [Pa]"] == pytest.approx(DENSITY * speed2, rel=1e-6)
    depth = 2.0 * (np.sqrt(0.8) if step == 0 else 1.0)  # normal to the bed
    assert bands["rho_1.5_4 [kg m-3]"] == pytest.approx(DENSITY * (depth - 1.5) / 2.5, rel=1e-5)
    assert bands["mass_outside [kg m-2]"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("edges", [(0.0, 1.0, 2.0, 4.0), (0.3, 0.7), (0.0, 0.9, 1.1)])
def test_layers_and_what_is_outside_hold_the_mass_of_each_cell(run, edges):
    terrain = read_terrain(run / "terrain.tif")
    bed, frame = Bed.of(terrain), read_frame(run / "frame_000000.h5")
    found = frame_layers(frame, bed, terrain.grid, edges)
    x, y = frame.map_xy()
    row, column = (np.floor(values + 0.5).astype(int) for values in terrain.grid.rowcol(x, y))
    of_cells = np.bincount(row * terrain.grid.shape[1] + column, frame.particles.mass)[found.index]
    held = (found.density * np.diff(edges)).sum(axis=1) / found.upright + found.outside
    assert held * terrain.grid.cell_area == pytest.approx(of_cells, rel=1e-12)
    assert found.outside.max() > 0 or edges[-1] > 2


def test_material_below_the_bed_counts_in_a_layer_from_zero_on_and_is_outside_of_a_higher_one(run):
    terrain = read_terrain(run / "terrain.tif")
    bed, frame = Bed.of(terrain, standoff=0.5), read_frame(run / "frame_000001.h5")  # all is 0.5 m lower
    placed = place(frame, bed)
    low, high = (height_layers(frame, placed, bed, terrain.grid, edges) for edges in ((0.0, 1.0), (0.5, 1.0)))
    assert low.density[:, 0] == pytest.approx(1.5 * DENSITY, rel=1e-9) and low.outside == pytest.approx(0.5 * DENSITY)
    assert high.density[:, 0] == pytest.approx(DENSITY, rel=1e-9) and high.outside == pytest.approx(1.5 * DENSITY)


def test_refusals_are_one_line(tmp_path, capsys):
    run = write_block_run(tmp_path)
    for layers, words in (("0,1", "needs 3D frames"), ("0,2,1", "ascending"), ("-1,1", "ascending"), ("3", "two or")):
        capsys.readouterr()
        try:
            assert main(["export-raster", str(run), f"--layers={layers}"]) == 2
        except SystemExit as ended:
            assert ended.code == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and words in said[0], said
    assert not (tmp_path / "run_gis").exists()
