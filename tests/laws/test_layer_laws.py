"""Layers of a flow with drag: roughness, profile and links (`laws/flow_layers`)."""

import numpy as np
import pytest

from mpmgis.laws import flow_layers
from mpmgis.laws.contact_friction import drag_roughness, equal_roughness
from mpmgis.laws.friction import friction_law

G = 9.81


def test_the_mean_of_the_log_profile_is_voellmys():
    """(1 + r) ln(1 + 1 / r) - 1 = KAPPA sqrt(xi / g): the mean of u(z) / U over the depth is 1, smooth and rough."""
    middles = (np.arange(400_000) + 0.5) / 400_000
    for xi in (2.0, 20.0, 200.0, 2000.0, 2e4):
        chezy = np.sqrt(xi / G)
        rough = flow_layers.relative_roughness(chezy)
        mean = np.mean(np.log1p(middles / rough)) / (flow_layers.KAPPA * chezy)
        assert mean == pytest.approx(1.0, rel=1e-4), xi
        assert flow_layers.layer_speed(0.5, rough, chezy) == pytest.approx(np.log1p(0.5 / rough) / (0.4 * chezy))
        assert drag_roughness(G / xi) == pytest.approx(rough, rel=1e-9)
        for law in (friction_law("Voellmy", 0.4, xi), friction_law("VoellmyMinShear", 0.4, xi, 70.0)):
            assert equal_roughness(law, False, G) == drag_roughness(G / xi) and equal_roughness(law, True, G) == 0.0
    assert flow_layers.relative_roughness(1e8) == flow_layers.SMOOTHEST
    assert drag_roughness(0.0) == 1.0 and equal_roughness(friction_law("Coulomb", 0.4), False, G) == 0.0


def test_links_of_layers_bear_the_steady_stress_at_any_two_heights():
    """rho link slip = rho u*^2 for the log profile, however far apart the layers are."""
    rough, shear = 0.03, 0.7
    for lower, upper in ((0.1, 0.2), (0.1, 2.0), (1.3, 1.9)):
        slip = shear / flow_layers.KAPPA * np.log((upper + rough) / (lower + rough))
        assert flow_layers.turbulent_link(slip, lower + rough, upper + rough) * slip == pytest.approx(shear**2)
    assert np.isfinite(flow_layers.turbulent_link(1.0, 0.5, 0.5))
