"""Processes that work for this one: nothing but this process reaches them, and they end with it."""

import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import psutil
import pytest

from mpmgis.system import dask_workers
from mpmgis.system.errors import InputError, UnphysicalError
from mpmgis.system.worker_processes import started


def pieces(count):
    return [SimpleNamespace(number=k) for k in range(count)]


def square(piece):
    print("what libraries print is no answer")
    return piece.number**2


def number_of(piece):
    return os.getpid()


def unphysical(piece):
    raise UnphysicalError(f"piece {piece.number}")


def not_to_be_sent(piece):
    return lambda: piece


def leaves(piece):
    sys.exit(3)


def slow(piece):
    time.sleep(600)


def connections(process):
    """What a process has open to any network, its own machine too."""
    look = getattr(process, "net_connections", None) or process.connections  # its name before psutil 6
    return look(kind="inet")


def test_every_piece_is_done_once_by_workers_that_listen_to_no_port():
    with started(2) as workers:
        workers.warm(square, SimpleNamespace(number=1))
        mine = [psutil.Process(process._process.pid) for process in workers._processes]
        assert not any(connections(process) for process in mine)
        done = {piece.number: answer for piece, answer in workers.worked(square, pieces(7))}
    assert done == {k: k * k for k in range(7)}
    assert not any(process.is_running() and process.status() != psutil.STATUS_ZOMBIE for process in mine)


def test_a_pool_opens_no_port_here():
    before = {c.laddr for c in connections(psutil.Process())}
    with started(1) as workers:
        list(workers.worked(square, pieces(1)))
        assert {c.laddr for c in connections(psutil.Process())} <= before


@pytest.mark.parametrize(
    ("work", "kind", "words"),
    [(unphysical, UnphysicalError, "piece 0"), (not_to_be_sent, RuntimeError, "."), (leaves, SystemExit, "3")],
)
def test_errors_of_workers_are_those_of_the_work(work, kind, words):
    with started(1) as workers, pytest.raises(kind, match=words):
        list(workers.worked(work, pieces(1)))


def test_work_that_a_worker_does_not_have_is_reported_in_a_line():
    """A module that is there only here."""
    module = type(sys)("only_here")
    exec("def work(piece):\n    return 1", vars(module))
    module.work.__module__ = "only_here"
    sys.modules["only_here"] = module
    try:
        with started(1) as workers, pytest.raises(InputError, match="a worker cannot run this program"):
            list(workers.worked(module.work, pieces(1)))
    finally:
        del sys.modules["only_here"]


def test_modules_beside_the_scene_are_not_imported_by_workers(tmp_path, monkeypatch):
    """Who is sent a folder does not run the Python in it."""
    for name in ("json", "numpy", "pickle", "mpmgis"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [name for name in sys.path if name])
    with started(1) as workers:
        assert [answer for _, answer in workers.worked(square, pieces(1))] == [0]
    assert not (tmp_path / "ran").exists()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
def test_workers_end_with_a_parent_that_is_killed():
    program = (
        "from test_workers import number_of, pieces, slow\nfrom mpmgis.system.worker_processes import started\n"
        "with started(1) as workers:\n"
        "    print([answer for _, answer in workers.worked(number_of, pieces(1))][0], flush=True)\n"
        "    list(workers.worked(slow, pieces(1), look=lambda: print('at work', flush=True)))\n"
    )
    path = os.pathsep.join([os.path.dirname(__file__), *sys.path])
    child = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path}
    )
    worker = psutil.Process(int(child.stdout.readline()))
    assert child.stdout.readline() == "at work\n"
    child.kill()
    child.wait()
    child.stdout.close()
    assert psutil.wait_procs([worker], timeout=60)[1] == []


def test_a_users_own_dask_cluster_is_asked_in_the_same_way():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, silence_logs=50
        ) as there,
        dask_workers.dask_client(there.scheduler_address) as client,
    ):
        workers = dask_workers.DaskWorkers(client)
        workers.warm(square, SimpleNamespace(number=1))
        assert {piece.number: answer for piece, answer in workers.worked(square, pieces(5))} == {
            k: k * k for k in range(5)
        }
        with pytest.raises(UnphysicalError, match="piece 0"):
            list(workers.worked(unphysical, pieces(1)))
