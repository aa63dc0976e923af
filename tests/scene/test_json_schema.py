"""The JSON Schema of scenes says what the program says."""

import copy
import json
import re
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from mpmgis.commands.shell.main import main
from mpmgis.scene import json_schema, scene_from_tables
from mpmgis.system.errors import SceneError

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^```toml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILES = sorted(path for folder in ("sample_data", "tests") for path in (ROOT / folder).rglob("scene.toml"))
WHOLE = {
    "solver": "columns",
    "terrain": {"dem": "dtm.tif", "to_crs": "auto", "window": [0, 0, 10, 10]},
    "release": {"source": "r.shp", "thickness": 1.5, "velocity": [0.0, 1]},
    "friction": {"law": "Voellmy", "mu": 0.2, "k": 0.005},
    "zones": [{"source": "z.gpkg", "mu": "mu_column"}],
    "entrainment": {"law": "ErosionEnergy", "source": "e.gpkg", "erosion_energy": 1e3},
    "barrier": [{"source": "dam.gpkg", "height": 8}],
    "output": {"end_time": 20, "frame_interval": 5.0, "maxima": True},
}
VALIDATOR = Draft202012Validator(json_schema())


def scenes_of_pages():
    """(page, tables) of every whole scene in the documentation."""
    for page in sorted((ROOT / "mpmgis" / "docs").rglob("*.md")):
        for block in FENCE.findall(page.read_text(encoding="utf-8")):
            try:
                tables = tomllib.loads(block)
            except tomllib.TOMLDecodeError:
                continue
            if {"terrain", "output"} <= set(tables):
                yield pytest.param(tables, id=page.stem)


def test_the_schema_is_one_and_is_printed(capsys):
    Draft202012Validator.check_schema(json_schema())
    assert main(["run", "--schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(json_schema()))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).parent.as_posix())
def test_scenes_of_the_project_are_accepted(path):
    VALIDATOR.validate(tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("tables", list(scenes_of_pages()))
def test_scenes_of_the_documentation_are_accepted(tables):
    VALIDATOR.validate(tables)


def test_a_whole_scene_and_one_with_an_own_law_are_accepted():
    VALIDATOR.validate(WHOLE)
    own = WHOLE | {"friction": {"law": "my_law.py:MyLaw", "strength": 3.0}, "zones": [{"strength": "s.tif"}]}
    VALIDATOR.validate(own)


WRONG = {
    "unknown table": {"terain": {"dem": "d.tif"}},
    "unknown key": {"terrain": {"dem": "d.tif", "dme": "d.tif"}},
    "unknown key of a law": {"friction": {"law": "Voellmy", "mue": 0.2}},
    "parameter of another law": {"friction": {"law": "Coulomb", "mu": 0.2, "xi": 1000.0}, "zones": []},
    "unknown law": {"friction": {"law": "Voelmy", "mu": 0.2}},
    "number above its range": {"friction": {"law": "Coulomb", "mu": 11.0}, "zones": []},
    "text for a number": {"output": {"end_time": "20", "frame_interval": 5.0}},
    "number for text": {"terrain": {"dem": 3}},
    "number for a switch": {"output": {"end_time": 20, "frame_interval": 5.0, "maxima": 1}},
    "switch for a number": {"output": {"end_time": True, "frame_interval": 5.0}},
    "no choice": {"release": {"source": "r.shp", "thickness_mode": "slope"}},
    "zero where it must be above": {"output": {"end_time": 0.0, "frame_interval": 5.0}},
    "missing key": {"output": {"end_time": 20}},
    "a table for a list": {"barrier": {"source": "dam.gpkg", "height": 8}},
    "a list for a table": {"release": [{"source": "r.shp"}]},
    "window of three": {"terrain": {"dem": "d.tif", "window": [0, 0, 10]}},
    "unknown end of a stage": {"stage": [{"solver": "columns", "until": {"tme": 3}}, {"solver": "points"}]},
    "parameter of zones": {"zones": [{"source": "z.gpkg", "moo": 0.3}]},
    "missing parameter": {"entrainment": {"law": "ErosionEnergy", "source": "e.gpkg"}},
    "unknown solver": {"solver": "column"},
}


@pytest.mark.parametrize("case", WRONG)
def test_what_the_program_refuses_the_schema_refuses(case):
    tables = WHOLE | WRONG[case]
    assert not VALIDATOR.is_valid(tables)
    with pytest.raises(SceneError):
        scene_from_tables(copy.deepcopy(tables))


def test_a_scene_needs_something_that_moves():
    assert not VALIDATOR.is_valid({name: table for name, table in WHOLE.items() if name != "release"})
