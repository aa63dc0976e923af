"""Commands that survive: kills, a second run, files that vanish, a full disk, a clock that jumps."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from kills import VERBS, arrays, require_whole
from slope_site import CHILD, SCENE, contents, record, slide, write_block_site

from mpmgis.commands.shell.main import main
from mpmgis.system import writer_process
from mpmgis.system.writer_process import Writer

try:
    import resource
except ImportError:  # Windows, where the tests that need it are skipped
    resource = None

POINTS = slide(8.0, 1.5, 0.25)
SEED = 20261121
needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
# a wall clock that jumps by years, forth and back, at every look
CLOCK = """
import datetime, itertools, sys, time
jumps = itertools.cycle([0.0, 3e8, -1e9, 7.5, -3600.0])
real, real_ns, real_local = time.time, time.time_ns, time.localtime
time.time = lambda: real() + next(jumps)
time.time_ns = lambda: real_ns() + int(1e9 * next(jumps))
time.localtime = lambda seconds=None: real_local(time.time() if seconds is None else seconds)
from mpmgis.commands.shell.main import main
sys.exit(main(sys.argv[1:]))
"""


def write_kill_site(folder):
    """The slope with a scene of columns and one of points."""
    write_block_site(folder)
    (folder / "columns.toml").write_text(SCENE)
    (folder / "points.toml").write_text(POINTS)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """The slope, and a run of columns that was left alone."""
    folder = tmp_path_factory.mktemp("sound")
    write_kill_site(folder)
    assert main(["run", str(folder / "columns.toml"), "-q", "-o", str(folder / "columns")]) == 0
    return folder


@pytest.fixture
def site(sound, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(sound, tmp_path / "site"))


def only_line(text):
    """The one line that `text` is."""
    assert text.count("\n") == 1, text
    return text


# ------------------------------------------------------------------------------------------------------------- kills


def killed(tmp_path, count, seed):
    """What the process that kills said, a line a kill; it must end well."""
    site = tmp_path / "site"
    site.mkdir()
    write_kill_site(site)
    command = [sys.executable, str(Path(__file__).with_name("kills.py")), str(site), str(count), str(seed)]
    environment = os.environ | {"NUMBA_THREADING_LAYER": "workqueue"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=7200, check=False, env=environment)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    return done.stdout


@pytest.mark.thorough
@needs_fork
def test_nothing_is_lost_by_a_dozen_kills(tmp_path):
    """Runs of columns and points, seeds, conversions, exports, at random moments; they finish to the same bytes."""
    assert "12 kills, 0 failures" in killed(tmp_path, 12, SEED)


@pytest.mark.slow
@needs_fork
def test_nothing_is_lost_by_two_hundred_kills(tmp_path):
    assert "200 kills, 0 failures" in killed(tmp_path, 200, SEED + 1)


KILLED = f"{Writer(2**31 - 1, writer_process.host(), writer_process.boot(), 1)}-0123abcd"
LEFT = [".run.part{0}.json", ".frame_000000.part{0}.h5"]


@pytest.mark.parametrize("left", [[".lock"], LEFT, [".lock", *LEFT], []])
def test_what_a_kill_leaves_before_the_first_file_is_an_empty_folder(site, sound, left):
    for option in ("--resume", "-q"):
        shutil.rmtree(site / "new", ignore_errors=True)
        (site / "new").mkdir()
        for name in left:
            (site / "new" / name.format(KILLED)).write_text("process 4711")
        assert main(["run", str(site / "columns.toml"), "-q", "-o", str(site / "new"), option]) == 0
        assert contents(site / "new") == contents(sound / "columns")
        assert not [path.name for path in (site / "new").iterdir() if path.name.startswith(".")]


# ------------------------------------------------------------------------------------- a run that is held at a frame


@pytest.fixture
def halted(site):
    """A run into `cut` that halts where its second frame is written and has no name yet."""
    name = "frame_000001.h5:1"
    words = ["run", str(site / "columns.toml"), "-q", "-o", str(site / "cut")]
    command = [sys.executable, "-c", CHILD, str(int(signal.SIGSTOP)), "name", name, *words]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    status = f"/proc/{child.pid}/stat"
    try:
        for _ in range(6000):
            if child.poll() is not None or Path(status).read_text().rpartition(")")[2].split()[0] == "T":
                break
            time.sleep(0.02)
        assert child.poll() is None, child.stderr.read()
        yield child
    finally:
        child.kill()
        child.wait()


def finished(child):
    """(exit code, stderr) of a child that continues."""
    child.send_signal(signal.SIGCONT)
    _, err = child.communicate(timeout=300)
    return child.returncode, err


needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc here")


@needs_proc
def test_a_second_run_into_the_same_folder_is_refused_and_the_first_continues(site, sound, halted, capsys):
    before = sorted(path.name for path in (site / "cut").iterdir())
    for options in ([], ["--resume"], ["--overwrite"]):
        assert main(["run", str(site / "columns.toml"), "-q", "-o", str(site / "cut"), *options]) == 2
        line = only_line(capsys.readouterr().err)
        words = f"is being written by process {halted.pid}" if options else "exists already"
        assert words in line and "give another -o" in line
    assert sorted(path.name for path in (site / "cut").iterdir()) == before
    assert finished(halted) == (0, "")
    assert contents(site / "cut") == contents(sound / "columns")
    assert record(site, "cut")["result_digest"] == record(sound, "columns")["result_digest"]


@pytest.fixture
def run_beside(site, monkeypatch):
    """A function: the exit code of a run into `cut`; `act` changes files where the second frame gets its name."""

    def run(act):
        replace = os.replace

        def watched(part, path):
            if os.path.basename(path) == "frame_000001.h5":
                monkeypatch.setattr(os, "replace", replace)
                act()
            return replace(part, path)

        monkeypatch.setattr(os, "replace", watched)
        return main(["run", str(site / "columns.toml"), "-q", "-o", str(site / "cut")])

    return run


def test_inputs_that_vanish_are_not_needed_any_more(site, sound, run_beside):
    assert run_beside(lambda: [(site / name).unlink() for name in ("dtm.tif", "release.geojson", "columns.toml")]) == 0
    assert contents(site / "cut") == contents(sound / "columns")


@pytest.mark.parametrize("replaced", [False, True])
def test_a_folder_that_vanishes_ends_its_run(site, run_beside, capsys, replaced):
    def move():
        (site / "cut").rename(site / "moved")
        if replaced:
            (site / "cut").mkdir()

    assert run_beside(move) == 2
    assert "cut" in only_line(capsys.readouterr().err)
    assert not list((site / "cut").glob("*"))
    require_whole(site / "moved")


def test_a_frame_that_vanishes_is_missed_by_info_alone(site, run_beside, capsys):
    assert run_beside((site / "cut" / "frame_000000.h5").unlink) == 0
    assert main(["info", str(site / "cut")]) == 0
    assert "frame 0 is missing" in capsys.readouterr().out


# ------------------------------------------------------------------------------------------------------------- disks


@pytest.fixture
def small_disk(tmp_path):
    """A function `disk(options)` that gives a mounted folder, mounted again when it is called again."""
    place = tmp_path / "disk"
    place.mkdir()

    def mounted(*options):
        return subprocess.run(["mount", *options, str(place)], capture_output=True, check=False).returncode == 0

    if shutil.which("mount") is None or not mounted("-t", "tmpfs", "-o", "size=8k", "tmpfs"):
        pytest.skip("this user may not mount a small disk")
    yield place, lambda options: mounted("-o", f"remount,{options}")
    subprocess.run(["umount", "-l", str(place)], check=False)


def test_a_full_disk_is_reported_in_a_line_and_a_run_continues_when_there_is_room(site, sound, small_disk, capsys):
    place, remount = small_disk
    for size in (8, 200, 400):
        assert remount(f"size={size}k")
        assert main(["run", str(site / "columns.toml"), "-q", "-o", str(place / "run"), "--resume"]) == 2
        assert "the disk is full" in only_line(capsys.readouterr().err)
        if (place / "run").exists():
            require_whole(place / "run")
    assert any((place / "run").glob("frame_*.h5"))
    assert remount("size=50m")
    assert main(["run", str(site / "columns.toml"), "-q", "-o", str(place / "run"), "--resume"]) == 0
    assert contents(place / "run") == contents(sound / "columns")


WRITERS = [verb for verb in VERBS if verb not in ("columns", "points")]


@pytest.mark.parametrize("verb", WRITERS)
def test_a_full_disk_leaves_no_half_of_any_file(verb, site, small_disk, capsys, monkeypatch):
    place, _ = small_disk
    monkeypatch.chdir(site)
    assert main([*VERBS[verb].replace("{to}", str(place)).split(), "-q"]) == 2
    line = only_line(capsys.readouterr().err)
    assert "disk is full" in line or "are free there" in line
    assert list(place.iterdir()) == []


def test_an_export_on_a_full_disk_gives_one_line(sound, small_disk, capfd, tmp_path):
    """Read from the descriptors, which is where C libraries write."""
    place, remount = small_disk
    words = ["export-raster", str(sound / "columns"), "-q", "--workers", "2"]
    assert main([*words, "-o", str(tmp_path / "gis")]) == 0
    whole = sum(4096 * -(-path.stat().st_size // 4096) for path in (tmp_path / "gis").rglob("*"))
    capfd.readouterr()
    for share in (0.1, 0.3, 0.5, 0.7, 0.85, 0.95):
        assert remount(f"size={int(share * whole)}")
        assert main([*words, "-o", str(place / "gis")]) == 2
        line = only_line(capfd.readouterr().err)
        assert line == f"mpmgis export-raster: {place / 'gis'}: the disk is full; free some space or give another -o\n"
        assert list(place.iterdir()) == []


@pytest.mark.parametrize("verb", WRITERS)
def test_a_disk_that_cannot_be_written_is_reported_in_a_line(verb, site, small_disk, capsys, monkeypatch):
    place, remount = small_disk
    assert remount("size=50m") and remount("ro")
    monkeypatch.chdir(site)
    assert main([*VERBS[verb].replace("{to}", str(place)).split(), "-q"]) == 2
    assert "no permission" in only_line(capsys.readouterr().err)


def test_a_run_on_a_disk_that_cannot_be_written_is_reported_in_a_line(site, small_disk, capsys):
    place, remount = small_disk
    assert remount("size=50m") and remount("ro")
    for options in ([], ["--resume"]):
        assert main(["run", str(site / "columns.toml"), "-q", "-o", str(place / "run"), *options]) == 2
        assert "no permission" in only_line(capsys.readouterr().err)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="address space is limited on Linux")
@pytest.mark.parametrize("words", ["run columns.toml -o few", "export-raster columns -o few", "info columns"])
def test_too_little_address_space_is_reported_in_a_line_before_a_library_aborts(words, site):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (600_000_000, 600_000_000))

    command = [sys.executable, "-m", "mpmgis", *words.split()]
    done = subprocess.run(command, cwd=site, capture_output=True, text=True, preexec_fn=limit)
    assert done.returncode == 2
    assert "address space is limited to 0.6 GB, the libraries need 1 GB" in only_line(done.stderr)
    assert not (site / "few").exists()


@pytest.fixture
def small_files():
    """A limit to the size of the files that this process writes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.skipif(resource is None, reason="no limits here")
@pytest.mark.parametrize("verb", ["columns", *WRITERS])
def test_files_that_may_not_grow_are_reported_in_a_line(verb, site, small_files, capfd, monkeypatch):
    """As a quota does; no small disk is needed."""
    monkeypatch.chdir(site)
    assert main([*VERBS[verb].replace("{to}", "limited").split(), "-q"]) == 2
    assert "cannot be written" in only_line(capfd.readouterr().err)
    if (site / "limited").exists():
        require_whole(site / "limited")
        assert not [path.name for path in (site / "limited").iterdir() if path.name.startswith(".")]


# ------------------------------------------------------------------------------------------------------------- clock


@pytest.mark.thorough
def test_a_clock_that_jumps_changes_nothing(site, sound):
    """Frames, progress, threads and waiting go by a clock that only goes forward."""
    words = ["run", str(site / "columns.toml"), "-o", str(site / "jumped")]
    done = subprocess.run(
        [sys.executable, "-c", CLOCK, *words], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert arrays(site / "jumped") == arrays(sound / "columns")
    assert 0.0 < record(site, "jumped")["wall_seconds"] < 300.0
