"""Before a run a few particles go through all its stages: what is compiled is compiled then, and said."""

import subprocess
import sys

import pytest
from slope_site import slide, write_block_site

from mpmgis.scene.scene_reading import read_toml
from mpmgis.simulation import warmup
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.stage import Stage
from mpmgis.simulation.warmup import FEW, warm_up
from mpmgis.studies import ensemble_member
from mpmgis.studies.ensemble_member import MemberTask, warmed
from mpmgis.system.errors import InputError
from mpmgis.system.messages import collected

STAGES = """
[[stage]]
solver = "columns"
until = {time = 0.5}
[[stage]]
solver = "points"
until = {calm = 1, time = 1}
[[stage]]
solver = "columns"
"""
CHILD = """
import sys
from mpmgis.compiled import jit
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.warmup import warm_up
from mpmgis.simulation.stage_sequence import StageSequence
def compiled():
    return sum(len(kernel.signatures) for kernel in jit._kernels)
prepared = prepare(sys.argv[1])
before = compiled()
warm_up(prepared)
ready = compiled()
frames = list(StageSequence(prepared))
print(before < ready, compiled() - ready, [frame.dimension for frame in frames])
"""


@pytest.fixture
def scene(tmp_path):
    folder = write_block_site(tmp_path)
    (folder / "scene.toml").write_text(slide(8.0, 1.5, 0.5, head="", more="particles_per_cell = 4") + STAGES)
    return folder / "scene.toml"


@pytest.mark.thorough
def test_a_run_compiles_nothing_after_its_warm_up(scene):
    """In a process of its own, where nothing is loaded: all kernels of all stages are there before the first step."""
    done = subprocess.run([sys.executable, "-c", CHILD, scene], capture_output=True, text=True, check=False)
    assert done.stdout.split(maxsplit=2) == ["True", "0", "[2, 3, 2, 2]\n"], done.stdout + done.stderr


def test_a_few_particles_go_through_every_stage(scene):
    frames = warm_up(prepare(scene))
    assert [frame.dimension for frame in frames] == [2, 3, 2]
    assert len(frames[0].particles) == FEW and all(len(frame.particles) for frame in frames)


def test_each_long_stage_has_a_message(scene, monkeypatch):
    """A timer that has run out as soon as it starts."""

    class Over:
        def __init__(self, seconds, function, arguments):
            self.start = lambda: function(*arguments)

        def cancel(self):
            pass

    monkeypatch.setattr(warmup.threading, "Timer", Over)
    prepared = prepare(scene)
    with collected() as said:
        warm_up(prepared, first=1)
    assert [line.split(":")[0] for line in said] == [
        "preparing stage 2 of 3 (points)",
        "preparing stage 3 of 3 (columns)",
    ]
    assert all("compiled" in line for line in said)


def test_an_error_at_a_switch_ends_the_warm_up(scene, monkeypatch):
    def refuse(*_):
        raise InputError("no")

    monkeypatch.setattr(Stage, "switched_from", refuse)
    assert [frame.dimension for frame in warm_up(prepare(scene))] == [2]


def test_workers_of_an_ensemble_are_warmed_for_all_stages(scene, monkeypatch):
    seen = []
    monkeypatch.setattr(ensemble_member, "average_frame", lambda frame, averaging: seen.append(frame.dimension))
    task = MemberTask(0, "", read_toml(scene), str(scene.parent), "scene.toml", None, "", None, 0.05)
    warmed(task, task.prepared())
    assert seen == [2, 3, 2]
