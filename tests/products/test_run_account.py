"""The words of a run's balances, by numbers that are given."""

from collections import defaultdict

from mpmgis.products.run_account import account


def balances(**told):
    """Balances that are 0 but for what is told."""
    return defaultdict(float, {"barriers": {}, "mass_start": 200.0, "mass_released": 200.0} | told)


def test_points_that_were_laid_back_are_told_by_their_share_of_the_mass():
    said = "% of the mass came more than a cell under the ground"
    assert not any(said in line for line in account(balances(), "points"))
    assert any(line.startswith(f"0.25 {said}") for line in account(balances(mass_lifted_onto_ground=0.5), "points"))


def test_energy_of_points_is_told_by_what_took_it_and_the_rest_is_left_over():
    lost = balances(energy_lost=100.0, energy_lost_to_ground=60.0, energy_lost_to_yielding=30.0)
    (line,) = (line for line in account(lost, "points") if line.startswith("energy"))
    assert line == "energy: 100 J lost: 60 J to the bed, 30 J to yielding, 10 J to blows, viscosity and the grid"


def test_what_left_and_what_came_in_later_are_shares_of_all_that_was_released():
    lines = account(balances(mass_start=150.0, mass_out=1.0), "columns")
    assert lines[0].startswith("mass: 150 kg at the start, 50 kg came in later, 0.50 % left the terrain")
    assert not any("larger DTM" in line for line in lines)
    assert any("larger DTM" in line for line in account(balances(mass_out=10.0), "columns"))


def test_what_was_taken_up_is_told_beside_the_release():
    assert "entrained: 0.4 kg, 0.00 times the release" in account(balances(mass_entrained=0.4), "columns")
    assert not any("entrained" in line for line in account(balances(), "columns"))


def test_what_is_beyond_the_model_is_told_from_its_thresholds_on():
    lines = account(balances(airborne_share_max=0.06, speed_limited_share_max=0.004), "columns")
    assert any("6 % of the mass would have left the ground" in line for line in lines)
    assert any("0.4 % of the mass was held to the speed" in line for line in lines)
    assert not any("beyond the model" in line for line in account(balances(airborne_share_max=0.05), "columns"))
