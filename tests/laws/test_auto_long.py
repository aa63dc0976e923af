"""What `auto` leaves out: nothing in the compiled step, and less than 5 % of the result."""

import shutil

import numpy as np
import pytest

from mpmgis.commands.demo_site import sample_folder
from mpmgis.simulation.preparation import prepare
from mpmgis.solvers.columns.column_solver import ColumnSolver

SCENE = """
[terrain]
dem = "lava_falls_dem_utm12n_10m.tif"
[release]
source = "lava_falls_release_small.shp"
density = 2000
[friction]
law = "Voellmy"
mu = 0.25
xi = {xi}
{use}
[output]
end_time = 90
frame_interval = 10
maxima = true
"""
# each just below its threshold on this site
WEAK = {
    "cohesion": "yield_stress = 72",
    "earth_pressure": "friction_angle = 11\nbed_friction_angle = 11",
    "viscosity": "viscosity = 6000",
}


@pytest.fixture
def solver(tmp_path):
    """Function: text of a scene on the sample site -> (its solver, its decisions by name)."""
    site = tmp_path / "site"
    shutil.copytree(sample_folder(), site)

    def made(text):
        path = site / "made.toml"
        path.write_text(text)
        prepared = prepare(path)
        marching = ColumnSolver(prepared.frame, prepared.terrain, prepared.effects, prepared.numerics, prepared.places)
        return marching, {decision.effect: decision for decision in prepared.decisions}

    return made


def outcome(marching, end=90.0):
    """Distance within which 99 % of the mass lies [m], area that the flow covered [m2], 99th percentile of the largest
    thickness of the nodes that it reached [m]."""
    start = marching.frame()
    centre = np.average(np.column_stack(start.map_xy()), axis=0, weights=start.particles.mass)
    marching.advance(end)
    frame = marching.frame()
    away = np.hypot(*(np.column_stack(frame.map_xy()) - centre).T)
    order = np.argsort(away)
    share = np.cumsum(frame.particles.mass[order]) / frame.particles.mass.sum()
    thickness = np.asarray(marching.maxima()["thickness"], float)
    largest = np.percentile(thickness[thickness > 0.05], 99)
    return away[order][np.searchsorted(share, 0.99)], marching.balances()["footprint_area"], largest


@pytest.mark.slow
@pytest.mark.parametrize("name", WEAK)
def test_an_effect_that_auto_leaves_out_changes_runout_area_and_depth_by_less_than_five_percent(solver, name):
    auto, decisions = solver(SCENE.format(xi=1000, use="") + f"[{name}]\n{WEAK[name]}\n")
    forced, others = solver(SCENE.format(xi=1000, use="") + f"[{name}]\n{WEAK[name]}\nuse = 'on'\n")
    assert (decisions[name].state, others[name].state) == ("off", "on")
    assert decisions[name].indicator > 0.7 * decisions[name].threshold, "too weak to tell anything"
    assert outcome(forced) == pytest.approx(outcome(auto), rel=0.05)


@pytest.mark.slow
def test_drag_that_auto_leaves_out_changes_less_than_five_percent(solver):
    auto, decisions = solver(SCENE.format(xi=570_000, use=""))
    forced, _ = solver(SCENE.format(xi=570_000, use='use = "on"'))
    assert decisions["turbulent_drag"].state == "off" and decisions["turbulent_drag"].indicator > 0.024
    assert outcome(forced) == pytest.approx(outcome(auto), rel=0.05)


@pytest.mark.slow
def test_what_is_left_out_costs_nothing_and_changes_no_bit(solver):
    """The same laws make the same compiled step, for kernels are compiled for the types of laws; rows are as wide."""
    voellmy = SCENE.format(xi=1000, use="")
    runs = set()
    weak = "".join(f"[{name}]\n{values}\n" for name, values in WEAK.items())
    for text in (voellmy, voellmy + weak):
        marching, _ = solver(text)
        width = marching.state()["rows"].shape[1]
        outcome(marching)
        runs.add((width, marching.state()["rows"].tobytes(), tuple(map(type, marching.effects))))
    assert len(runs) == 1
