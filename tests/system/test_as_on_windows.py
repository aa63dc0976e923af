"""Windows and macOS: their rules emulated on Linux, and constructs that must not be in the sources.

Neither system is here. What these tests cannot show is listed in mpmgis/docs/limits.md.
"""

import ast
import errno
import io
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath

import h5py
import pytest
import rasterio
from refusals import refusal
from slope_site import SCENE, contents, write_site

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.compiled import cache_folder
from mpmgis.frames import run_terrain
from mpmgis.frames.run_folder import RunFolder
from mpmgis.laws.quantities import BAND
from mpmgis.results import answer_files
from mpmgis.solvers.columns.column_solver import ColumnSolver
from mpmgis.system import file_references, links, operating_system, source_names, whole_files
from mpmgis.system import writer_process as writer
from mpmgis.system.errors import FormatError, OutputError
from mpmgis.system.folder_lock import LOCK_FILE, sole_writer

if sys.platform != "linux":
    pytest.skip("emulated on Linux", allow_module_level=True)

from as_on_windows import ABSENT, MODULES, Windows

PACKAGE = Path(mpmgis.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))
ASKS = {
    "system/memory.py",
    "system/operating_system.py",
    "qgis_plugin/mpmgis_qgis/calling.py",
    "qgis_plugin/mpmgis_qgis/own_environment.py",
    "qgis_plugin/mpmgis_qgis/python_search.py",
}  # which system this is; the plugin imports nothing of ours
SHORT = SCENE.replace("end_time = 30", "end_time = 12").replace("frame_interval = 5", "frame_interval = 2")


@pytest.fixture
def windows(monkeypatch, tmp_path):
    """The rules of Windows below the test's own folder."""
    for cached in (writer.host, writer.boot, writer._space):
        cached.cache_clear()
    yield Windows(monkeypatch, tmp_path)
    monkeypatch.undo()
    for cached in (writer.host, writer.boot, writer._space):
        cached.cache_clear()


@pytest.fixture
def site(tmp_path):
    """A small site with a scene, beside `names`, where outputs go."""
    folder = write_site(tmp_path)
    (folder / "scene.toml").write_text(SHORT, encoding="utf-8")
    return folder


def everything(folder):
    """Path -> bytes of all files below `folder`."""
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@contextmanager
def open_elsewhere(path):
    """As QGIS, which keeps its rasters open for reading."""
    with open(path, "rb"):
        yield


# ------------------------------------------------------------------------------------------------------ in the sources


def named(path):
    return path.relative_to(PACKAGE).as_posix()


OF_ONE_SYSTEM = {f"{module.__name__}.{name}" for module, names in ABSENT.items() for name in names}
OF_ONE_SYSTEM |= {"os.name", "sys.platform", "os.kill", "platform.system", "sys.getwindowsversion", "os.startfile"}
GUARDED = {"os.geteuid": "compiled/cache_folder.py"}  # behind hasattr


PLACES = ("/proc", "/dev/", "/tmp", "/etc")


def text_mode(call):
    """The mode of a call of `open`; None where no text is opened."""
    mode = next((word.value for word in call.keywords if word.arg == "mode"), None)
    mode = mode or (call.args[1] if len(call.args) > 1 else None)
    mode = mode.value if isinstance(mode, ast.Constant) else "r" if mode is None else "?"
    return None if "b" in mode else mode


def missing(call):
    """What a call lacks that reads text without an encoding, or writes it without ends of lines.

    Without them Windows takes its own: cp1252, and two characters at the end of a line.
    """
    name, given = getattr(call.func, "attr", getattr(call.func, "id", "")), {word.arg for word in call.keywords}
    mode = {"read_text": "r", "write_text": "w"}.get(name)
    if name == "open" and isinstance(call.func, ast.Name):
        mode = text_mode(call)
    if mode is not None and "encoding" not in given:
        yield f"{name} without encoding"
    if mode is not None and set("wxa") & set(mode) and "newline" not in given:
        yield f"{name} without newline"


def of_one_system(node, where):
    """What is at `node` that only one system has: a name, a module, a folder."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        name = f"{node.value.id}.{node.attr}"
        if name in OF_ONE_SYSTEM and GUARDED.get(name) != where:
            yield name
    elif isinstance(node, ast.Import | ast.ImportFrom):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
        if isinstance(node, ast.Import) or not node.level:
            yield from {name.split(".")[0] for name in names} & {*MODULES, "msvcrt", "winreg", "nt", "posix"}
    elif isinstance(node, ast.keyword) and node.arg == "dir_fd":
        yield node.arg
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith(PLACES):
        yield node.value


def differences(text, where):
    """(line, what) in a source that may be another thing on another system."""
    for node in ast.walk(ast.parse(text)):
        found = [] if where in ASKS else list(of_one_system(node, where))
        found += missing(node) if isinstance(node, ast.Call) else []
        yield from (f"{where}:{getattr(node, 'lineno', 0)}: {what}" for what in found)


def test_sources_are_the_same_on_every_system():
    """Only named modules ask which system this is; text has an encoding and the same ends of lines everywhere."""
    found = [line for path in SOURCES for line in differences(path.read_text(encoding="utf-8"), named(path))]
    assert len(SOURCES) > 250 and not found


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("os.kill(1, 2)", ["os.kill"]),
        ("import os, fcntl.x", ["fcntl"]),
        ("from winreg import x", ["winreg"]),
        ("f(dir_fd=3)", ["dir_fd"]),
        ("x = '/proc/self'", ["/proc/self"]),
        ("open('a')", ["open without encoding"]),
        ("open('a', 'w', encoding='utf-8')", ["open without newline"]),
        ("p.read_text()", ["read_text without encoding"]),
        ("p.write_text('a')", ["write_text without encoding", "write_text without newline"]),
        ("open('a', 'rb'); open('a', encoding='utf-8'); p.open('w'); os.getpid(); from .nt import a", []),
    ],
)
def test_the_search_in_the_sources_finds(text, what):
    assert [line.partition(": ")[2] for line in differences(text, "x.py")] == what


IMPORT_ALL = """
import importlib, os, pkgutil, signal, sys, warnings
import numba, rasterio, pyogrio, h5py, netCDF4, matplotlib.figure, geopandas, xarray, rioxarray, scipy, psutil, filelock
import numba.core.caching, scipy.interpolate, scipy.spatial, rich.progress, affine
try:  # it loads libraries in another way on each system
    import numba_cuda, numba.cuda
    left_out = ()
except ImportError:
    left_out = "mpmgis.solvers.gpu."
for name in {modules!r}:
    sys.modules[name] = None
for module, names in (("os", {of_os!r}), ("signal", {of_signal!r})):
    for name in names:
        if hasattr(sys.modules[module], name):
            delattr(sys.modules[module], name)
warnings.filterwarnings("error", category=EncodingWarning, module=r"mpmgis")
import mpmgis
done = 0
for found in pkgutil.walk_packages(mpmgis.__path__, "mpmgis."):
    if found.name.startswith(left_out) and found.name != "mpmgis.solvers.gpu.available":
        continue
    if not found.name.endswith("__main__"):
        importlib.import_module(found.name)
        done += 1
print(done)
"""


def test_every_module_is_imported_without_what_only_posix_has(tmp_path):
    """With every warning of text in an encoding that was not named as an error."""
    script = IMPORT_ALL.format(modules=MODULES, of_os=ABSENT[os], of_signal=ABSENT[signal])
    environment = os.environ | {"MPMGIS_CACHE_DIR": os.environ.get("MPMGIS_CACHE_DIR", str(tmp_path))}
    done = subprocess.run(
        [sys.executable, "-X", "warn_default_encoding", "-c", script], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout) > 250


def uses_compiler(path):
    return bool(re.search(r"^from \.[.\w]*jit import", path.read_text(encoding="utf-8"), re.MULTILINE))


def kernels_of(path):
    """Kernel modules that a module imports, and those that these import."""
    found, left = set(), [path]
    while left:
        path = left.pop()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
                named = {base.with_suffix(".py"), *(base / f"{alias.name}.py" for alias in node.names)}
                new = {file for file in named if file.exists() and uses_compiler(file)} - found
                found, left = found | new, [*left, *new]
    return found


@pytest.mark.parametrize("package", ["maps/averaging", "maps/qgis"])
def test_what_threads_call_at_the_same_time_is_serial(package):
    """Frames are averaged on several threads. Without OpenMP, as on macOS, numba ends a process of parallel calls."""
    used = {kernel for path in (PACKAGE / package).glob("*.py") for kernel in kernels_of(path)}
    assert PACKAGE / ("maps/averaging/binning.py" if package == "maps/averaging" else "compiled/mask_rings.py") in used
    assert not [kernel.name for kernel in used if "jit_parallel" in kernel.read_text(encoding="utf-8")]


def test_no_two_bands_have_names_that_differ_in_case_alone():
    """They are in file names: run_Ut.vrt."""
    names = [name.lower() for name in BAND]
    assert len(names) == len(set(names))


# --------------------------------------------------------------------------------------------- what differs by system


def test_names_that_windows_gives_to_devices_or_cuts_are_refused_there(monkeypatch):
    wrong = ["nul", "NUL.tif", "con.h5", "com1.csv", "x/lpt9/run", "a:b.h5", "x.", "x ", "a?b.tif", "a|b", "AUX .txt"]
    right = ["console.h5", "a.b.c", "com.tif", "com10", "Überlauf.tif", "..", "../x", ".lock", "null_1", "x/y", "lpt"]
    assert [name for name in wrong if operating_system.wrong_name(name)] == []
    monkeypatch.setattr(operating_system, "WINDOWS", True)
    assert [name for name in wrong if not operating_system.wrong_name(name)] == []
    assert [name for name in right if operating_system.wrong_name(name)] == []
    for path in (PureWindowsPath(r"C:\runs\one"), PureWindowsPath(r"\\host\share\run.h5")):
        drive_and_root, *names = path.parts  # ':' and '\' of the drive are no names
        assert path.anchor == drive_and_root and not operating_system.wrong_name("/".join(names))


@pytest.mark.parametrize("name", ["nul.tif", "a:b", "end."])
def test_outputs_of_such_names_are_one_line(windows, tmp_path, name):
    for whole in (whole_files.whole_file, whole_files.whole_folder):
        with pytest.raises(OutputError, match=r"on Windows.*; give another -o"), whole(tmp_path / name):
            raise AssertionError("the block must not run")
    with pytest.raises(OutputError, match="on Windows"):
        RunFolder(tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("text", ["lava", "a/../../b", "CON", "x:y", "", "..", "Ö <1>", "a\\b", "end. ", "nul.txt"])
def test_any_text_makes_a_part_of_a_file_name(text, monkeypatch):
    name = operating_system.file_name(text)
    monkeypatch.setattr(operating_system, "WINDOWS", True)
    assert name and Path(name).name == name and not operating_system.wrong_name(name)
    assert name == text or text != "lava"


@pytest.mark.parametrize(
    ("system_is", "folder"), [({"WINDOWS": True}, "AppData/Local"), ({"MACOS": True}, "Library/Caches"), ({}, ".cache")]
)
def test_kernels_are_kept_where_each_system_keeps_such_files(tmp_path, monkeypatch, system_is, folder):
    for name in ("MPMGIS_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    for name, value in system_is.items():
        monkeypatch.setattr(operating_system, name, value)
    assert cache_folder.cache_folder().parents[1] == tmp_path / folder
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "moved"))
    assert cache_folder.cache_folder().parents[1] == tmp_path / ("moved" if "WINDOWS" in system_is else folder)


def test_folders_on_windows_without_modes_keep_kernels(tmp_path, windows, monkeypatch):
    """Every folder there is shown as writable by all: kernels were compiled again at every start."""
    (tmp_path / "root").mkdir()
    (tmp_path / "root").chmod(0o777)
    monkeypatch.setenv("MPMGIS_CACHE_DIR", str(tmp_path / "root"))
    assert cache_folder.cache_folder().parents[1] == tmp_path / "root"
    assert cache_folder.is_own(tmp_path / "root")


def test_paths_between_two_drives_are_absolute_and_have_forward_slashes(monkeypatch, tmp_path):
    assert operating_system.slashed(tmp_path / "a" / "dtm.tif", tmp_path / "b") == "../a/dtm.tif"

    def two_drives(path, start):
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(os.path, "relpath", two_drives)
    assert operating_system.slashed(tmp_path / "dtm.tif", "x") == (tmp_path / "dtm.tif").as_posix()


def test_a_path_with_a_drive_is_no_name_for_gdal_and_no_address():
    for name in (r"C:\maps\dtm.tif", "c:/maps/dtm.tif", r"\\host\share\dtm.tif"):
        found = source_names.source_of(name)
        assert found.is_plain and str(found.file) == name


@pytest.mark.parametrize(
    ("name", "share"),
    [
        (r"\\host\share\dtm.tif", r"host\share"),
        ("//HOST/Share/x/dtm.tif", r"host\share"),
        (r"C:\x.tif", ""),
        ("x.tif", ""),
        (r"\\?\C:\x.tif", ""),
        (r"\\?\UNC\host\share\x.tif", r"host\share"),
        ("../x.tif", ""),
    ],
)
def test_the_share_of_a_path_is_found(name, share):
    assert source_names.network_share(name) == share


def test_what_others_name_leads_to_no_other_computer(windows, tmp_path):
    """Windows would hand it the user's name and a digest of the password."""
    for name in (r"\\far\share\dtm.tif", "//far/share/dtm.tif"):
        with pytest.raises(FormatError, match="is in the network"):
            file_references.require_local(name, tmp_path / "scene.toml")
    file_references.require_local("//near/share/dtm.tif", "//near/share/scene.toml")
    (tmp_path / "list.vrt").write_text("<VRTDataset><SourceFilename>//far/x/a.tif</SourceFilename></VRTDataset>")
    with pytest.raises(FormatError, match="is in the network"):
        file_references.require_local(tmp_path / "list.vrt", tmp_path / "scene.toml")


def test_macos_flushes_through_to_the_disk(monkeypatch, tmp_path):
    import fcntl

    asked = []
    monkeypatch.setattr(operating_system, "MACOS", True)
    monkeypatch.setattr(fcntl, "F_FULLFSYNC", 51, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", lambda descriptor, what: asked.append(what))
    monkeypatch.setattr(os, "fsync", lambda descriptor: asked.append("fsync"))
    with whole_files.whole_file(tmp_path / "a") as part:
        part.touch()
    assert asked == [51]

    def without(descriptor, what):
        raise OSError(errno.ENOTSUP, "not supported")

    monkeypatch.setattr(fcntl, "fcntl", without)
    with whole_files.whole_file(tmp_path / "b") as part:
        part.touch()
    assert asked == [51, "fsync"]


def test_ctrl_break_ends_a_program_as_ctrl_c(monkeypatch):
    assert operating_system.stop_signals() == (signal.SIGINT, signal.SIGTERM)
    monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR1, raising=False)
    assert operating_system.stop_signals() == (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)


def test_processes_are_found_without_a_proc(windows):
    """As on Windows and macOS, by psutil: no signal is sent."""
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    start = operating_system.process_start(child.pid)
    assert start > 100 * 1_500_000_000 and start == operating_system.process_start(
        child.pid
    )  # hundredths of a second since 1970
    living = writer.Writer(child.pid, writer.host(), writer.boot(), start)
    assert not living.is_over() and writer.written_by(str(living)) == living
    assert living._replace(start=start - 1).is_over()  # its number was given again
    assert not living._replace(host="0" * 8).is_over()
    child.communicate(b"\n")
    assert living.is_over()
    assert not writer.this_process().is_over()


def test_memory_is_found_without_a_proc(monkeypatch, tmp_path):
    from mpmgis.system import memory

    known = memory.available_memory()
    monkeypatch.setattr(memory, "_LINUX", tmp_path / "nothing")
    assert 0.5 < memory.available_memory() / known < 2.0


def test_facts_as_json_are_ascii_where_the_stream_is_not_utf_8(tmp_path, monkeypatch):
    """PowerShell and pipes of Windows have cp1252, and whoever reads JSON expects UTF-8."""
    write_site(tmp_path)
    (tmp_path / "dtm.tif").rename(tmp_path / "größe.tif")
    for encoding in ("cp1252", "utf-8"):
        told = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(told, encoding=encoding))
        assert main(["info", "--json", str(tmp_path / "größe.tif")]) == 0
        sys.stdout.flush()
        assert Path(json.loads(told.getvalue().decode("utf-8"))["file"]).name == "größe.tif"
        assert told.getvalue().isascii() == (encoding != "utf-8")


def test_names_in_other_case_are_the_same_folder_on_such_disks(monkeypatch, tmp_path):
    """On macOS and Windows `-o RESULTS` is the folder `results`: neither inputs nor where one stands are replaced."""
    same = os.path.samefile
    monkeypatch.setattr(os.path, "samefile", lambda a, b: str(a).lower() == str(b).lower() or same(a, b))
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "frame_000000.h5").touch()
    with pytest.raises(OutputError, match="contains the input"):
        run_terrain.refuse_within(tmp_path / "RESULTS", tmp_path / "results" / "frame_000000.h5")
    run_terrain.refuse_within(tmp_path / "OTHER", tmp_path / "results" / "frame_000000.h5")
    with pytest.raises(OutputError, match="contains the input"):
        answer_files.checked_output(tmp_path / "RESULTS", ("a.csv",), False, [tmp_path / "results" / "frame_000000.h5"])


def test_a_closed_pipe_is_no_error(monkeypatch):
    """`mpmgis info x | more`, left early: Windows has another number for it; other errors of it are reported."""

    class Unread:
        def flush(self):
            raise OSError(errno.EINVAL, "Invalid argument")

    error = OSError(errno.EINVAL, "Invalid argument")
    assert operating_system.is_unread(Unread(), BrokenPipeError()) and not operating_system.is_unread(Unread(), error)
    monkeypatch.setattr(operating_system, "WINDOWS", True)
    assert operating_system.is_unread(Unread(), error) and not operating_system.is_unread(sys.__stdout__, error)
    assert not operating_system.is_unread(Unread(), OSError(errno.EINVAL, "Invalid argument", "dtm.tif"))


# ---------------------------------------------------------------------------------------------- files that are open


def test_the_rules_hold(windows, tmp_path):
    """What the tests below go by: each of these is refused on Windows."""
    folder = tmp_path / "folder"
    folder.mkdir()
    file, other = folder / "file", folder / "other"
    file.write_text("x")
    other.write_text("y")
    with open(file, "rb") as handle:
        for act in (
            lambda: os.replace(other, file),
            lambda: os.replace(file, other),
            file.unlink,
            lambda: os.rename(file, file),
            lambda: file.rename(folder / "new"),
        ):
            with pytest.raises(PermissionError):
                act()
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fsync(handle.fileno())
        with pytest.raises(PermissionError):
            folder.rename(tmp_path / "moved")
    with pytest.raises(PermissionError):
        os.open(folder, os.O_RDONLY)
    with pytest.raises(FileExistsError):
        other.rename(file)
    with pytest.raises(AssertionError):
        os.kill(os.getpid(), 0)
    assert not hasattr(os, "O_NOFOLLOW") and not hasattr(os, "geteuid")
    with pytest.raises(ImportError):
        import fcntl  # noqa: F401
    os.replace(other, file)
    file.unlink()


def test_a_file_that_is_open_elsewhere_is_refused_before_the_work(windows, tmp_path):
    path = tmp_path / "depth.tif"
    path.write_text("old")
    with (
        open_elsewhere(path),
        pytest.raises(OutputError, match=r"depth\.tif is open in another program, for example QGIS;.*close it there"),
        whole_files.whole_file(path),
    ):
        raise AssertionError("the block must not run")
    assert everything(tmp_path) == {Path("depth.tif"): b"old"}


@pytest.mark.parametrize("late", [False, True], ids=["before", "during"])
def test_a_folder_of_which_a_file_is_open_elsewhere_remains_complete(windows, tmp_path, late):
    """Opened before the work, or while it was done: nothing is half replaced, and the line names the file."""
    gis = tmp_path / "gis"
    with whole_files.whole_folder(gis) as part:
        (part / "rasters").mkdir()
        (part / "rasters" / "max.tif").write_text("old")
    before, ran = everything(tmp_path), []
    held = open_elsewhere(gis / "rasters" / "max.tif")
    if not late:
        held.__enter__()
    with (
        pytest.raises(OutputError, match=r"max\.tif is open in another program"),
        whole_files.whole_folder(gis, True) as part,
    ):
        ran.append(part)
        (part / "new").write_text("new")
        held.__enter__()
    assert bool(ran) == late and everything(tmp_path) == before
    held.__exit__(None, None, None)
    with whole_files.whole_folder(gis, True) as part:
        (part / "new").write_text("new")
    assert sorted(everything(tmp_path)) == [Path("gis/.mpmgis"), Path("gis/new")]


def test_a_folder_that_is_open_in_a_terminal_is_named(windows, tmp_path, monkeypatch):
    """Windows moves no folder that is some process' current one; no file in it is open."""
    with whole_files.whole_folder(tmp_path / "gis") as part:
        (part / "old").touch()
    before = everything(tmp_path)

    def refuse(source, target):
        raise PermissionError(errno.EACCES, "Access is denied")

    with (
        monkeypatch.context() as patch,
        pytest.raises(OutputError, match=r"gis: no permission to replace it, or a terminal or file manager"),
        whole_files.whole_folder(tmp_path / "gis", True),
    ):
        patch.setattr(os, "replace", refuse)
    assert everything(tmp_path) == before


def test_what_a_virus_scanner_holds_for_a_moment_is_waited_for(windows, tmp_path, monkeypatch):
    real, tries = {name: getattr(os, name) for name in ("replace", "rename")}, []

    def held_twice(name):
        def act(source, target):
            tries.append(name)
            if tries.count(name) < 3:
                raise PermissionError(errno.EACCES, "held")
            real[name](source, target)

        return act

    (tmp_path / "a").write_text("old")
    for name in real:
        monkeypatch.setattr(os, name, held_twice(name))
    with whole_files.whole_file(tmp_path / "a") as part:
        part.write_text("whole")
    assert (tmp_path / "a").read_text() == "whole" and tries == ["rename"] * 3 + ["replace"] * 3


def test_elsewhere_no_permission_is_not_waited_for(tmp_path, monkeypatch):
    tries = []

    def refuse(source, target):
        tries.append(target)
        raise PermissionError(errno.EACCES, "no")

    monkeypatch.setattr(os, "replace", refuse)
    with (
        pytest.raises(OutputError, match="no permission to write there"),
        whole_files.whole_file(tmp_path / "a") as part,
    ):
        part.touch()
    assert len(tries) == 1


# ---------------------------------------------------------------------------------------------------------------- locks


def test_a_folder_has_one_writer_on_windows(windows, tmp_path):
    """The byte that is locked cannot be read, and yet the line names the holder; the file goes when it is let go."""
    with sole_writer(tmp_path) as hold:
        hold.require_folder()
        for _ in range(2):
            refusal = pytest.raises(OutputError, match=f"is being written by process {os.getpid()} on ")
            with refusal, sole_writer(tmp_path):
                raise AssertionError("the block must not run")
    assert ("unlink", str(tmp_path / LOCK_FILE)) in windows.refused  # it was open, and goes once it is closed
    assert not list(tmp_path.iterdir())
    with sole_writer(tmp_path):
        pass


def test_a_lock_that_another_program_looks_at_stays_and_blocks_nothing(windows, tmp_path):
    with sole_writer(tmp_path):
        looker = open(tmp_path / LOCK_FILE, "rb")  # noqa: SIM115
    assert (tmp_path / LOCK_FILE).exists()
    with sole_writer(tmp_path):
        looker.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("what", ["folder", "link"])
def test_a_lock_that_is_none_is_refused_without_flags_for_links(windows, tmp_path, what):
    """`os.open` has no O_NOFOLLOW there: what the name stands for is looked at before and after."""
    (tmp_path / "victim.txt").write_text("keep")
    folder = tmp_path / "run"
    folder.mkdir()
    if what == "folder":
        (folder / LOCK_FILE).mkdir()
    else:
        (folder / LOCK_FILE).symlink_to(tmp_path / "victim.txt")
    with pytest.raises(OutputError, match=r"is not a regular file|is a link"), sole_writer(folder):
        raise AssertionError("the block must not run")
    assert (tmp_path / "victim.txt").read_text() == "keep"


def test_a_link_that_comes_between_the_look_and_the_opening_is_seen(windows, tmp_path, monkeypatch):
    (tmp_path / "victim.txt").write_text("keep")
    looked = links.refuse_link

    def too_late(path):
        looked(path)
        Path(path).symlink_to(tmp_path / "victim.txt")

    monkeypatch.setattr(links, "refuse_link", too_late)
    with pytest.raises(OutputError, match=r"another name \(hard link\)"):
        links.open_own(tmp_path / LOCK_FILE)


# ---------------------------------------------------------------------------------------------------------- the verbs


def test_a_run_goes_through(windows, site, capsys):
    """Runs and is replaced; an open terrain is refused before anything changes, one opened later as well."""
    scene, results = site / "scene.toml", site / "results"
    assert main(["run", str(scene), "-q"]) == 0
    whole = contents(results)
    assert main(["run", str(scene), "--resume", "-q"]) == 0
    assert main(["run", str(scene), "--overwrite", "-q"]) == 0
    assert contents(results) == whole
    before = everything(results)
    with rasterio.open(results / "terrain.tif"):
        line = refusal(capsys, "run", scene, "--overwrite")
        assert re.search(r"terrain\.tif is open in another program, for example QGIS; nothing has changed", line)
        assert everything(results) == before
    assert main(["run", str(scene), "--overwrite", "-q"]) == 0
    assert contents(results) == whole
    assert not [path for path in site.rglob(".*") if path.name != ".mpmgis"]


def test_a_run_that_is_opened_while_it_is_replaced_remains_complete(windows, site, capsys, monkeypatch):
    scene, results = site / "scene.toml", site / "results"
    assert main(["run", str(scene), "-q"]) == 0
    before, opened = everything(results), []
    write = RunFolder.write_frame

    def opening(folder, frame):
        if not opened:
            opened.append(open(results / "terrain.tif", "rb"))  # noqa: SIM115
        write(folder, frame)

    monkeypatch.setattr(RunFolder, "write_frame", opening)
    line = refusal(capsys, "run", scene, "--overwrite")
    assert "terrain.tif is open in another program" in line and "the earlier run is complete" in line
    assert everything(results) == before
    opened[0].close()


def test_a_frame_that_is_read_while_the_run_continues_stops_nothing(windows, site, monkeypatch):
    scene, results, opened = site / "scene.toml", site / "results", []
    write = RunFolder.write_frame

    def reading(folder, frame):
        write(folder, frame)
        if folder.frames == 2:
            opened.append(open(results / "frame_000001.h5", "rb"))  # noqa: SIM115

    monkeypatch.setattr(RunFolder, "write_frame", reading)
    assert main(["run", str(scene), "-q"]) == 0
    opened[0].close()
    with_state = []
    for path in sorted(results.glob("frame_*.h5")):
        with h5py.File(path) as file:
            with_state += [path.stem] if "state" in file else []
    assert with_state == ["frame_000001", "frame_000005", "frame_000006"]
    assert main(["run", str(scene), "-q", "--resume"]) == 0


def test_a_run_continues_after_a_kill(windows, site, monkeypatch):
    """What the process left, its lock too, blocks nothing: its number is asked for by psutil."""
    run, cut = ["run", str(site / "scene.toml"), "-q", "-o"], site / "cut"
    assert main([*run, str(site / "whole")]) == 0
    advance = ColumnSolver.advance

    def interrupted(solver, *given, **named):
        if solver.time >= 7.0:
            raise KeyboardInterrupt
        return advance(solver, *given, **named)

    with monkeypatch.context() as patch:
        patch.setattr(ColumnSolver, "advance", interrupted)
        assert main([*run, str(cut)]) == 130
    assert 3 <= len(list(cut.glob("frame_*.h5"))) < len(list((site / "whole").glob("frame_*.h5")))
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    left = (
        f"{writer.Writer(child.pid, writer.host(), writer.boot(), operating_system.process_start(child.pid))}-0123abcd"
    )
    child.communicate(b"\n")
    (cut / LOCK_FILE).write_text(f"process {child.pid} on here")
    (cut / f".frame_000009.part{left}.h5").write_text("half")
    assert main([*run, str(cut), "--resume"]) == 0
    assert contents(cut) == contents(site / "whole")
    assert not [path for path in cut.iterdir() if path.name.startswith(".")]


def test_seed_convert_info_export_and_report_go_through(windows, site, capsys):
    """Outputs twice, the second time over the first; a raster that is open is named and nothing is lost."""
    scene, seed, results, gis = site / "scene.toml", site / "columns.h5", site / "results", site / "gis"
    scene.write_text(SHORT.replace("end_time = 12", "end_time = 6"), encoding="utf-8")
    again = [[], ["--overwrite"]]
    assert main(["run", str(scene), "-q"]) == 0
    for more in again:
        for words in (
            ["seed", "--dem", site / "dtm.tif", "--release", site / "release.geojson", "--thickness", 2, "-o", seed],
            ["convert", seed, "-o", site / "points.h5"],
            ["info", seed, results, "--json", "-o", site / "facts.json"],
            ["export-raster", results, "-o", gis],
            ["intensity", results, "--guideline", "swiss-debris-flow", "-o", site / "intensity"],
        ):
            assert main([*map(str, words), "-q", *more]) == 0, (words, capsys.readouterr().err)
    assert main(["report", str(results), "-o", str(site / "report.html"), "-q"]) == 0
    before = everything(gis)
    raster = next(gis.rglob("*_max.tif"))
    with rasterio.open(raster):
        line = refusal(capsys, "export-raster", results, "-o", gis, "--overwrite")
        assert f"{raster.name} is open in another program, for example QGIS" in line and everything(gis) == before
    names_are_good(site)


def test_an_ensemble_goes_through_and_again(windows, site, capsys):
    """With its members in this process; then another plan over it, and with one member's raster open."""
    output = site / "ensemble"
    words = ["ensemble", site / "scene.toml", "-o", output, "--workers", 1, "--samples", 2, "-q"]
    words = list(map(str, words))
    assert main([*words, "--vary", "friction.mu=0.1:0.4"]) == 0
    assert main([*words, "--vary", "friction.mu=0.1:0.3", "--overwrite"]) == 0, capsys.readouterr().err
    before = everything(output)
    with rasterio.open(next((output / "maps").rglob("*.tif"))):
        line = refusal(capsys, *words[:-1], "--vary", "friction.mu=0.1:0.3", "--overwrite")
        assert "is open in another program" in line
    assert {name: data for name, data in everything(output).items() if name.parts[0] == "maps"} == {
        name: data for name, data in before.items() if name.parts[0] == "maps"
    }
    names_are_good(output)


def names_are_good(folder):
    """No name is one that Windows refuses, no two in a folder differ in case alone, and no text has ends of its own."""
    for path in folder.rglob("*"):
        assert not operating_system.wrong_name(path.name), path
        if path.suffix in (".json", ".toml", ".qml", ".vrt", ".html"):
            assert b"\r\n" not in path.read_bytes(), path
            assert b"\\\\" not in path.read_bytes() or path.suffix == ".html", path
    for place, folders, files in os.walk(folder):
        names = [name.lower() for name in (*folders, *files)]
        assert len(names) == len(set(names)), place
