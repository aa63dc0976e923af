"""Kernels that are compiled before a scene is prepared are those that its run calls."""

import os
import subprocess
import sys
import tomllib

import numba
import pytest
from slope_site import SCENE, slide, write_block_site, write_site

from mpmgis.compiled.called_kernels import argument_types, called_kernels
from mpmgis.compiled.checked_cache import is_kept
from mpmgis.scene import scene_from_tables
from mpmgis.simulation import kernels_ahead
from mpmgis.simulation.kernels_ahead import sample_columns, sample_points
from mpmgis.simulation.preparation import prepare

STAGES = """
[[stage]]
solver = "columns"
until = {time = 0.5}
[[stage]]
solver = "points"
"""
needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
SAMPLES = {"columns": sample_columns, "float64": sample_points, "float32": lambda: sample_points("float32")}


@pytest.fixture
def samples(monkeypatch):
    """A function from tables of a scene to names of the samples that would be made after an installation."""
    monkeypatch.setattr(kernels_ahead, "is_first", lambda loop: True)
    monkeypatch.setattr(kernels_ahead, "sample_columns", lambda: "columns")
    monkeypatch.setattr(kernels_ahead, "sample_points", lambda precision: precision)

    def names(more="", stages="", head=""):
        scene = scene_from_tables(tomllib.loads(slide(8.0, 1.5, 0.5, head, more=more) + stages))
        return [sample() for sample in kernels_ahead._samples(scene)]

    return names


def test_each_solver_of_a_scene_has_a_sample(samples):
    assert samples(head='solver = "points"') == ["float64"]
    assert samples(more='precision = "float32"', stages=STAGES) == ["columns", "float32"]


def test_there_is_no_sample_for_a_device(samples):
    assert samples(more='device = "cuda"', head='solver = "points"') == []
    assert samples(more='device = "auto"', head='solver = "points"') == ["float64"]


def test_there_is_no_sample_of_a_loop_that_is_compiled(samples, monkeypatch):
    monkeypatch.setattr(kernels_ahead, "is_first", lambda loop: False)
    assert samples(stages=STAGES) == []


@needs_compiler
@pytest.mark.parametrize("solver", ["columns", "points"])
def test_a_sample_has_the_types_of_a_scene(tmp_path, solver):
    folder = write_block_site(tmp_path)
    scene = slide(8.0, 1.5, 0.5, head=f'solver = "{solver}"')
    if solver == "columns":
        scene = scene.replace(scene[scene.index("[material]") : scene.index("[friction]")], "")
    (folder / "scene.toml").write_text(scene)
    solvers = SAMPLES["float64" if solver == "points" else solver](), prepare(folder / "scene.toml").solver()
    types = [argument_types(one.kernel.advance, one.step_arguments()) for one in solvers]
    sample, scene = types
    assert sample == scene


@needs_compiler
@pytest.mark.thorough
@pytest.mark.parametrize("sample", SAMPLES)
def test_the_kernels_of_a_loop_are_found_with_the_types_that_it_calls_them_with(sample):
    """Once the loop is compiled, each of them is in the cache: none was found with other types."""
    solver = SAMPLES[sample]()
    loop, arguments = solver.kernel.advance, solver.step_arguments()
    found = called_kernels(loop, argument_types(loop, arguments))
    loop.compile(argument_types(loop, arguments))
    assert len(found) > 15
    assert [kernel.py_func.__name__ for kernel, given in found if not is_kept(kernel, given)] == []


@needs_compiler
@pytest.mark.thorough
def test_the_first_run_of_an_installation_compiles_with_a_child_and_the_second_not_at_all(tmp_path):
    folder = write_site(tmp_path)
    (folder / "scene.toml").write_text(SCENE.replace("end_time = 30", "end_time = 5"))
    environment = os.environ | {"MPMGIS_CACHE_DIR": str(tmp_path / "cache"), "MPMGIS_COMPILE_PROCESSES": "2"}
    command = [sys.executable, "-m", "mpmgis", "run", str(folder / "scene.toml"), "--overwrite"]
    first, second = (
        subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900) for _ in range(2)
    )
    assert first.returncode == second.returncode == 0, first.stderr + second.stderr
    assert "preparing: kernels are compiled once after an installation, " in first.stderr
    assert "kernels compiled in " in first.stderr
    assert "compiled" not in second.stderr
    digests = [line for done in (first, second) for line in done.stderr.splitlines() if "digest of the result" in line]
    assert len(digests) == 2 and digests[0] == digests[1]
