"""MOX report 15/2025, section 4.3: what the conversion keeps, and what the report's own measure measures."""

import numpy as np
import pytest
from converting import columns_on, hills, over_bed, terrain_of

from mpmgis.conversion.columns_to_points import columns_to_points
from mpmgis.conversion.conserved_sums import conservation_error, particle_mass_scatter, points_sum
from mpmgis.conversion.conversion_options import PointOptions

SPACINGS_X = (0.02, 0.01, 0.005, 0.0033, 0.0025, 0.0017)
SPACINGS_Z = (0.01, 0.001, 0.0001, 0.00005, 0.00001)
SPEED, DENSITY = 2.001, 1000.0
VOLUME = 250.0 - 0.5 * (1.0 - np.cos(10.0)) * np.sin(5.0)
QUADRATURE = (2.93e-7, 7.32e-8, 1.83e-8, 7.98e-9, 4.58e-9, 2.12e-9)
LONG = [pytest.param(h, marks=pytest.mark.slow) if h < 0.003 else h for h in SPACINGS_X]


def paper_columns(spacing):
    """(thickness, side) of the report's columns, as many as come nearest to `spacing` [m] along a side of 5 m."""
    count = round(5.0 / spacing)
    at = (np.arange(count) + 0.5) * 5.0 / count
    return (10.0 - np.sin(2.0 * at)[None, :] * np.cos(at)[:, None]).ravel(), 5.0 / count


@pytest.mark.parametrize("spacing", LONG)
def test_mass_and_momentum_at_every_spacing(spacing):
    """In closed form: up to 8.6e12 points, which nobody has ever stored."""
    thickness, side = paper_columns(spacing)
    mass = DENSITY * side**2 * thickness
    before = mass.sum()
    for vertical in SPACINGS_Z:
        for counting in ("round", "paper"):
            count = PointOptions(counting=counting).points_in(thickness, vertical)
            assert abs(points_sum(count, mass) / before - 1.0) < 1e-13
            assert abs(points_sum(count, mass, SPEED) / (before * SPEED) - 1.0) < 1e-13


@pytest.mark.parametrize("vertical", [20.0, 3.0, 0.1, 0.01])
def test_closed_form_is_what_stored_points_sum_to(vertical):
    """The sums over stored points and over columns are the same, one point a column included."""
    ground = terrain_of(hills, pixel=1.0)
    frame = columns_on(ground, lambda x, y: 10.0 - np.sin(2 * x) * np.cos(y), (SPEED, 0.0), 0.25, (20, 25, 20, 25))
    options = PointOptions(spacing=vertical)
    result = columns_to_points(frame, ground, options)
    points, columns = result.frame.particles, frame.particles
    count = options.points_in(columns.thickness, vertical)
    assert len(points) == count.sum()
    assert points.mass.sum() == pytest.approx(points_sum(count, columns.mass), rel=1e-13)
    assert (points.mass * points.velocity[:, 0]).sum() == pytest.approx(
        points_sum(count, columns.mass, SPEED), rel=1e-13
    )
    report = result.report
    assert max(conservation_error(report.before, report.after)) < 1e-13
    assert report.mass_scatter == pytest.approx(
        particle_mass_scatter(count, columns.mass, columns.volume, columns.mass.sum())
    )
    share = points.mass.sum() / len(points)
    stored = np.sqrt((points.volume * (points.mass - share) ** 2).sum() / points.volume.sum())
    assert report.mass_scatter == pytest.approx(stored, rel=1e-9)


def test_quadrature_against_the_exact_volume():
    """Midpoint columns are of second order, 2.9e-7 to 2.1e-9."""
    errors = []
    for spacing in SPACINGS_X[:5]:
        thickness, side = paper_columns(spacing)
        errors.append(abs(side**2 * thickness.sum() / VOLUME - 1.0))
    assert errors == pytest.approx(QUADRATURE[:5], rel=0.02)
    assert np.polyfit(np.log(SPACINGS_X[:5]), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.02)


def scatter(spacing, vertical, value=1.0, kept=1.0, counting="paper"):
    thickness, side = paper_columns(spacing)
    volume = side**2 * thickness
    count = PointOptions(counting=counting).points_in(thickness, vertical)
    exact = DENSITY * VOLUME * value
    return particle_mass_scatter(count, kept * DENSITY * volume, volume, exact, value)


@pytest.mark.parametrize("value", [1.0, SPEED])
def test_the_printed_measure_falls_with_the_size_of_particles(value):
    """Figure 12: quadratic in hx. In hz it falls at least linearly (Eqs 7, 8 only bound it)."""
    wide = SPACINGS_X[:4]
    errors = [scatter(spacing, 0.01, value) for spacing in wide]
    assert np.polyfit(np.log(wide), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)
    errors = [scatter(0.02, vertical, value) for vertical in SPACINGS_Z]
    assert np.all(np.diff(errors) < 0)
    assert np.polyfit(np.log(SPACINGS_Z), np.log(errors), 1)[0] >= 1.0


def test_the_printed_measure_does_not_see_lost_mass():
    """A tenth of the mass thrown away has the same rate: eps is a scatter of particle masses, no conservation."""
    wide = SPACINGS_X[:4]
    losing = [scatter(spacing, 0.01, kept=0.9) for spacing in wide]
    assert np.polyfit(np.log(wide), np.log(losing), 1)[0] == pytest.approx(2.0, abs=0.1)
    thickness, side = paper_columns(0.02)
    assert abs(0.9 * side**2 * thickness.sum() / VOLUME - 1.0) == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("placement", "ratio"), [("centred", lambda m: 1 - 1 / m**2), ("paper", lambda m: (m + 1) / (m - 1))]
)
@pytest.mark.parametrize("count", [2, 4, 8, 16])
def test_second_moment_of_a_column(placement, ratio, count):
    """Measured on the points: the printed levels have 2/(M - 1) too much, slices 1/M^2 too little."""
    ground = terrain_of(lambda x, y: 0 * x + 100.0)
    frame = columns_on(ground, 2.0)
    result = columns_to_points(frame, ground, PointOptions(spacing=2.0 / count, placement=placement))
    height = over_bed(result.frame, ground) - 1.0
    assert np.mean(height) == pytest.approx(0.0, abs=1e-12)
    assert np.mean(height**2) / (2.0**2 / 12) == pytest.approx(ratio(count), rel=1e-9)
    assert result.report.second_moment == pytest.approx(ratio(count), rel=1e-12)


def test_energies():
    """The centre of mass stays, potential energy too; tangent motion adds its own energy only."""
    ground = terrain_of(hills)
    frame = columns_on(ground, lambda x, y: 2 + np.sin(x / 5), lambda x, y: (5 + 0.1 * x, 0.05 * y))
    for options in (PointOptions(spacing=0.2), PointOptions(spacing=0.2, placement="paper", counting="paper")):
        result = columns_to_points(frame, ground, options)
        before, after = result.report.before, result.report.after
        assert abs(after.potential / before.potential - 1.0) < 1e-12
        assert after.kinetic_horizontal == pytest.approx(before.kinetic_horizontal, rel=1e-13)
        points, columns = result.frame.particles, frame.particles
        for axis in (0, 1):
            centre = (points.mass * (points.position[:, axis] + result.frame.origin[axis])).sum() / points.mass.sum()
            held = (columns.mass * (columns.position[:, axis] + frame.origin[axis])).sum() / columns.mass.sum()
            assert abs(centre / held - 1.0) < 1e-13
        assert before.kinetic_vertical == 0.0 and after.kinetic_vertical > 0.0
        tangent = sum_of_climb(ground, frame)
        assert after.kinetic_vertical == pytest.approx(tangent, rel=1e-12)


def sum_of_climb(ground, frame):
    """Kinetic energy of u . grad b, bilinear gradients by hand."""
    row, column = ground.grid.rowcol(*frame.map_xy())
    i, j = np.floor(row).astype(int), np.floor(column).astype(int)
    f, g = (row - i)[:, None], (column - j)[:, None]
    slopes = ground.limited_gradient
    here = (1 - f) * ((1 - g) * slopes[i, j] + g * slopes[i, j + 1]) + f * (
        (1 - g) * slopes[i + 1, j] + g * slopes[i + 1, j + 1]
    )
    climb = (here * frame.particles.velocity[:, :2]).sum(axis=1)
    return 0.5 * (frame.particles.mass * climb**2).sum()


def test_as_printed_deletes_columns_of_one_point():
    """0/0 in Eq (2) and 'eliminate NaN' lose the thin columns; the report says how much."""
    ground = terrain_of(hills)
    frame = columns_on(ground, lambda x, y: np.where(x < 30, 0.15, 1.0))
    result = columns_to_points(frame, ground, PointOptions.as_printed(0.1))
    thin = frame.particles.thickness < 0.2
    assert result.report.deleted.mass == pytest.approx(frame.particles.mass[thin].sum(), rel=1e-13)
    assert result.report.deleted.count == thin.sum() > 0
    report = result.report
    assert max(conservation_error(report.before, report.after, report.deleted)) < 1e-13
    assert not np.isin(frame.particles.id[thin], result.frame.particles.parent).any()
    assert (result.frame.particles.velocity[:, 2] == 0).all() and result.frame.state == {}
    height = over_bed(result.frame, ground)
    assert height.min() == pytest.approx(0.0, abs=1e-9) and height.max() == pytest.approx(1.0, abs=1e-9)
    kept = columns_to_points(frame, ground, PointOptions(spacing=0.1))
    assert kept.report.after.mass == pytest.approx(frame.particles.mass.sum(), rel=1e-13)


@pytest.mark.parametrize("thickness", [0.4, 1.49, 1.51, 1.99, 7.3])
def test_spacing_of_floor_and_round(thickness):
    """Floor leaves up to 2 r between the slices' points, round at most 1.5 r."""
    for counting, most in (("paper", 2.0), ("round", 1.5)):
        slices = thickness / PointOptions(counting=counting).points_in(np.array([thickness]), 1.0)[0]
        assert slices < most
    assert PointOptions(counting="paper").points_in(np.array([1.99]), 1.0)[0] == 1
    assert PointOptions().points_in(np.array([1.99]), 1.0)[0] == 2
