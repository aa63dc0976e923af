"""Text of a run's balances for given numbers."""

from collections import defaultdict

import pytest

from mpmgis.simulation.run_summary import account, extreme_lines, extremes, flight_lines


def balances(**told):
    """Balances of 0, except the given ones."""
    places = {"thickness_max_at": [600000.0, 5100000.0], "speed_max_at": [600010.0, 5100020.0]}
    return defaultdict(float, {"barriers": {}, "mass_start": 200.0, "mass_released": 200.0} | places | told)


ENERGY = {
    "energy_start": 900.0,
    "energy_released_later": 50.0,
    "energy_entrained": 50.0,
    "energy_lost": 100.0,
    "energy_lost_to_ground": 60.0,
    "energy_lost_to_eroded_mass": 45.0,
    "energy_lost_to_bends": -5.0,
    "kinetic_energy": 3.0,
    "energy_error_relative": 2e-4,
}
POINT_ENERGY = {"energy_lost": 100.0, "energy_lost_to_yielding": 30.0, "energy_lost_to_mixing": 10.0}
LEFT = {"mass_start": 150.0, "mass_out": 1.0}


@pytest.mark.parametrize(
    ("solver", "told", "words"),
    [
        ("points", {"mass_lifted_onto_ground": 0.5}, "0.25 % of the mass was more than a cell below the ground"),
        (
            "points",
            POINT_ENERGY | {"energy_lost_to_ground": 60.0},
            "energy: 100 J lost: 60 J to the bed, 30 J to yielding, 10 J to impacts, viscosity and the grid",
        ),
        (
            "points",
            {"speed_p999": 12.34, "speed_p999_time": 7.0},
            "99.9th percentile of the speed by mass: 12.3 m/s at most, in the frame at t = 7.0 s",
        ),
        ("columns", LEFT, "mass: 150 kg at the start, 50 kg entered later, 0.50 % left the terrain"),
        ("columns", {"mass_out": 10.0}, "larger DTM"),
        (
            "columns",
            ENERGY,
            "energy: 900 J at the start, 50 J entered later, 50 J with eroded mass; 100 J lost: 60 J to friction on "
            "the bed, 45 J to acceleration of eroded mass, -5 J to bends of the bed; kinetic now 3 J; the balance "
            "closes to 0.0002 of the input",
        ),
        ("columns", ENERGY | {"energy_error_relative": -2e-3}, "is off by -0.2 %"),
        ("columns", {"mass_entrained": 0.4}, "entrained: 0.4 kg, 0.00 times the release"),
        ("columns", {"airborne_share_max": 0.06}, "6 % of the mass would have left the ground"),
        ("columns", {"speed_limited_share_max": 0.004}, "0.4 % of the mass was limited to the speed"),
    ],
)
def test_what_is_above_its_threshold_is_reported_in_one_line(solver, told, words):
    assert sum(words in line for line in account(balances(**told), solver)) == 1


@pytest.mark.parametrize(
    ("solver", "told", "words"),
    [
        ("points", {}, "below the ground"),
        ("columns", LEFT, "larger DTM"),
        ("columns", {}, "entrained"),
        ("columns", {"airborne_share_max": 0.05}, "outside the model"),
    ],
)
def test_what_is_not_is_not(solver, told, words):
    assert not any(words in line for line in account(balances(**told), solver))


def test_mass_in_flight_that_became_columns_is_reported():
    def stage(laid):
        return {"time": 14.0, "switch": {"laid_mass": laid, "before": {"mass": 200.0}}}

    assert flight_lines([{"solver": "columns"}, stage(0.0), stage(2.0)]) == []
    (line,) = flight_lines([stage(1.0), stage(40.0), {"solver": "columns"}])
    assert line.startswith("in flight: stage 2 ended at t = 14 s with 20 % of the mass above the bed")


def test_locations_of_lost_mass_are_reported_with_a_fix():
    places = [
        {"where": "hole", "mass": 100.0, "east": 600.04, "north": 50.0},
        {"where": "west", "mass": 20.0, "east": 0.0, "north": 7.0},
        {"where": "collar", "mass": 4.0, "east": 3.0, "north": 8.0},
        *({"where": "east", "mass": 1.0, "east": 9.0, "north": float(k)} for k in range(3)),
        {"where": "south", "mass": 1e-4, "east": 9.0, "north": 0.0},
    ]
    for solver in ("columns", "points"):
        lines = account(balances(mass_out=127.0, left_places=places), solver)
        hole = "  50 % (100 kg) flowed into a hole of the DTM at E 600.0 N 50.0: set [terrain] fill_nodata ="
        assert any(line.startswith(hole) for line in lines)
        assert "  10 % (20 kg) over the west edge of the DTM at E 0.0 N 7.0" in lines
        assert any(line.startswith("  2 % (4 kg) flowed into the nodata around the DTM at E 3.0") for line in lines)
        assert "  1 % (2 kg) at 2 more locations" in lines


@pytest.mark.parametrize("solver", ["columns", "points"])
def test_largest_thickness_and_speed_have_their_place_and_time(solver):
    told = balances(thickness_max=3.25, thickness_max_time=4.0, speed_max=21.5, speed_max_time=7.25, mach_max=0.1)
    lines = account(told, solver)
    for said in (
        "largest vertical thickness 3.25 m at E 600000.0 N 5100000.0, t = 4.0 s",
        "largest speed 21.5 m/s at E 600010.0 N 5100020.0, t = 7.2 s",
    ):
        assert any(line.startswith(said) for line in lines)


@pytest.mark.parametrize("solver", ["columns", "points"])
@pytest.mark.parametrize(("share", "flagged"), [(0.45, False), (1.0, False), (1.1, True)])
def test_a_speed_above_free_fall_is_flagged(solver, share, flagged):
    lines = account(balances(speed_bound_ratio=share), solver)
    assert any("outside the model" in line and "110 %" in line for line in lines) == flagged
    assert any("45 % of" in line for line in lines) == (share == 0.45)


def test_the_extremes_of_stages_are_the_largest_of_them_and_of_columns_outside():
    def part(thickness, speed):
        at = {"thickness_max_at": [1.0, thickness], "speed_max_at": [2.0, speed]}
        return at | {"thickness_max": thickness, "speed_max": speed, "thickness_max_time": 5.0, "speed_max_time": 6.0}

    found = extremes([part(3.0, 4.0), part(2.0, 5.0) | {"outside_columns": part(3.5, 1.0)}, {"mass_start": 1.0}])
    assert found["thickness"] == {"value": 3.5, "at": [1.0, 3.5], "time": 5.0, "stage": 2}
    assert found["speed"] == {"value": 5.0, "at": [2.0, 5.0], "time": 6.0, "stage": 2}
    assert extreme_lines(found)[1] == "largest speed along the ground of all stages: 5.00 m/s at E 2.0 N 5.0, t = 6.0 s"
    assert extremes([{"mass_start": 1.0}]) == {} and extreme_lines({}) == []
