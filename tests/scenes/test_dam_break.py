"""Water let go in a tank against its end wall, through `mpmgis run`: front and pressure as measured."""

import numpy as np
import pytest
from chain import scene_module

pytestmark = pytest.mark.thorough

dam = scene_module("dam_break")


def test_the_impulse_is_taken_from_the_arrival_on():
    """A constant 1 kPa from 0.05 s on, of which the measured impact time is a part."""
    time = np.arange(0.0, 0.4, 0.001)
    found = dam.Course(time, 0.0 * time, np.where(time >= 0.05, 1000.0, 0.0)[:, None])
    assert dam.early_impulse(found) == pytest.approx(1000.0 * 0.111, rel=0.02)
    assert dam.first_pressure(found) == pytest.approx([1000.0])


@pytest.mark.parametrize(("cells", "late", "fast", "impulse", "least"), [
    (16, 0.07, 1.62, 1012.0, 0.78),
    pytest.param(32, 0.065, 1.52, 1108.0, 0.85, marks=pytest.mark.slow),
])  # fmt: skip
def test_water_runs_to_the_wall_and_presses_on_it_as_measured(tmp_path, cells, late, fast, impulse, least):
    """Measured: dZ / dt* 1.25 (Martin and Moyce 1.40), impulse 1274 Pa s at 3 mm: 21 and 13 % too low."""
    size = dam.Size(0.6, cells)
    record = dam.make(tmp_path / "dam", size, end_time=0.5)
    assert abs(record["balances"]["mass_error_relative"]) <= 1e-12 and record["volume"]["kept"]
    found = dam.course(tmp_path / "dam", size, dam.PEAKS[:, 0])
    assert dam.front_error(found, size) <= late
    scaled = found.time * np.sqrt(dam.GRAVITY / size.depth), found.front / size.depth
    assert dam.front_speed(*scaled) == pytest.approx(fast, abs=0.06)
    assert dam.early_impulse(found) == pytest.approx(impulse, rel=0.05)
    assert dam.IMPACT["impulse"] * least < dam.early_impulse(found) < dam.IMPACT["impulse"] * 1.4
