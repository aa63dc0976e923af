"""What the sum of a raster over its cells is: mass, volume, cos(slope) of the volume, or nothing, as its band says."""

import numpy as np
import pytest
import rasterio
from affine import Affine
from exporting import CRS, write_run
from hypothesis import given, settings
from hypothesis import strategies as st
from test_export_folder import export

from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import BAND, MASS, NO_VOLUME, VOLUME, VOLUME_ON_SLOPES
from mpmgis.maps.averaging.export_resolution import export_grid
from mpmgis.maps.averaging.frame_values import Averaging, average_frame
from mpmgis.maps.averaging.placement import Bed
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

PIXEL, SIDE, DENSITY = 5.0, 200.0, 300.0


def plane(degrees, facing):
    """A plane of 200 m x 200 m that falls by `degrees` in the direction `facing` [degrees from east]."""
    count = int(SIDE / PIXEL)
    grid = Grid(CRS, Affine(PIXEL, 0, 0, 0, -PIXEL, SIDE), (count, count))
    x, y = grid.xy(*np.indices(grid.shape))
    along = np.cos(np.radians(facing)) * x + np.sin(np.radians(facing)) * y
    return Terrain(grid, 2000.0 - np.tan(np.radians(degrees)) * along)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.0, 70.0),
    st.floats(0.0, 360.0),
    st.sampled_from([1.0, 2.5, 5.0, 10.0, 25.0]),
    st.sampled_from([0, 2, 5]),
)
def test_sums_over_the_cells_of_a_plane(degrees, facing, cell, spacing):
    """Columns anywhere well inside the plane, as squares (0) or spread by splines of a solver of that spacing."""
    ground = plane(degrees, facing)
    rng = np.random.default_rng(int(10 * facing))
    x, y = rng.uniform(80.0, 120.0, (2, 50))
    thickness, area = rng.uniform(0.2, 4.0, 50), np.full(50, 2.0)
    bed = ground.sample(x, y)
    volume = thickness * area
    particles = Particles(np.column_stack((x, y, bed)), np.zeros((50, 3)), DENSITY * volume, volume, thickness, area)
    frame = Frame(particles, crs=CRS, header={"cell_size": float(spacing)} if spacing else {})
    grid = export_grid(ground.grid, cell)
    averaging = Averaging(Bed.of(ground), grid, DENSITY, ("h", "t", "t_vol", "mass"))
    values = average_frame(frame, averaging).values
    total = {name: float(values[name].sum(dtype=float)) * cell**2 for name in values}
    assert total["mass"] / DENSITY == pytest.approx(volume.sum(), rel=1e-5)
    assert total["t_vol"] == pytest.approx(np.cos(np.radians(degrees)) * volume.sum(), rel=1e-3)


def test_each_band_says_what_its_sum_is():
    said = {name: quantity.total for name, quantity in BAND.items() if quantity.total}
    assert {name for name, words in said.items() if words == VOLUME} == {
        "eroded",
        "deposit",
        "thickness_end",
        "detrained",
    }
    assert said["mass"] == MASS and said["t_vol"] == VOLUME_ON_SLOPES
    assert all(said[name].startswith(NO_VOLUME) for name in ("h", "t", "h_max", "t_max"))
    lengths = {name for name, quantity in BAND.items() if quantity.unit in ("m", "kg m-2")}
    assert lengths - set(said) == {"surface_new", "bed_new"}  # elevations


@pytest.mark.parametrize("cog", [False, True])
def test_the_steps_have_a_thickness_that_can_be_summed_and_their_tags_say_so(tmp_path, cog):
    folder, _ = export(write_run(tmp_path / "slide", dimension=2), cog=cog)
    with rasterio.open(folder / "rasters" / "slide_0001.tif") as source:
        band = source.descriptions.index("t_vol [m]") + 1
        told = source.tags()["TIFFTAG_IMAGEDESCRIPTION"] if cog else source.tags(band)["meaning"]
    assert VOLUME_ON_SLOPES in told


@pytest.mark.parametrize(("cell", "said"), [(2.0, False), (4.0, False), (4.1, True), (20.0, True)])
@pytest.mark.parametrize("dimension", [2, 3])
def test_cells_larger_than_those_of_the_solver_are_reported(tmp_path, dimension, cell, said):
    frames = write_run(tmp_path / "run", dimension=dimension, header={"cell_size": 4.0, "density": 1000.0})
    _, messages = export(frames, cell_size=cell, output=tmp_path / "out")
    assert any("larger than those of the solver, 4 m" in text for text in messages) == said
