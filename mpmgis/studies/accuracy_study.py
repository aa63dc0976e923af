"""Measure the accuracy of a scene against its computing time (`mpmgis study`): a table, a plot and text."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..maps.averaging.placement import Bed
from ..results.comparison import nearest
from ..simulation.companion_run import centre_of
from ..simulation.cost_prediction import predicted
from ..simulation.numerical_parameters import crossed, one_at_a_time, parameters_of, reference
from ..simulation.preparation import prepare, prepare_scene
from ..simulation.scene_files import input_files
from ..simulation.scene_run import use_threads
from ..simulation.stage_sequence import StageSequence
from ..simulation.warmup import warm_up
from ..system.csv_rows import write_records
from ..system.errors import InputError, OutputError, SceneError
from ..system.links import input_inside
from ..system.messages import log, muted
from ..system.whole_files import whole_folder
from ..terrain.grid import Grid
from ..terrain.spatial_inputs import read_placed_raster
from ..terrain.undeclared_nodata import THICKNESS
from .export_sweep import ExportSetting, ExportSweep
from .other_code_results import read_other_results
from .run_measures import NAMES, Errors, State, StudyCells, errors_against_exact, errors_of, outcomes
from .study_options import AskedStudy
from .study_plots import write_plot
from .study_table import OtherResult, Row, Study

if TYPE_CHECKING:
    from .study_table import SettingChoice

TABLE_FILE, PLOT_FILE, EXPORT_FILE, SUMMARY_FILE = "study.csv", "study.png", "export.csv", "summary.csv"
COMPARISONS = 4  # number of times at which flows are compared, including the end
ASK_SECONDS = 600.0  # [s] predicted time of a study above which it must be confirmed


@dataclass(frozen=True)
class StudyFound:
    """Results of a study.

    Parameters
    ----------
    study : Study
    choice : SettingChoice or None
        For the target error.
    lines : tuple of str
        The conclusions.
    files : tuple of Path
    """

    study: Study
    choice: "SettingChoice | None"
    lines: tuple
    files: tuple


def study(
    asked: AskedStudy,
    *,
    confirm: Callable[[str], bool] = lambda question: True,
    watch: Callable = lambda solver, end_time, left: None,
) -> StudyFound:
    """Run the scene with its settings changed one at a time; compare with a finer run or an exact solution.

    Parameters
    ----------
    asked : AskedStudy
    confirm : callable
        Question -> whether to run a long study.
    watch : callable
        Called with (solver, end time [s], '') a few times a second.

    Returns
    -------
    StudyFound

    Raises
    ------
    InputError, SceneError, OutputError
        Before the first step; nothing is written.
    UnphysicalError
        The solver stopped with one of the settings.
    """
    _require_possible(asked)
    output = Path(asked["output"] or Path(asked["scene"]).parent / "study")
    with whole_folder(output, asked["overwrite"]) as part:
        found = _study(asked, output, confirm, watch)
        write_records(part / TABLE_FILE, *found.study.records())
        write_plot(
            part / PLOT_FILE,
            found.study,
            f"Accuracy against computing time: {Path(asked['scene']).resolve().parent.name}",
        )
        write_records(part / SUMMARY_FILE, ("what", "value"), found.study.summary())
        names = [TABLE_FILE, SUMMARY_FILE, PLOT_FILE]
        if found.study.exports:
            write_records(part / EXPORT_FILE, ExportSetting._fields, found.study.exports)
            names.append(EXPORT_FILE)
    return replace(found, files=tuple(output / name for name in names))


def _require_possible(asked):
    measure = asked["measure"]
    if measure not in NAMES:
        raise InputError(f"`measure={measure}`: expected one of {', '.join(NAMES)}")
    if asked["exact"] is not None and measure != "thickness":
        raise InputError(f"`exact` contains only thickness; leave `measure={measure}` out")
    if asked["exact"] is not None and asked["refinement"] is not None:
        raise InputError("`exact` needs no finer run; leave `refinement` out")


def _study(asked: AskedStudy, output: Path, confirm: Callable, watch: Callable) -> StudyFound:
    base = prepare(asked["scene"], asked["law"])
    given = input_inside(output, input_files(asked["scene"], base.scene, asked["law"]))
    if given is not None:
        raise OutputError(f"{output} contains the input {given} and would be replaced; give another `output`")
    scene, knobs = base.scene, parameters_of(base.scene, asked["knobs"], asked["cell_sizes"])
    settings = one_at_a_time(scene, knobs) + (crossed(scene, knobs) if asked["full"] else [])
    finer = None
    if asked["exact"] is None:
        finer = reference(scene, settings, asked["refinement"])
    cells, times = _cells(base), _interval(scene) * np.arange(1, COMPARISONS + 1)
    exact = None if asked["exact"] is None else _thickness(asked["exact"], base.terrain, cells.grid)
    beside = tuple(_other_results(file, asked, exact, base.terrain, cells.grid) for file in asked["beside"])
    threads = use_threads(max(base.particles_of(number) for number in range(len(base.stages))), asked["threads"])
    seconds = predicted(base, threads).seconds
    repeats = asked["repeats"]
    _require_affordable(settings, finer, base.scene, seconds, repeats, confirm)

    def run(settings, repeats, begun=lambda turn, number: None):
        return outcomes(
            settings,
            muted()(lambda s: prepare_scene(s.scene)),
            muted()(warm_up),
            partial(_Flow, interval=times[0], watch=watch),
            cells,
            times,
            repeats,
            lambda setting: seconds * setting.work_over(scene),
            begun,
        )

    def log_turn(turn, number):
        log.info(f"run {turn + 1} of {repeats}, setting {number + 1} of {len(settings)}: {settings[number].name}")

    truth = None
    if finer is not None:
        log.info(f"the reference: {finer.name}")
        truth = run([finer], 1)[0].states
    rows = [Row(made, _errors(made.states, truth, exact)) for made in run(settings, repeats, log_turn)]
    exports = _exports(base) if asked["exports"] else ()
    cell = 0.0 if finer is None else finer.cell_size
    made = Study(tuple(rows), asked["measure"], cell, exports, sum(beside, ()))
    choice = None if asked["target_error"] is None else made.choice(asked["target_error"])
    return StudyFound(made, choice, tuple(made.lines()), ())


def _interval(scene):
    """Return the time [s] between two comparisons of the flow."""
    return scene.output.end_time / COMPARISONS


class _Flow:
    """Frames of a prepared run, `interval` [s] apart, and afterwards its steps and the error of its mass."""

    def __init__(self, prepared, interval, watch=lambda solver, end_time, left: None):
        output = replace(prepared.scene.output, frame_interval=float(interval))
        prepared = replace(prepared, scene=replace(prepared.scene, output=output))
        self._sequence = StageSequence(prepared, lambda solver, end_time: watch(solver, end_time, ""))

    def __iter__(self):
        return iter(self._sequence)

    @property
    def steps(self):
        return self._sequence.steps

    @property
    def particle_steps(self):
        return self._sequence.particle_steps

    @property
    def mass_error(self):
        """Relative, of all stages together."""
        if self._sequence.prepared.scene.stage:
            return self._sequence.mass_account()["error_relative"]
        return self._sequence.solver.balances()["mass_error_relative"]


def _errors(states, truth, exact) -> Errors:
    return errors_of(states, truth) if exact is None else errors_against_exact(states, exact)


def _cells(base):
    """Return the cells for comparing runs: the scene's cell size, with stages the largest, over the whole terrain."""
    west, south, east, north = base.terrain.grid.bounds
    size = max(stage.numerics.cell_size for stage in base.stages)
    shape = tuple(int(np.ceil(round(span / size, 6))) for span in (north - south, east - west))
    grid = Grid.north_up(base.terrain.grid.crs, west, north, size, shape)
    return StudyCells(grid, Bed.of(base.terrain), base.numerics.density, centre_of(base.frame))


def _thickness(path, terrain, grid):
    """Return the thickness of a raster on the cells of the study, float64[rows, columns] [m]."""
    values, own = read_placed_raster(path, terrain, THICKNESS)
    return nearest(values, own, grid)


def _other_results(
    path: Path, asked: AskedStudy, exact: np.ndarray | None, terrain: object, grid: Grid
) -> tuple[OtherResult, ...]:
    """Read results of other codes; errors of rasters are computed as for the study's own runs.

    Raises
    ------
    FormatError, InputError
    """
    found = []
    for row in read_other_results(path, asked["measure"]):
        errors = row.errors
        if row.thickness is not None:
            if exact is None:
                raise InputError(
                    f"`beside={path}`: '{row.setting}' is a raster of the thickness at the end, whose error requires "
                    f"`exact`; give `exact`, or its error in a column error_{asked['measure']}"
                )
            errors = errors_against_exact([_state_of(_thickness(row.thickness, terrain, grid))], exact)
        found.append(OtherResult(row.code, row.setting, row.seconds, errors))
    return tuple(found)


def _state_of(thickness):
    """Return a State with only the thickness; NaN is no flow."""
    return State(np.nan, np.nan_to_num(thickness), np.full((*thickness.shape, 2), np.nan), np.nan)


def _require_affordable(settings, finer, scene, seconds, repeats, confirm):
    """Log the predicted time of the study, whose scene takes `seconds`, and ask `confirm(question)` if it is long."""
    runs = [*((setting, repeats) for setting in settings), *([(finer, 1)] if finer else [])]
    total = seconds * sum(times * setting.work_over(scene) for setting, times in runs)
    log.info(f"{len(settings)} settings, {repeats} times each: predicted {total:.0f} s of steps")
    if total > ASK_SECONDS and not confirm(f"this study is predicted to take {total / 60:.0f} minutes"):
        raise SceneError(
            f"this study is predicted to take {total / 60:.0f} minutes; give `yes` to run it, or fewer `knobs` or "
            "`repeats`, or a shorter [output] end_time"
        )


def _exports(base):
    """Return the ExportSettings of the unchanged scene."""
    interval, size = base.scene.output.frame_interval, min(stage.numerics.cell_size for stage in base.stages)
    log.info(f"exports: frames every {interval:g} s on cells of {0.5 * size:g} m and coarser")
    sweep = ExportSweep(
        Bed.of(base.terrain),
        base.terrain.grid.bounds,
        base.terrain.grid.crs,
        0.5 * size,
        interval,
        base.numerics.density,
    )
    for frame in _Flow(muted()(prepare_scene)(base.scene), interval):
        if abs(frame.time / interval - round(frame.time / interval)) < 1e-6:  # no frames at switches between stages
            sweep.take(frame)
    return tuple(sweep.settings())
