"""Strength lost by shearing: the laws' own exp, sin and cos against those of math, and their curves."""

import math
from itertools import pairwise

import numpy as np
import pytest

from mpmgis.laws.series import decay, sine_cosine
from mpmgis.laws.softening import LINEAR, Softening, cone, softened_cone, softening
from mpmgis.system.errors import InputError

PEAK, RESIDUAL = (40.0, 1e3), (20.0, 0.0)


def angle_of(slope):
    """phi [deg] of a cone matched at triaxial compression."""
    return math.degrees(math.asin(3.0 * slope / (6.0 + slope)))


def test_decay_is_the_exponential():
    for y in np.linspace(0.0, 40.0, 4001):
        assert abs(decay(y) - math.exp(-y)) <= 1e-14
    assert decay(0.0) == decay(-1.0) == 1.0
    assert 0.0 < decay(1e300) == decay(40.0) < 1e-17


def test_sine_and_cosine_are_those_of_math():
    for angle in np.linspace(0.0, math.pi / 2, 1001):
        sine, cosine = sine_cosine(angle)
        assert abs(sine - math.sin(angle)) <= 1e-12 and abs(cosine - math.cos(angle)) <= 1e-12
    assert sine_cosine(0.0) == (0.0, 1.0)


def test_friction_angle_and_cohesion_fall_exponentially_from_40_to_20_degrees():
    law = softening(PEAK, RESIDUAL, 10.0)
    for strain in (0.0, 0.01, 0.07, 0.23, 1.0, 50.0):
        slope, strength = softened_cone(law, 0.0, 0.0, strain)
        left = math.exp(-10.0 * strain)
        assert angle_of(slope) == pytest.approx(20.0 + 20.0 * left, rel=1e-11)
        assert (slope, strength) == pytest.approx(cone(20.0 + 20.0 * left, 1e3 * left), rel=1e-11, abs=1e-11)
    assert math.exp(-10.0 * 0.23) == pytest.approx(0.1, abs=1e-3)  # 90 % is lost


@pytest.mark.parametrize("form", ["exponential", "tangent", "linear"])
@pytest.mark.parametrize("match", ["triaxial", "plane_strain"])
def test_every_form_goes_from_peak_to_residual(form, match):
    law = softening(PEAK, (20.0, 100.0), 10.0, form=form, match=match)
    assert softened_cone(law, 0.0, 0.0, 0.0) == pytest.approx(cone(*PEAK, match), rel=1e-12)
    assert softened_cone(law, 0.0, 0.0, 1e3) == pytest.approx(cone(20.0, 100.0, match), rel=1e-12)
    slopes = [softened_cone(law, 0.0, 0.0, strain)[0] for strain in np.linspace(0.0, 1.0, 101)]
    assert all(b <= a for a, b in pairwise(slopes))


def test_tangents_are_less_than_a_degree_and_a_half_from_angles():
    angles, tangents = softening(PEAK, RESIDUAL, 10.0), softening(PEAK, RESIDUAL, 10.0, form="tangent")
    apart = [
        abs(angle_of(softened_cone(angles, 0, 0, strain)[0]) - angle_of(softened_cone(tangents, 0, 0, strain)[0]))
        for strain in np.linspace(0.0, 0.5, 101)
    ]
    assert 0.5 < max(apart) < 1.5


def test_linear_softening_starts_at_its_peak_strain():
    law = softening(PEAK, RESIDUAL, 20.0, form="linear", peak_strain=0.01)
    assert law.peak_strain == 0.01 and law.residual_strain == pytest.approx(0.06)
    assert softened_cone(law, 0, 0, 0.01) == pytest.approx(cone(*PEAK), rel=1e-12)
    assert softened_cone(law, 0, 0, 0.035) == pytest.approx(cone(30.0, 500.0), rel=1e-12)
    assert softened_cone(law, 0, 0, 0.0600001) == pytest.approx(cone(*RESIDUAL), rel=1e-12)
    assert law.kind == LINEAR


def test_hard_coefficients():
    """xi_s = 0 never softens, 1e6 does at the first strain; neither divides by anything."""
    assert softened_cone(softening(PEAK, RESIDUAL, 0.0), 0, 0, 1e6) == pytest.approx(cone(*PEAK), rel=1e-12)
    assert softened_cone(softening(PEAK, RESIDUAL, 1e6), 0, 0, 1e-3) == pytest.approx(cone(*RESIDUAL), rel=1e-12)
    assert softened_cone(softening(PEAK, RESIDUAL, 1e6), 0, 0, 0.0) == pytest.approx(cone(*PEAK), rel=1e-12)
    assert softened_cone(softening((0.0, 0.0), (0.0, 0.0), 10.0), 0, 0, 0.1) == (0.0, 0.0)


def test_no_softening_leaves_the_cone():
    assert softened_cone(Softening(), 1.2, 300.0, 5.0) == (1.2, 300.0)


def test_what_is_no_softening_is_refused():
    with pytest.raises(InputError, match="no form 'cubic', expected exponential, tangent or linear"):
        softening(PEAK, RESIDUAL, 10.0, form="cubic")
    with pytest.raises(InputError, match="coefficient 0, expected above 0"):
        softening(PEAK, RESIDUAL, 0.0, form="linear")
    with pytest.raises(InputError, match="match is 'plane', expected one of triaxial, plane_strain"):
        softening(PEAK, RESIDUAL, 10.0, match="plane")
