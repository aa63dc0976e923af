"""Seeded volumes, areas and masses against exact integrals (2e-4 on planes)."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from seed_sites import CENTRE, PIXELS, area_of, grid_of, inclined, ring, two_islands

from mpmgis.seeding.column_seeding import seed_columns
from mpmgis.system.errors import InputError
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.release_parts import ReleaseArea, ReleasePart, ThicknessRaster
from mpmgis.terrain.synthetic_terrain import bumps, plane

COS30 = np.cos(np.radians(30.0))


def inside(release, frame):
    whole = shapely.union_all(release.polygons).buffer(1e-6)
    return shapely.contains_xy(whole, *frame.map_xy())


@pytest.mark.parametrize("pixels", PIXELS.values(), ids=PIXELS)
@pytest.mark.parametrize("options", [{}, {"cell_size": 4.0, "anchor": (CENTRE[0] - 1.1, CENTRE[1] + 2.3)}])
def test_plane_of_any_pixel_shape(pixels, options):
    """Thickness normal to a 30 degree plane: volume = area h / cos, and every column says so."""
    terrain, release = inclined(pixels), area_of(two_islands(), thickness=2.0)
    frame = seed_columns(terrain, release, density=900.0, **options)
    columns = frame.particles
    exact = two_islands().area * 2.0 / COS30
    assert columns.volume.sum() == pytest.approx(exact, rel=1e-9)
    assert columns.area.sum() == pytest.approx(two_islands().area, rel=1e-12)
    assert abs(columns.mass.sum() / frame.header["reference_mass"] - 1) <= 1e-12
    np.testing.assert_allclose(columns.thickness, 2.0 / COS30, rtol=1e-9)
    np.testing.assert_allclose(columns.thickness * columns.area, columns.volume, rtol=1e-12)
    assert inside(release, frame).all()
    x, y = frame.map_xy()
    np.testing.assert_allclose(columns.position[:, 2], terrain.sample(x, y), atol=1e-9)
    centroid = shapely.get_coordinates(two_islands().centroid)[0]
    np.testing.assert_allclose([columns.mass @ x, columns.mass @ y] / columns.mass.sum(), centroid, atol=0.05)


@pytest.mark.parametrize("pixels", PIXELS.values(), ids=PIXELS)
def test_vertical_thickness_is_taken_as_it_is(pixels):
    frame = seed_columns(inclined(pixels), area_of(ring(), thickness=3.0, mode="vertical"))
    assert frame.particles.volume.sum() == pytest.approx(3.0 * ring().area, rel=1e-12)


def test_wedge_of_linear_thickness():
    """A thickness that grows linearly, on a lattice of its own: the pixels' sum is the exact integral within 2e-4."""
    terrain = inclined(PIXELS["north_up"])
    grid = terrain.grid
    x, y = grid.xy(*np.indices(grid.shape))
    wedge = ThicknessRaster(3.0 + 0.02 * (x - CENTRE[0]) - 0.01 * (y - CENTRE[1]), grid)
    release = ReleaseArea((ReleasePart("w", ring(), wedge),), "vertical")
    dx, dy = shapely.get_coordinates(ring().centroid)[0] - CENTRE
    exact = ring().area * (3.0 + 0.02 * dx - 0.01 * dy)
    for options in ({}, {"count": 500}, {"mass": "equal"}, {"spacing": 3.7}):
        columns = seed_columns(terrain, release, **options).particles
        assert columns.volume.sum() == pytest.approx(exact, rel=2e-4)


def test_parts_keep_their_own_thickness():
    x, y = CENTRE
    west, east = shapely.box(x - 40, y - 20, x, y + 20), shapely.box(x, y - 20, x + 30, y + 20)
    frame = seed_columns(inclined(PIXELS["north_up"]), area_of(west, east, thickness=[1.0, 4.0], mode="vertical"))
    columns, east_side = frame.particles, frame.map_xy()[0] > x
    assert columns.volume[~east_side].sum() == pytest.approx(1600.0, rel=1e-12)
    assert columns.volume[east_side].sum() == pytest.approx(4800.0, rel=1e-12)


def test_real_slopes_within_two_permille():
    """Against a fine integration of the slope-normal volume over bumpy ground."""
    from_bumps = plane(32.0, 100.0, CENTRE, 1500.0) + bumps(2.0, 60.0)
    terrain = from_bumps.terrain(inclined(PIXELS["north_up"]).grid)
    frame = seed_columns(terrain, area_of(ring(), thickness=5.0))
    step = 0.1
    x, y = np.meshgrid(np.arange(-41, 41, step) + CENTRE[0], np.arange(-41, 41, step) + CENTRE[1])
    fine = shapely.contains_xy(ring(), x, y)
    bx, by = from_bumps.gradient(x[fine], y[fine])
    exact = 5.0 * np.sqrt(1 + bx**2 + by**2).mean() * ring().area
    assert frame.particles.volume.sum() == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("per_cell", [1, 2, 4, 6, 7, 9, 10, 13, 16, 25, 40])
def test_any_number_a_cell(per_cell):
    """A whole cell holds exactly what was asked for, in equal shares of its area, centred on the cell."""
    terrain = inclined(PIXELS["north_up"])
    x, y = CENTRE
    frame = seed_columns(terrain, area_of(shapely.box(x - 50, y - 50, x + 50, y + 50)), per_cell=per_cell)
    row, column = terrain.grid.rowcol(*frame.map_xy())
    cell = np.round(row).astype(int) * 1000 + np.round(column).astype(int)
    keys, counts = np.unique(cell, return_counts=True)
    middle = (np.abs(keys // 1000 - 49.5) < 8) & (np.abs(keys % 1000 - 49.5) < 8)
    assert set(counts[middle]) == {per_cell}
    inner = np.isin(cell, keys[middle])
    np.testing.assert_allclose(frame.particles.area[inner], 25.0 / per_cell, rtol=1e-12)
    mean = [np.bincount(cell[inner], part[inner] - np.round(part[inner])).sum() for part in (row, column)]
    np.testing.assert_allclose(mean, 0.0, atol=1e-6)


@pytest.mark.parametrize("points", ["lattice", "staggered", "jittered", "halton", "random"])
@pytest.mark.parametrize("mass", ["thickness", "equal", "paper"])
@pytest.mark.parametrize("count", [1, 3, 17, 100, 1234, 20000])
def test_count_is_met(points, mass, count):
    frame = seed_columns(inclined(PIXELS["north_up"]), area_of(ring()), count=count, points=points, mass=mass)
    assert abs(len(frame.particles) - count) <= 0.01 * count
    assert abs(frame.particles.mass.sum() / frame.header["reference_mass"] - 1) <= 1e-12
    assert inside(area_of(ring()), frame).all()


def test_spacing_sets_the_lattice():
    frame = seed_columns(inclined(PIXELS["north_up"]), area_of(ring()), spacing=2.0)
    columns = frame.particles
    whole = np.isclose(columns.area, 4.0, rtol=1e-12)
    assert whole.mean() > 0.7
    x, y = frame.map_xy()
    corner = np.array(frame.header["cell_corner"])
    for offset in ((x[whole] - corner[0]) / 2.0, (y[whole] - corner[1]) / 2.0):
        np.testing.assert_allclose(offset % 1.0, 0.5, atol=1e-6)


@pytest.mark.parametrize("per_cell", [4, 9, 12, 16])
def test_staggered_columns_of_a_cell_share_no_row_and_no_line(per_cell):
    terrain = inclined(PIXELS["north_up"])
    x, y = CENTRE
    box = shapely.box(x - 50, y - 50, x + 50, y + 50)
    frame = seed_columns(terrain, area_of(box), per_cell=per_cell, points="staggered")
    places = np.column_stack(terrain.grid.rowcol(*frame.map_xy())) + 0.5
    _, cell, number = np.unique(np.floor(places), axis=0, return_inverse=True, return_counts=True)
    whole = np.flatnonzero(number == per_cell)
    assert len(whole) > 300
    for c in whole[:50]:
        for part in places.T:
            of_cell = np.sort(part[cell.ravel() == c] % 1.0)
            np.testing.assert_allclose(of_cell, (np.arange(per_cell) + 0.5) / per_cell, atol=1e-6)


def test_rim_pieces_are_no_slivers():
    frame = seed_columns(inclined(PIXELS["north_up"]), area_of(ring()))
    assert frame.particles.area.min() >= 0.05 * 25.0 / 16 * (1 - 1e-12)


def test_a_release_smaller_than_a_sub_square_is_one_column():
    speck = shapely.Point(*CENTRE).buffer(0.1)
    frame = seed_columns(inclined(PIXELS["north_up"]), area_of(speck))
    assert frame.particles.area.sum() == pytest.approx(speck.area, rel=1e-9)
    assert len(frame.particles) <= 4


def test_velocity_is_tangent_to_the_bed():
    frame = seed_columns(inclined(PIXELS["rotated"], angle=25.0, azimuth=90.0), area_of(ring()), velocity=(3.0, -2.0))
    velocity = frame.particles.velocity
    np.testing.assert_allclose(velocity[:, :2], np.tile([3.0, -2.0], (len(velocity), 1)))
    np.testing.assert_allclose(velocity[:, 2], -3.0 * np.tan(np.radians(25.0)), rtol=1e-9)


def test_refinement_follows_the_slope_and_keeps_the_mass():
    """Refinement on a slope of 45 degrees beside flat ground: 1 + beta times the columns, their areas in proportion."""
    grid = inclined(PIXELS["north_up"]).grid
    x, _ = grid.xy(*np.indices(grid.shape))
    terrain = Terrain(grid, np.where(x < CENTRE[0], CENTRE[0] - x, 0.0))
    half = 60.0
    box = shapely.box(CENTRE[0] - half, CENTRE[1] - half, CENTRE[0] + half, CENTRE[1] + half)
    for points in ("lattice", "staggered", "halton", "random"):
        frame = seed_columns(terrain, area_of(box, mode="vertical"), per_cell=9, refine_slope=2.0, points=points)
        offset = frame.map_xy()[0] - CENTRE[0]
        steep, flat = (offset < -15) & (offset > -45), (offset > 15) & (offset < 45)
        assert steep.sum() / flat.sum() == pytest.approx(3.0, rel=0.08)
        assert frame.particles.area[steep].sum() == pytest.approx(frame.particles.area[flat].sum(), rel=0.04)
        assert frame.particles.area.sum() == pytest.approx(box.area, rel=1e-12)
        assert abs(frame.particles.mass.sum() / frame.header["reference_mass"] - 1) <= 1e-12
    frame = seed_columns(terrain, area_of(box), count=5000, refine_slope=3.0)
    assert abs(len(frame.particles) - 5000) <= 50


def test_refinement_is_refused_where_it_would_lie():
    with pytest.raises(InputError, match="refine slope"):
        seed_columns(inclined(PIXELS["north_up"]), area_of(ring()), refine_slope=1.0, mass="equal")
    with pytest.raises(InputError, match="0 to 3"):
        seed_columns(inclined(PIXELS["north_up"]), area_of(ring()), refine_slope=3.5)


def test_a_raster_too_rough_for_its_columns_is_refused():
    """|k - 1| beyond 2 % is an error (1.3): spikes of one pixel that a single column cannot see."""
    terrain = inclined(PIXELS["north_up"])
    values = np.full(terrain.grid.shape, 0.1)
    values[44, 44] = 50.0
    spiky = ReleaseArea((ReleasePart("s", ring(), ThicknessRaster(values, terrain.grid)),), "vertical")
    with pytest.raises(InputError, match="too coarse or too rough"):
        seed_columns(terrain, spiky, count=4)


def test_bed_without_data_is_refused_by_cell_and_beside_it_is_not():
    terrain = inclined(PIXELS["north_up"])
    row, column = (round(float(v)) for v in terrain.grid.rowcol(CENTRE[0] - 20, CENTRE[1]))
    holed = terrain.elevation.copy()
    holed[row, column] = np.nan
    with pytest.raises(InputError, match=rf"\({row}, {column}\)"):
        seed_columns(Terrain(terrain.grid, holed), area_of(ring()))
    beside = shapely.box(*terrain.grid.xy(row + 10, column + 0.5), CENTRE[0] - 5, CENTRE[1])
    frame = seed_columns(Terrain(terrain.grid, holed), area_of(beside))
    np.testing.assert_allclose(frame.particles.position[:, 2], terrain.sample(*frame.map_xy()), atol=1e-6)


shapes = st.tuples(st.floats(3, 45), st.floats(3, 45), st.floats(0, 3.1), st.floats(-50, 50), st.floats(-50, 50))


@settings(max_examples=40, deadline=None)
@given(
    shapes,
    st.floats(0, 50),
    st.floats(0, 360),
    st.floats(0.05, 8),
    st.sampled_from(sorted(PIXELS)),
    st.sampled_from([{}, {"per_cell": 5}, {"spacing": 2.3}, {"points": "jittered"}, {"points": "random"}]),
)
def test_any_ellipse_on_any_plane(shape, angle, azimuth, thickness, pixels, options):
    """Seeded area = polygon area, seeded volume = area h / cos, the centre of mass is the polygon's centroid."""
    a, b, turn, dx, dy = shape
    ellipse = shapely.affinity.rotate(
        shapely.affinity.scale(shapely.Point(CENTRE[0] + dx, CENTRE[1] + dy).buffer(1.0), a, b), turn, use_radians=True
    )
    frame = seed_columns(inclined(PIXELS[pixels], angle, azimuth), area_of(ellipse, thickness=thickness), **options)
    columns = frame.particles
    assert columns.area.sum() == pytest.approx(ellipse.area, rel=1e-10)
    assert columns.volume.sum() == pytest.approx(ellipse.area * thickness / np.cos(np.radians(angle)), rel=1e-7)
    assert (columns.mass > 0).all() and (columns.area > 0).all()
    if options.get("points") != "random":
        x, y = frame.map_xy()
        centre = np.array([columns.area @ x, columns.area @ y]) / columns.area.sum()
        np.testing.assert_allclose(centre, shapely.get_coordinates(ellipse.centroid)[0], atol=0.1)


def test_thickness_raster_of_another_grid_keeps_its_volume():
    """A turned, finer thickness raster on a north-up terrain: the sum over its own pixels is the reference."""
    terrain = inclined(PIXELS["north_up"])
    other = grid_of(PIXELS["rotated"], (70, 70))
    other = Grid(None, other.transform, other.shape)
    x, y = other.xy(*np.indices(other.shape))
    values = 2.0 + np.sin((x - CENTRE[0]) / 30) * np.cos((y - CENTRE[1]) / 40)
    cells = shapely.Polygon([other.transform * c for c in ((20, 20), (50, 20), (50, 45), (20, 45))])
    release = ReleaseArea((ReleasePart("r", cells, ThicknessRaster(values, other)),), "vertical")
    frame = seed_columns(terrain, release)
    exact = values[20:45, 20:50].sum() * other.cell_area
    assert frame.particles.volume.sum() == pytest.approx(exact, rel=1e-9)
    assert frame.header["closure_factor"] == pytest.approx(1.0, abs=2e-3)
