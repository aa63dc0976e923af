"""Particles of another 3D code (Matter) on its terrain, where the project's data folder is at hand."""

import re
from pathlib import Path

import numpy as np
import pyproj
import pytest

from mpmgis.frames.particles import Frame, Particles
from mpmgis.maps.averaging.band_products import cell_values
from mpmgis.maps.averaging.cell_averages import bin_frame
from mpmgis.maps.averaging.export_resolution import export_grid
from mpmgis.maps.averaging.frame_values import automatic_standoff, survey_frame
from mpmgis.maps.averaging.placement import Bed, place

DATA = Path(__file__).parents[2] / "../shared/data/matter_terrain"
DENSITY = 1500.0
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no third-party data: ../shared/data/matter_terrain")


@pytest.fixture(scope="module")
def ground():
    from mpmgis.terrain.dtm import read_terrain

    return read_terrain(DATA / "terrain_epsg32632.asc", "EPSG:32632")


def frame(number):
    """Frame `number`: y is up, z is south; every particle has the volume that info.txt says."""
    content = (DATA / f"particles_f{number}.ply").read_bytes()
    head, body = content.split(b"end_header\n", 1)
    count = int(re.search(rb"element vertex (\d+)", head).group(1))
    x, y, z, vx, vy, vz = np.frombuffer(body, "<f8").reshape(count, -1).T[:6]
    volume = np.full(count, float((DATA / "info.txt").read_text().split()[4]))
    particles = Particles(
        np.stack([x, -z, y], axis=1), np.stack([vx, -vz, vy], axis=1), DENSITY * volume, volume.copy()
    )
    return Frame(particles, dimension=3, crs=pyproj.CRS.from_epsg(32632), origin=(600000.0, 5170000.0, 0.0))


def numbers():
    return sorted(int(path.stem[11:]) for path in DATA.glob("particles_f*.ply"))


def volumes(ground, bed, particles):
    """(from mass, highest minus bed, highest minus lowest) [m3], each vertical, over the DTM's cells."""
    cells = bin_frame(particles, place(particles, bed), bed, export_grid(ground.grid), DENSITY)
    values = cell_values(cells, ("h", "t", "t_vol"), 0.0)
    gradient = bed.gradient_by_pixel[cells.index]
    upright = 1 / np.sqrt(1 + (gradient**2).sum(axis=1))
    assert cells.outside == 0
    return tuple(float((values[name] / upright).sum() * 4.0) for name in ("t_vol", "h", "t"))


def test_volume_from_mass_is_the_releases_in_every_frame(ground):
    for number in numbers():
        assert volumes(ground, Bed.of(ground), frame(number))[0] == pytest.approx(18732.6, rel=1e-4)


def test_depth_and_thickness_at_rest_are_the_measured_ones(ground):
    """The README's own sums: 9694 m3 above the DTM, 17140 m3 between highest and lowest."""
    _, depth, thickness = volumes(ground, Bed.of(ground), frame(numbers()[-1]))
    assert depth == pytest.approx(9694, rel=0.02)
    assert thickness == pytest.approx(17140, rel=0.01)


def test_standoff_is_found_within_the_codes_own_cell(ground):
    facts = [survey_frame(frame(number), Bed.of(ground), DENSITY) for number in numbers()]
    shares = [fact.below for fact in facts]
    assert shares[0] == pytest.approx(0.0, abs=0.02) and shares[-1] == pytest.approx(0.47, abs=0.02)
    standoff = automatic_standoff(facts)
    assert -1.568 <= standoff < -0.5
    _, depth, _ = volumes(ground, Bed.of(ground, standoff=standoff), frame(numbers()[-1]))
    assert 0.8 < depth / 18732.6 < 1.2
