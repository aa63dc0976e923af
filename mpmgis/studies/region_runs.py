"""Run every release area of a region in its own window of one large DTM (`mpmgis region`); maps of all together."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..frames.many_runs_folder import AREAS_FILE, REGION, ManyRunsFolder
from ..frames.region_maps import AreaRaster, write_region_maps
from ..frames.run_facts import record_facts
from ..maps.qgis.colours import chosen_classes
from ..maps.qgis.region_footprints import write_footprints
from ..maps.qgis.region_project import RegionProject, terrain_path, write_region_project
from ..system.errors import InputError
from ..system.messages import log
from ..system.whole_files import whole_folder
from .many_runs import ManyRuns, ManyRunsFound
from .region_areas import write_areas
from .region_options import AskedRegion
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


@dataclass(frozen=True, kw_only=True)
class RegionFound(ManyRunsFound):
    """Results of a region.

    Parameters
    ----------
    repeated : int
        Number of areas whose flow reached the edge of a window, so that they were run again in a larger one.
    plan_seconds : float [s]
        Wall time of the plan with the prediction.
    window_seconds, prepare_seconds : float [s]
        Sums over the areas that were run: choice of the window, and seeding.
    """

    repeated: int
    plan_seconds: float
    window_seconds: float
    prepare_seconds: float


def region(
    asked: AskedRegion, *, confirm: Callable[[str], bool] = lambda question: True, look: Callable = lambda *state: None
) -> RegionFound:
    """Run every release area in its own window of the DTM, and write maps of all areas together.

    Finished areas are not run again.

    Parameters
    ----------
    asked : AskedRegion
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
    output = Path(asked["output"] or Path(asked["scene"]).parent / "region")
    chosen_classes(asked["classes"])  # refuses an unknown name before the first run
    plan = PlannedRegion.of(asked, output)
    folder = ManyRunsFolder(REGION, output, plan.digest, asked["overwrite"])
    folder.refuse_inputs(plan.input_files())
    runs = ManyRuns(plan.tasks, "area", asked["workers"], asked["dask"])
    with folder.planned():
        if runs.to_run:
            plan.prepare_samples(runs.to_run)
        runs.require_affordable(plan.cost, confirm)
    planned = time.perf_counter() - began
    with folder.held():
        folder.write_record(state="running", areas=len(plan.tasks))
        started, ran = runs.run(plan.samples[:1], look)
        began = time.perf_counter()
        repeated = sum(record.get("runs", 1) > 1 for record in runs.in_order)
        _report(runs, repeated)
        files = _write(folder, plan, runs)
        found = RegionFound(
            folder=folder.path,
            files=tuple(files),
            statuses=runs.statuses,
            before=runs.before,
            repeated=repeated,
            plan_seconds=planned,
            start_seconds=started,
            run_seconds=ran,
            map_seconds=time.perf_counter() - began,
            window_seconds=runs.spent("window_seconds"),
            prepare_seconds=runs.spent("prepare_seconds"),
            member_seconds=runs.spent("wall_seconds"),
            companion=runs.companion,
        )
        folder.write_record(
            state="finished",
            areas=len(plan.tasks),
            statuses=found.statuses,
            repeated=repeated,
            companion=found.companion,
        )
    return found


def _report(runs, repeated):
    """Log repeated, cut and failed areas; raise InputError for no result."""
    if repeated:
        log.info(f"{repeated} areas reached the edge of their first window and were run again in a larger one")
    for task, record in zip(runs.tasks, runs.in_order, strict=True):
        if record["status"] != "finished":
            log.info(f"area {task.number} is {record['status']}, the maps omit it: {record['reason']}")
        elif record["edge_reached"]:
            log.info(f"area {task.number} still reaches the edge of its window after {record['runs']} runs")
    runs.log_moving()
    if not runs.finished:
        first = next(iter(runs.records.values()))["reason"]
        raise InputError(f"none of the {len(runs.tasks)} areas has a result; the first: {first}")


def _write(folder, plan, runs):
    """Write the table of areas and the maps; return their paths."""
    table = folder.path / AREAS_FILE
    write_areas(table, plan.areas, _columns(plan, runs))
    asked, rasters, scenarios = plan.asked, {}, []
    for task, scenario, frequency in zip(plan.tasks, plan.scenarios, plan.frequencies, strict=True):
        record = runs.record(task)
        if record["status"] != "finished" or record["extent"] is None:
            continue
        top, _, left, _ = record["window"]
        at_rest = bool(record["came_to_rest"])
        one = AreaRaster(task.number, task.files.maxima, top, left, tuple(record["extent"]), float(frequency), at_rest)
        rasters.setdefault("all", []).append(one)
        scenarios.append(scenario if asked["scenario"] is not None else None)
        if asked["scenario"] is not None:
            rasters.setdefault(f"scenario_{scenario}", []).append(one)
    tags, often = runs.tags(folder.digest, asked["min_depth"]), asked["frequency"] is not None
    with whole_folder(folder.maps, overwrite=True) as part:
        paths = [
            path.relative_to(part)
            for name, areas in sorted(rasters.items())
            for path in write_region_maps(part, name, plan.grid, areas, asked["min_depth"], tags, often)
        ]
        footprints = part / "all_footprints.gpkg"
        write_footprints(footprints, rasters.get("all", []), scenarios, plan.grid, asked["min_depth"])
        paths.append(footprints.relative_to(part))
        terrain = _terrain_layer(plan, folder.maps)
        project = RegionProject(
            folder=part,
            grid=plan.grid,
            areas=rasters,
            min_depth=asked["min_depth"],
            frequency=often,
            terrain=terrain,
            facts=record_facts({"scene": plan.scene.as_tables()}),
            author=asked["author"] or "",
            classes=chosen_classes(asked["classes"]),
        )
        made, *styles = (path.relative_to(part) for path in write_region_project(project))
    return [folder.maps / made, table, *(folder.maps / path for path in (*paths, *styles))]


def _terrain_layer(plan, maps):
    """Return the path of the DTM for the project; None for a DTM that was reprojected."""
    table = plan.scene.terrain
    return None if table.to_crs is not None else terrain_path(Path(plan.scene.path(table.dem)), table.band, maps)


def _columns(plan, runs):
    """Return the results of the areas, in their order, by name."""
    found = runs.in_order
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
