"""Commands of mpmgis that are killed at random moments, and checks of their files.

Children are forked from a process that has run each command once, so that a kill costs a quarter of a second and not
ten. Run it with NUMBA_THREADING_LAYER=workqueue: the threads of OpenMP do not survive a fork. Half of the kills come
after a random share of the time that the command takes, the others instead of a random one of its openings, renamings
and removals of files: the moments where something could be half done.
"""

import contextlib
import io
import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from random import Random

import h5py
import pyogrio
import rasterio

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_digest import AS_WRITTEN, check_content

EVENTS = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate")
VERBS = {
    "columns": "run columns.toml -o {to}",
    "points": "run points.toml -o {to}",
    "seed_h5": "seed --dem dtm.tif --release release.geojson --thickness 1 -o {to}/a.h5 --overwrite",
    "seed_csv": "seed --dem dtm.tif --release release.geojson --thickness 1 -o {to}/a.csv --overwrite",
    "seed_gpkg": "seed --dem dtm.tif --release release.geojson --thickness 1 -o {to}/a.gpkg --overwrite",
    "seed_parquet": "seed --dem dtm.tif --release release.geojson --thickness 1 -o {to}/a.parquet --overwrite",
    "convert": "convert columns/frame_000002.h5 --to points --cell 10 -o {to}/points.h5 --overwrite",
    "export": "export-raster columns -o {to}/gis --overwrite",
}
RUNS = ("columns", "points")


def forked(words, folder, kill=None):
    """(exit code or minus the signal, seconds) of `mpmgis words` in a child that works in `folder`.

    `kill` is how it ends: ("after", seconds), or ("event", number) instead of that opening, renaming or removal;
    ("count", path) lets it live and writes to `path` how many of these there were.
    """
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        if kill is not None:
            os.dup2(nothing, 2)
        seen = _watched(folder, kill[1] if kill is not None and kill[0] == "event" else None)
        try:
            code = main([*words, "-q"])
            if kill is not None and kill[0] == "count":
                Path(kill[1]).write_text(str(seen[0]))
            os._exit(code)
        finally:
            os._exit(99)
    if kill is not None and kill[0] == "after":
        time.sleep(kill[1])
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), time.monotonic() - began


def _watched(folder, deadly):
    """[number] of what this process will have done to files below `folder`; the one numbered `deadly` ends it."""
    seen = [0]

    def hook(event, arguments):
        if event not in EVENTS or not arguments or not isinstance(arguments[0], (str, bytes, Path)):
            return
        if event == "open" and not str(arguments[1] or "r").strip("rbt"):
            return
        if os.path.abspath(os.fsdecode(arguments[0])).startswith(str(folder)):
            if seen[0] == deadly:
                os.kill(os.getpid(), signal.SIGKILL)
            seen[0] += 1

    sys.addaudithook(hook)
    return seen


def require_whole(folder):
    """AssertionError where a file in `folder` that has its final name is not whole."""
    for path in folder.rglob("*"):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if path.is_dir() or hidden:
            continue
        if path.suffix == ".h5":
            assert check_content(path) == AS_WRITTEN, path
        elif path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix in (".tif", ".vrt"):
            with rasterio.open(path) as raster:
                raster.read()
        elif path.suffix == ".gpkg":
            pyogrio.list_layers(path)
        elif path.suffix == ".csv":
            assert path.read_text().endswith("\n"), path


def arrays(folder):
    """(file, name) -> bytes of every array of every frame and band below `folder`; of other tables their bytes."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".h5":
            with h5py.File(path) as file:
                found[name, "time"] = (file.attrs["time"], file.attrs["step"], file.attrs.get("result_sha256"))
                for group in ("particles", "maxima"):
                    for key, values in file.get(group, {}).items():
                        found[name, key] = values[()].tobytes()
        elif path.suffix == ".tif":
            with rasterio.open(path) as raster:
                found[name] = raster.read().tobytes()
        elif path.suffix == ".gpkg":
            layers = [layer for layer, _ in pyogrio.list_layers(path) if layer != "layer_styles"]  # which tell the hour
            found[name] = [pyogrio.read_dataframe(path, layer=layer).to_csv() for layer in layers]
        elif path.suffix in (".csv", ".parquet"):
            found[name] = path.read_bytes()
        elif path.is_file() and not name.endswith(".aux.xml"):  # GDAL's own, of looking at a GeoPackage
            found[name] = None  # may tell the hour
    return found


def kill_one(verb, number, seed, site, whole, cost):
    """Kill the command `verb` once, at a moment that follows from number and seed; look; finish; compare.

    `whole` is arrays() of one that was never killed, `cost` its (seconds, events). Answers a line about what happened;
    raises AssertionError, with that line, where something is lost.
    """
    random = Random(f"{seed} {verb} {number}")
    seconds, events = cost
    kill = random.choice([("after", random.uniform(0.0, 1.05 * seconds)), ("event", random.randrange(events))])
    to = site / f"{verb}_{number}"
    words = VERBS[verb].replace("{to}", to.name).split()
    old = verb not in RUNS and random.random() < 0.5
    if old:
        shutil.copytree(site / f"{verb}_whole", to)
    code, _ = forked(words, site, kill)
    told = f"{verb} {number} (seed {seed}): killed {kill[0]} {kill[1]:.3g}, ended with {code}"
    try:
        assert code in (0, -signal.SIGKILL)
        if to.exists():
            require_whole(to)
        if old:
            assert _is_there(to, verb), "the old result is gone"
        again = [*words, "--resume"] if verb in RUNS else words
        assert forked(again, site)[0] == 0, "it cannot be done again"
        assert arrays(to) == whole, "it does not come out the same"
        left = [path.name for path in to.rglob(".*") if path.name != ".mpmgis"]
        assert not left, f"left over: {left}"
    except Exception as error:
        raise AssertionError(f"{told}: {error}") from error
    shutil.rmtree(to)
    return told


def _is_there(to, verb):
    """Whether a result lies under its name, or beside it where the next command puts it back from."""
    if verb != "export":
        return any(to.glob("*.*"))
    return (to / "gis").is_dir() or any(to.glob(".gis.old*"))


def run_here(words, folder):
    """Run `mpmgis words` in this process: children that are forked later have what it imported and compiled."""
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        code = main([*words, "-q"])
    if code != 0:
        raise RuntimeError(f"{' '.join(words)} ended with {code}")


def prepare(site, verbs):
    """Whole results and costs: (whole, cost) by verb."""
    result = {}
    for verb in verbs:
        to = "columns" if verb == "columns" else f"{verb}_whole"
        words, count = VERBS[verb].split(), site / "events"
        run_here([word.replace("{to}", to) for word in words], site)
        _, seconds = forked([word.replace("{to}", "counted") for word in words], site, ("count", count))
        shutil.rmtree(site / "counted")
        result[verb] = arrays(site / to), (seconds, int(count.read_text()))
    return result


def run_kills(site, count, seed):
    """Kill `count` commands, in turn; a line for each on stdout."""
    verbs = list(VERBS)[: max(count, 2)]
    prepared = prepare(site, verbs)
    print({verb: cost for verb, (_, cost) in prepared.items()}, flush=True)
    failures = 0
    for number in range(count):
        verb = verbs[number % len(verbs)]
        try:
            print(kill_one(verb, number, seed, site, *prepared[verb]), flush=True)
        except AssertionError as error:
            failures += 1
            print("FAILED", " ".join(str(error).split())[:600], flush=True)
    print(f"{count} kills, {failures} failures", flush=True)
    return failures


if __name__ == "__main__":
    sys.exit(1 if run_kills(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])) else 0)
