"""Energy that appears without a source between two frames stops a run of either solver, with one line."""

import numpy as np
import pytest
from test_guard import block, pool

from mpmgis.frames.particle_store import GAIN_STOP, EnergyLook, least_kinetic
from mpmgis.simulation.time_integration import TimeIntegration
from mpmgis.solvers.columns import column_rows
from mpmgis.solvers.points import point_rows
from mpmgis.system.errors import UnphysicalError

MOTION = {"points": [point_rows.PX, point_rows.PY, point_rows.PZ], "columns": [column_rows.U, column_rows.V]}


def scene(name):
    """A block that slides and falls, with stable steps, and released water."""
    return block(0.5) if name == "points" else pool_at(0.2)


def pool_at(step):
    solver = pool()
    solver._settings = solver._settings._replace(fixed_dt=step)
    solver._whole_step["fixed_dt"] = step
    return solver


def plant(solver, name, gain, after):
    """Increase the kinetic energy by the share `gain` [1] in each slice of steps of `solver` from `after` [s] on."""
    advance = solver.advance

    def planting(*given, **named):
        code = advance(*given, **named)
        if solver.time > after:
            rows = int(solver._counts[solver.kernel.ROWS])
            solver.arrays.rows[:rows, MOTION[name]] *= np.sqrt(1.0 + gain)
        return code

    solver.advance = planting


@pytest.mark.parametrize("name", ["points", "columns"])
def test_a_fifth_more_kinetic_energy_stops_the_run(name):
    end, interval, after = (0.4, 0.02, 0.03) if name == "points" else (12.0, 0.5, 3.0)
    whole = TimeIntegration(scene(name), end, interval)
    assert len(list(whole)) > 10 and whole.troubles == []
    solver = scene(name)
    plant(solver, name, 0.2, after)
    with pytest.raises(UnphysicalError) as stopped:
        list(TimeIntegration(solver, end, interval))
    line = str(stopped.value)
    assert "\n" not in line and f"the {name} gained" in line and "out of nothing since t = " in line
    assert "steps of down to 1/32" in line


def test_the_gain_is_held_against_kinetic_energy_and_work_since_the_last_look():
    last = EnergyLook(-5.0, 100.0, 1.0, (20.0, 3.0), 1.0)
    share, made = EnergyLook(9.0, 110.0, 1.0, (30.0, -7.0), 2.0).gained_since(last)
    assert made == 14.0 and share == pytest.approx(14.0 / (100.0 + 10.0 + 10.0)) and share > GAIN_STOP
    at_rest = last._replace(kinetic=0.0, work=(30.0, -7.0))
    assert EnergyLook(-4.0, 0.0, 1.0, (30.0, -7.0), 2.0).gained_since(at_rest)[0] == 1.0
    assert least_kinetic(2000.0, 1.0, 10.0, 0.1) == 20.0 and least_kinetic(0.0, 1.0, 10.0, 0.1) == pytest.approx(0.01)
