"""Files and folders appear whole or not at all, and nothing that was there is lost."""

import errno
import os
import subprocess
import sys

import pytest

from mpmgis.system import operating_system, whole_files, writer_process
from mpmgis.system.errors import OutputError
from mpmgis.system.whole_files import refuse_existing, whole_file, whole_folder
from mpmgis.system.writer_process import Writer


def everything(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_a_file_appears_when_it_is_whole(tmp_path):
    target = tmp_path / "new" / "frame.h5"
    with whole_file(target) as part:
        part.write_text("half")
        assert not target.exists()
        assert part.suffix == ".h5" and part.parent == target.parent
    assert target.read_text() == "half"
    assert everything(tmp_path) == ["new", "new/frame.h5"]


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt, SystemExit, MemoryError])
def test_a_file_that_fails_leaves_nothing_and_keeps_the_old_one(tmp_path, stop):
    target = tmp_path / "a.tif"
    target.write_text("old")
    with pytest.raises(stop), whole_file(target) as part:
        part.write_text("half")
        raise stop
    assert target.read_text() == "old"
    assert everything(tmp_path) == ["a.tif"]


def test_a_file_that_was_never_written_is_an_error(tmp_path):
    with pytest.raises(OutputError, match=r"a\.csv: cannot be written"), whole_file(tmp_path / "a.csv"):
        pass
    assert everything(tmp_path) == []


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (errno.ENOSPC, "the disk is full"),
        (errno.EACCES, "no permission"),
        (errno.EROFS, "no permission"),
        (errno.EIO, "cannot be written"),
    ],
)
@pytest.mark.parametrize("whole", [whole_file, whole_folder])
def test_what_the_system_refuses_is_one_line(tmp_path, monkeypatch, number, says, whole):
    def refuse(*_):
        raise OSError(number, os.strerror(number))

    target = tmp_path / "x"
    with monkeypatch.context() as patch, pytest.raises(OutputError, match=says) as caught, whole(target) as part:
        if whole is whole_file:
            part.write_text("data")
        patch.setattr(whole_files.os, "replace", refuse)
    assert "\n" not in str(caught.value) and str(target) in str(caught.value)
    assert everything(tmp_path) == []


@pytest.mark.parametrize("whole", [whole_file, whole_folder])
def test_errors_of_writers_name_the_options_of_the_user(tmp_path, whole):
    target = tmp_path / "x"
    with pytest.raises(OutputError) as caught, whole(target) as part:
        if whole is whole_file:
            part.write_text("data")
        raise OutputError(f"{part}: layer 'a' cannot be written")
    assert str(caught.value) == f"{target}: layer 'a' cannot be written"
    assert everything(tmp_path) == []


def test_a_file_below_a_file_is_one_line(tmp_path):
    (tmp_path / "plain").write_text("")
    for whole in (whole_file, whole_folder):
        with pytest.raises(OutputError, match="cannot be written"), whole(tmp_path / "plain" / "x"):
            raise AssertionError("the block must not run")


@pytest.mark.parametrize("whole", [whole_file, whole_folder])
def test_folders_made_for_what_failed_go_again(tmp_path, whole):
    (tmp_path / "mine").mkdir()
    with pytest.raises(ValueError), whole(tmp_path / "mine" / "a" / "b" / "x"):
        raise ValueError
    assert everything(tmp_path) == ["mine"]


def test_a_folder_appears_when_it_is_whole(tmp_path):
    target = tmp_path / "run_gis"
    with whole_folder(target) as part:
        (part / "rasters").mkdir()
        (part / "rasters" / "a.tif").write_text("a")
        assert not target.exists()
    assert everything(tmp_path) == ["run_gis", "run_gis/.mpmgis", "run_gis/rasters", "run_gis/rasters/a.tif"]


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt, OSError(errno.ENOSPC, "full")])
@pytest.mark.parametrize("there", [True, False])
def test_a_folder_that_fails_leaves_nothing_and_keeps_the_old_one(tmp_path, stop, there):
    target = tmp_path / "gis"
    if there:
        with whole_folder(target) as part:
            (part / "old.txt").write_text("old")
    before = everything(tmp_path)
    with pytest.raises((ValueError, KeyboardInterrupt, OutputError)), whole_folder(target, overwrite=True) as part:
        (part / "new.txt").write_text("new")
        raise stop
    assert everything(tmp_path) == before


def test_the_old_folder_comes_back_when_the_last_step_fails(tmp_path, monkeypatch):
    target = tmp_path / "gis"
    with whole_folder(target) as part:
        (part / "old.txt").write_text("old")
    replace = os.replace

    def refuse_new(source, destination):
        if ".part" in os.path.basename(source):
            raise OSError(errno.ENOSPC, "full")
        replace(source, destination)

    monkeypatch.setattr(whole_files.os, "replace", refuse_new)
    with pytest.raises(OutputError, match="disk is full"), whole_folder(target, overwrite=True):
        pass
    assert everything(tmp_path) == ["gis", "gis/.mpmgis", "gis/old.txt"]


def test_overwrite_replaces_all_of_the_old_folder(tmp_path):
    target = tmp_path / "gis"
    for name in ("old.txt", "new.txt"):
        with whole_folder(target, overwrite=True) as part:
            (part / name).write_text(name)
    assert everything(tmp_path) == ["gis", "gis/.mpmgis", "gis/new.txt"]


def test_without_overwrite_what_exists_is_refused(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("x")
    (tmp_path / "empty").mkdir()
    refuse_existing(tmp_path / "nothing", overwrite=False)
    refuse_existing(tmp_path / "empty", overwrite=False)
    for name in ("full", "full/x"):
        with pytest.raises(OutputError, match="exists already; give another -o, or --overwrite"):
            refuse_existing(tmp_path / name, overwrite=False)
        refuse_existing(tmp_path / name, overwrite=True)
    with pytest.raises(OutputError, match="exists already"), whole_folder(tmp_path / "full"):
        raise AssertionError("the block must not run")


def test_an_empty_folder_is_taken(tmp_path):
    (tmp_path / "gis").mkdir()
    with whole_folder(tmp_path / "gis") as part:
        (part / "a").write_text("a")
    assert everything(tmp_path) == ["gis", "gis/.mpmgis", "gis/a"]


def test_overwrite_never_takes_what_mpmgis_did_not_write(tmp_path):
    documents = tmp_path / "documents"
    documents.mkdir()
    (documents / "thesis.tex").write_text("years")
    with pytest.raises(OutputError, match="not written by mpmgis"), whole_folder(documents, overwrite=True):
        raise AssertionError("the block must not run")
    with pytest.raises(OutputError, match="is a file"), whole_folder(documents / "thesis.tex", overwrite=True):
        raise AssertionError("the block must not run")
    assert everything(tmp_path) == ["documents", "documents/thesis.tex"]


@pytest.mark.parametrize("name", [".", "..", "../here"])
def test_the_folder_one_stands_in_is_never_replaced(tmp_path, monkeypatch, name):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    with pytest.raises(OutputError, match="current working folder"), whole_folder(name, overwrite=True):
        raise AssertionError("the block must not run")
    assert everything(tmp_path) == ["here"]


@pytest.fixture
def dead():
    """The token of a process that is no more."""
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return f"{Writer(child.pid, writer_process.host(), writer_process.boot(), 77)}-0123abcd"


def alive(number=None, **other):
    """The token of a process that runs (this one's parent), or of an `other` machine's."""
    number = number or os.getppid()
    known = Writer(number, writer_process.host(), writer_process.boot(), operating_system.process_start(number))
    return f"{known._replace(**other)}-0123abcd"


@pytest.mark.skipif(os.name != "posix", reason="a process cannot be asked whether it is alive")
def test_what_a_killed_process_left_of_a_file_goes_with_the_next_one(tmp_path, dead):
    left = [f".a.part{dead}.gpkg", f".a.part{dead}.gpkg-journal"]
    others = [
        f".a.part{alive()}.gpkg",
        f".a.part{alive(4194303, host='0' * 8)}.gpkg",  # on another machine
        ".a.part4711.gpkg",  # of a version that did not tell its machine
        f".b.part{dead}.gpkg",
        f".a.part{dead}.csv",
        f".a.part{dead}",
        ".a.part.gpkg",
    ]
    for name in (*left, *others):
        (tmp_path / name).write_text("half")
    with whole_file(tmp_path / "a.gpkg") as part:
        part.write_text("whole")
    assert everything(tmp_path) == sorted([*others, "a.gpkg"])


@pytest.mark.skipif(os.name != "posix", reason="a process cannot be asked whether it is alive")
@pytest.mark.parametrize("replaced", [True, False])
def test_a_folder_that_a_killed_process_had_put_aside_comes_back(tmp_path, dead, replaced):
    for name in (f".gis.old{dead}", f".gis.part{dead}", *(["gis"] if replaced else [])):
        (tmp_path / name).mkdir()
        (tmp_path / name / whole_files.MARK).touch()
        (tmp_path / name / ("newest" if name == "gis" else name[1:8].replace(".", "_"))).touch()
    with pytest.raises(OutputError, match="exists already"), whole_folder(tmp_path / "gis"):
        raise AssertionError("the block must not run")
    assert everything(tmp_path) == ["gis", "gis/.mpmgis", "gis/newest" if replaced else "gis/gis_old"]
    with whole_folder(tmp_path / "gis", overwrite=True) as part:
        (part / "new").touch()
    assert everything(tmp_path) == ["gis", "gis/.mpmgis", "gis/new"]


@pytest.mark.parametrize("overwrite", [True, False])
def test_of_two_that_write_one_folder_the_later_one_is_refused_unless_it_may_overwrite(tmp_path, overwrite):
    def write():
        with whole_folder(tmp_path / "gis", overwrite) as part:
            (part / "slow").touch()
            (tmp_path / "gis").mkdir()  # another process was quicker
            for name in (whole_files.MARK, "quick"):
                (tmp_path / "gis" / name).touch()

    if overwrite:
        write()
    else:
        with pytest.raises(OutputError, match="exists already"):
            write()
    assert everything(tmp_path) == ["gis", "gis/.mpmgis", "gis/slow" if overwrite else "gis/quick"]
