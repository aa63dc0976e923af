"""Run a scene many times with varied parameters (`mpmgis ensemble`); maps of probabilities and percentiles."""

import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .. import __version__
from ..frames.ensemble_folder import EnsembleFolder, member_files
from ..frames.headline_numbers import ERROR_TAG, error_words
from ..frames.member_stack import MemberStack
from ..laws.quantities import MEMBER_BANDS
from ..simulation.cost_prediction import duration_words
from ..simulation.memory_need import MEMORY_SHARE
from ..simulation.scene_run import ASK_SECONDS
from ..system import dask_workers, operating_system
from ..system.errors import InputError, MpmgisError, SceneError, UnphysicalError
from ..system.memory import available_memory
from ..system.messages import log
from ..system.whole_files import whole_folder
from ..system.worker_processes import Workers, started
from .ensemble_maps import EnsembleMaps, write_maps
from .ensemble_member import run_member, warm_worker, warmed
from .ensemble_plan import TIMES, PlannedRuns, read_plan

if TYPE_CHECKING:
    from .region_plan import PlannedRegion

LEFT_OUT = ("unphysical", "refused", "lost")  # statuses of members that the statistics omit


@dataclass(frozen=True)
class EnsembleRequest:
    """Request for an ensemble, with the options of `mpmgis ensemble`."""

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
    """Results of an ensemble.

    Parameters
    ----------
    folder : Path
    files : tuple of Path
        The QGIS project first.
    statuses : dict of str to int
        Number of members by status.
    before : int
        Number of members that were finished earlier.
    start_seconds, run_seconds, map_seconds : float [s]
        Wall time until the workers were ready, until all members were done, and of the statistics.
    member_seconds, processor_seconds : float [s]
        Sums of the wall and processor times of the members that were run.
    companion : dict or None
        Numerical errors of the first member.
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
    companion: dict | None = None


def ensemble(
    request: EnsembleRequest,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable = lambda *state: None,
) -> EnsembleFound:
    """Run the scene many times with different values, and write maps of all runs together.

    Finished members are not run again.

    Parameters
    ----------
    request : EnsembleRequest
    confirm : callable
        Question -> whether to start long runs.
    look : callable
        Called with (done, total, left out) a few times a second.

    Returns
    -------
    EnsembleFound

    Raises
    ------
    InputError, SceneError, OutputError
        Before the first run nothing is written; later, finished members are kept.
    UnphysicalError
        More members became unphysical than `tolerate` allows.
    """
    plan, products = read_plan(request)
    study = PlannedRuns.of(request, plan)
    output = Path(request.output or Path(request.scene).parent / "ensemble")
    folder = EnsembleFolder(output, study.digest, request.overwrite)
    if plan.remark():
        log.info(plan.remark())
    tasks = study.tasks(folder.members.resolve())
    records = {task.digest: task.record() for task in tasks}
    records = {digest: record for digest, record in records.items() if record is not None}
    to_run = list({task.digest: task for task in tasks if task.digest not in records}.values())
    workers = min(request.workers or operating_system.cores(), max(1, len(to_run)))
    if to_run:
        require_affordable(study, to_run, workers, confirm)
        dask_workers.require_scheduler(request.dask)
    before = sum(task.digest in records for task in tasks)
    if before:
        log.info(f"{before} of {len(tasks)} members are already finished")
    folder.refuse_inputs(study.input_files())
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
        moving = log_moving([records[task.digest] for task in tasks], "members")
        began = time.perf_counter()
        files = _write_maps(folder, study, products, tasks, records, workers)
        found = EnsembleFound(
            folder.path,
            (*files, table, folder.plan),
            statuses,
            before,
            *times,
            time.perf_counter() - began,
            *(sum(records[task.digest].get(name, 0.0) for task in to_run) for name in TIMES),
            study.companion(records),
        )
        folder.write_record(
            state="finished",
            plan=ensemble_tables,
            scene=study.tables,
            members=statuses,
            not_at_rest=len(moving),
            before=before,
            workers=workers,
            start_seconds=found.start_seconds,
            run_seconds=found.run_seconds,
            map_seconds=found.map_seconds,
            member_seconds=found.member_seconds,
            companion=found.companion,
        )
    return found


def require_affordable(
    study: "PlannedRuns | PlannedRegion", tasks: list, workers: int, confirm: Callable[[str], bool]
) -> None:
    """Log the predicted cost of runs; ask before runs of more than an hour or of most of the memory.

    Parameters
    ----------
    study : PlannedRuns or PlannedRegion
    tasks : list of MemberTask or AreaTask
    workers : int
    confirm : callable
        Question -> whether to start them.

    Raises
    ------
    SceneError
        The answer is no.
    """
    seconds, memory = study.cost(tasks)
    at_once = "" if study.request.dask else f" on {workers} worker{'s' if workers > 1 else ''}"
    seconds, memory = (seconds, 0.0) if study.request.dask else (seconds / workers, memory * workers)
    need = f"{duration_words(seconds)}{at_once}" + (f" and {memory / 1e9:.2g} GB" if memory else " in all")
    log.info(f"{len(tasks)} run{'s' if len(tasks) != 1 else ''}, predicted: {need}")
    if not seconds > ASK_SECONDS and memory < MEMORY_SHARE * available_memory():
        return
    if not confirm(f"these {len(tasks)} runs are predicted to take {need}"):
        raise SceneError(
            f"{len(tasks)} runs are predicted to take {need}; give `yes` to run them, or fewer `samples`, fewer "
            "`workers` or larger cells"
        )


def _run(
    request: EnsembleRequest, study: PlannedRuns, tasks: list, workers: int, records: dict, look: Callable
) -> tuple[float, float]:
    """Run `tasks` into `records`; return (seconds until the workers were ready, seconds of the runs)."""
    if not tasks:
        return 0.0, 0.0
    began = time.perf_counter()
    for task, prepared in study.groups.values():
        warmed(task, prepared)

    total = len(records) + len(tasks)

    def looked(*state):
        look(len(records), total, sum(record["status"] in LEFT_OUT for record in records.values()))

    with ExitStack() as stack:
        pool = pool_of(stack, request.dask, workers)
        if pool is not None:
            pool.warm(warm_worker, [task for task, _ in study.groups.values()])
        ready = time.perf_counter()
        for task, record in done_by(pool, tasks, looked):
            records[task.digest] = record or {"status": "lost", "reason": "its worker process died each time"}
            looked()
            if record is not None and record["status"] != "finished":
                log.info(f"member {task.number} is {record['status']}: {record['reason']}")
        return ready - began, time.perf_counter() - ready


def pool_of(stack: ExitStack, dask: str | None, workers: int) -> dask_workers.DaskWorkers | Workers | None:
    """Start workers that end with a stack of contexts.

    Parameters
    ----------
    stack : contextlib.ExitStack
    dask : str or None
        Address of the scheduler of a Dask cluster.
    workers : int
        Number of processes without a cluster.

    Returns
    -------
    DaskWorkers, Workers or None
        None: everything runs in this process.
    """
    if dask is not None:
        return dask_workers.DaskWorkers(stack.enter_context(dask_workers.dask_client(dask)))
    return stack.enter_context(started(workers)) if workers > 1 else None


def done_by(
    pool: dask_workers.DaskWorkers | Workers | None, tasks: list, look: Callable, work: Callable = run_member
) -> Iterator[tuple]:
    """Run tasks and yield each with its record when it is done.

    Parameters
    ----------
    pool : DaskWorkers, Workers or None
        None: they run in this process.
    tasks : list of MemberTask or AreaTask
    look : callable
        Called a few times a second.
    work : callable
        (task, look) -> record.

    Yields
    ------
    task : MemberTask or AreaTask
    record : dict or None
        None if the worker died each time.
    """
    if pool is None:
        yield from ((task, work(task, look)) for task in tasks)
        return

    def died(task, again):
        log.info(f"the worker of member {task.number} died; {'it is run again' if again else 'given up after 3 times'}")

    yield from pool.worked(work, tasks, look, died)


def log_moving(records: list, word: str) -> list:
    """Log how many finished runs of an ensemble or a region did not come to rest, and return their records.

    Parameters
    ----------
    records : list of dict
        Of all runs.
    word : str
        What a run is: "members" or "areas".
    """
    finished = [record for record in records if record["status"] == "finished"]
    moving = [record for record in finished if not record["came_to_rest"]]
    if moving:
        log.info(
            f"{len(moving)} of {len(finished)} {word} did not come to rest (`came_to_rest` in the table): their "
            "runout can grow, and their last step is no deposit; use a later [output] end_time"
        )
    return moving


def _require_enough(statuses: dict, records: dict, total: int, tolerate: float, table: Path) -> None:
    """Log the members that the statistics omit; raise UnphysicalError or InputError if there are too many."""
    left = {status: count for status, count in statuses.items() if status in LEFT_OUT}
    if not left:
        return
    words = ", ".join(f"{count} {status}" for status, count in left.items())
    first = next(record["reason"] for record in records.values() if record["status"] in LEFT_OUT)
    count = sum(left.values())
    if count > tolerate * total or count == total:
        kind = UnphysicalError if set(left) == {"unphysical"} else InputError
        raise kind(
            f"{count} of {total} members gave no result ({words}; first: {first}), more than `tolerate={tolerate:g}` "
            f"allows; see {table}"
        )
    log.info(f"the statistics omit {count} of {total} members ({words}); first: {first}")


def _write_maps(folder, study, products, tasks, records, workers):
    """Write the maps of all finished members; return the paths, the project first."""
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
        "version": __version__,
        "digest": folder.digest,
        "members": len(finished),
        "left_out": len(tasks) - len(finished),
        "not_at_rest": sum(not records[task.digest]["came_to_rest"] for task in finished),
        "sampling": study.plan.sampling,
        "seed": study.plan.seed,
        "cs_e": study.grid.cell_size,
        "min_depth": request.min_depth,
        "dem": Path(prepared.terrain.path).name,
        "varied": json.dumps(study.plan.as_tables()["vary"]),
    }
    errors = error_words(study.companion(records))
    tags |= {ERROR_TAG: errors} if errors else {}
    name = folder.path.resolve().name
    with whole_folder(folder.maps, overwrite=True) as part:
        maps = EnsembleMaps(part, name, study.grid, extent, request.min_depth, products.rasters())
        write_maps(maps, stack, prepared.terrain, tags, _release(study), f"{name}: {len(finished)} runs")
        files = sorted(path.relative_to(part) for path in part.rglob("*") if path.is_file() and path.name[0] != ".")
    return [folder.maps / file for file in sorted(files, key=lambda file: (file.suffix != ".qgz", file))]


def _release(study):
    """Return the polygons of the scene's release; [] if it has no outline."""
    from ..seeding.release_areas import read_outlines  # imports GDAL's vector library

    _, prepared = study.first
    release = prepared.scene.release
    if release is None or release.source is None:
        return []
    try:
        return read_outlines(prepared.scene.path(release.source), prepared.terrain)
    except MpmgisError:
        return []
