"""Where compiled kernels are kept, and what they run on: as the user says, whatever a parent process or machine has."""

import ast
import importlib.util
import os
import pickle
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from random import Random

import numba
import pytest

from mpmgis.compiled import cache_folder as folders
from mpmgis.compiled.jit import jit  # this process has chosen, and says so in its environment

TELL = "import mpmgis.compiled.jit, numba; print(numba.config.CACHE_DIR)"


def imported_at_the_top(path):
    """(file, name) of what a module imports from the package at its top, by Python's own parser."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for alias in node.names:
                inner = base / f"{alias.name}.py"
                yield (inner if inner.exists() else base.with_suffix(".py")), alias.name


def test_the_digest_is_of_all_sources_that_a_kernel_may_be_compiled_from():
    """Whatever the layout of an import: a source that is left out would let stale kernels run."""
    found = {Path(path) for path in folders._kernel_sources()}
    compiler = folders.PACKAGE / "compiled" / "jit.py"
    decorators = ("jit", "kernel_part", "law_")
    package = list(folders.PACKAGE.rglob("*.py"))
    for path in package:
        uses = any(file == compiler and name.startswith(decorators) for file, name in imported_at_the_top(path))
        assert path in found or not uses, path
    for path in found:
        assert {file for file, _ in imported_at_the_top(path) if file.exists()} <= found, path
    assert 60 < len(found) < len(package) / 4  # the whole package would compile kernels again after every edit


def folder_of_a_child(**environment):
    child = [sys.executable, "-c", TELL]
    return Path(subprocess.run(child, env=environment, capture_output=True, text=True, check=True).stdout.strip())


def test_a_child_chooses_for_itself(tmp_path):
    found = folder_of_a_child(**os.environ | {"MPMGIS_CACHE_DIR": str(tmp_path)})
    assert found.is_relative_to(tmp_path)


def test_numbas_own_variable_is_the_users(tmp_path):
    given = tmp_path / "given"
    told = {"NUMBA_CACHE_DIR": str(given), "MPMGIS_CACHE_DIR": str(tmp_path)}
    assert folder_of_a_child(**os.environ | told) == given


def threads_of_a_child(first="numba", then="mpmgis.compiled.jit", **environment):
    tell = f"import {first}, {then}; mpmgis.compiled.jit.ready_threads(); print(numba.threading_layer())"
    child = subprocess.run([sys.executable, "-c", tell], env=environment, capture_output=True, text=True, check=True)
    return child.stdout.strip()


def test_openmp_threads_are_the_default_and_the_user_can_choose_others():
    if importlib.util.find_spec("numba.np.ufunc.omppool") is None or sys.platform == "darwin":
        pytest.skip("numba has no OpenMP here")
    own = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_THREADING_LAYER")}
    assert threads_of_a_child(**own) == threads_of_a_child("mpmgis.compiled.jit", "numba", **own) == "omp"
    assert threads_of_a_child(**own | {"NUMBA_THREADING_LAYER_PRIORITY": "workqueue omp tbb"}) == "workqueue"


def half(number):
    """What the processes below compile, one for whole numbers and one for others."""
    return number / 2


needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
posix_only = pytest.mark.skipif(os.name != "posix", reason="owners and modes of folders are those of POSIX")


@needs_compiler
def test_two_processes_that_compile_at_a_time_do_not_take_each_others_code(monkeypatch):
    """Both have read the index before either wrote it, and the first is last to write its code."""
    first, second = jit(half), jit(half)
    files, late = first._cache._cache_file, []
    files.flush()
    monkeypatch.setattr(files, "_save_data", lambda *given: late.append(given))
    assert first(3) == 1.5
    second._cache._cache_file.flush()  # as if it had read the index before
    assert second(7.5) == 3.75
    monkeypatch.undo()
    for given in late:
        files._save_data(*given)
    third = jit(half)
    assert third(7.5) == 3.75 and third.signatures == [(numba.float64,)]
    assert third.stats.cache_hits and third(3) == 1.5


# ------------------------------------------------------------------------------------- what is damaged, and who owns it


def double(number):
    """What the tests below compile."""
    return 2 * number


def compiled(folder, monkeypatch):
    """A kernel of `double` with its cache in `folder`."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder))
    return jit(double)


def cached_files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def damage(path, how, random):
    content = bytearray(path.read_bytes())
    if how == "byte":
        content[random.randrange(len(content))] ^= 1 << random.randrange(8)
    elif how == "cut":
        del content[random.randrange(len(content)) :]
    elif how == "longer":
        content += b"\0"
    else:
        content[:] = random.randbytes(len(content))
    path.write_bytes(content)


@needs_compiler
@pytest.mark.parametrize("how", ["byte", "cut", "longer", "junk"])
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_a_damaged_cache_is_dropped_and_compiled_anew(tmp_path, monkeypatch, how, suffix):
    assert compiled(tmp_path, monkeypatch)(3) == 6
    random = Random(f"{how} {suffix}")
    for _ in range(8):
        whole = {path: path.read_bytes() for path in cached_files(tmp_path)}
        damaged = [path for path in whole if path.suffix == suffix]
        assert damaged
        for path in damaged:
            damage(path, how, random)
        again = compiled(tmp_path, monkeypatch)
        assert again(4) == 8 and not again.stats.cache_hits
        third = compiled(tmp_path, monkeypatch)
        assert third(5) == 10 and third.stats.cache_hits


@needs_compiler
def test_code_under_the_name_of_other_code_is_not_run(tmp_path, monkeypatch):
    kernel = compiled(tmp_path, monkeypatch)
    assert kernel(3) == 6 and kernel(3.5) == 7.0
    first, second = (path for path in cached_files(tmp_path) if path.suffix == ".nbc")
    one, other = first.read_bytes(), second.read_bytes()
    first.write_bytes(other)
    second.write_bytes(one)
    again = compiled(tmp_path, monkeypatch)
    assert (again(3), again(3.5)) == (6, 7.0) and not again.stats.cache_hits


@needs_compiler
def test_a_cache_that_cannot_be_written_is_none(tmp_path, monkeypatch):
    kernel = compiled(tmp_path, monkeypatch)
    monkeypatch.setattr(kernel._cache._cache_file, "_index_path", str(tmp_path / "gone" / "x.nbi"))
    assert kernel(3) == 6


class Planted:
    """Unpickled, it leaves a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@needs_compiler
def test_what_others_put_into_the_cache_is_not_unpickled(tmp_path, monkeypatch):
    assert compiled(tmp_path, monkeypatch)(3) == 6
    for path in cached_files(tmp_path):
        path.write_bytes(pickle.dumps(Planted(tmp_path / "ran")))
    assert compiled(tmp_path, monkeypatch)(4) == 8
    assert not (tmp_path / "ran").exists()


def chosen(tmp_path, monkeypatch):
    """The folder for caches below `tmp_path` as its own process would choose it."""
    monkeypatch.setenv("MPMGIS_CACHE_DIR", str(tmp_path / "root"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.delenv(folders.CHOSEN, raising=False)
    monkeypatch.setattr(folders, "_private", [])
    monkeypatch.setattr(folders.atexit, "register", lambda *given: None)
    (tmp_path / "tmp").mkdir(exist_ok=True)
    return folders.cache_folder()


def is_private(folder, tmp_path):
    assert stat.S_IMODE(folder.parent.stat().st_mode) == 0o700
    return folder.is_relative_to(tmp_path / "tmp")


@posix_only
def test_the_cache_is_the_users_alone(tmp_path, monkeypatch):
    folder = chosen(tmp_path, monkeypatch)
    assert folder.parent == tmp_path / "root" / "mpmgis"
    assert [stat.S_IMODE(path.stat().st_mode) for path in (folder, folder.parent)] == [0o700, 0o700]
    (folder / "kept").touch()
    folder.chmod(0o755)
    assert chosen(tmp_path, monkeypatch) == folder and stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert (folder / "kept").exists()


@posix_only
@pytest.mark.parametrize("mode", [0o777, 0o770])
def test_a_cache_that_others_could_write_to_is_emptied(tmp_path, monkeypatch, mode):
    folder = chosen(tmp_path, monkeypatch)
    (folder / "planted").mkdir()
    (folder / "planted" / "x.nbi").touch()
    folder.chmod(mode)
    assert chosen(tmp_path, monkeypatch) == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700 and not list(folder.iterdir())


@posix_only
@pytest.mark.parametrize("which", ["mpmgis", "name"])
@pytest.mark.parametrize("what", ["link", "dangling", "file", "fifo", "others"])
def test_a_cache_that_is_not_the_users_is_not_used(tmp_path, monkeypatch, which, what):
    usual = chosen(tmp_path, monkeypatch)
    place = usual if which == "name" else usual.parent
    shutil.rmtree(place)
    (tmp_path / "victim").mkdir()
    if what == "others":
        if not hasattr(os, "geteuid") or os.geteuid() != 0:
            pytest.skip("only root can give a folder to another user")
        place.mkdir()
        os.chown(place, 12345, 12345)
    elif what == "file":
        place.touch()
    elif what == "fifo":
        os.mkfifo(place)
    else:
        place.symlink_to(tmp_path / ("victim" if what == "link" else "nowhere"))
    assert is_private(chosen(tmp_path, monkeypatch), tmp_path)
    assert not list((tmp_path / "victim").iterdir()) and not (tmp_path / "nowhere").exists()


@posix_only
def test_a_root_that_anybody_may_write_to_is_not_used(tmp_path, monkeypatch):
    (tmp_path / "root").mkdir()
    (tmp_path / "root").chmod(0o777)
    assert is_private(chosen(tmp_path, monkeypatch), tmp_path)
    (tmp_path / "root").chmod(0o1777)
    assert chosen(tmp_path, monkeypatch).is_relative_to(tmp_path / "root")


@posix_only
def test_a_predictable_folder_in_the_systems_temporary_one_is_not_used(tmp_path, monkeypatch):
    (tmp_path / "root").touch()  # no folder can be made there
    planted = tmp_path / "tmp" / f"mpmgis-{os.getuid()}" / folders.source_digest()
    planted.mkdir(parents=True)
    folder = chosen(tmp_path, monkeypatch)
    assert is_private(folder, tmp_path) and not folder.is_relative_to(planted.parent)


@posix_only
def test_a_private_cache_is_that_of_children_too_and_goes_at_the_end(tmp_path):
    (tmp_path / "root").touch()
    environment = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", folders.CHOSEN)}
    tell = (
        "import mpmgis.compiled.jit, numba, subprocess, sys; print(numba.config.CACHE_DIR, flush=True);"
        f"subprocess.run([sys.executable, '-c', {TELL!r}])"
    )
    environment |= {"MPMGIS_CACHE_DIR": str(tmp_path / "root"), "TMPDIR": str(tmp_path)}
    child = subprocess.run([sys.executable, "-c", tell], env=environment, capture_output=True, text=True, check=True)
    first, second = child.stdout.split()
    assert first == second and Path(first).is_relative_to(tmp_path) and not Path(first).parent.exists()


@posix_only
def test_a_given_folder_that_is_anothers_is_not_used(tmp_path, monkeypatch):
    monkeypatch.delenv(folders.CHOSEN, raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "given"))
    assert folders.given_cache_folder() == str(tmp_path / "given")
    (tmp_path / "given").chmod(0o777)
    assert folders.given_cache_folder() is None
