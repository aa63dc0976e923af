"""A user's own law of friction: what is refused, in one line, and one that runs like any other."""

import json
import shutil
import subprocess
import sys

import pytest
from compiled import compiled_function

from mpmgis.commands.demo_site import sample_folder
from mpmgis.compiled.law_functions import require_compiled
from mpmgis.laws.friction import basal_stress, friction_law, stress_parts
from mpmgis.laws.own_law import NO_OWN_LAWS, load_laws, require_sound, tried_inputs
from mpmgis.scene import TerrainFacts, resolve, scene_from_tables
from mpmgis.system.errors import InputError, SceneError

HEAD = "from typing import NamedTuple\nimport math\n"
SIGNATURE = "    def basal_stress(self, density, gravity, normal_stress, thickness_normal, speed):\n        "
WEAKENING = (
    HEAD
    + "class Weakening(NamedTuple):\n    mu: float\n    mu_fast: float\n    scale: float = 10.0\n"
    + SIGNATURE
    + "return normal_stress * (self.mu_fast + (self.mu - self.mu_fast) / (1.0 + speed / self.scale))\n"
)
TABLES = {"terrain": {"dem": "d.tif"}, "release": {"source": "r.shp"}, "output": {"end_time": 5, "frame_interval": 1}}


def one_law(folder, body, name="Mine", fields="    mu: float\n"):
    """The laws of a file with one class of one method."""
    path = folder / "my_law.py"
    path.write_text(f"{HEAD}class {name}(NamedTuple):\n{fields}{SIGNATURE}{body}\n")
    return load_laws(path)


def made(own, *values):
    (name, (kind, _)), *_ = own.laws.items()
    return kind(*values), name


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return math.sqrt(speed - 1.0) * normal_stress", "basal_stress fails (ValueError"),
        ("return self.mu * normal_stress / speed", "fails (ZeroDivisionError"),
        ("return self.mu * normal_stress - speed", "must be finite and at least 0"),
        ("return normal_stress * float('nan')", "is nan at density 100"),
        ("return 'much'", "fails (ValueError"),
        ("return self.nu * normal_stress", "no attribute 'nu'"),
    ],
)
def test_a_law_that_fails_somewhere_is_refused_with_the_place(tmp_path, body, words):
    law, name = made(one_law(tmp_path, body), 0.4)
    with pytest.raises(SceneError) as error:
        require_sound(law, name)
    assert words in str(error.value) and "my_law.py:Mine" in str(error.value)
    assert "\n" not in str(error.value) and "speed" in str(error.value)


def test_a_law_that_does_not_compile_is_refused_with_what_the_compiler_misses(tmp_path):
    law, name = made(one_law(tmp_path, "return abs(NamedTuple is None) + self.mu * normal_stress"), 0.4)
    require_sound(law, name)
    with pytest.raises(SceneError, match=r"my_law\.py:Mine does not compile: .*NamedTuple.*use arithmetic") as error:
        require_compiled(law, name)
    assert "\n" not in str(error.value)


def test_a_parameter_cannot_have_the_name_of_a_method(tmp_path):
    own = one_law(tmp_path, "return self.at_node * normal_stress", fields="    at_node: float\n")
    law, name = made(own, 0.4)
    with pytest.raises(SceneError, match="'at_node'"):
        require_compiled(law, name)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read"),
        (None, "expected a Python file"),
        ("x = 1\n", "contains no law"),
        ("1 / 0\n", "line 1: ZeroDivisionError"),
        ("def f(:\n", "line 1: SyntaxError"),
        (HEAD + "class Mine(NamedTuple):\n    mu: float\n", "has neither basal_stress"),
        (
            HEAD + "class Mine(NamedTuple):\n    mu: float\n    def basal_stress(self, speed):\n        return 1.0\n",
            r"takes (self, speed), expected (self, density",
        ),
        (HEAD + "class Mine(NamedTuple):\n" + SIGNATURE + "return 1.0\n", "has no parameter"),
    ],
)
def test_a_file_without_a_law_that_fits_is_refused(tmp_path, text, words):
    path = tmp_path / ("law.toml" if "Python" in words else "my_law.py")
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError) as error:
        load_laws(path)
    assert words in str(error.value) and "\n" not in str(error.value)
    assert not list(tmp_path.glob("__pycache__"))


def test_the_split_made_for_a_law_is_the_law(tmp_path):
    """Voellmy written as one method comes out as Voellmy, at every speed it is tried at."""
    own = one_law(
        tmp_path,
        "return self.mu * normal_stress + density * gravity * speed**2 / self.xi",
        fields="    mu: float\n    xi: float\n",
    )
    law, name = made(own, 0.2, 1500.0)
    require_sound(law, name)
    require_compiled(law, name)
    for inputs in tried_inputs():
        assert basal_stress(law, *inputs) == pytest.approx(
            basal_stress(friction_law("Voellmy", 0.2, 1500.0), *inputs), rel=1e-9
        )
        assert min(compiled_function(stress_parts)(law, *inputs)) >= 0.0


def test_a_law_that_weakens_with_speed_keeps_its_stress(tmp_path):
    path = tmp_path / "w.py"
    path.write_text(WEAKENING)
    law, _ = made(load_laws(path), 0.5, 0.2, 10.0)
    for inputs in tried_inputs():
        assert basal_stress(law, *inputs) == pytest.approx(law.basal_stress(*inputs), rel=1e-12)


def test_three_methods_of_ones_own_are_taken_as_they_are(tmp_path):
    path = tmp_path / "three.py"
    path.write_text(
        HEAD + "class Three(NamedTuple):\n    mu: float\n"
        "    def dry_stress(self, density, gravity, normal_stress, thickness_normal, speed):\n"
        "        return self.mu * normal_stress\n"
        "    def viscous_coefficient(self, density, gravity, normal_stress, thickness_normal, speed):\n"
        "        return 3.0\n"
        "    def drag_coefficient(self, gravity, thickness_normal, speed):\n        return 0.01\n"
    )
    law, name = made(load_laws(path), 0.5)
    require_sound(law, name)
    require_compiled(law, name)
    assert basal_stress(law, 1000.0, 9.81, 100.0, 1.0, 2.0) == pytest.approx(50.0 + 6.0 + 40.0)


def test_a_scene_runs_no_file_that_was_not_named(tmp_path):
    friction = {"law": "my_law.py:Weakening", "mu": 0.5, "mu_fast": 0.2}
    path = tmp_path / "my_law.py"
    path.write_text(WEAKENING)
    with pytest.raises(SceneError, match=r"allow it to be run with --law my_law\.py"):
        scene_from_tables({**TABLES, "friction": friction}, own_laws=NO_OWN_LAWS)
    own = load_laws(path)
    scene = scene_from_tables({**TABLES, "friction": friction}, own_laws=own)
    assert scene.friction.parameters == {"mu": 0.5, "mu_fast": 0.2, "scale": 10.0}
    for wrong, words in [
        ({"law": "my_law.py:Other", "mu": 0.5}, "contains my_law.py:Weakening"),
        ({"law": "Coulomb", "mu": 0.5}, "leave --law out"),
        ({**friction, "mue": 1.0}, "no parameter 'mue'"),
        ({"law": "my_law.py:Weakening", "mu": 0.5}, "needs mu_fast"),
    ]:
        with pytest.raises(SceneError) as error:
            scene_from_tables({**TABLES, "friction": wrong}, own_laws=own)
        assert words in str(error.value)


FIELDS = {"neither": "k: float", "mu": "mu: float", "xi": "xi: float", "both": "mu: float; xi: float"}


@pytest.mark.parametrize("named", FIELDS)
def test_effects_of_a_user_law_are_decided_whatever_its_parameters_are(tmp_path, named):
    """A law with xi has turbulent drag, with or without mu; no law ends in an internal error."""
    fields = FIELDS[named]
    own = one_law(tmp_path, "return 0.3 * normal_stress", fields=f"    {fields}\n")
    values = {name: 0.25 if name != "xi" else 1000.0 for name in own.laws["my_law.py:Mine"][1]}
    friction = {"law": "my_law.py:Mine", **values}
    scene = scene_from_tables({**TABLES, "friction": friction}, own_laws=own)
    facts = TerrainFacts(0.0, 0.5, 100.0, 20.0, release_thickness=1.0, release_length=50.0)
    effects, decisions = resolve(scene, facts)
    drag = next(decision for decision in decisions if decision.effect == "turbulent_drag")
    assert scene.dry_friction() == values.get("mu", 0.0)
    assert type(effects.friction).__name__ == "Mine"
    assert drag.state == ("on" if "xi" in values else "off")
    if "xi" in values:  # (U / U_t)^2 with U_t^2 = xi h_n (sin - mu cos)
        cosine = 1.25**-0.5
        expected = 20.0**2 / (1000.0 * cosine * (0.5 * cosine - values.get("mu", 0.0) * cosine))
        assert drag.indicator == pytest.approx(expected)


def test_the_digest_of_a_scene_includes_the_law(tmp_path):
    friction = {"law": "my_law.py:Weakening", "mu": 0.5, "mu_fast": 0.2}
    digests = set()
    for text in (WEAKENING, WEAKENING + "# another\n"):
        (tmp_path / "my_law.py").write_text(text)
        own = load_laws(tmp_path / "my_law.py")
        digests.add(scene_from_tables({**TABLES, "friction": friction}, own_laws=own).digest())
    assert len(digests) == 2


@pytest.mark.slow
def test_a_scene_with_a_law_of_ones_own_runs(tmp_path):
    """Slow, because every kernel is compiled anew in the law's own cache; in processes of their own for its sake."""
    site = tmp_path / "site"
    shutil.copytree(sample_folder(), site)
    (site / "my_law.py").write_text(WEAKENING)
    (site / "scene.toml").write_text(
        '[terrain]\ndem = "lava_falls_dem_utm12n_10m.tif"\n'
        '[release]\nsource = "lava_falls_release_small.shp"\ndensity = 2000\n'
        '[friction]\nlaw = "my_law.py:Weakening"\nmu = 0.5\nmu_fast = 0.2\n'
        "[output]\nend_time = 4\nframe_interval = 2\n"
    )

    def run(*options):
        command = [sys.executable, "-m", "mpmgis", "run", "scene.toml", "-q", *options]
        return subprocess.run(command, cwd=site, capture_output=True, text=True, timeout=600)

    refused = run()
    assert refused.returncode == 2 and "--law my_law.py" in refused.stderr
    assert not (site / "results").exists()
    for option in ("--law", "--overwrite"):  # the second run reads what the first compiled
        done = run("--law", "my_law.py", *(["--overwrite"] if option == "--overwrite" else []))
        assert done.returncode == 0, done.stderr
    record = json.loads((site / "results" / "run.json").read_text())
    friction = next(e for e in record["effects"] if e["effect"] == "friction")
    assert friction["state"] == "on" and "my_law.py:Weakening: mu = 0.5" in friction["reason"]
    assert record["balances"]["kinetic_energy"] > 0
