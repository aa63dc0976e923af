"""Damaged inputs by the thousand: each must end with exit code 0, 2 or 3, in one line, soon, and write nothing astray.

`make fuzz` runs 20 000 of them; `python tests/fuzz/fuzzer.py --case N --seed S` shows what case N does. Everything
follows from the seed. Children are forked after the imports, so that a case costs tens of milliseconds; each case has
its own folder as working, home and temporary folder, its own limit of time and of memory, and all that it leaves
behind is looked at.
"""

import argparse
import json
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).resolve().parent))

import psutil
from mutations import copy_of, damage
from sound_inputs import FOREIGN, TIFFS, VECTORS, write_sound_inputs

SECONDS, WALL_SECONDS = 10.0, 60.0  # of computing; and of waiting, on a machine that has other work too
MOST_WHOLE_SECONDS = 60.0  # of a whole command, which may compile
MEMORY = 1 << 30  # [bytes] of address space beyond what the process has when a case begins
BATCH = 100  # cases a child
PROGRAM = "mpmgis"
LIBTIFF = (
    "_tiffSeekProc: "  # its own word on stderr where a BigTIFF says that data lie beyond 2^63; GDAL cannot stop it
)

# kind -> rows of (files, commands): one of the files is damaged, and one of the commands reads it as {file}
KINDS = {
    "tiff": [
        (
            [*TIFFS, "mask.tif"],
            [
                "info {file}",
                "seed --dem {file} --release release.gpkg --thickness 1 -o out/a.h5",
                "seed --dem {file} --release release.gpkg --thickness 1 --spacing 4 -o out/a.csv",
                "seed --dem dtm.tif --release {file} -o out/a.h5",
                "seed --dem dtm.tif --release release.gpkg --thickness {file} -o out/a.h5",
                "seed --dem dtm.tif --release release.gpkg --surface {file} -o out/a.h5",
                "compare mask.tif {file} -o out/c.csv",
                "exposure results --objects {file} -o out/e.csv",
                "path results --line {file} -o out/p.csv",
                "path results --outline {file} -o out/p.csv",
            ],
        ),
        (["dtm.tif"], ["effects scene.toml", "effects points.toml"]),
    ],
    "vector": [
        (
            [*VECTORS, "release.shp", "release.gpkg", "wall.gpkg"],
            [
                "info {file}",
                "seed --dem dtm.tif --release {file} -o out/a.h5",
                "seed --dem dtm.tif --release {file} --thickness 1 -o out/a.h5",
                "compare mask.tif {file} -o out/c.csv",
            ],
        ),
        (["release.shp", "release.gpkg", "wall.gpkg"], ["effects scene.toml"]),
        (
            ["path.gpkg", "wall.gpkg", "places.geojson"],
            [
                "profile results --line {file} -o out/p.csv",
                "runout results --line {file} -o out/r.csv",
                "hydrograph results --section {file} -o out/h.csv",
                "timeseries results --points {file} -o out/t.csv",
            ],
        ),
        (["release.gpkg"], ["effects inflow.toml"]),
    ],
    "frame": [
        (
            ["seed.h5", "points.h5", "results/frame_000000.h5", "results/frame_000004.h5"],
            [
                *["info {file}", "convert {file} --dem dtm.tif -o out/c.h5"] * 4,
                "convert {file} --dem dtm.tif -o out/c.h5 --cell 5",
                "export-raster {file} --dem dtm.tif -o out/gis --no-qgis",
            ],
        ),
        (["results/frame_000000.h5", "results/frame_000004.h5"], ["info results"]),
        (
            ["results/frame_000000.h5", "results/frame_000002.h5", "results/run.json"],
            [
                "runout results -o out/r.csv",
                "timeseries results --at 400100,5100120 -o out/t.csv",
                "profile results --line path.gpkg -o out/p.csv",
                "hydrograph results --section wall.gpkg -o out/h.csv",
                "intensity results --guideline swiss-flood -o out/i.gpkg",
            ],
        ),
        (["points.h5"], ["vertical {file} --at 400060,5100120 --dem dtm.tif -o out/v.csv"]),
        (["seed.h5"], ["effects frame.toml"]),
    ],
    "hydrograph": [(["inflow.csv"], ["effects inflow.toml"])],
    "foreign": [
        (
            [
                f"{folder}/{name}"
                for folder, (_, names) in FOREIGN.items()
                for name in (*names, names[0], "georef.json")
            ],
            [*["info {folder}", "info {file}"], *["export-raster {folder} --dem dtm.tif -o out/gis --no-qgis"] * 2],
        )
    ],
    "scene": [
        (
            ["scene.toml", "inflow.toml", "points.toml", "frame.toml", "stages.toml"],
            ["effects {file}", "effects {file}", "info {file}"],
        ),
        (["guidelines.toml"], ["intensity results --guideline swiss-flood --guidelines {file} -o out/i.tif"]),
    ],
}
SHARES = {"tiff": 5, "vector": 5, "frame": 4, "hydrograph": 2, "foreign": 4, "scene": 4}
WHOLE = {  # the same of cases that go through the whole program, in a process of their own
    "tiff": (["dtm.tif"], ["run plain.toml -o out/run"]),
    "vector": (["release.shp"], ["run plain.toml -o out/run"]),
    "frame": (
        ["results/frame_000004.h5", "results/frame_000003.h5"],
        ["run plain.toml -o results --resume", "export-raster results -o out/gis"],
    ),
    "hydrograph": (["inflow.csv"], ["run inflow.toml -o out/run"]),
    "foreign": (
        ["cbgeo/particles-0_2-0500.h5", "zlib/slide_1.vtu", "npz/step1.npz", "gid/slide.post.res"],
        ["export-raster {folder} --dem dtm.tif -o out/gis"],
    ),
    "scene": (
        ["scene.toml", "inflow.toml", "points.toml", "frame.toml", "stages.toml"],
        ["effects {file}", "info {file}"],
    ),
}


@dataclass(frozen=True)
class Case:
    """One damaged input and the command that reads it."""

    number: int
    kind: str
    file: str
    command: str

    @property
    def words(self):
        """The command line after `mpmgis`."""
        return [*self.command.format(file=self.file, folder=self.file.rpartition("/")[0]).split(), "-q"]


def case_of(number, seed, kinds=SHARES):
    """(Case, the generator that continues with its damage), always the same for a number and a seed."""
    random = Random(f"{seed} {number}")
    kind = random.choices(list(kinds), [SHARES[name] for name in kinds])[0]
    files, commands = random.choices(KINDS[kind], [len(row[0]) for row in KINDS[kind]])[0]
    return Case(number, kind, random.choice(files), random.choice(commands)), random


def prepared(case, random, sound, folder):
    """Copy the sound inputs into `folder` and damage the case's file; answers what was done."""
    copy_of(sound, folder)
    (folder / "out").mkdir()
    path = folder / case.file
    return "; ".join(damage(path, random) for _ in range(random.choice([1, 1, 1, 1, 2, 4])) if path.exists())


def everything(folder):
    """Path -> size and time of change of every file below `folder`; of a folder None."""
    return {
        path.relative_to(folder).as_posix(): None if path.is_dir() else (path.stat().st_size, path.stat().st_mtime_ns)
        for path in folder.rglob("*")
    }


# ------------------------------------------------------------------------------------------------ inside of a child


def _child(numbers, seed, kinds, sound, work, sink):
    """Run the cases `numbers` one after the other; a line of JSON before each and after it."""
    from mpmgis.commands.shell.main import main

    home = os.getcwd()
    for number in numbers:
        case, random = case_of(number, seed, kinds)
        folder = work / f"case_{number}"
        done = prepared(case, random, sound, folder)
        before = everything(folder)
        os.write(sink, (json.dumps({"begin": number, "damage": done}) + "\n").encode())
        os.chdir(folder)
        os.environ["HOME"] = os.environ["TMPDIR"] = str(folder)
        tempfile.tempdir = None
        try:
            result = _measured(main, case.words, folder.parent / f"stderr_{number}")
        finally:
            os.chdir(home)
        result |= _left_behind(folder, before)
        os.write(sink, (json.dumps({"end": number, **result}) + "\n").encode())
        shutil.rmtree(folder, ignore_errors=True)


def _measured(main, words, stderr):
    """Exit code, what came on stderr and stdout, and what it cost."""
    began, used = time.perf_counter(), time.process_time()
    streams = [os.dup(number) for number in (1, 2)]
    target = os.open(stderr, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(target, 2)
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + MEMORY, hard))
    try:
        code = main(words)
    except SystemExit as error:
        code = error.code
    except BaseException as error:  # nothing may come out of the program
        code = f"{type(error).__name__}: {error}"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        sys.stdout.flush()
        sys.stderr.flush()
        for number, stream in zip((1, 2), streams, strict=True):
            os.dup2(stream, number)
            os.close(stream)
        os.close(nothing)
        os.close(target)
    text = Path(stderr).read_text(errors="replace")
    Path(stderr).unlink()
    spent = {"seconds": time.process_time() - used, "wall": time.perf_counter() - began}
    return {"code": code, "stderr": text, **spent}


def _left_behind(folder, before):
    """Names that are new, gone or changed outside of `out`, and those in it."""
    after = everything(folder)
    touched = sorted(name for name in before.keys() | after.keys() if before.get(name, 0) != after.get(name, 0))
    return {
        "astray": [name for name in touched if name.split("/")[0] != "out"],
        "output": [name for name in touched if name.startswith("out/")],
    }


# ----------------------------------------------------------------------------------------------------- its parent


def complaints(result, most_seconds=SECONDS):
    """What is wrong with the way in which a case ended; nothing is right."""
    found = []
    code = result["code"]
    lines = [line for line in result["stderr"].splitlines() if not line.startswith(LIBTIFF)]
    if code not in (0, 2, 3):
        found.append(f"exit code {code}")
    if "Traceback" in result["stderr"]:
        found.append("a traceback")
    if code in (2, 3) and (len(lines) != 1 or not lines[0].startswith(PROGRAM)):
        found.append(f"{len(lines)} lines on stderr, wanted one of {PROGRAM}")
    if code == 0 and lines:
        found.append("words on stderr in spite of -q")
    if code == 2 and result["output"]:
        found.append(f"left behind: {', '.join(result['output'][:3])}")
    if result["astray"]:
        found.append(f"written or removed outside of the output: {', '.join(result['astray'][:3])}")
    if result["seconds"] > most_seconds:
        found.append(f"took {result['seconds']:.1f} s")
    return found


def run_cases(numbers, seed, sound, work, kinds=SHARES, tell=lambda result: None):
    """Run the cases `numbers` in forked children; answers the results in their order, each with its complaints."""
    numbers, results = list(numbers), []
    while numbers:
        done = _run_batch(numbers[:BATCH], seed, sound, work, kinds)
        for result in done:
            if str(result["code"]).startswith("hang"):  # once more: the machine may have stood still
                result = _run_batch([result["number"]], seed, sound, work, kinds)[0]
            result["complaints"] = complaints(result)
            results.append(result)
            tell(result)
        numbers = numbers[len(done) :]
    return results


def _run_batch(numbers, seed, sound, work, kinds):
    """Results of one child's cases, up to and with the one that ended it."""
    source, sink = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(source)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        try:
            _child(numbers, seed, kinds, sound, work, sink)
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    os.close(sink)
    try:
        results = _listened(child, source, seed, kinds)
    finally:
        os.close(source)
    if not results:
        raise RuntimeError(f"the fuzzer failed at case {numbers[0]}, before a command was called")
    return results


def _listened(child, source, seed, kinds):
    """Take in what the child tells until it ends; one that computes or waits for too long is ended."""
    results, text, begun, ended_for = [], b"", None, ""
    process = psutil.Process(child)
    while True:
        ready, _, _ = select.select([source], [], [], 0.5)
        more = os.read(source, 1 << 16) if ready else None
        if more == b"":
            break
        text += more or b""
        *lines, text = text.split(b"\n")
        for line in lines:
            told = json.loads(line)
            if "begin" in told:
                begun = (told, time.monotonic(), _computed(process))
            else:
                results.append(_result(told.pop("end"), seed, kinds, begun[0]["damage"], told))
                begun = None
        if begun is not None and not ended_for:
            computed, waited = _computed(process) - begun[2], time.monotonic() - begun[1]
            if computed > 1.5 * SECONDS or waited > WALL_SECONDS:
                ended_for = f"hang: {computed:.0f} s of computing in {waited:.0f} s"
                os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if begun is not None:
        code = ended_for or f"signal {os.waitstatus_to_exitcode(status)}"
        lost = {"code": code, "stderr": "", "astray": [], "output": [], "seconds": 0.0, "wall": 0.0}
        results.append(_result(begun[0]["begin"], seed, kinds, begun[0]["damage"], lost))
    return results


def _computed(process):
    try:
        used = process.cpu_times()
    except psutil.Error:
        return 0.0
    return used.user + used.system


def _result(number, seed, kinds, done, told):
    case, _ = case_of(number, seed, kinds)
    return {"number": number, "kind": case.kind, "file": case.file, "words": case.words, "damage": done, **told}


# ------------------------------------------------------------------------------------------- through the whole command


def whole_case_of(number, seed):
    """As `case_of`, of commands that run the whole program."""
    random = Random(f"{seed} whole {number}")
    kind = random.choices(list(SHARES), SHARES.values())[0]
    files, commands = WHOLE[kind]
    return Case(number, kind, random.choice(files), random.choice(commands)), random


def run_whole(number, seed, sound, work, baseline):
    """Run one case as a user does, in a separate process that may take `baseline` bytes and MEMORY; its result.

    Compiled kernels stay where they are, outside of the case's home, in which nothing may be written.
    """
    from mpmgis.compiled.jit import cache_folder

    case, random = whole_case_of(number, seed)
    folder = work / f"whole_{number}"
    done = prepared(case, random, sound, folder)
    before = everything(folder)
    began, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    limit = baseline + MEMORY
    homes = {"HOME": str(folder), "TMPDIR": str(folder), "MPMGIS_CACHE_DIR": str(cache_folder().parents[1])}
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "mpmgis", *case.words],
            cwd=folder,
            env=os.environ | homes,
            capture_output=True,
            timeout=3 * WALL_SECONDS,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        )
        code, text = ended.returncode, ended.stderr.decode(errors="replace")
    except subprocess.TimeoutExpired:
        code, text = "hang", ""
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    told = {"code": code, "stderr": text, "seconds": seconds, "wall": time.perf_counter() - began}
    result = {
        "number": number,
        "kind": case.kind,
        "file": case.file,
        "words": case.words,
        "damage": done,
        **told,
        **_left_behind(folder, before),
    }
    if "--resume" in case.words:  # the run that is continued is the output
        result["astray"] = [name for name in result["astray"] if not name.startswith("results")]
    result["complaints"] = complaints(result, MOST_WHOLE_SECONDS)
    shutil.rmtree(folder, ignore_errors=True)
    return result


# ------------------------------------------------------------------------------------------------- the command line


def main():
    """Run cases and tell what was found; exit code 1 if anything was."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--whole", type=int, default=200, help="so many more through the whole command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--case", type=int, help="only this one; its folder and all that it says are kept")
    parser.add_argument("--only", choices=SHARES, action="append")
    parser.add_argument("--log", type=Path, help="file for one line of JSON a finding")
    parser.add_argument("--all", action="store_true", help="log every case, not only findings")
    arguments = parser.parse_args()
    work = Path(tempfile.mkdtemp(prefix="fuzz_"))
    sound = work / "sound"
    _made_in_a_child(sound)
    kinds = {name: SHARES[name] for name in arguments.only or SHARES}
    if arguments.case is not None:
        return _show(arguments.case, arguments.seed, kinds, sound, work)
    print(f"seed {arguments.seed}, cases {arguments.first} to {arguments.first + arguments.cases - 1}", flush=True)
    counts, spent, findings = Counter(), Counter(), []

    def tell(result):
        counts[result["kind"], result["code"] if result["code"] in (0, 2, 3) else "other"] += 1
        spent[result["kind"]] += result["seconds"]
        if sum(counts.values()) % 1000 == 0:
            print(f"{sum(counts.values())} cases", flush=True)
        if result["complaints"]:
            findings.append(result)
            print(
                f"{result['number']}: {' '.join(result['words'])} [{result['damage']}]: {result['complaints']} "
                f"{result['stderr'][:300]!r}",
                flush=True,
            )
        if arguments.log and (result["complaints"] or arguments.all):
            with open(arguments.log, "a") as log:
                log.write(json.dumps(result) + "\n")

    began = time.monotonic()
    run_cases(range(arguments.first, arguments.first + arguments.cases), arguments.seed, sound, work, kinds, tell)
    middle = time.monotonic()
    baseline = _needed_whole(sound, work) if arguments.whole else 0
    for number in range(arguments.whole):
        tell(run_whole(number, arguments.seed, sound, work, baseline))
    for kind in kinds:
        codes = {code: n for (name, code), n in sorted(counts.items(), key=str) if name == kind}
        total = sum(codes.values())
        if total:
            print(f"{kind}: {total} cases, exit codes {codes}, {1e3 * spent[kind] / total:.0f} ms of computing each")
    print(f"{len(findings)} findings; {middle - began:.0f} s, whole commands {time.monotonic() - middle:.0f} s")
    shutil.rmtree(work)
    return 1 if findings else 0


def _made_in_a_child(sound):
    """Make the sound inputs in a child: compiled code that has run on threads does not survive a fork."""
    sound.mkdir(parents=True)
    child = os.fork()
    if child == 0:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        try:
            write_sound_inputs(sound)
        except BaseException as error:
            print(f"sound inputs: {error}", file=sys.stderr)
            os._exit(1)
        os._exit(0)
    if os.waitpid(child, 0)[1] != 0:
        raise RuntimeError("the sound inputs could not be made")
    import_what_commands_import()


def import_what_commands_import():
    """So that children have it; nothing compiled is run here."""
    import importlib

    for name in (
        "runout",
        "profile",
        "timeseries",
        "hydrograph",
        "vertical",
        "comparison",
        "exposure",
        "path",
        "hazard.intensity",
    ):
        importlib.import_module(f"mpmgis.results.{name}_answer")
    for name in ("maps.export.map_export", "seeding.seeded_file", "conversion.frame_conversion"):
        importlib.import_module(f"mpmgis.{name}")
    for name in ("seed", "convert", "run"):
        importlib.import_module(f"mpmgis.commands.{name}")
    for name in (
        "simulation.scene_run",
        "results.reports.file_facts",
        "frames.particle_files",
        "maps.qgis.qgis_files",
        "maps.qgis.outlines",
    ):
        importlib.import_module(f"mpmgis.{name}")
    for name in ("file_verbs", "simulation_verbs", "effects_text", "info_text", "answers"):
        importlib.import_module(f"mpmgis.commands.shell.{name}")


def _needed_whole(sound, work):
    """Address space [bytes] at most of a sound run in a separate process; what is resident is a sixth of it."""
    code = (
        "import re, sys; from mpmgis.commands.shell.main import main; code = main(sys.argv[1:])\n"
        "print(re.search(r'VmPeak:\\s+(\\d+)', open('/proc/self/status').read())[1]); sys.exit(code)"
    )
    words = ["run", str(sound / "plain.toml"), "-o", str(work / "sound_run"), "-q"]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    return 1024 * int(done.stdout.split()[-1])


def _show(number, seed, kinds, sound, work):
    """Run one case here, with all that it says."""
    case, random = case_of(number, seed, kinds)
    folder = work / "case"
    print(f"{folder}: {prepared(case, random, sound, folder)}")
    print("mpmgis", *case.words)
    os.chdir(folder)
    from mpmgis.commands.shell.main import main as command

    print("exit code", command([*case.words[:-1], "-v"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
