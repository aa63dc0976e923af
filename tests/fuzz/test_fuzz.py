"""A few of the fuzzer's cases in the ordinary tests; `make fuzz` runs 20 000 of them, `make validate` 2000."""

import ast
import os
import pickle
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import mpmgis
from mpmgis.commands.shell.main import main

pytestmark = pytest.mark.skipif(not hasattr(os, "fork") or sys.platform != "linux", reason="wants fork and /proc")
FUZZER = Path(__file__).with_name("fuzzer.py")


def fuzzed(cases, whole, seed):
    """What the fuzzer said of so many cases; it must have found nothing."""
    words = ["--cases", str(cases), "--whole", str(whole), "--seed", str(seed)]
    done = subprocess.run([sys.executable, str(FUZZER), *words], capture_output=True, text=True, check=False)
    print(done.stdout)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    return done.stdout


@pytest.mark.thorough
def test_three_hundred_damaged_inputs_each_end_in_a_line():
    """Exit code 0, 2 or 3, one line, within 10 s and 1 GB, nothing written outside of the output."""
    assert "0 findings" in fuzzed(300, 2, 20261121)


@pytest.mark.slow
def test_two_thousand_damaged_inputs_each_end_in_a_line():
    assert "0 findings" in fuzzed(2000, 20, 20261122)


# --------------------------------------------------------------------------------------------- no code out of a file


def calls():
    """(module, name of what is called, its keywords) of every call in the program."""
    package = Path(mpmgis.__file__).parent
    for path in sorted(package.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                keywords = {word.arg: ast.unparse(word.value) for word in node.keywords}
                yield path.relative_to(package).as_posix(), ast.unparse(node.func), keywords


# of the compiler's cache, whose folder and checksums are looked at before; of this program's own processes, over pipes;
# installed libraries, which are imported without the settings in the current folder
OWN = {
    ("system/folder_settings.py", "self._loader.exec_module"),
    ("compiled/checked_cache.py", "pickle.loads"),
    ("system/worker_processes.py", "pickle.loads"),
    ("system/worker_processes.py", "pickle.dumps"),
    ("system/worker_processes.py", "subprocess.Popen"),
}


def test_nothing_that_is_read_can_run():
    """No pickle, no eval, no shell; a program is run only out of the file that --law names."""
    forbidden = ("eval", "exec", "compile", "__import__", "os.system", "os.popen", "marshal.loads", "yaml.load")
    loading = ("exec_module", "run_path", "run_module", "SourceFileLoader")
    for module, name, keywords in calls():
        if name in forbidden or name.startswith(("pickle.", "subprocess.")) or name.endswith(loading):
            assert module == "laws/own_law.py" or (module, name) in OWN, (module, name)
        assert keywords.get("allow_pickle", "False") == "False", (module, name)


def test_a_scene_that_names_a_law_in_a_file_runs_nothing(tmp_path, capsys):
    (tmp_path / "law.py").write_text("open('ran', 'w')\n")
    (tmp_path / "scene.toml").write_text(
        '[terrain]\ndem = "a.tif"\n[release]\nsource = "b.shp"\n[friction]\nlaw = "law.py:Law"\n'
        "[output]\nend_time = 1\nframe_interval = 1\n"
    )
    assert main(["run", str(tmp_path / "scene.toml"), "-q"]) == 2
    assert "allow it to be run with --law" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists() and not Path("ran").exists()


class Trap:
    """Unpickled it would make a file."""

    def __reduce__(self):
        return (open, (str(Path("ran").absolute()), "w"))


@pytest.mark.parametrize("kind", ["object", "opaque", "text", "reference"])
def test_a_frame_with_objects_is_refused_and_runs_nothing(kind, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "frame.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update(format="mpmgis-frame", format_version=1, time=0.0, dimension=2)
        particles = file.create_group("particles")
        for name in ("velocity", "mass", "area"):
            particles[name] = np.ones((3, 3) if name == "velocity" else 3)
        raw = pickle.dumps(Trap())
        if kind == "object":
            particles.create_dataset("position", (3,), dtype=h5py.vlen_dtype(np.uint8))
            particles["position"][0] = np.frombuffer(raw, np.uint8)
        elif kind == "opaque":
            particles["position"] = np.array([np.void(raw)] * 3)
        elif kind == "text":
            particles.create_dataset("position", data=["1"] * 3, dtype=h5py.string_dtype())
        else:
            particles.create_dataset("position", data=[file.ref] * 3, dtype=h5py.ref_dtype)
    assert main(["info", str(path), "-q"]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and "expected numbers" in line
    assert not (tmp_path / "ran").exists()
