"""One writer in a folder: the lock of the system, what it is where there is none, and whose temporary files go."""

import errno
import os
import socket
import subprocess
import sys

import pytest

from mpmgis.system import operating_system, whole_files, writer_process
from mpmgis.system.errors import OutputError
from mpmgis.system.folder_lock import LOCK_FILE, sole_writer
from mpmgis.system.whole_files import whole_file, whole_folder
from mpmgis.system.writer_process import Writer

if os.name == "posix":
    import fcntl

posix_only = pytest.mark.skipif(os.name != "posix", reason="elsewhere a process cannot be asked whether it is alive")
removes_open_files = pytest.mark.skipif(os.name == "nt", reason="there no open file is removed, no folder of one moved")
needs_start = pytest.mark.skipif(
    operating_system.process_start(os.getpid()) == operating_system.UNKNOWN, reason="no start of processes here"
)


@pytest.fixture
def ended():
    """The Writer of a process that is over."""
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return Writer(child.pid, writer_process.host(), writer_process.boot(), 1)


def here(**other):
    return writer_process.this_process()._replace(**other)


# ------------------------------------------------------------------------------------------------------------- writers


def test_this_process_is_not_over():
    assert not writer_process.this_process().is_over()
    assert writer_process.written_by(writer_process.new_token()) == writer_process.this_process()
    assert writer_process.new_token() != writer_process.new_token()


@posix_only
def test_a_process_that_has_ended_is_over(ended):
    assert ended.is_over()


@posix_only
@needs_start
def test_a_number_that_was_given_again_is_another_process():
    assert here(start=operating_system.process_start(os.getpid()) - 1).is_over()
    assert not here(start=operating_system.UNKNOWN).is_over()


@posix_only
def test_processes_of_other_machines_and_containers_count_as_alive(ended, monkeypatch):
    assert not ended._replace(host="00000000").is_over()
    machine = writer_process.host()
    monkeypatch.setattr(writer_process, "_space", lambda: "pid:[4026539999]")
    writer_process.host.cache_clear()
    try:
        assert writer_process.host() != machine and not ended.is_over()
    finally:
        monkeypatch.undo()
        writer_process.host.cache_clear()


@posix_only
def test_before_the_last_start_of_the_machine_all_are_over_but_in_containers(monkeypatch):
    monkeypatch.setattr(writer_process, "_is_no_container", lambda: True)
    assert here(boot="00000000").is_over()
    monkeypatch.setattr(writer_process, "_is_no_container", lambda: False)
    assert not here(boot="00000000").is_over()


@posix_only
def test_a_process_that_was_not_waited_for_has_ended():
    if not os.path.exists("/proc/self/stat"):
        pytest.skip("no /proc here")
    child = subprocess.Popen([sys.executable, "-c", ""], stdout=subprocess.PIPE)
    child.stdout.read()
    for _ in range(10_000):
        if operating_system.process_facts(child.pid)[:1] == ["Z"]:
            break
        os.sched_yield()
    assert Writer(
        child.pid, writer_process.host(), writer_process.boot(), operating_system.process_start(child.pid)
    ).is_over()
    child.wait()
    child.stdout.close()


@pytest.mark.parametrize("text", ["", "12", "12-abc-1", "x-0123456789abcdef-1", f"12-{'0' * 16}-", "-1-" + "0" * 16])
def test_what_is_no_writer_is_none(text):
    assert writer_process.written_by(text) is None


# --------------------------------------------------------------------------------------------------------- part files


@pytest.mark.parametrize("whole", [whole_file, whole_folder])
def test_parts_of_other_machines_stay(tmp_path, whole, ended):
    """Files and folders that a process writes on a machine which shares this folder, whatever its number is here."""
    kept = [f".a.{kind}{ended._replace(host='0' * 8)}-0000abcd" for kind in ("part", "old")]
    for name in kept:
        (tmp_path / name).mkdir()
    with whole(tmp_path / "a") as part:
        if whole is whole_file:
            part.write_text("x")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*kept, "a"])


@posix_only
def test_links_among_parts_go_and_what_they_lead_to_stays(tmp_path, ended):
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / "file").touch()
    try:
        (tmp_path / f".a.part{ended}-0000abcd").symlink_to(tmp_path / "victim")
    except OSError:
        pytest.skip("no links can be made here")
    (tmp_path / f".a.old{ended}-0000abcd").symlink_to(tmp_path / "victim")
    with whole_folder(tmp_path / "a"):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "victim"]
    assert (tmp_path / "victim" / "file").exists()


@pytest.mark.parametrize("length", [1, 100, 200, 240, 250, 255])
def test_names_as_long_as_the_system_allows(tmp_path, length):
    for name in ("x" * (length - 1) + "y", "ö" * max(1, (length - 4) // 2) + ".csv"):
        with whole_file(tmp_path / name) as part:
            part.write_text("whole")
            assert (part.suffix == ".csv") == name.endswith(".csv")
        assert (tmp_path / name).read_text() == "whole"
        with whole_folder(tmp_path / "sub" / name) as part:
            (part / "file").touch()
        assert (tmp_path / "sub" / name / "file").exists()


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    """Flushed, through a descriptor that may write, and only then renamed: a power cut leaves the old or the new."""
    done = []
    fsync, replace = os.fsync, os.replace

    def flushed(handle):
        os.write(handle, b"")  # Windows flushes only what may be written
        done.append(("flushed", os.fstat(handle).st_ino))
        fsync(handle)

    def named(part, path):
        done.append(("named", os.stat(part).st_ino))
        replace(part, path)

    monkeypatch.setattr(whole_files.os, "fsync", flushed)
    monkeypatch.setattr(whole_files.os, "replace", named)
    with whole_file(tmp_path / "a.csv") as part:
        part.write_text("whole")
        node = part.stat().st_ino
    assert done == [("flushed", node), ("named", node)]


# --------------------------------------------------------------------------------------------------------------- locks


def test_a_folder_has_one_writer(tmp_path):
    with sole_writer(tmp_path) as hold:
        hold.require_folder()
        with pytest.raises(OutputError, match=f"is being written by process {os.getpid()}"), sole_writer(tmp_path):
            raise AssertionError("the block must not run")
        assert (tmp_path / LOCK_FILE).read_text() == f"process {os.getpid()} on {socket.gethostname()}"
    assert not list(tmp_path.iterdir())
    with sole_writer(tmp_path):
        pass


@pytest.mark.parametrize("text", ["", "process 4711", "process 1 on another host"])
def test_files_of_a_killed_process_block_no_later_run(tmp_path, text):
    (tmp_path / LOCK_FILE).write_text(text)
    with sole_writer(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


@removes_open_files
def test_a_folder_that_is_removed_or_replaced_is_not_held_any_more(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    for replaced in (False, True):
        with sole_writer(folder) as hold:
            folder.rename(tmp_path / f"moved_{replaced}")
            if replaced:
                folder.mkdir()
                (folder / LOCK_FILE).write_text("process 4711")
            with pytest.raises(OutputError, match="was removed or replaced"):
                hold.require_folder()
        assert (folder / LOCK_FILE).exists() == replaced  # that of another run stays
        folder.mkdir(exist_ok=True)


@removes_open_files
def test_a_lock_whose_holder_removed_it_meanwhile_is_taken_anew(tmp_path, monkeypatch):
    """The file was opened, then its holder let go and removed it: a lock on that file holds nothing."""
    locked, seen = fcntl.flock, []

    def removed(handle, operation):
        if not seen:
            os.unlink(tmp_path / LOCK_FILE)
        seen.append(os.fstat(handle).st_ino)
        return locked(handle, operation)

    monkeypatch.setattr(fcntl, "flock", removed)
    with sole_writer(tmp_path) as hold:
        hold.require_folder()
        assert len(seen) == 2
        with pytest.raises(OutputError, match="is being written by"), sole_writer(tmp_path):
            raise AssertionError("the block must not run")


@removes_open_files
@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP])
def test_a_file_system_without_locks_is_written_without_a_lock(tmp_path, monkeypatch, number):
    def refuse(handle, operation):
        raise OSError(number, "no locks")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with sole_writer(tmp_path) as hold:
        hold.require_folder()
    assert not list(tmp_path.iterdir())
