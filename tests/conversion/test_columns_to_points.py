"""Where the points of a conversion stand, how they move, what load they start with."""

import dataclasses

import numpy as np
import pytest
import shapely
from converting import DENSITY, ORIGIN, columns_on, doubled, hills, over_bed, slope, terrain_of, with_particles

from mpmgis.conversion import ground_below as geostatic
from mpmgis.conversion.columns_to_points import columns_to_points
from mpmgis.conversion.conserved_sums import conservation_error
from mpmgis.conversion.conversion_options import ColumnOptions, PointOptions
from mpmgis.frames.particles import Particles
from mpmgis.system.errors import InputError


def whole(frame):
    return frame.particles.position + np.asarray(frame.origin)


def test_points_stand_in_the_middle_of_slices():
    ground = terrain_of(slope())
    frame = columns_on(ground, 2.0)
    points = columns_to_points(frame, ground, PointOptions(spacing=0.5)).frame
    height = over_bed(points, ground).reshape(-1, 4)
    assert height == pytest.approx(np.tile([0.25, 0.75, 1.25, 1.75], (len(height), 1)), abs=1e-9)
    parent = points.particles.parent.reshape(-1, 4)
    assert (parent == frame.particles.id[:, None]).all()
    assert (points.particles.id == np.arange(len(points.particles))).all()
    assert whole(points).reshape(-1, 4, 3)[:, 0, :2] == pytest.approx(whole(frame)[:, :2], abs=1e-9)
    assert points.particles.mass.reshape(-1, 4) == pytest.approx(
        np.repeat(frame.particles.mass[:, None] / 4, 4, axis=1)
    )
    assert points.particles.volume.sum() == pytest.approx(frame.particles.volume.sum(), rel=1e-13)
    assert points.dimension == 3 and points.header["density"] == pytest.approx(DENSITY)
    assert np.abs(points.particles.position).max() < 25  # float32 keeps 2 micrometres there


@pytest.mark.parametrize("turn", [0.0, 25.0])
def test_motion_is_along_the_bed(turn):
    """No velocity across the slope; as printed the flow takes off at |u| sin(theta)."""
    ground = terrain_of(slope(0.6, 0.0), turn=turn, length=160, width=160)
    box = (20.0, 60.0, 20.0, 50.0) if turn == 0 else (60.0, 90.0, 110.0, 140.0)
    frame = columns_on(ground, 2.0, (7.0, 0.0), box=box)
    normal = np.array([0.6, 0.0, 1.0]) / np.hypot(0.6, 1.0)
    tangent = columns_to_points(frame, ground).frame.particles.velocity
    assert tangent @ normal == pytest.approx(np.zeros(len(tangent)), abs=1e-9)
    printed = columns_to_points(frame, ground, PointOptions(vertical_velocity="paper"))
    assert printed.frame.particles.velocity @ normal == pytest.approx(7.0 * 0.6 / np.hypot(0.6, 1.0), abs=1e-9)
    assert printed.report.launch == pytest.approx(7.0 * 0.6 / np.hypot(0.6, 1.0))
    kept = printed.report.after.kinetic / columns_to_points(frame, ground).report.after.kinetic
    assert kept == pytest.approx(1.0 / (1 + 0.6**2))  # cos^2


def spreading(rate, ground, **more):
    """Columns that spread at `rate` [s-1] in both directions, and know it."""
    frame = columns_on(ground, 2.0, lambda x, y: (3 + rate * (x - 40), rate * (y - 35)), **more)
    gradient = np.tile(rate * np.eye(2), (len(frame.particles), 1, 1))
    return dataclasses.replace(frame, state={"velocity_gradient": gradient})


def test_linear_vertical_velocity_closes_the_column():
    """W falls with height by the divergence, so that the surface sinks as the column spreads."""
    ground = terrain_of(slope(0.5, 0.0))
    frame = spreading(0.1, ground)
    points = columns_to_points(frame, ground, PointOptions(spacing=0.25, vertical_velocity="linear")).frame
    velocity = points.particles.velocity
    expected = -0.5 * velocity[:, 0] - 0.2 * over_bed(points, ground)
    assert velocity[:, 2] == pytest.approx(expected, abs=1e-9)
    affine = points.state["affine"]
    assert np.trace(affine, axis1=1, axis2=2) == pytest.approx(np.zeros(len(affine)), abs=1e-12)
    assert affine[0] == pytest.approx(np.array([[0.1, 0, 0], [0, 0.1, 0], [-0.05, 0, -0.2]]))
    with pytest.raises(InputError, match="velocity gradient"):
        columns_to_points(dataclasses.replace(frame, state={}), ground, PointOptions(vertical_velocity="linear"))


def test_pieces_move_by_their_columns_gradient():
    """Split columns carry the velocity field on, not one step a column, and keep momentum."""
    ground = terrain_of(slope(0.5, 0.0))
    frame = spreading(0.1, ground)
    result = columns_to_points(frame, ground, PointOptions(spacing=1.0, cell=0.5))
    x, y = result.frame.map_xy()
    velocity = result.frame.particles.velocity
    assert velocity[:, 0] == pytest.approx(3 + 0.1 * (x - ORIGIN[0] - 40), abs=1e-9)
    assert velocity[:, 1] == pytest.approx(0.1 * (y - ORIGIN[1] - 35), abs=1e-9)
    assert max(conservation_error(result.report.before, result.report.after)) < 1e-13


def test_load_of_the_column():
    """Stress -rho g c^2 d, and the strain that bears it in a confined elastic layer."""
    ground = terrain_of(slope(0.5, 0.2))
    points = columns_to_points(columns_on(ground, 3.0), ground, PointOptions(spacing=0.5)).frame
    depth, load = points.state["depth"], points.state["vertical_stress"]
    assert depth == pytest.approx(3.0 - over_bed(points, ground), abs=1e-9)
    assert load == pytest.approx(-DENSITY * 9.81 * depth / (1 + 0.5**2 + 0.2**2), rel=1e-9)
    strain = geostatic.vertical_strain(load, 6.7e6, 4.0e6)
    assert strain * (6.7e6 + 4 / 3 * 4.0e6) == pytest.approx(load)
    pressure = 1e6 * (1 / geostatic.volume_ratio(DENSITY, 9.81, depth, 1e6) - 1)
    assert pressure == pytest.approx(DENSITY * 9.81 * depth, rel=0.05)
    with pytest.raises(InputError, match="bulk modulus is 0"):
        geostatic.volume_ratio(1.0, 9.81, depth, 0.0)
    with pytest.raises(InputError, match="confined modulus"):
        geostatic.vertical_strain(load, -1.0, 0.0)


def test_points_stand_on_the_terrain_and_not_on_the_columns_beds():
    """Another terrain than the columns' moves them up or down with their thickness."""
    ground = terrain_of(hills)
    frame = columns_on(terrain_of(lambda x, y: hills(x, y) + 0.7), 2.0)
    result = columns_to_points(frame, ground, PointOptions(spacing=0.25))
    height = over_bed(result.frame, ground)
    assert height.min() == pytest.approx(0.125, abs=1e-9) and height.max() == pytest.approx(1.875, abs=1e-9)
    assert result.report.bed_shift == pytest.approx(0.7)


def empty_cells(frame, cell, box):
    """Share of the plan cells in `box` (from ORIGIN) that hold no point."""
    x, y = frame.map_xy()
    west, east, south, north = box
    i, j = np.floor((x - ORIGIN[0] - west) / cell).astype(int), np.floor((y - ORIGIN[1] - south) / cell).astype(int)
    held = np.zeros((round((north - south) / cell), round((east - west) / cell)), bool)
    inside = (i >= 0) & (j >= 0) & (i < held.shape[1]) & (j < held.shape[0])
    held[j[inside], i[inside]] = True
    return 1.0 - held.mean()


def stretch(frame, factor, turn=0.0):
    """The frame with its columns moved apart eastwards and together northwards (then turned), about their middle."""
    position = frame.particles.position.copy()
    middle = 0.5 * (position[:, :2].min(axis=0) + position[:, :2].max(axis=0))
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    position[:, :2] = middle + (position[:, :2] - middle) * [factor, 1 / factor] @ np.array([[c, s], [-s, c]])
    return with_particles(frame, position=position)


def test_no_curtains():
    """Without a cell wide columns leave gaps, which is said; with it no cell under the flow is empty."""
    ground = terrain_of(hills)
    frame = columns_on(ground, 2.0, spacing=2.0)
    box = (21.0, 59.0, 21.0, 49.0)
    plain = columns_to_points(frame, ground)
    assert plain.report.widest == pytest.approx(2.0) and empty_cells(plain.frame, 0.5, box) > 0.9
    for cell in (0.5, 1.0):
        split = columns_to_points(frame, ground, PointOptions(cell=cell))
        assert empty_cells(split.frame, cell, box) == 0.0
        assert split.report.widest <= 0.5 * cell + 1e-9
        assert split.report.pieces_per_column == (2.0 / (0.5 * cell)) ** 2
        assert split.report.points_per_cell[1] >= 4
        assert max(conservation_error(split.report.before, split.report.after)) < 1e-13
    narrow = columns_to_points(frame, ground, PointOptions(cell=4.0))
    assert narrow.report.pieces_per_column == 1  # columns that are narrow enough are left whole


@pytest.mark.parametrize(("factor", "turn"), [(1.5, 0.0), (2.0, 30.0), (2.0, 45.0)])
def test_no_curtains_in_a_flow_that_stretched(factor, turn):
    """Squares would leave rows of gaps between columns that moved apart one way and together the other."""
    ground = terrain_of(slope())
    frame = stretch(columns_on(ground, 2.0, spacing=1.25, box=(25, 55, 20, 50)), factor, turn)
    split = columns_to_points(frame, ground, PointOptions(cell=0.5, spacing=1.0)).frame
    core = (36.0, 44.0, 32.0, 38.0)
    assert empty_cells(split, 0.5, core) < 0.02
    x, y = split.map_xy()
    inside = shapely.contains_xy(shapely.box(36, 32, 44, 38), x - ORIGIN[0], y - ORIGIN[1])
    edges, mass = ((36, 44), (32, 38)), split.particles.mass[inside]
    spread = np.histogram2d((x - ORIGIN[0])[inside], (y - ORIGIN[1])[inside], (8, 6), edges, weights=mass)[0]
    assert np.abs(spread / (DENSITY * 2.0) - 1).max() < 0.25  # cells of 1 m, narrower than a column


def test_overlapping_columns_are_raised_to_what_they_fill():
    """Twice as many columns on the same ground are twice as dense, until relevelling; rims are left alone."""
    ground = terrain_of(slope())
    frame = doubled(columns_on(ground, 1.0))
    plain = columns_to_points(frame, ground, PointOptions(cell=1.0))
    assert plain.report.overlap == pytest.approx(1.0, abs=0.1) and plain.report.raised == 0
    level = columns_to_points(frame, ground, PointOptions(cell=1.0, relevel=True))
    x, y = level.frame.map_xy()
    core = shapely.contains_xy(shapely.box(28, 28, 52, 42), x - ORIGIN[0], y - ORIGIN[1])
    height = over_bed(level.frame, ground)
    mass = level.frame.particles.mass
    assert 2 * (mass * height)[core].sum() / mass[core].sum() == pytest.approx(2.0, rel=0.02)
    assert 2 * over_bed(plain.frame, ground).mean() == pytest.approx(1.0, rel=1e-6)
    assert max(conservation_error(level.report.before, level.report.after)) < 1e-13
    alone = columns_to_points(columns_on(ground, 1.0), ground, PointOptions(cell=1.0, relevel=True))
    assert alone.report.raised == 0 and alone.report.overlap < 1e-9


@pytest.mark.parametrize("cell", [None, 0.5])
def test_inside_and_outside_of_a_window(cell):
    """What lies outside stays columns; mass, momentum and centre of the two add up to the whole."""
    ground = terrain_of(hills)
    frame = spreading(0.05, ground)
    window = shapely.Polygon([(30, 15), (52, 22), (47, 60), (28, 44)])
    window = shapely.affinity.translate(window, ORIGIN[0], ORIGIN[1])
    result = columns_to_points(frame, ground, PointOptions(spacing=0.5, cell=cell), window)
    report = result.report
    assert max(conservation_error(report.before, report.after, report.outside)) < 1e-13
    assert 0.1 < report.after.mass / report.before.mass < 0.9
    x, y = result.frame.map_xy()
    assert shapely.contains_xy(window, x, y).all()
    rest = result.rest.particles
    total = np.concatenate([result.frame.particles.mass, rest.mass])
    for axis in (0, 1):
        at = np.concatenate([whole(result.frame)[:, axis], whole(result.rest)[:, axis]])
        before = (frame.particles.mass * whole(frame)[:, axis]).sum() / frame.particles.mass.sum()
        assert (total * at).sum() / total.sum() == pytest.approx(before, abs=1e-7)
    area = rest.area.sum() + result.frame.particles.volume.sum() / 2.0
    assert area == pytest.approx(frame.particles.area.sum(), rel=1e-12)
    assert rest.mass / (DENSITY * rest.area) == pytest.approx(rest.thickness)
    if cell is None:
        assert len(rest) + len(np.unique(result.frame.particles.parent)) == len(frame.particles)
    else:
        assert len(rest) + len(np.unique(result.frame.particles.parent)) > len(frame.particles)
    assert len(result.rest.state["velocity_gradient"]) == len(rest)
    with pytest.raises(InputError, match="window"):
        columns_to_points(frame, ground, window=shapely.box(0, 0, 1, 1))


def test_columns_off_the_terrain_stay_columns():
    """No ground, no points; beside a gap pieces stand closer together and no mass is lost."""
    ground = terrain_of(slope(), hole=(20, 15))
    frame = columns_on(terrain_of(slope()), 2.0)
    result = columns_to_points(frame, ground, PointOptions(cell=0.5))
    bare = ~np.isfinite(ground.sample(*frame.map_xy()))
    assert result.report.outside.count == bare.sum() > 0
    assert (result.rest.particles.id == frame.particles.id[bare]).all()
    assert max(conservation_error(result.report.before, result.report.after, result.report.outside)) < 1e-13
    assert np.isfinite(result.frame.particles.position).all()
    far = dataclasses.replace(frame, origin=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="none of the 768 columns"):
        columns_to_points(far, ground)


def test_one_column():
    """H3: no neighbours, nothing to stretch by."""
    ground = terrain_of(slope())
    frame = columns_on(ground, 2.0)
    frame = dataclasses.replace(frame, particles=frame.particles.take(np.array([5])))
    result = columns_to_points(frame, ground, PointOptions(cell=0.5))
    assert result.report.pieces_per_column == 25 and result.report.after.mass == pytest.approx(frame.particles.mass[0])


def broken(name, value):
    def change(frame):
        values = getattr(frame.particles, name).copy()
        values[3] = value
        setattr(frame.particles, name, values)
        return frame

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (broken("thickness", -1.0), "thickness of column 1003 is -1.0, expected 0 or more"),
        (broken("mass", 0.0), "mass of column 1003 is 0.0, expected above 0"),
        (broken("area", np.nan), "area of column 1003"),
        (broken("velocity", np.inf), "velocity of column 1003"),
        (lambda frame: dataclasses.replace(frame, dimension=3), "expected columns"),
        (lambda frame: dataclasses.replace(frame, particles=frame.particles.take(slice(0))), "no column"),
    ],
)
def test_bad_columns(change, message):
    ground = terrain_of(slope())
    with pytest.raises(InputError, match=message):
        columns_to_points(change(columns_on(ground)), ground)


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        (PointOptions, {"spacing": 0.0}, "spacing is 0"),
        (PointOptions, {"spacing": np.nan}, "spacing is nan"),
        (PointOptions, {"cell": -1.0}, "cell is -1"),
        (PointOptions, {"vertical_velocity": "up"}, "vertical velocity 'up' is unknown"),
        (PointOptions, {"relevel": True}, "relevel requires"),
        (ColumnOptions, {"by": "name"}, "by 'name' is unknown"),
        (ColumnOptions, {"detached": "drop"}, "detached 'drop' is unknown"),
        (ColumnOptions, {"cell": 0.0}, "cell is 0"),
        (ColumnOptions, {"point_cell": np.inf}, "point cell is inf"),
    ],
)
def test_bad_options(kind, options, message):
    with pytest.raises(InputError, match=message):
        kind(**options)


def test_too_many_points():
    ground = terrain_of(slope())
    with pytest.raises(InputError, match="expected at most 2000000000"):
        columns_to_points(columns_on(ground), ground, PointOptions(spacing=1e-7))


def test_columns_without_ids():
    ground = terrain_of(slope())
    frame = columns_on(ground, 2.0)
    values = {name: array for name, array in frame.particles.arrays().items() if name != "id"}
    frame = dataclasses.replace(frame, particles=Particles(**values))
    parent = columns_to_points(frame, ground, PointOptions(spacing=1.0)).frame.particles.parent
    assert (parent == np.repeat(np.arange(len(frame.particles)), 2)).all()
