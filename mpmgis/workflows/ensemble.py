"""`mpmgis ensemble`: a scene and what varies in it in, maps of probabilities and percentiles out."""

import hashlib
import json
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from .. import __version__, system
from ..errors import InputError, MpmgisError, SceneError, UnphysicalError
from ..experiments.numerical_parameters import COST_POWER
from ..experiments.sampling_plan import Plan, variation, with_values
from ..experiments.statistics import MEMBER_BANDS, Products, exceedances
from ..io.atomic import whole_folder
from ..io.ensemble_folder import EnsembleFolder, MemberStack, member_files, read_member
from ..kernels.code_cache import source_digest
from ..kernels.jit import set_threads
from ..machine import available_memory
from ..messages import log
from ..reports.ensemble_maps import EnsembleMaps, write_maps
from ..scene.reading import read_toml
from ..scene.table_values import meant
from ..solvers.cost import MEMORY_SHARE
from . import parallel
from .ensemble_member import FIGURES, MemberTask, run_member, warm_worker, warmed
from .run import ASK_SECONDS
from .run_setup.cost_prediction import duration, foreseen
from .run_setup.prepare import scene_to_prepare
from .run_setup.scene_files import input_files
from .workers import started

PLAN_KEYS = ("sampling", "samples", "seed", "vary", "exceed", "percentiles")
LEFT_OUT = ("unphysical", "refused", "lost")
TIMES = ("wall_seconds", "processor_seconds")
TABLE_HEAD, TABLE_TAIL = ("number",), ("digest", "status", *TIMES, *FIGURES, "reason")
DIGEST_LENGTH = 16


@dataclass(frozen=True)
class EnsembleRequest:
    """What was asked for: the command's options by name. Its help tells more."""

    scene: Path
    output: Path | None = None
    overwrite: bool = False
    vary: tuple = ()  # of texts KEY=VALUES, or a dict
    plan: Path | None = None
    sampling: str | None = None
    samples: int | None = None
    seed: int | None = None
    exceed: tuple | dict | None = None  # of texts QUANTITY=NUMBERS, or a dict
    percentiles: tuple | None = None
    cell_size: float | None = None  # [m]
    min_depth: float = 0.05  # [m]
    keep: str = "maxima"
    workers: int | None = None
    dask: str | None = None
    tolerate: float = 0.1
    law: Path | None = None


@dataclass(frozen=True)
class EnsembleFound:
    """What came of it.

    Parameters
    ----------
    folder : Path
    files : tuple of Path
        The QGIS project first.
    statuses : dict of str to int
        Members by what they came to.
    before : int
        Of them those that were done before this start.
    start_seconds, run_seconds, map_seconds : float [s]
        Wall time until the workers were ready, until all members were done, and of the statistics.
    member_seconds, processor_seconds : float [s]
        Sums of the wall and processor times of the members that were run.
    """

    folder: Path
    files: tuple
    statuses: dict
    before: int
    start_seconds: float
    run_seconds: float
    map_seconds: float
    member_seconds: float
    processor_seconds: float


def ensemble(request, *, confirm=lambda question: True, look=lambda *state: None):
    """Run the scene many times with other values, and write maps of what the runs say together.

    Members that are done are not run again. `look(done, total, left_out)` is called a few times a second.

    Returns
    -------
    EnsembleFound

    Raises
    ------
    InputError, SceneError, OutputError
        Before the first run; nothing is left behind. Later: what is done is kept.
    UnphysicalError
        More members became unphysical than --tolerate allows.
    """
    plan, products = read_plan(request)
    study = _Study.of(request, plan)
    output = Path(request.output or Path(request.scene).parent / "ensemble")
    folder = EnsembleFolder(output, study.digest, request.overwrite)
    if plan.remark():
        log.info(plan.remark())
    tasks = study.tasks(folder.members.resolve())
    records = {task.digest: read_member(task.output, task.digest, task.frames) for task in tasks}
    records = {digest: record for digest, record in records.items() if record is not None}
    to_run = list({task.digest: task for task in tasks if task.digest not in records}.values())
    workers = min(request.workers or system.cores(), max(1, len(to_run)))
    if to_run:
        _require_affordable(study, to_run, workers, confirm)
    before = sum(task.digest in records for task in tasks)
    if before:
        log.info(f"{before} of {len(tasks)} members are done already")
    folder.spare(study.input_files())
    with folder.held():
        ensemble_tables = plan.as_tables() | products.as_tables()
        folder.write_plan(ensemble_tables, f"the plan of {Path(request.scene).name}, for mpmgis ensemble --plan")
        folder.write_record(state="running", plan=ensemble_tables, scene=study.tables)
        if request.overwrite:
            folder.keep_members(task.digest for task in tasks)
        try:
            times = _run(request, study, to_run, workers, records, look)
        finally:
            table = folder.write_table(*study.table(records))
        statuses = dict(Counter(records[task.digest]["status"] for task in tasks))
        _require_enough(statuses, records, len(tasks), request.tolerate, table)
        began = time.perf_counter()
        files = _write_maps(folder, study, products, tasks, records, workers)
        found = EnsembleFound(
            folder.path, (*files, table, folder.plan), statuses, before, *times, time.perf_counter() - began,
            *(sum(records[task.digest].get(name, 0.0) for task in to_run) for name in TIMES),
        )  # fmt: skip
        folder.write_record(
            state="finished", plan=ensemble_tables, scene=study.tables, members=statuses, before=before,
            workers=workers, start_seconds=found.start_seconds, run_seconds=found.run_seconds,
            map_seconds=found.map_seconds, member_seconds=found.member_seconds,
        )  # fmt: skip
    return found


def read_plan(request):
    """(Plan, Products) of what the plan's file says and, over it, the request.

    Raises
    ------
    InputError
    """
    told = {} if request.plan is None else _plan_file(request.plan)
    varied = {key: variation(asked, f"{request.plan} [vary] {key}") for key, asked in told.get("vary", {}).items()}
    given = {}
    for key, asked in _asked(request.vary):
        if key in given:
            raise InputError(f"--vary {key} is there twice; give it once")
        given[key] = variation(asked, f"--vary {key}")
    exceed, percentiles = request.exceed, request.percentiles
    exceed = exceedances(exceed) if isinstance(exceed, (tuple, list)) else exceed
    return (
        Plan.of(
            varied | given,
            request.sampling or told.get("sampling"),
            request.samples or told.get("samples"),
            told.get("seed", 0) if request.seed is None else request.seed,
        ),
        Products.of(
            told.get("exceed") if exceed is None else exceed,
            told.get("percentiles") if percentiles is None else percentiles,
        ),
    )


def _asked(vary):
    """(key, what it may be) of texts KEY=VALUES or of a dictionary."""
    if isinstance(vary, dict):
        yield from vary.items()
        return
    for text in vary:
        key, equals, values = text.partition("=")
        if not (equals and key.strip()):
            raise InputError(f"--vary {text}: wanted KEY=VALUES, for example friction.mu=0.1:0.3")
        yield key.strip(), values


def _plan_file(path):
    """The tables of a plan's file, of which every key is known and every value of its kind."""
    tables = read_toml(path)
    for name in tables:
        if name not in PLAN_KEYS:
            raise InputError(f"{path}: unknown key {name!r}{meant(name, PLAN_KEYS)}; it takes {', '.join(PLAN_KEYS)}")
    for name, kind, words in (
        ("sampling", str, "text"), ("samples", int, "a whole number above 0"), ("seed", int, "a whole number from 0"),
        ("vary", dict, "a table of keys"), ("exceed", dict, "a table like {h = [0.5, 1]}"),
        ("percentiles", list, "a list of numbers"),
    ):  # fmt: skip
        value = tables.get(name, kind())
        wrong = not isinstance(value, kind) or isinstance(value, bool) or (kind is int and value < (name == "samples"))
        if name in tables and wrong:
            raise InputError(f"{path}: {name} = {value!r}, wanted {words}")
    if "exceed" in tables:
        tables["exceed"] = {name: of if isinstance(of, list) else [of] for name, of in tables["exceed"].items()}
    return tables | {"vary": dict(_flat(tables.get("vary", {})))}


def _flat(table, before=""):
    """(key, value) of a table in which keys may be written with dots or as tables of their own."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


@dataclass(frozen=True)
class _Study:
    """A scene with its members, checked, and what is known of each group of members that read the same files.

    Parameters
    ----------
    request : EnsembleRequest
    scene : Scene
    tables : dict
        Of the scene, with peaks of every step where its solver can keep them.
    plan : Plan
    members : list of studies.plan.Member
    groups : dict
        Varied texts (names of files and laws) -> (MemberTask of the scene with them, Prepared).
    """

    request: EnsembleRequest
    scene: object
    tables: dict
    plan: Plan
    members: list
    groups: dict

    @classmethod
    def of(cls, request, plan):
        """Check all members, and prepare one run of each group."""
        scene = scene_to_prepare(request.scene, request.law)
        name, tables = Path(request.scene).name, _with_peaks(scene, request.min_depth)
        members = plan.members(tables, scene.folder, name, scene.own_laws)
        study = cls(request, scene, tables, plan, members, {})
        for member in members:
            texts = study._texts(member)
            if texts not in study.groups:
                task = study._task(0, "", with_values(tables, dict(texts)), name, "")
                try:
                    study.groups[texts] = task, task.prepared()
                except SceneError:
                    raise
                except MpmgisError as error:
                    raise type(error)(f"{name}: {error}") from error
        study._require_one_grid()
        return study

    def _texts(self, member):
        """(key, text) of what varies in words: only such values can change which files are read."""
        values = zip(self.plan.varied, member.values, strict=True)
        return tuple((key, value) for key, value in values if isinstance(value, str))

    def _require_one_grid(self):
        if "terrain.window" in self.plan.varied:
            raise SceneError(
                "--vary terrain.window: runs on other pieces of the DTM have no cells in common; set it once"
            )
        grids = {(p.terrain.grid.transform, p.terrain.grid.shape) for _, p in self.groups.values()}
        if len(grids) > 1:
            raise SceneError("--vary terrain: the DTMs have different pixels; bring them onto one grid to compare runs")

    def _task(self, number, digest, tables, name, output):
        folder, request = Path(self.scene.folder).resolve(), self.request
        law = None if request.law is None else str(Path(request.law).resolve())
        return MemberTask(
            number, digest, tables, str(folder), name, law, str(output), request.cell_size, request.min_depth,
            request.keep == "frames",
        )  # fmt: skip

    def input_files(self):
        """Yield the path of every file that a member reads."""
        for _, prepared in self.groups.values():
            yield from input_files(self.request.scene, prepared.scene, self.request.law)

    @property
    def first(self):
        """(MemberTask, Prepared) that stand for all: the terrain and the grid are the same for every member."""
        return next(iter(self.groups.values()))

    @property
    def grid(self):
        """Grid of all rasters."""
        task, prepared = self.first
        return task.averaging(prepared).grid

    @cached_property
    def digests(self):
        """Digest of each member: its scene, what its files hold, the raster asked for, this program and its physics."""
        request = self.request
        known = [__version__, source_digest(), request.cell_size, request.min_depth]
        inputs = {texts: prepared.digest for texts, (_, prepared) in self.groups.items()}
        return [_digest([member.tables, inputs[self._texts(member)], *known]) for member in self.members]

    @property
    def digest(self):
        """Digest of all members in their order."""
        return _digest(self.digests)

    def tasks(self, output):
        """List of MemberTask; members that are the same in everything share a digest and one run."""
        name = Path(self.request.scene).name
        return [
            self._task(member.number, digest, member.tables, f"{name}, member {member.number}", output)
            for member, digest in zip(self.members, self.digests, strict=True)
        ]

    def cost(self, tasks):
        """(seconds, bytes) that `tasks` are foreseen to need one after the other, and one of them."""
        _, prepared = self.first
        set_threads(1)  # as a worker has
        ahead = foreseen(prepared, 1)
        set_threads(None)
        return ahead.seconds * sum(self._factor(task) for task in tasks), ahead.memory

    def _factor(self, task):
        """How much more steps and particles a member has than the scene, as far as numbers of [numerics] tell."""
        own, base = task.tables.get("numerics", {}), self.tables.get("numerics", {})
        output = task.tables["output"]["end_time"] / self.tables["output"]["end_time"]
        ratio = {key: own.get(key) / base.get(key) for key in base if isinstance(own.get(key), (int, float))
                 and not isinstance(own.get(key), bool) and base.get(key)}  # fmt: skip
        more = ratio.get("particles_per_cell", 1.0) * ratio.get("points_per_cell", 1.0) / ratio.get("cfl", 1.0)
        return output * more * ratio.get("cell_size", 1.0) ** -COST_POWER[self.scene.solver]

    def table(self, records):
        """(names, rows) of `members.csv`; members that are not done have no figures."""
        rows = []
        for member, digest in zip(self.members, self.digests, strict=True):
            record = records.get(digest, {"status": "open"}) | {"digest": digest}
            told = [record.get(name) for name in TABLE_TAIL]
            values = [str(value).lower() if isinstance(value, bool) else value for value in member.values]
            rows.append([member.number, *values, *(float("nan") if value is None else value for value in told)])
        return (*TABLE_HEAD, *self.plan.varied, *TABLE_TAIL), rows


def _with_peaks(scene, min_depth):
    """The scene's tables, in which solvers keep the peaks of every step."""
    tables = scene.as_tables()
    tables["output"] = {"arrival_thickness": min_depth} | tables["output"] | {"maxima": True}
    return tables


def _digest(what):
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:DIGEST_LENGTH]


def _require_affordable(study, tasks, workers, confirm):
    """Tell what the runs are foreseen to take; ask `confirm(question)` over an hour or most of the memory."""
    seconds, memory = study.cost(tasks)
    at_once = "" if study.request.dask else f" on {workers} worker{'s' if workers > 1 else ''}"
    seconds, memory = (seconds, 0.0) if study.request.dask else (seconds / workers, memory * workers)
    need = f"{duration(seconds)}{at_once}" + (f" and {memory / 1e9:.2g} GB" if memory else " in all")
    log.info(f"{len(tasks)} runs, predicted: {need}")
    if seconds < ASK_SECONDS and memory < MEMORY_SHARE * available_memory():
        return
    if not confirm(f"these {len(tasks)} runs are predicted to take {need}"):
        raise SceneError(
            f"{len(tasks)} runs are predicted to take {need}; give --yes to run them, or fewer --samples, fewer "
            "--workers or larger cells"
        )


def _run(request, study, tasks, workers, records, look):
    """Run `tasks` into `records`; (seconds until the workers were ready, seconds of the runs)."""
    if not tasks:
        return 0.0, 0.0
    began = time.perf_counter()
    for task, prepared in study.groups.values():
        warmed(task, prepared)

    total = len(records) + len(tasks)

    def looked(*state):
        look(len(records), total, sum(record["status"] in LEFT_OUT for record in records.values()))

    with ExitStack() as stack:
        pool = _pool(stack, request.dask, workers)
        if pool is not None:
            pool.warm(warm_worker, [task for task, _ in study.groups.values()])
        ready = time.perf_counter()
        for task, record in _done(pool, tasks, looked):
            records[task.digest] = record or {"status": "lost", "reason": "its worker died each time"}
            looked()
            if record is not None and record["status"] != "finished":
                log.info(f"member {task.number} is {record['status']}: {record['reason']}")
        return ready - began, time.perf_counter() - ready


def _pool(stack, dask, workers):
    """Who runs members, until the ExitStack `stack` ends: a Dask cluster, processes, or None for this process alone."""
    if dask is not None:
        return parallel.DaskWorkers(stack.enter_context(parallel.connected(dask)))
    return stack.enter_context(started(workers)) if workers > 1 else None


def _done(pool, tasks, look):
    """Yield (task, record) as they are done: by the workers of `pool`, or without one in this process."""
    if pool is None:
        yield from ((task, run_member(task, look)) for task in tasks)
        return

    def died(task, again):
        log.info(f"the worker of member {task.number} died; {'it is run again' if again else 'given up after 3 times'}")

    yield from pool.worked(run_member, tasks, look, died)


def _require_enough(statuses, records, total, tolerate, table):
    """Say which members the statistics go without; refuse where they are too many."""
    left = {status: count for status, count in statuses.items() if status in LEFT_OUT}
    if not left:
        return
    words = ", ".join(f"{count} {status}" for status, count in left.items())
    first = next(record["reason"] for record in records.values() if record["status"] in LEFT_OUT)
    count = sum(left.values())
    if count > tolerate * total or count == total:
        kind = UnphysicalError if set(left) == {"unphysical"} else InputError
        raise kind(
            f"{count} of {total} members gave no result ({words}; first: {first}), more than --tolerate {tolerate:g} "
            f"allows; see {table}"
        )
    log.info(f"the statistics go without {count} of {total} members ({words}); first: {first}")


def _write_maps(folder, study, products, tasks, records, workers):
    """The products of all members that finished; paths, the project first."""
    finished = [task for task in tasks if records[task.digest]["status"] == "finished"]
    extents = [records[task.digest]["extent"] for task in finished]
    extents = [extent for extent in extents if extent is not None]
    extent = None
    if extents:
        top, bottom, left, right = zip(*extents, strict=True)
        extent = min(top), max(bottom), min(left), max(right)
    request, (_, prepared) = study.request, study.first
    paths = [member_files(task.output, task.digest)[1] for task in finished]
    stack = MemberStack(paths, study.grid, extent, MEMBER_BANDS, workers)
    tags = {
        "version": __version__, "digest": folder.digest, "members": len(finished),
        "left_out": len(tasks) - len(finished),
        "sampling": study.plan.sampling, "seed": study.plan.seed, "cs_e": study.grid.cell_size,
        "min_depth": request.min_depth, "dem": Path(prepared.terrain.path).name,
        "varied": json.dumps(study.plan.as_tables()["vary"]),
    }  # fmt: skip
    name = folder.path.resolve().name
    with whole_folder(folder.maps, overwrite=True) as part:
        maps = EnsembleMaps(part, name, study.grid, extent, request.min_depth, products.rasters())
        write_maps(maps, stack, prepared.terrain, tags, _release(study), f"{name}: {len(finished)} runs")
        files = sorted(path.relative_to(part) for path in part.rglob("*") if path.is_file() and path.name[0] != ".")
    return [folder.maps / file for file in sorted(files, key=lambda file: (file.suffix != ".qgz", file))]


def _release(study):
    """Polygons of the scene's release; none where it has no outline of its own."""
    from ..io.release_areas import read_outlines  # brings GDAL's vector files

    _, prepared = study.first
    release = prepared.scene.release
    if release is None or release.source is None:
        return []
    try:
        return read_outlines(prepared.scene.path(release.source), prepared.terrain)
    except MpmgisError:
        return []
