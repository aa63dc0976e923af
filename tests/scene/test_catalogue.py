"""The catalogue of `mpmgis effects`: whatever a scene may name is in it, with its quantities and their units."""

from dataclasses import fields

import pytest

from mpmgis.commands.shell.main import main
from mpmgis.laws import entrainment, friction
from mpmgis.scene import catalogue
from mpmgis.scene.tables import TABLES
from mpmgis.terrain.inflow import COLUMNS

ENTRIES = catalogue()
EFFECTS = [name for name in TABLES if name not in ("terrain", "release", "numerics", "output", "stage")]
UNITS = {
    "1",
    "m",
    "s",
    "Pa",
    "Pa s",
    "Pa s^n",
    "s m-1/3",
    "degrees",
    "m s-1",
    "m s-2",
    "m3 s-1",
    "kg m-3",
    "J kg-1",
    "m-1",
    "as the law has them",
}


def of(table):
    return [entry for entry in ENTRIES if entry["table"] == table]


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_is_there_with_what_it_is_and_its_quantities(name):
    """Each key that may be a number is listed with its unit; so is each parameter of each law, and nothing else."""
    assert of(name)
    numbers = {f.name for f in fields(TABLES[name]) if "kind" in f.metadata and float in _kinds(f)}
    for entry in of(name):
        assert entry["what"].endswith(".") and len(entry["what"]) > 15
        assert numbers <= set(entry["parameters"])
        assert set(entry["parameters"].values()) <= UNITS


def _kinds(f):
    return f.metadata["kind"] if isinstance(f.metadata["kind"], tuple) else (f.metadata["kind"],)


@pytest.mark.parametrize(("table", "laws"), [("friction", friction.LAWS), ("entrainment", entrainment.LAWS)])
def test_every_law_is_there_by_the_name_that_a_scene_gives_it(table, laws):
    assert [entry["law"] for entry in of(table)] == list(laws)
    for entry, (_, parameters) in zip(of(table), laws.values(), strict=True):
        units = {name: parameter.unit for name, parameter in parameters.items()}
        assert list(entry["parameters"].items())[: len(units)] == list(units.items())


def test_what_has_no_key_of_its_own():
    assert [entry["law"] for entry in of("numerics")] == ["form = 'slope'", "form = 'swe'"]
    inflow = of("hydrograph")[0]["parameters"]
    assert {name.removeprefix("file: "): unit for name, unit in inflow.items() if "file" in name} == COLUMNS
    assert not {entry["table"] for entry in ENTRIES} - {*EFFECTS, "numerics"}


def test_the_command_prints_it(capsys):
    assert main(["effects"]) == 0
    out = capsys.readouterr().out
    for entry in ENTRIES:
        assert f"[{entry['table']}]{' ' * bool(entry['law'])}{entry['law'] or ''}: {entry['what']}" in out
    assert "viscosity [Pa s], yield_stress [Pa]" in out and "trigger_thickness [m]" in out
