"""Layers of a flow with Voellmy's drag: roughness, profile and links, plain and compiled (`laws/flow_layers`)."""

import numpy as np
import pytest
from compiled import compiled_function

from mpmgis.laws import flow_layers
from mpmgis.laws.contact_friction import (
    coulomb_contact,
    layer_friction,
    layer_roughness,
    sticking_contact,
    voellmy_contact,
)

G = 9.81


def test_the_mean_of_the_log_profile_is_voellmys():
    """(1 + r) ln(1 + 1 / r) - 1 = KAPPA sqrt(xi / g): the mean of u(z) / U over the depth is 1, smooth and rough."""
    middles = (np.arange(400_000) + 0.5) / 400_000
    for xi in (2.0, 20.0, 200.0, 2000.0, 2e4):
        chezy = flow_layers.chezy_number(xi, G)
        rough = flow_layers.relative_roughness(chezy)
        mean = np.mean(np.log1p(middles / rough)) / (flow_layers.KAPPA * chezy)
        assert mean == pytest.approx(1.0, rel=1e-4), xi
        assert flow_layers.layer_speed(0.5, rough, chezy) == pytest.approx(np.log1p(0.5 / rough) / (0.4 * chezy))
    assert flow_layers.relative_roughness(1e8) == flow_layers.SMOOTHEST


def test_links_of_layers_bear_the_steady_stress_at_any_two_heights():
    """rho link slip = rho u*^2 for the log profile, however far apart the layers are."""
    rough, shear = 0.03, 0.7
    for lower, upper in ((0.1, 0.2), (0.1, 2.0), (1.3, 1.9)):
        slip = shear / flow_layers.KAPPA * np.log((upper + rough) / (lower + rough))
        assert flow_layers.turbulent_link(slip, lower + rough, upper + rough) * slip == pytest.approx(shear**2)
    assert np.isfinite(flow_layers.turbulent_link(1.0, 0.5, 0.5))


def test_contact_laws_of_layers_agree_with_compiled():
    for law in (coulomb_contact(0.4), voellmy_contact(0.4, 500.0), voellmy_contact(0.4, 1e15), sticking_contact()):
        assert compiled_function(layer_friction)(law) == layer_friction(law)
        assert compiled_function(layer_roughness)(law, 9.81) == pytest.approx(layer_roughness(law, 9.81), rel=1e-12)
    assert layer_friction(voellmy_contact(0.4, 500.0)) == 0.4 and layer_friction(coulomb_contact(0.4)) == 0.0
