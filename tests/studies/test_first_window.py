"""The first window of a region follows the least friction of its scene."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from mpmgis.scene import scene_from_tables
from mpmgis.studies.region_plan import first_mu
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.release_window import reach_window


def scene(friction, **more):
    tables = {
        "terrain": {"dem": "dtm.tif"},
        "release": {"source": "a.shp", "thickness": 1.0},
        "output": {"end_time": 10.0, "frame_interval": 1.0},
    }
    return scene_from_tables(tables | ({} if friction is None else {"friction": friction}) | more)


@given(st.floats(0.0, 2.0), st.lists(st.floats(0.0, 2.0), max_size=3))
def test_it_is_the_least_mu_of_friction_and_zones(mu, zones):
    more = {"zones": [{"source": "z.gpkg", "mu": value} for value in zones]} if zones else {}
    found = first_mu(scene({"law": "Voellmy", "mu": mu, "xi": 1500.0}, **more))
    assert found == pytest.approx(max(0.1, min([mu, *zones])))


@pytest.mark.parametrize(
    ("friction", "more", "expected"),
    [
        (None, {}, 0.1),
        ({"law": "Coulomb", "mu": 0.5, "use": "off"}, {}, 0.1),
        ({"law": "Bingham", "yield_stress": 500.0, "viscosity": 10.0}, {}, 0.2),
        ({"law": "ModifiedVoellmy", "mu": 0.4, "xi": 500.0, "crossover_speed": 10.0}, {}, 0.2),  # 100 / 500
        ({"law": "Coulomb", "mu": 0.5}, {"zones": [{"source": "z.gpkg", "mu": "mu"}]}, 0.1),
        ({"law": "Coulomb", "mu": 0.5}, {"zones": [{"source": "z.gpkg", "mu": 0.2, "use": "off"}]}, 0.5),
    ],
)
def test_laws_without_a_coefficient_and_zones_by_column(friction, more, expected):
    assert first_mu(scene(friction, **more)) == pytest.approx(expected)


@pytest.mark.parametrize("mu", [0.12, 0.2, 0.3, 0.5])
def test_the_window_ends_where_a_line_of_that_slope_meets_the_ground(mu):
    """A slope of 45 degrees, 100 m high, above level ground: the line from its top ends at 100 / mu."""
    grid = Grid(CRS.from_epsg(32632), Affine(10, 0, 0, 0, -10, 400), (40, 200))
    x, _ = grid.xy(*np.indices(grid.shape))
    ground = Terrain(grid, np.maximum(100.0 - x, 0.0))

    def part(rows, columns):
        shape = rows.stop - rows.start, columns.stop - columns.start
        return SimpleNamespace(
            grid=grid.part(rows.start, columns.start, shape),
            elevation=ground.elevation[rows, columns],
            sample=ground.sample,
        )

    window = reach_window(grid, part, shapely.box(5, 190, 15, 210), first_mu(scene({"law": "Coulomb", "mu": mu})))
    end = 10.0 * (window.left + window.shape[1])
    assert end >= min(95.0 / mu, 2000.0) and end <= min(100.0 / mu + 300.0, 2000.0)
    assert math.isclose(first_mu(scene({"law": "Coulomb", "mu": mu})), mu)
