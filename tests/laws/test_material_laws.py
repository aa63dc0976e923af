"""Earth pressure and in-plane viscosity one by one, plain and compiled alike."""

import math

import pytest
from compiled import compiled_function

from mpmgis.laws.friction import plug_ratio
from mpmgis.laws.internal_stress import (
    SWITCH,
    EarthPressure,
    InPlaneViscosity,
    apparent_viscosity,
    earth_pressure,
    is_hydrostatic,
    is_viscous,
    largest_factor,
    pressure_factor,
)


@pytest.mark.parametrize("law", [EarthPressure(0.5, 3.0), EarthPressure()])
def test_earth_pressure_plain_and_compiled_agree(law):
    for rate in (-10.0, -0.3, -1e-9, 0.0, 1e-9, 0.3):
        plain = pressure_factor(law, rate, 0.03)
        assert compiled_function(pressure_factor)(law, rate, 0.03) == pytest.approx(plain, rel=1e-15)
        assert plain == 1.0 or not is_hydrostatic(law)


VISCOUS = [InPlaneViscosity(30.0, 200.0), InPlaneViscosity(30.0, 0.0), InPlaneViscosity(0.0, 200.0), InPlaneViscosity()]


@pytest.mark.parametrize("law", VISCOUS)
def test_viscosity_plain_and_compiled_agree(law):
    for state in ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (1.0, 3.0, -4.0, 0.1, 0.2, -0.3), (1e-4, 40.0, 0.0, 2.0, 0.0, 0.0)):
        plain = apparent_viscosity(law, *state)
        assert math.isfinite(plain) and (plain > 0.0 if is_viscous(law) else plain == 0.0)
        assert compiled_function(apparent_viscosity)(law, *state) == pytest.approx(plain, rel=1e-12)


@pytest.mark.parametrize("phi", [10.0, 30.0, 45.0])
def test_earth_pressure_without_bed_friction_is_rankines(phi):
    law = earth_pressure(phi, 0.0)
    assert law.active == pytest.approx(math.tan(math.radians(45.0 - phi / 2)) ** 2)
    assert law.passive == pytest.approx(math.tan(math.radians(45.0 + phi / 2)) ** 2)


def test_earth_pressure_of_a_bed_as_rough_as_the_material_has_one_value():
    law = earth_pressure(30.0, 30.0)
    assert (
        law.active == pytest.approx(law.passive, abs=1e-7) == pytest.approx(2.0 / math.cos(math.radians(30)) ** 2 - 1)
    )


def test_earth_pressure_is_active_where_it_stretches_and_passive_where_it_is_compressed():
    law, dt = earth_pressure(35.0, 25.0), 0.03
    assert law.active < 1.0 < law.passive == largest_factor(law)
    assert pressure_factor(law, 0.1, dt) == pressure_factor(law, 0.0, dt) == law.active
    assert pressure_factor(law, -1.01 * SWITCH / dt, dt) == law.passive
    middle = pressure_factor(law, -0.5 * SWITCH / dt, dt)
    assert middle == pytest.approx(0.5 * (law.active + law.passive))


def test_viscosity_of_a_column_at_rest_is_that_of_its_regularisation():
    assert apparent_viscosity(InPlaneViscosity(30.0, 200.0), 1.0, 0, 0, 0, 0, 0) == pytest.approx(30.0 + 100.0 / 1e-3)


def test_a_sliding_column_is_sheared_through_its_depth():
    """Without shear in the map the invariant is that of D_xz = 1.5 u / ((2 + Z) h) alone."""
    law, depth, speed = InPlaneViscosity(30.0, 200.0), 2.0, 5.0
    shear = 1.5 * speed / ((2.0 + plug_ratio(200.0, 30.0, depth, speed)) * depth)
    expected = 30.0 + 100.0 / math.hypot(shear, 1e-3)
    assert apparent_viscosity(law, depth, 3.0, 4.0, 0, 0, 0) == pytest.approx(expected)
