"""Kernels that a loop calls are found without compiling them, and compiled by several processes."""

import os
import subprocess
import sys
import threading
from contextlib import contextmanager
from types import SimpleNamespace

import numba
import numpy as np
import pytest
import small_kernels

from mpmgis.compiled import compilation
from mpmgis.compiled.called_kernels import argument_types, called_kernels
from mpmgis.compiled.checked_cache import has_any, is_kept
from mpmgis.compiled.compilation import Compilation, begun, complete, processes
from mpmgis.compiled.jit import jit
from mpmgis.system import worker_processes
from mpmgis.system.messages import progress_shown

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

CALLED = ("ends", "clip", "halves", "scale")  # by the loop itself
# In a process of its own with an empty cache: prints which kernels this process has compiled itself
CHILD = """
import sys, time
import numpy as np
import small_kernels
from numba.core import event
from mpmgis.compiled.called_kernels import argument_types, called_kernels
from mpmgis.compiled.checked_cache import is_kept
from mpmgis.compiled.compilation import begun, complete, processes
own = []

class Listener(event.Listener):
    def on_start(self, what):
        own.append(what.data["dispatcher"].py_func.__name__)

    def on_end(self, what):
        pass

event.register("numba:compile", Listener())
call = np.ones(8), small_kernels.Limits(0.0, 1.0), 2
assert processes() == int(sys.argv[1])
with begun([(small_kernels.loop, call)] * (processes() - 1)):
    while processes() > 1 and not all(
        is_kept(kernel, given)
        for kernel, given in called_kernels(small_kernels.loop, argument_types(small_kernels.loop, call))
    ):
        time.sleep(0.1)
    complete(small_kernels.loop, call)
small_kernels.loop(*call)
print(*sorted({name for name in own if hasattr(small_kernels, name)}))
"""


def call(dtype=float):
    return np.ones(8, dtype), small_kernels.Limits(0.0, 1.0), 2


def compiled_by(folder, number):
    """Names of the kernels that one of `number` processes with the cache `folder` compiles itself, not its children."""
    environment = os.environ | {"MPMGIS_CACHE_DIR": str(folder), "MPMGIS_COMPILE_PROCESSES": str(number)}
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    child = [sys.executable, "-c", CHILD, str(number)]
    done = subprocess.run(child, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


@pytest.mark.parametrize(("dtype", "count"), [(np.float64, 4), (np.float32, 5)])
def test_the_kernels_found_are_those_that_compilation_needs(dtype, count):
    """Also their types: of records, of what other kernels return with an annotation and without, in both precisions."""
    given = argument_types(small_kernels.loop, call(dtype))
    before = [set(kernel.overloads) for kernel in map(small_kernels.__dict__.get, CALLED)]
    found = called_kernels(small_kernels.loop, given)
    assert [set(kernel.overloads) for kernel in map(small_kernels.__dict__.get, CALLED)] == before
    assert len(found) == count and {kernel.py_func.__name__ for kernel, _ in found} == set(CALLED)
    small_kernels.loop.compile(given)
    assert all(is_kept(kernel, types) or types in kernel.overloads for kernel, types in found)


def test_one_process_compiles_all(tmp_path):
    assert compiled_by(tmp_path, 1) == {*CALLED, "clipped", "loop"}
    assert compiled_by(tmp_path, 1) == set()


@pytest.mark.thorough
def test_children_compile_what_the_loop_calls(tmp_path):
    assert compiled_by(tmp_path, 2) == {"loop"}
    assert compiled_by(tmp_path, 1) == set()


# ------------------------------------------------------------------------------------- without compilation


@pytest.fixture
def pieces(monkeypatch):
    """Kernels that count as not compiled, and the names of those that are compiled by this process."""
    done = []
    monkeypatch.setattr(compilation, "is_kept", lambda kernel, given: False)
    monkeypatch.setattr(compilation, "called_kernels", lambda loop, given: [(kernel_of(n), (n,)) for n in CALLED])
    monkeypatch.setattr(compilation, "compile_piece", lambda piece: done.append(piece.name))
    return done


def kernel_of(name):
    return getattr(small_kernels, name)


class Loop:
    """In place of a loop; it says when it is compiled."""

    py_func, overloads = small_kernels.loop.py_func, {}

    def __init__(self, done):
        self._done = done

    typeof_pyval = staticmethod(numba.typeof)

    def compile(self, given):
        self._done.append("loop")


def test_the_largest_kernel_is_first_and_the_loop_last(pieces, monkeypatch):
    monkeypatch.setenv("MPMGIS_COMPILE_PROCESSES", "1")
    complete(Loop(pieces), call())
    sizes = [compilation.seconds_of(kernel_of(name)) for name in pieces[:-1]]
    assert sizes == sorted(sizes, reverse=True) and set(pieces[:-1]) == set(CALLED) and pieces[-1] == "loop"
    assert compilation.seconds_of(small_kernels.clip) > compilation.seconds_of(small_kernels.clipped)


@pytest.mark.parametrize("fault", [OSError("no process"), ImportError("another program")])
def test_without_children_this_process_compiles_all(pieces, monkeypatch, fault):
    def fail(count):
        raise fault

    monkeypatch.setenv("MPMGIS_COMPILE_PROCESSES", "3")
    monkeypatch.setattr(worker_processes, "started", fail)
    with begun([(Loop(pieces), call())]):
        complete(Loop(pieces), call())
    assert set(pieces) == {*CALLED, "loop"}


@pytest.mark.parametrize(
    ("step", "fault"),
    [
        ("called_kernels", AttributeError("numba has changed")),
        ("compile_piece", numba.core.errors.TypingError("a kernel was found with wrong types")),
    ],
)
def test_what_numba_cannot_infer_is_left_to_the_compilation_of_the_loop(pieces, monkeypatch, step, fault):
    def fail(*given):
        raise fault

    monkeypatch.setattr(compilation, step, fail)
    complete(Loop(pieces), call())
    assert pieces == ["loop"]


def start_instead(monkeypatch, worked):
    """Let two processes compile, whose child does what `worked` does; return the list of children started."""
    children = []

    @contextmanager
    def started(count):
        children.append(count)
        yield SimpleNamespace(worked=worked)

    monkeypatch.setenv("MPMGIS_COMPILE_PROCESSES", "2")
    monkeypatch.setattr(worker_processes, "started", started)
    return children


def test_a_child_that_dies_is_not_replaced(pieces, monkeypatch):
    children = start_instead(monkeypatch, lambda function, given, look, died: died(given[0], True))
    complete(Loop(pieces), call())
    assert children == [1] and pieces[-1] == "loop" and len(pieces) >= len(CALLED)


def test_no_thread_is_left_when_the_block_ends_early(pieces, monkeypatch):
    """A child that never answers: an error in the block ends it."""

    def never(function, given, look, died):
        while True:
            look()

    start_instead(monkeypatch, never)
    before = threading.active_count()
    with pytest.raises(ValueError, match="scene"), begun([(Loop(pieces), call())]):
        assert threading.active_count() == before + 2
        raise ValueError("scene")
    assert threading.active_count() == before


def test_the_line_counts_what_is_left(pieces):
    work = Compilation()
    work.add(Loop(pieces), ())
    assert "5 of 5 left, about " in work.line()
    work.add(Loop(pieces), ())  # the same kernels for another loop
    assert "6 of 6 left, about " in work.line()
    work.finish(Loop(pieces), ())
    assert "2 of 6 left, about " in work.line()


def test_progress_is_shown_while_kernels_are_compiled(pieces, monkeypatch):
    shown = threading.Event()
    monkeypatch.setattr(compilation, "SHOW_SECONDS", 0.001)
    monkeypatch.setattr(compilation, "compile_piece", lambda piece: shown.wait(10))
    lines = []
    with progress_shown(lambda text: (lines.append(text), shown.set())):
        complete(Loop(pieces), call())
    assert lines[0].startswith("preparing: kernels are compiled once after an installation, 5 of 5 left, about ")


def test_the_number_of_processes_is_that_of_cores_at_most_four(monkeypatch):
    monkeypatch.delenv("MPMGIS_COMPILE_PROCESSES", raising=False)
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 3)
    assert processes() == 3
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 64)
    assert processes() == compilation.MOST_PROCESSES
    monkeypatch.setattr(worker_processes, "_serving", [True])
    assert processes() == 1


@pytest.mark.parametrize(
    ("of", "name", "value"), [(numba.config, "CACHE_DIR", "gone"), (sys, "executable", "qgis-bin.exe")]
)
def test_no_children_without_a_cache_that_they_can_fill_or_an_interpreter(monkeypatch, tmp_path, of, name, value):
    monkeypatch.setenv("MPMGIS_COMPILE_PROCESSES", "2")
    assert processes() == 2
    monkeypatch.setattr(of, name, str(tmp_path / value))
    assert processes() == 1


def test_a_loop_is_first_until_the_cache_has_it(tmp_path, monkeypatch):
    def double(number):
        return 2 * number

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    kernel = jit(double)
    given = argument_types(kernel, (3,))
    assert not has_any(kernel) and not is_kept(kernel, given) and compilation.is_first(kernel)
    assert kernel(3) == 6
    assert has_any(kernel) and is_kept(kernel, given) and not is_kept(kernel, argument_types(kernel, (3.0,)))
    assert not compilation.is_first(kernel) and not compilation.is_first(double)
