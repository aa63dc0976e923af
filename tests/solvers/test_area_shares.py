"""Zones, forests and erodible ground act by the area that they cover, against loops over the nodes' squares."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely
import shapely.affinity
from affine import Affine
from column_scenes import terrain_of
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.laws.forest import DETRAINMENT, DRAG, FRICTION, SHARE, STRENGTH
from mpmgis.laws.friction import LAWS, parameters_to_give
from mpmgis.scene import Scene
from mpmgis.scene.tables import EntrainmentTable, ForestTable, FrictionTable, ZoneTable
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.solvers.features.area_shares import Area, domain_shares, raster_means, touched_cells, visible_shares
from mpmgis.solvers.features.feature_placement import PlacedFiles, erodible_ground, painted_zones
from mpmgis.solvers.features.forest_values import forest_values
from mpmgis.system.errors import InputError, SceneError
from mpmgis.terrain.grid import Grid

LENGTH, WIDTH, PIXEL = 120.0, 80.0, 4.0


@dataclass
class Drawn:
    """A feature of a file."""

    shape: shapely.Geometry
    columns: dict = field(default_factory=dict)
    name: str = "drawn"
    path: str = "drawn.gpkg"

    def number(self, column):
        return self.columns[column]


def grid_of(cell, bed=lambda x, y: 0 * x):
    return ColumnGrid.on(terrain_of(bed, LENGTH, WIDTH, PIXEL), cell)


def squares_of(grid):
    """The square of each node of the domain, clipped at its edge."""
    rows, columns = grid.inside.shape
    west, south, size = grid.x0, grid.y0 + grid.rest, grid.cell_size
    domain = shapely.box(west, south, west + columns * size, south + rows * size)
    x, y = np.meshgrid(west + np.arange(columns + 1) * size, south + np.arange(rows + 1) * size)
    return shapely.intersection(shapely.box(x - size / 2, y - size / 2, x + size / 2, y + size / 2), domain)


def shares_by_loop(shape, grid):
    squares = squares_of(grid)
    return shapely.area(shapely.intersection(shape, squares)) / shapely.area(squares)


def visible_by_loop(shapes, grid):
    hidden = [shape.difference(shapely.union_all(shapes[k + 1 :])) for k, shape in enumerate(shapes)]
    return [shares_by_loop(shape, grid) for shape in hidden]


@st.composite
def polygons(draw):
    """Bars of any width and direction, rings and blocks with edges on nodes, partly off the terrain."""
    x, y = draw(st.floats(-20.0, 140.0)), draw(st.floats(-20.0, 100.0))
    kind = draw(st.sampled_from(["bar", "ring", "block"]))
    if kind == "block":
        x, y = 8.0 * round(x / 8.0), 8.0 * round(y / 8.0)
        return shapely.box(x, y, x + 8.0 * draw(st.integers(1, 6)), y + 8.0 * draw(st.integers(1, 6)))
    if kind == "ring":
        return shapely.Point(x, y).buffer(draw(st.floats(5.0, 40.0))).difference(shapely.Point(x, y).buffer(4.0))
    bar = shapely.box(x, y, x + draw(st.floats(0.3, 90.0)), y + draw(st.floats(0.3, 9.0)))
    return shapely.affinity.rotate(bar, draw(st.floats(0.0, 180.0)))


@given(st.lists(polygons(), min_size=1, max_size=4), st.sampled_from([3.7, 5.0, 8.0, 16.0]))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_shares_are_areas(shapes, cell):
    """Of each polygon alone, and of what later ones leave of it, in every square."""
    grid = grid_of(cell)
    np.testing.assert_allclose(domain_shares(shapes[0], grid), shares_by_loop(shapes[0], grid), atol=1e-9)
    expected = visible_by_loop(shapes, grid)
    found = [np.zeros(expected[0].shape) for _ in shapes]
    for number, window, part in visible_shares([Area(shape) for shape in shapes], grid):
        found[number][window] = part
    np.testing.assert_allclose(found, expected, atol=2e-9)


@given(
    st.floats(0.7, 30.0),
    st.floats(0.7, 30.0),
    st.floats(-40.0, 90.0),
    st.integers(0, 1000),
    st.sampled_from([5.0, 8.0]),
)
@settings(max_examples=25, deadline=None, derandomize=True)
def test_means_of_a_raster_are_by_area(width, height, shift, seed, cell):
    """Cells of any size and place; mean of the values and of their reciprocals, share with values."""
    rng, grid = np.random.default_rng(seed), grid_of(cell)
    values = rng.uniform(1.0, 9.0, (5, 7))
    values[rng.random(values.shape) < 0.3] = np.nan
    placed = Grid(None, Affine(width, 0.0, shift, 0.0, -height, 90.0 - 0.5 * shift), values.shape)
    mean, share = raster_means(values, placed, grid)
    drag, _ = raster_means(values, placed, grid, reciprocal=True)
    pixels = [
        (values[row, column], shapely.box(*sorted_box(placed, row, column))) for row, column in np.argwhere(values > 0)
    ]
    for (j, i), square in np.ndenumerate(squares_of(grid)):
        areas = np.array([pixel.intersection(square).area for _, pixel in pixels] or [0.0])
        own = np.array([value for value, _ in pixels] or [1.0])
        assert share[j, i] == pytest.approx(areas.sum() / square.area, abs=2e-9)
        if areas.sum() > 1e-6:
            assert mean[j, i] == pytest.approx((areas * own).sum() / areas.sum(), rel=1e-6)
            assert drag[j, i] == pytest.approx(areas.sum() / (areas / own).sum(), rel=1e-6)
        elif not areas.any():
            assert np.isnan(mean[j, i])


def sorted_box(placed, row, column):
    t = placed.transform
    x, y = t.c + t.a * column, t.f + t.e * row
    return x, y + t.e, x + t.a, y


def test_means_of_a_rotated_raster_are_by_area():
    """From samples: within 2 % of a square."""
    grid = grid_of(5.0)
    turned = Affine.translation(50.0, 10.0) * Affine.rotation(30.0) * Affine.scale(9.0, -9.0)
    share = raster_means(np.ones((4, 6)), Grid(None, turned, (4, 6)), grid)[1]
    corners = [turned * corner for corner in ((0, 0), (6, 0), (6, 4), (0, 4))]
    expected = shares_by_loop(shapely.Polygon(corners), grid)
    np.testing.assert_allclose(share, expected, atol=0.09)
    assert share.sum() == pytest.approx(expected.sum(), rel=0.02)


@pytest.mark.parametrize("cell", [10.0, 5.0, 2.5, 3.7])
@pytest.mark.parametrize(("width", "height"), [(20, 40), (10, 10), (3, 50), (0.8, 0.5)])
@pytest.mark.parametrize("shift", [0.0, 1.0, 1.25, 2.5])
def test_erodible_ground_has_the_mass_that_was_drawn(width, height, shift, cell):
    """On a plane of 30 degrees, to 1e-9, once drawn and once as a raster; narrower than a cell too."""
    grid = grid_of(cell, lambda x, y: 200.0 - math.tan(math.radians(30)) * x)
    shape = shapely.box(40 + shift, 12 + shift, 40 + shift + width, 12 + shift + height)
    table = EntrainmentTable(law="ErosionSpeed", source="drawn.gpkg", thickness=0.3, density=200.0, parameters={})
    found = erodible_ground(table, PlacedFiles([Drawn(shape)]), "drawn.gpkg", grid, 1.0, [])
    exact = width * height / math.cos(math.radians(30)) * 0.3 * 200.0
    assert found.mass.sum() * cell**2 == pytest.approx(exact, rel=1e-9)
    assert found.share.sum() * cell**2 == pytest.approx(width * height, rel=1e-9)
    west, south, east, north = shape.bounds
    placed = Grid(None, Affine((east - west) / 4, 0, west, 0, (south - north) / 8, north), (8, 4))
    table = EntrainmentTable(law="ErosionSpeed", source="drawn.tif", density=200.0, parameters={})
    again = erodible_ground(table, PlacedFiles(raster=(np.full((8, 4), 0.3), placed)), "drawn.tif", grid, 1.0, [])
    np.testing.assert_allclose(again.mass, found.mass, atol=1e-6)


def test_overlapping_erodible_ground_has_the_thickness_of_the_later_one():
    """Also none: a polygon of thickness 0 is a hole."""
    grid = grid_of(5.0)
    features = [Drawn(shapely.box(20, 20, 53, 47), {"d": 2.0}), Drawn(shapely.box(31, 33, 41, 36), {"d": 0.0})]
    features.append(Drawn(shapely.box(50, 20, 56, 47), {"d": 1.0}))
    table = EntrainmentTable(
        law="ErosionSpeed", source="d.gpkg", thickness="d", thickness_mode="vertical", parameters={}
    )
    found = erodible_ground(table, PlacedFiles(features), "d.gpkg", grid, 100.0, [])
    assert found.mass.sum() * 25.0 == pytest.approx(100.0 * (2.0 * (30 * 27 - 30) + 6 * 27), rel=1e-9)
    with pytest.raises(InputError, match="no erodible ground"):
        erodible_ground(table, PlacedFiles([Drawn(shapely.box(900, 0, 950, 9), {"d": 1.0})]), "d.gpkg", grid, 100.0, [])


def scene(**friction):
    return Scene(terrain=None, output=None, friction=FrictionTable(law="Voellmy", parameters=friction))


def zone(**parameters):
    return ZoneTable(source="zones.gpkg", parameters=parameters)


@pytest.mark.parametrize("cell", [5.0, 8.0])
@pytest.mark.parametrize("shift", [0.0, 1.3, 2.5, 4.0])
@pytest.mark.parametrize("width", [0.6, 3.0, 20.0])
def test_a_zone_does_the_work_of_its_width(width, shift, cell):
    """Sums over the domain of mu and of the drag 1 / xi, for any place and width of a strip."""
    grid = grid_of(cell)
    strip = shapely.box(40 + shift, -10, 40 + shift + width, 90)
    zones = [(1, zone(mu=0.5, xi=250.0), PlacedFiles([Drawn(strip)]))]
    found = painted_zones(scene(mu=0.2, xi=1000.0), zones, grid, [])
    middle = found["mu"][grid.bed.shape[0] // 2, 1:-1], found["xi"][grid.bed.shape[0] // 2, 1:-1]
    assert ((middle[0] - 0.2) * cell).sum() == pytest.approx(0.3 * width, rel=1e-9)
    assert ((1.0 / middle[1] - 1e-3) * cell).sum() == pytest.approx(3e-3 * width, rel=1e-9)
    assert middle[0].max() <= 0.5 and middle[1].min() >= 250.0


def test_zones_that_share_a_square_share_it_by_area():
    """Two zones that touch in a square leave nothing of the ground between them; without [friction] none is needed."""
    grid = grid_of(8.0)
    west, east = Drawn(shapely.box(-9, -9, 41, 99), {"mu": 0.1}), Drawn(shapely.box(41, -9, 199, 99), {"mu": 0.5})
    found = painted_zones(scene(xi=1000.0), [(1, zone(mu="mu"), PlacedFiles([west, east]))], grid, [])["mu"]
    row = found[4, 1:-1]
    np.testing.assert_array_equal(row[:5], 0.1)
    np.testing.assert_array_equal(row[6:], 0.5)
    assert row[5] == pytest.approx((5 * 0.1 + 3 * 0.5) / 8)
    np.testing.assert_array_equal(found[:, 0], found[:, 1])  # ghosts
    with pytest.raises(InputError, match="number 3 covers no part"):
        painted_zones(scene(), [(3, zone(mu=0.2), PlacedFiles([Drawn(shapely.box(900, 0, 950, 9))]))], grid, [])


LIMITS = [
    (law, name, limit, side)
    for law in LAWS
    for name, known in parameters_to_give(law).items()
    for limit, side in ((known.smallest, -1), (known.largest, 1))
    if math.isfinite(limit) and limit != 0.0
]


@pytest.mark.parametrize(("law", "name", "limit", "side"), LIMITS)
@pytest.mark.parametrize("pixel", [PIXEL, 3.7])
def test_a_raster_may_have_the_limits_of_a_parameter(law, name, limit, side, pixel):
    """As float32 rounds them, also in means over pixels; what is beyond is refused."""
    grid = grid_of(5.0)
    placed = Grid(None, Affine(pixel, 0.0, -20.0, 0.0, -pixel, 110.0), (60, 60))

    def painted(value):
        values = np.full(placed.shape, np.float32(value), float)
        own = Scene(terrain=None, output=None, friction=FrictionTable(law=law, parameters={}))
        files = PlacedFiles([Drawn(shapely.box(0, 0, 40, 40))], values={name: (values, placed)})
        return painted_zones(own, [(1, zone(**{name: "values.tif"}), files)], grid, [])

    assert painted(limit)
    with pytest.raises(SceneError, match=f"{name} reaches"):
        painted(limit * (1 + side * 1e-6))


@pytest.mark.parametrize("shift", [0.0, 1.3, 2.5])
def test_a_forest_acts_by_its_share_and_breaks_by_its_strength(shift):
    """Also one narrower than a cell; of two in a square the limits are those of the larger."""
    grid = grid_of(5.0)
    strip, beside = shapely.box(40 + shift, -10, 43 + shift, 90), shapely.box(43 + shift, -10, 44 + shift, 90)
    table = ForestTable(source="f.gpkg", strength="s", detrainment=30.0, drag=0.01, friction=0.02)
    features = [Drawn(strip, {"s": 1e4}), Drawn(beside, {"s": 1e6})]
    found = forest_values([(1, table, PlacedFiles(features))], grid, [])
    row = found[grid.bed.shape[0] // 2]
    for entry, value in ((DETRAINMENT, 30.0), (DRAG, 0.01), (FRICTION, 0.02), (SHARE, 1.0)):
        assert 5.0 * row[:, entry].sum() == pytest.approx(4.0 * value, rel=1e-9)
    assert set(row[row[:, SHARE] > 0.0, STRENGTH]) <= {1e4, 1e6}
    assert row[np.argmax(row[:, SHARE]), STRENGTH] == 1e4
    assert not found[0].any() and not found[:, 0].any()


def test_a_lake_is_touched_by_any_part_of_its_polygon():
    grid = grid_of(8.0)
    touched = touched_cells(shapely.box(41.0, 17.0, 41.5, 31.0), grid)
    assert np.argwhere(touched).tolist() == [[2, 5], [3, 5]]
    assert not touched_cells(shapely.box(900, 0, 950, 9), grid).any()
