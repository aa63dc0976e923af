"""Run a scene many times with varied parameters (`mpmgis ensemble`); maps of probabilities and percentiles."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..frames.many_runs_folder import ENSEMBLE, PLAN_FILE, TABLE_FILE, ManyRunsFolder
from ..frames.member_stack import MemberStack
from ..frames.run_facts import record_facts
from ..laws.quantities import MEMBER_BANDS
from ..maps.qgis.colours import chosen_classes
from ..maps.qgis.print_layout import parameter_facts
from ..system.csv_rows import write_records
from ..system.errors import InputError, MpmgisError, UnphysicalError
from ..system.messages import log
from ..system.whole_files import whole_file, whole_folder
from .ensemble_maps import EnsembleMaps, write_maps
from .ensemble_options import AskedEnsemble
from .ensemble_plan import PlannedRuns, plan_text, read_plan
from .ensemble_statistics import Products
from .many_runs import ManyRuns, ManyRunsFound


@dataclass(frozen=True, kw_only=True)
class EnsembleFound(ManyRunsFound):
    """Results of an ensemble.

    Parameters
    ----------
    processor_seconds : float [s]
        Sum of the processor times of the members of this start.
    """

    processor_seconds: float


def ensemble(
    asked: AskedEnsemble,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    look: Callable = lambda *state: None,
) -> EnsembleFound:
    """Run the scene many times with different values, and write maps of all runs together.

    Finished members are not run again.

    Parameters
    ----------
    asked : AskedEnsemble
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
    plan, products = read_plan(asked)
    chosen_classes(asked["classes"])  # refuses an unknown name before the first run
    study = PlannedRuns.of(asked, plan)
    scene = Path(asked["scene"])
    output = Path(asked["output"] or scene.parent / "ensemble")
    folder = ManyRunsFolder(ENSEMBLE, output, study.digest, asked["overwrite"])
    if plan.remark():
        log.info(plan.remark())
    tasks = study.tasks(folder.runs.resolve())
    runs = ManyRuns(tasks, "member", asked["workers"], asked["dask"], ", the nearest to the values of the scene")
    runs.require_affordable(study.cost, confirm)
    folder.refuse_inputs(study.input_files())
    with folder.held():
        ensemble_tables = plan.as_tables() | products.as_tables()
        known = {"plan": ensemble_tables, "scene": study.tables}
        with whole_file(folder.path / PLAN_FILE) as part:
            text = plan_text(ensemble_tables, f"the plan of {scene.name}, for mpmgis ensemble --plan")
            part.write_text(text, encoding="utf-8", newline="\n")
        folder.write_record(state="running", **known)
        if asked["overwrite"]:
            folder.keep_runs(task.digest for task in runs.tasks)
        table = folder.path / TABLE_FILE
        try:
            started, ran = runs.run(study.groups.values(), look, _log_failed)
        finally:
            write_records(table, *study.table(runs.records))
        _require_enough(runs, asked["tolerate"], table)
        moving = runs.log_moving()
        began = time.perf_counter()
        files = _write_maps(folder, study, products, runs, moving)
        found = EnsembleFound(
            folder=folder.path,
            files=(*files, table, folder.path / PLAN_FILE),
            statuses=runs.statuses,
            before=runs.before,
            start_seconds=started,
            run_seconds=ran,
            map_seconds=time.perf_counter() - began,
            member_seconds=runs.spent("wall_seconds"),
            processor_seconds=runs.spent("processor_seconds"),
            companion=runs.companion,
        )
        folder.write_record(
            state="finished",
            **known,
            members=found.statuses,
            not_at_rest=moving,
            before=found.before,
            workers=runs.workers,
            start_seconds=found.start_seconds,
            run_seconds=found.run_seconds,
            map_seconds=found.map_seconds,
            member_seconds=found.member_seconds,
            companion=found.companion,
        )
    return found


def _log_failed(task, record):
    if record["status"] != "finished":
        log.info(f"member {task.number} is {record['status']}: {record['reason']}")


def _require_enough(runs: ManyRuns, tolerate: float, table: Path) -> None:
    """Log the members that the statistics omit; raise UnphysicalError or InputError if there are too many."""
    left = {status: count for status, count in runs.statuses.items() if status != "finished"}
    if not left:
        return
    words = ", ".join(f"{count} {status}" for status, count in left.items())
    first = next(record["reason"] for record in runs.records.values() if record["status"] != "finished")
    count, total = sum(left.values()), len(runs.tasks)
    if count > tolerate * total or count == total:
        kind = UnphysicalError if set(left) == {"unphysical"} else InputError
        raise kind(
            f"{count} of {total} members gave no result ({words}; first: {first}), more than `tolerate={tolerate:g}` "
            f"allows; see {table}"
        )
    log.info(f"the statistics omit {count} of {total} members ({words}); first: {first}")


def _write_maps(
    folder: ManyRunsFolder, study: PlannedRuns, products: Products, runs: ManyRuns, moving: int
) -> list[Path]:
    """Write the maps of all finished members; return the paths, the project first."""
    finished = runs.finished
    extents = [runs.record(task)["extent"] for task in finished]
    extents = [extent for extent in extents if extent is not None]
    extent = None
    if extents:
        top, bottom, left, right = zip(*extents, strict=True)
        extent = min(top), max(bottom), min(left), max(right)
    asked, (_, prepared) = study.asked, study.first
    stack = MemberStack([task.files.maxima for task in finished], study.grid, extent, MEMBER_BANDS, runs.workers)
    tags = {
        "members": len(finished),
        "left_out": len(runs.tasks) - len(finished),
        "not_at_rest": moving,
        "sampling": study.plan.sampling,
        "seed": study.plan.seed,
        "cs_e": study.grid.cell_size,
        "dem": Path(prepared.terrain.path).name,
        "varied": json.dumps(study.plan.as_tables()["vary"]),
    }
    tags = runs.tags(folder.digest, asked["min_depth"]) | tags
    name = folder.path.resolve().name
    with whole_folder(folder.maps, overwrite=True) as part:
        maps = EnsembleMaps(
            folder=part,
            name=name,
            grid=study.grid,
            extent=extent,
            min_depth=asked["min_depth"],
            bands=products.rasters(),
            facts=_facts(study, prepared.scene, tags),
            author=asked["author"] or "",
            classes=chosen_classes(asked["classes"]),
        )
        write_maps(maps, stack, prepared.terrain, tags, _release(study), f"{name}: {len(finished)} runs")
        files = sorted(path.relative_to(part) for path in part.rglob("*") if path.is_file() and path.name[0] != ".")
    return [folder.maps / file for file in sorted(files, key=lambda file: (file.suffix != ".qgz", file))]


def _facts(study, scene, tags):
    """(name, text) of the page for print: what varied and what did not."""
    varied = "; ".join(f"{key} {_values(value)}" for key, value in study.plan.as_tables()["vary"].items())
    runs = f"{tags['members']}, {tags['sampling']}, seed {tags['seed']}"
    left, moving = tags["left_out"], tags["not_at_rest"]
    runs += (f"; {left} left out" if left else "") + (f"; {moving} not at rest" if moving else "")
    return (
        ("Varied", varied),
        *parameter_facts(record_facts({"scene": scene.as_tables()})),
        ("Runs", runs),
        ("Cells", f"{tags['cs_e']:g} m; reached from a depth of {study.asked['min_depth']:g} m"),
        ("DTM", tags["dem"]),
    )


def _values(value):
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


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
