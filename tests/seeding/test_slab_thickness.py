"""Thickness of a released slab: the factor of the Swiss guideline, altitude, wind, return periods."""

import math

import numpy as np
import pytest

from mpmgis.seeding.snow_slabs.slab_thickness import (
    FRICTION,
    REFERENCE_SLOPE,
    STRENGTH,
    NewSnow,
    parsed_depths,
    slope_factor,
)
from mpmgis.system.errors import InputError


def test_the_factor_has_the_values_of_the_guideline():
    np.testing.assert_allclose(
        slope_factor(np.array([28.0, 30, 35, 40, 45])), [1, 0.895, 0.713, 0.596, 0.516], atol=5e-4
    )
    assert np.all(slope_factor(np.array([0.0, 12.0, 27.9, 28.0])) == 1.0)
    steep = slope_factor(np.linspace(28.0, 60.0, 100))
    assert np.all(np.diff(steep) <= 0)


def test_the_factor_is_the_failure_of_a_slab_with_the_strength_at_28_degrees():
    psi = math.radians(REFERENCE_SLOPE)
    assert pytest.approx(math.sin(psi) - FRICTION * math.cos(psi), abs=5e-4) == STRENGTH
    for slope in np.radians([30.0, 40.0, 55.0]):
        thickness = slope_factor(np.degrees([slope]))[0]
        assert thickness * (math.sin(slope) - FRICTION * math.cos(slope)) == pytest.approx(STRENGTH, rel=1e-12)


def test_altitude_and_wind_are_added_before_the_factor():
    snow = NewSnow({30: 0.9, 300: 1.5}, altitude=2000.0, gradient=0.05, wind=0.3, wind_altitude=2200.0)
    slope, elevation = np.array([28.0, 35.0, 28.0]), np.array([2000.0, 2400.0, 1000.0])
    depths = snow.thickness(slope, elevation)
    factor = slope_factor(slope)
    np.testing.assert_allclose(depths[30], np.array([0.9, 0.9 + 0.2 + 0.3, 0.9 - 0.5]) * factor)
    np.testing.assert_allclose(depths[300] - depths[30], 0.6 * factor)
    everywhere = NewSnow({0: 1.0}, wind=0.5).thickness(np.array([28.0]), np.array([0.0]))
    assert everywhere[0].tolist() == [1.5]


def test_there_is_no_negative_thickness():
    low = NewSnow({0: 0.5}, altitude=3000.0).thickness(np.array([30.0]), np.array([500.0]))
    assert low[0].tolist() == [0.0]


@pytest.mark.parametrize(
    ("text", "depths"),
    [("1.2", {0: 1.2}), (1.2, {0: 1.2}), ("30=0.9,300=1.5", {30: 0.9, 300: 1.5}), ({100: 1}, {100: 1.0})],
)
def test_depths_are_a_number_or_by_return_period(text, depths):
    assert parsed_depths(text) == depths


@pytest.mark.parametrize(
    "text", ["", "deep", "30=", "=1", "30:1", "0=1", "-3=1", "1.5=1", "1,2", "30=1,2", "30=1,30=2"]
)
def test_other_texts_are_refused(text):
    with pytest.raises(InputError, match="`snow_depth`"):
        parsed_depths(text)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"depths": {30: 120.0}}, r"`snow_depth` is 120 \(1\.2 m if it is in cm\)"),
        ({"depths": {30: 0.0}}, "`snow_depth` is 0, expected metres above 0"),
        ({"depths": {30: math.nan}}, "`snow_depth`"),
        ({"wind": 30.0}, "`wind` is 30"),
        ({"wind": -0.1}, "`wind`"),
        ({"gradient": 5.0}, "`snow_gradient` is 5"),
    ],
)
def test_depths_in_centimetres_and_other_numbers_are_refused(wrong, says):
    with pytest.raises(InputError, match=says):
        NewSnow(**wrong)
