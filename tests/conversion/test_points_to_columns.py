"""Points back to columns: the round trip, cells, what has left the bed."""

import dataclasses
import math

import numpy as np
import pytest
from converting import DENSITY, ORIGIN, columns_on, hills, slope, terrain_of, with_particles
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.conversion.columns_to_points import columns_to_points
from mpmgis.conversion.conserved_sums import conservation_error
from mpmgis.conversion.conversion_options import ColumnOptions, PointOptions
from mpmgis.conversion.points_to_columns import points_to_columns
from mpmgis.frames.particles import Frame, Particles
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.system.errors import InputError


def moving(ground, **more):
    rate = np.array([[0.2, 0.05], [-0.1, -0.15]])
    frame = columns_on(
        ground,
        lambda x, y: 2 + np.sin(x / 5),
        lambda x, y: (3 + 0.2 * (x - 40) + 0.05 * (y - 35), -0.1 * (x - 40) - 0.15 * (y - 35)),
        **more,
    )
    return dataclasses.replace(frame, state={"velocity_gradient": np.tile(rate, (len(frame.particles), 1, 1))})


@pytest.mark.parametrize(
    "options",
    [
        PointOptions(spacing=0.2),
        PointOptions(spacing=50.0),
        PointOptions(cell=0.5),
        PointOptions(spacing=0.3, vertical_velocity="linear"),
        PointOptions(spacing=0.1, placement="paper", counting="paper"),
    ],
    ids=str,
)
def test_there_and_back(options):
    """Mass, centre, momentum to 1e-12; thickness and area too, because nothing was relevelled.

    The bed takes the motion across it, of points that are not above the column's centre or move vertically in it.
    """
    ground = terrain_of(hills)
    frame = moving(ground)
    points = columns_to_points(frame, ground, options)
    back = points_to_columns(points.frame, ground)
    before, after = frame.particles, back.frame.particles
    assert back.report.by == "parent" and (after.id == before.id).all() and back.rest is None
    assert np.abs(after.mass / before.mass - 1).max() < 1e-12
    for axis in (0, 1):
        there = after.position[:, axis] + back.frame.origin[axis]
        assert np.abs(there / (before.position[:, axis] + frame.origin[axis]) - 1).max() < 1e-12
        scale = np.abs(before.velocity[:, :2]).max()
        along = options.cell is None and options.vertical_velocity == "tangent"
        assert np.abs(after.velocity[:, axis] - before.velocity[:, axis]).max() < (1e-12 if along else 0.04) * scale
    assert np.abs(after.thickness / before.thickness - 1).max() < 1e-9
    assert np.abs(after.area / before.area - 1).max() < 1e-9
    assert after.position[:, 2] + back.frame.origin[2] == pytest.approx(before.position[:, 2], abs=1e-9)
    assert max(conservation_error(back.report.before, back.report.after, back.report.bed)) < 1e-12
    if options.placement != "paper" and along:
        assert back.frame.state["velocity_gradient"] == pytest.approx(frame.state["velocity_gradient"], abs=1e-9)
    assert back.frame.dimension == 2


def scattered(ground, rng, fastest, highest, count=800):
    """Points strewn over and above a terrain, with velocities in all directions."""
    x, y = rng.uniform(10.0, 90.0, count), rng.uniform(10.0, 70.0, count)
    height = rng.uniform(0.0, highest, count) * (rng.uniform(size=count) < 0.5)
    z = ground.sample(x + ORIGIN[0], y + ORIGIN[1]) + height
    velocity = rng.normal(size=(count, 3))
    velocity *= (fastest * rng.uniform(size=count) / np.linalg.norm(velocity, axis=1))[:, None]
    mass = rng.uniform(1.0, 2000.0, count)
    return Frame(Particles(np.column_stack([x, y, z]), velocity, mass, mass / DENSITY), dimension=3, origin=ORIGIN)


def by_cells(points, ground, cell):
    """Rows of the points in each cell of `cell` m, west to east, north to south: an independent loop."""
    west, _, _, north = ground.grid.bounds
    found = {}
    for row, (x, y) in enumerate(zip(*points.map_xy(), strict=True)):
        found.setdefault((math.floor((north - y) / cell), math.floor((x - west) / cell)), []).append(row)
    return [found[key] for key in sorted(found)]


@given(
    degrees=st.floats(0.0, 80.0),
    aspect=st.floats(0.0, 360.0),
    jump=st.floats(0.0, 60.0),
    cell=st.floats(1.0, 10.0),
    solver=st.booleans(),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_column_moves_along_the_bed_with_no_more_than_its_points(degrees, aspect, jump, cell, solver, seed):
    """Speed and kinetic energy never above those of the points, what the bed takes is booked, to 1e-12.

    On a plane, with a cliff and with single blocks on it; on a plane the momentum is P sum(m v), P = 1 - n n^T.
    """
    rng = np.random.default_rng(seed)
    east, north = (math.tan(math.radians(degrees)) * f(math.radians(aspect)) for f in (math.cos, math.sin))
    ground = terrain_of(lambda x, y: 900.0 + east * x + north * y + jump * ((x > 50) + (np.hypot(x - 30, y - 30) < 4)))
    points = scattered(ground, rng, 40.0, 30.0)
    grid = ColumnGrid.on(ground, 2.0)
    options = ColumnOptions(by="cell", cell=cell, detached="lay")
    made = points_to_columns(points, ground, options, slopes=grid.gradients_at if solver else None)
    columns, report = made.frame.particles, made.report
    assert max(conservation_error(report.before, report.after, report.bed)) < 1e-12
    total = report.after.kinetic + report.bed.kinetic + report.kinetic_lost
    assert total == pytest.approx(report.before.kinetic, rel=1e-12)
    speed = np.linalg.norm(columns.velocity, axis=1)
    if solver:  # the speed that the solver has on its own bed
        climb = (columns.velocity[:, :2] * grid.gradients_at(made.frame)).sum(axis=1)
        np.testing.assert_allclose(climb, columns.velocity[:, 2], atol=1e-9)
    normal = np.array([-east, -north, 1.0]) / math.sqrt(1.0 + east**2 + north**2)
    of_points, mass = points.particles.velocity, points.particles.mass
    rows = by_cells(points, ground, cell)
    assert len(rows) == len(columns)
    for column, some in enumerate(rows):
        assert speed[column] <= np.linalg.norm(of_points[some], axis=1).max() * (1 + 1e-12)
        energy = (mass[some] * (of_points[some] ** 2).sum(axis=1)).sum()
        assert columns.mass[column] * speed[column] ** 2 <= energy * (1 + 1e-12)
        if jump == 0.0:
            momentum = mass[some] @ of_points[some]
            along = momentum - (momentum @ normal) * normal
            np.testing.assert_allclose(columns.mass[column] * columns.velocity[column], along, atol=1e-5 * mass.max())


def test_twice_there_and_back_is_once():
    """On a plane; on a bent bed the bed takes a part each time."""
    ground = terrain_of(slope())
    once = points_to_columns(columns_to_points(moving(ground), ground, PointOptions(cell=1.0)).frame, ground).frame
    twice = points_to_columns(columns_to_points(once, ground, PointOptions(cell=1.0)).frame, ground).frame
    for name, values in once.particles.arrays().items():
        assert values == pytest.approx(getattr(twice.particles, name), rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize("cell", [None, 5.0])
def test_by_cell(cell):
    """Thickness is what the mass fills of the cell, area the cell's; momentum and centre are the points'."""
    ground = terrain_of(slope(), pixel=2.0)
    points = columns_to_points(columns_on(ground, 2.0, spacing=1.0), ground, PointOptions(cell=1.0)).frame
    points.header["density"] = DENSITY
    result = points_to_columns(points, ground, ColumnOptions(by="cell", cell=cell))
    columns, side = result.frame.particles, cell or 2.0
    assert result.report.by == "cell" and result.report.cell_area == side**2
    assert (columns.area == side**2).all()
    assert len(columns) == 40 * 30 / side**2
    assert columns.thickness == pytest.approx(2.0, rel=1e-9)
    assert columns.mass == pytest.approx(DENSITY * 2.0 * side**2)
    assert max(conservation_error(result.report.before, result.report.after)) < 1e-12
    x = result.frame.map_xy()[0]
    assert ((x - ORIGIN[0]) / side) % 1 == pytest.approx(0.5)
    assert columns.velocity[:, 2] == pytest.approx(-0.5 * columns.velocity[:, 0] + 0.2 * columns.velocity[:, 1])


def test_gradient_of_a_cell():
    """The velocity field of the points, by least squares: exact where it is linear."""
    ground = terrain_of(slope())
    frame = moving(ground)
    points = columns_to_points(frame, ground, PointOptions(cell=0.5)).frame
    result = points_to_columns(points, ground, ColumnOptions(by="cell", cell=5.0))
    wanted = np.tile(frame.state["velocity_gradient"][0], (len(result.frame.particles), 1, 1))
    assert result.frame.state["velocity_gradient"] == pytest.approx(wanted, abs=1e-9)
    assert result.report.kinetic_lost > 0


def lifted(points, height=0.0, speed=0.0, east=40.0):
    """Points with those east of `east` [m from ORIGIN] raised by `height` and given an upward `speed`."""
    position, velocity = points.particles.position.copy(), points.particles.velocity.copy()
    up = position[:, 0] + points.origin[0] - ORIGIN[0] > east
    position[up, 2] += height
    velocity[up, 2] += speed
    return with_particles(points, position=position, velocity=velocity), up


@pytest.mark.parametrize("spacing", [0.3, 1.0, 2.9, 5.0, 20.0])
@pytest.mark.parametrize("thickness", [0.5, 3.0, 9.0])
def test_columns_of_few_points_come_back_whatever_the_spacing(thickness, spacing):
    """Down to one point a column, which then stands half the thickness above the bed."""
    ground = terrain_of(slope())
    columns = columns_on(ground, thickness)
    points = columns_to_points(columns, ground, PointOptions(spacing=spacing)).frame
    back = points_to_columns(points, ground).frame.particles
    np.testing.assert_allclose(back.thickness, columns.particles.thickness, rtol=1e-9)
    np.testing.assert_allclose(back.area, columns.particles.area, rtol=1e-9)
    flying = lifted(points, 4.0 * spacing + thickness + 20.0, 0.0)[0]
    with pytest.raises(InputError, match="clear of the bed"):
        points_to_columns(flying, ground)


@pytest.mark.parametrize(("height", "speed"), [(3.0, 0.0), (0.0, 4.0)])
@pytest.mark.parametrize("by", ["parent", "cell"])
def test_what_has_left_the_bed(height, speed, by):
    """Refused by name and place, or kept as points; the rest becomes columns and nothing is lost."""
    ground = terrain_of(slope())
    points = columns_to_points(columns_on(ground, 2.0), ground, PointOptions(cell=1.0)).frame
    points, up = lifted(points, height, speed)
    with pytest.raises(InputError, match=r"clear of the bed or moving across it.*--detached keep"):
        points_to_columns(points, ground, ColumnOptions(by=by, cell=5.0))
    result = points_to_columns(points, ground, ColumnOptions(by=by, cell=5.0, detached="keep"))
    report = result.report
    assert max(conservation_error(report.before, report.after, report.detached)) < 1e-12
    assert report.detached.mass == pytest.approx(points.particles.mass[up].sum(), rel=1e-12)
    assert set(result.rest.particles.id) == set(points.particles.id[up])
    assert len(result.rest.state["depth"]) == up.sum()
    everything = lifted(points, height, speed, east=-1.0)[0]
    with pytest.raises(InputError, match="all of the flow"):
        points_to_columns(everything, ground, ColumnOptions(by=by, cell=5.0, detached="keep"))


def test_the_launch_of_the_printed_velocity_is_refused():
    """Points with vertical velocity 0 on a slope are leaving it."""
    ground = terrain_of(slope())
    frame = columns_on(ground, 2.0, (15.0, 0.0))
    points = columns_to_points(frame, ground, PointOptions.as_printed(0.2)).frame
    with pytest.raises(InputError, match="768 of 768 columns"):
        points_to_columns(points, ground)


def test_a_slow_settling_is_no_flight():
    ground = terrain_of(slope())
    points = columns_to_points(columns_on(ground, 2.0, (0.0, 0.0)), ground, PointOptions(cell=1.0)).frame
    points, _ = lifted(points, speed=-0.3)
    assert points_to_columns(points, ground).report.detached.count == 0


@pytest.mark.parametrize("cell", [0.3, 1.0, 4.0])
@pytest.mark.parametrize(("share", "lifts"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_speed_that_lifts_by_a_tenth_of_a_cell_is_flight(cell, share, lifts, up):
    """v^2 / (2 g) is the height of a throw."""
    ground = terrain_of(lambda x, y: 0 * x)
    points = columns_to_points(columns_on(ground, 2.0, (0.0, 0.0)), ground, PointOptions(spacing=0.5)).frame
    points, _ = lifted(points, speed=up * share * math.sqrt(2.0 * 9.81 * 0.1 * cell))
    found = points_to_columns(points, ground, ColumnOptions(point_cell=cell, detached="keep"))
    assert (found.report.detached.count > 0) == lifts


def test_points_that_moved_apart_are_binned():
    """A column whose points were strewn is none any more; --by parent enforces it."""
    ground = terrain_of(slope())
    points = columns_to_points(columns_on(ground, 2.0), ground, PointOptions(cell=1.0)).frame
    position = points.particles.position.copy()
    shift = np.random.default_rng(1).uniform(-4, 4, len(position))
    position[:, 1] += shift
    position[:, 2] += 0.2 * shift
    points = with_particles(points, position=position)
    result = points_to_columns(points, ground, ColumnOptions(cell=5.0))
    assert result.report.by == "cell" and result.report.apart > 0.5
    assert points_to_columns(points, ground, ColumnOptions(by="parent")).report.by == "parent"


def test_points_off_the_terrain_stay_points():
    ground = terrain_of(slope())
    points = columns_to_points(columns_on(ground, 2.0), ground, PointOptions(cell=1.0)).frame
    position = points.particles.position.copy()
    position[:50, 0] += 500.0
    points = with_particles(points, position=position)
    result = points_to_columns(points, ground, ColumnOptions(by="cell"))
    assert result.report.outside.count == 50 and len(result.rest.particles) == 50
    assert max(conservation_error(result.report.before, result.report.after, result.report.outside)) < 1e-12


def test_bad_points():
    ground = terrain_of(slope())
    frame = columns_on(ground, 2.0)
    points = columns_to_points(frame, ground, PointOptions(cell=1.0)).frame
    with pytest.raises(InputError, match="expected points"):
        points_to_columns(frame, ground)
    with pytest.raises(InputError, match="none of the"):
        points_to_columns(dataclasses.replace(points, origin=(0.0, 0.0, 0.0)), ground)
    orphans = with_particles(points, parent=None)
    with pytest.raises(InputError, match="have no parent identities"):
        points_to_columns(orphans, ground, ColumnOptions(by="parent"))
    assert points_to_columns(orphans, ground).report.by == "cell"
    sunk, _ = lifted(points, -5.0, east=-1.0)
    with pytest.raises(InputError, match="are below the bed"):
        points_to_columns(sunk, ground, ColumnOptions(by="parent"))
    bad = points.particles.velocity.copy()
    bad[7] = np.nan
    with pytest.raises(InputError, match="velocity of point 7"):
        points_to_columns(with_particles(points, velocity=bad), ground)
