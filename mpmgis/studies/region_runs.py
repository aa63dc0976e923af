"""Run every release area of a region in its own window of one large DTM (`mpmgis region`); maps of all together."""

import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from .. import __version__
from ..frames.ensemble_folder import member_files, read_member
from ..frames.headline_numbers import ERROR_TAG, error_words
from ..frames.region_folder import RegionFolder
from ..frames.region_maps import AreaRaster, write_region_maps
from ..maps.qgis.region_footprints import write_footprints
from ..maps.qgis.region_project import RegionProject, terrain_path, write_region_project
from ..system import operating_system
from ..system.dask_workers import require_scheduler
from ..system.errors import InputError
from ..system.messages import log
from ..system.whole_files import whole_folder
from .area_run import run_area
from .ensemble_member import warm_worker, warmed
from .ensemble_runs import done_by, log_moving, pool_of, require_affordable
from .region_areas import write_areas
from .region_plan import PlannedRegion

FIGURES = (
    "area_m2",
    "h_max_m",
    "Ut_max_m_s",
    "p_max_Pa",
    "runout_m",
    "travel_angle_degrees",
    "mass_out_share",
    "came_to_rest",
    "end_time_s",
    "runs",
    "edge_reached",
)
TIMES = ("window_seconds", "prepare_seconds", "wall_seconds")


@dataclass(frozen=True)
class RegionRequest:
    """Request for a region, with the options of `mpmgis region`."""

    scene: Path
    releases: Path | None = None
    output: Path | None = None
    overwrite: bool = False
    scenario: str | None = None
    frequency: str | None = None
    angle: float | None = None  # [degrees]
    min_depth: float = 0.05  # [m]
    workers: int | None = None
    dask: str | None = None
    law: Path | None = None


@dataclass(frozen=True)
class RegionFound:
    """Results of a region.

    Parameters
    ----------
    folder : Path
    files : tuple of Path
        The table of areas first, then the maps.
    statuses : dict of str to int
        Number of areas by status.
    before : int
        Number of areas that were finished earlier.
    repeated : int
        Number of areas whose flow reached the edge of a window, so that they were run again in a larger one.
    plan_seconds, start_seconds, run_seconds, map_seconds : float [s]
        Wall time of the plan with the prediction, until the workers were ready, of the runs, of the maps.
    window_seconds, prepare_seconds, member_seconds : float [s]
        Sums over the areas that were run: choice of the window, seeding, and all together.
    companion : dict or None
        Numerical errors of the first area.
    """

    folder: Path
    files: tuple
    statuses: dict
    before: int
    repeated: int
    plan_seconds: float
    start_seconds: float
    run_seconds: float
    map_seconds: float
    window_seconds: float
    prepare_seconds: float
    member_seconds: float
    companion: dict | None = None


def region(
    request: RegionRequest,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable = lambda *state: None,
) -> RegionFound:
    """Run every release area in its own window of the DTM, and write maps of all areas together.

    Finished areas are not run again.

    Parameters
    ----------
    request : RegionRequest
    confirm : callable
        Question -> whether to start long runs.
    look : callable
        Called with (done, total, left out) a few times a second.

    Returns
    -------
    RegionFound

    Raises
    ------
    InputError, SceneError, OutputError
        Before the first run nothing is written; later, finished areas are kept.
    """
    began = time.perf_counter()
    output = Path(request.output or Path(request.scene).parent / "region")
    plan = PlannedRegion.of(request, output)
    folder = RegionFolder(output, plan.digest, request.overwrite)
    folder.refuse_inputs(plan.input_files())
    records = {task.digest: read_member(task.run.output, task.digest) for task in plan.tasks}
    records = {digest: record for digest, record in records.items() if record is not None}
    before = sum(task.digest in records for task in plan.tasks)
    to_run = list({task.digest: task for task in plan.tasks if task.digest not in records}.values())
    workers = min(request.workers or operating_system.cores(), max(1, len(to_run)))
    if before:
        log.info(f"{before} of {len(plan.tasks)} areas are already finished")
    if to_run:
        plan.prepare_samples(to_run)
        require_affordable(plan, to_run, workers, confirm)
        require_scheduler(request.dask)
    planned = time.perf_counter() - began
    with folder.held():
        folder.write_record(state="running", areas=len(plan.tasks))
        started, ran = _run(plan, to_run, workers, records, look)
        began = time.perf_counter()
        statuses = _report(plan, records)
        files = _write(folder, plan, records)
        sums = [sum(records[task.digest].get(name, 0.0) for task in to_run) for name in TIMES]
        repeated = sum(records[task.digest].get("runs", 1) > 1 for task in plan.tasks)
        mapped = time.perf_counter() - began
        errors = _companion(plan, records)
        folder.write_record(
            state="finished", areas=len(plan.tasks), statuses=statuses, repeated=repeated, companion=errors
        )
    times = (planned, started, ran, mapped, *sums)
    return RegionFound(folder.path, tuple(files), statuses, before, repeated, *times, errors)


def _run(plan: PlannedRegion, tasks: list, workers: int, records: dict, look: Callable) -> tuple[float, float]:
    """Run `tasks` into `records`; return (seconds until the workers were ready, seconds of the runs)."""
    if not tasks:
        return 0.0, 0.0
    began, total = time.perf_counter(), len(records) + len(tasks)

    def looked(*state):
        look(len(records), total, sum(record["status"] != "finished" for record in records.values()))

    with ExitStack() as stack:
        pool = pool_of(stack, plan.request.dask, workers)
        if plan.samples:
            warmed(*plan.samples[0])
            if pool is not None:
                pool.warm(warm_worker, [plan.samples[0][0]])
        ready = time.perf_counter()
        for task, record in done_by(pool, tasks, looked, run_area):
            records[task.digest] = record or {"status": "lost", "reason": "its worker process died each time"}
            looked()
        return ready - began, time.perf_counter() - ready


def _report(plan, records):
    """Log repeated, cut and failed areas, return the number of areas by status; raise InputError for no result."""
    repeated = sum(records[task.digest].get("runs", 1) > 1 for task in plan.tasks)
    if repeated:
        log.info(f"{repeated} areas reached the edge of their first window and were run again in a larger one")
    for task in plan.tasks:
        record = records[task.digest]
        if record["status"] != "finished":
            log.info(f"area {task.number} is {record['status']}, the maps omit it: {record['reason']}")
        elif record["edge_reached"]:
            log.info(f"area {task.number} still reaches the edge of its window after {record['runs']} runs")
    log_moving([records[task.digest] for task in plan.tasks], "areas")
    statuses = dict(Counter(records[task.digest]["status"] for task in plan.tasks))
    if "finished" not in statuses:
        first = next(iter(records.values()))["reason"]
        raise InputError(f"none of the {len(plan.tasks)} areas has a result; the first: {first}")
    return statuses


def _companion(plan, records):
    """Return the companion of the first area, and of which area it is (`of`); None without."""
    found = records[plan.tasks[0].digest].get("companion")
    return found and found | {"of": f"area {plan.tasks[0].number}"}


def _write(folder, plan, records):
    """Write the table of areas and the maps; return their paths."""
    write_areas(folder.areas, plan.areas, _columns(plan, records))
    rasters, scenarios = {}, []
    for task, scenario, frequency in zip(plan.tasks, plan.scenarios, plan.frequencies, strict=True):
        record = records[task.digest]
        if record["status"] != "finished" or record["extent"] is None:
            continue
        raster = member_files(task.run.output, task.digest)[1]
        top, _, left, _ = record["window"]
        at_rest = bool(record["came_to_rest"])
        one = AreaRaster(task.number, raster, top, left, tuple(record["extent"]), float(frequency), at_rest)
        rasters.setdefault("all", []).append(one)
        scenarios.append(scenario if plan.request.scenario is not None else None)
        if plan.request.scenario is not None:
            rasters.setdefault(f"scenario_{scenario}", []).append(one)
    tags = {"version": __version__, "digest": folder.digest, "min_depth": plan.request.min_depth}
    errors = error_words(_companion(plan, records))
    tags |= {ERROR_TAG: errors} if errors else {}
    with whole_folder(folder.maps, overwrite=True) as part:
        paths = [
            path.relative_to(part)
            for name, areas in sorted(rasters.items())
            for path in write_region_maps(
                part, name, plan.grid, areas, plan.request.min_depth, tags, plan.request.frequency is not None
            )
        ]
        footprints = part / "all_footprints.gpkg"
        write_footprints(footprints, rasters.get("all", []), scenarios, plan.grid, plan.request.min_depth)
        paths.append(footprints.relative_to(part))
        terrain = _terrain_layer(plan, folder.maps)
        project = RegionProject(
            part, plan.grid, rasters, plan.request.min_depth, plan.request.frequency is not None, terrain
        )
        made, *styles = (path.relative_to(part) for path in write_region_project(project))
    return [folder.maps / made, folder.areas, *(folder.maps / path for path in (*paths, *styles))]


def _terrain_layer(plan, maps):
    """Return the path of the DTM for the project; None for a DTM that was reprojected."""
    table = plan.scene.terrain
    return None if table.to_crs is not None else terrain_path(Path(plan.scene.path(table.dem)), table.band, maps)


def _columns(plan, records):
    """Return the results of the areas, in their order, by name."""
    found = [records[task.digest] for task in plan.tasks]
    windows = [plan.bounds(record.get("window")) for record in found]
    sides = ("west", "south", "east", "north")
    return {
        "number": [task.number for task in plan.tasks],
        "scenario": list(plan.scenarios),
        "status": [record["status"] for record in found],
        "reason": [record["reason"] for record in found],
        **{name: [record.get(name) for record in found] for name in FIGURES},
        **{f"window_{side}": [bounds[k] for bounds in windows] for k, side in enumerate(sides)},
        "digest": [task.digest for task in plan.tasks],
    }
