"""Run the verbs that simulate: run, demo, ensemble, calibrate, region, study."""

import argparse
import sys
from functools import partial
from typing import TYPE_CHECKING

from ...frames.headline_numbers import error_words
from ...system.errors import InputError
from ...system.whole_files import refuse_existing
from .. import demo as demo_verb
from .. import run as run_verb
from ..verb import module_of, verb_of
from ..verb_calls import complete
from . import terminal
from .parser import values_of
from .progress import interruptible, member_progress, run_progress, show_count, without_bar

if TYPE_CHECKING:
    from ...studies.calibration_result import Calibration
    from ...studies.study_table import SettingChoice


def run(arguments: argparse.Namespace) -> int:
    """Run the scene, or print the template.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    if arguments.template or arguments.schema:
        _print_help_of_scenes(arguments)
        return 0

    asked = complete(run_verb.VERB, values_of(arguments, run_verb.VERB))
    with run_progress() as shown, interruptible(shown) as watch:
        summary = run_verb.work(asked, lambda question: asked["yes"] or confirmed(question), watch)
    _print_summary(summary)
    print(summary.folder)
    return 0


def demo(arguments: argparse.Namespace) -> int:
    """Seed, run, export and draw the sample site; print the QGIS project and the picture.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    asked = complete(demo_verb.VERB, values_of(arguments, demo_verb.VERB))
    refuse_existing(asked["output"], asked["overwrite"])
    terminal.note("Lava Falls, Grand Canyon: seed, run, export (the first time also compiles, about 50 seconds)")
    # project and picture have no callback: a signal during these takes effect at the end
    with run_progress() as shown, interruptible(shown, partial(show_count, "frame"), done=False) as (watch, progress):
        summary, project, picture = demo_verb.work(asked, watch, progress)
    _print_summary(summary)
    terminal.note("open the project in QGIS (double-click), then press play in the Temporal Controller")
    print(project)
    print(picture)
    return 0


def ensemble(arguments: argparse.Namespace) -> int:
    """Run the ensemble, and print the paths of the files.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    found = _many_runs(arguments)
    _print_counts(found)
    terminal.list_files(found.files, arguments)
    return 0


def _many_runs(arguments):
    """Let the verb do its work with a bar of the finished runs; return what it found."""
    verb = verb_of(arguments.verb)
    asked = complete(verb, values_of(arguments, verb))
    with member_progress() as shown, interruptible(shown) as look:
        return module_of(verb.name).work(
            asked, confirm=lambda question: arguments.yes or confirmed(question), look=look
        )


def calibrate(arguments: argparse.Namespace) -> int:
    """Calibrate, and print the parameters and the paths of the files.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    found = _many_runs(arguments)
    for line in calibration_lines(found.result):
        terminal.note(line)
    terminal.list_files(found.files, arguments)
    return 0


def calibration_lines(result: "Calibration") -> list[str]:
    """Return lines of text: the parameters, how well they are known, and what limits the result.

    Parameters
    ----------
    result : Calibration

    Returns
    -------
    list of str
    """
    figures = result.parameters()
    width = max(map(len, (*figures, "parameter"))) + 2
    lines = [f"{'parameter':<{width}}{'best fit':>10}{'median':>10}{'90 % interval':>22}{'identified':>12}"]
    for key, one in figures.items():
        interval = "{:g} to {:g}".format(*one["interval_90"])
        lines.append(f"{key:<{width}}{one['best_fit']:>10g}{one['median']:>10g}{interval:>22}{one['identified']:>12}")
    return [*lines, *result.remarks()]


def region(arguments: argparse.Namespace) -> int:
    """Run the region, and print the paths of the files.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    found = _many_runs(arguments)
    _print_counts(found, "areas")
    terminal.list_files(found.files, arguments)
    return 0


def study(arguments: argparse.Namespace) -> int:
    """Run the study, and print the table.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    verb = verb_of("study")
    asked = complete(verb, values_of(arguments, verb))
    with run_progress() as watch:
        found = module_of("study").work(
            asked, confirm=lambda question: arguments.yes or confirmed(question), watch=watch
        )
    print("\n".join([*_table(found.study), "", *found.lines, *target_lines(arguments.target_error, found.choice)]))
    for file in found.files:
        print(file)
    return 0


def confirmed(question: str) -> bool:
    """Ask a question on a terminal, and return whether the answer is yes; False without a terminal.

    Parameters
    ----------
    question : str
    """
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    with without_bar():
        print(f"{question}; continue? [y/N] ", end="", file=sys.stderr, flush=True)
        return sys.stdin.readline().strip().lower() in ("y", "yes")


def _print_summary(summary):
    """Print the balances and the cost of a run on stderr."""
    from ...simulation.companion_run import companion_lines
    from ...simulation.run_summary import account, extreme_lines

    terminal.note(f"ended: {summary.reason}")
    if summary.end is not None and not summary.came_to_rest:
        terminal.note(f"the flow did not come to rest: {summary.end.moving_words()}; its last step is no deposit")
    terminal.note(f"t = {summary.time:.1f} s after {summary.steps} steps, {summary.frames} frames")
    for line in account(summary.balances, summary.solver, summary.mass):
        terminal.note(line)
    if summary.mass is not None:
        for line in extreme_lines(summary.extremes):
            terminal.note(line)
    for line in companion_lines(summary.companion):
        terminal.note(line)
    if summary.result_digest:
        terminal.note(f"digest of the result: {summary.result_digest}")
    _print_cost(summary)
    for line in summary.warnings:  # last, so that it is seen
        terminal.note(line)


def _print_help_of_scenes(arguments):
    """Print the commented scene, or the schema of scenes."""
    import json

    from ...scene import json_schema, template

    word, file = ("template", "scene.toml") if arguments.template else ("schema", "scene.schema.json")
    if arguments.template and arguments.schema:
        raise InputError("--template and --schema exclude each other; give one of them")
    if arguments.scene is not None or arguments.output is not None:
        raise InputError(f"--{word} takes neither scene nor -o; use mpmgis run --{word} > {file}")
    print(template() if arguments.template else json.dumps(json_schema(), indent=1) + "\n", end="")


def _print_cost(summary):
    if not summary.wall_seconds:
        return
    rate = summary.particle_steps_per_second / 1e6
    predicted = summary.predicted_seconds
    predicted_words = "" if predicted is None else f" (predicted {predicted:.2g} s)"
    terminal.note(
        f"wall time {summary.wall_seconds:.1f} s{predicted_words}, {rate:.1f} million particle-steps a second"
    )


def _print_counts(found, what="members"):
    """Print statuses, numerical errors of one and cost of the runs on stderr."""
    counts = ", ".join(f"{number} {status}" for status, number in found.statuses.items())
    terminal.note(f"{what}: {counts}" + (f"; {found.before} of them finished earlier" if found.before else ""))
    errors = error_words(found.companion)
    if errors:
        terminal.note(f"numerical errors: {errors}")
    if found.run_seconds:
        terminal.note(
            f"wall time {found.run_seconds:.1f} s for runs of {found.member_seconds:.1f} s, {found.map_seconds:.1f} s "
            f"for the maps, {found.start_seconds:.1f} s to start"
        )


def _table(study):
    """Lines of text: a row per setting, the fastest first; * on the front, + other codes."""
    from ...studies.study_table import value_words

    names = [row.outcome.setting.name for row in study.rows] + [other.name for other in study.beside]
    width = max(28, *(len(name) + 2 for name in names))
    head = (
        f"{'':2}{'setting':<{width}}{'particles':>10}{'steps':>8}{'time [s]':>10}{'spread':>8}{'predicted':>10}"
        f"{'error':>10}"
    )
    lines = []
    for k, row in enumerate(study.rows):
        outcome = row.outcome
        spread = (max(outcome.seconds) - min(outcome.seconds)) / study.seconds[k]
        lines.append(
            (
                study.seconds[k],
                f"{'*' if study.front[k] else '':<2}{names[k]:<{width}}{outcome.particles:>10}{outcome.steps:>8}"
                f"{study.seconds[k]:>10.3g}{100 * spread:>6.0f} %{outcome.predicted:>10.3g}"
                f"{value_words(study.measure, study.errors[k]):>10}",
            )
        )
    for other, error in zip(study.beside, study.errors_of_others(), strict=True):
        typical, least, most = other.seconds
        lines.append(
            (
                typical,
                f"{'+':<2}{other.name:<{width}}{'':>18}{typical:>10.3g}{100 * (most - least) / typical:>6.0f} %{'':>10}"
                f"{value_words(study.measure, error):>10}",
            )
        )
    return [head, *(line for _, line in sorted(lines))]


def target_lines(error: float | None, choice: "SettingChoice | None") -> list[str]:
    """Return lines of text: the settings for a target.

    Parameters
    ----------
    error : float or None
        The target, relative or [m]; None: no lines.
    choice : SettingChoice or None

    Returns
    -------
    list of str
    """
    if error is None:
        return []
    if choice is None:
        return [f"no tested setting reaches an error of {error:g}, and no prediction is possible"]
    lines = [f"for an error of at most {error:g}: about {choice.seconds:.3g} s of steps"]
    if choice.estimated:
        lines[0] += ", extrapolated with the law above: run it as a check"
    if not choice.changes:
        return [lines[0] + ", with the scene as it is"]
    tables = {}
    for key, value in choice.changes.items():
        stage, _, own = key.rpartition(".")
        head = f"[[stage]] number {stage.removeprefix('stage')}" if stage else "[numerics]"
        tables.setdefault(head, []).append(f"{own} = {value!r}".replace("'", '"'))
    return [*lines, *(text for head, keys in tables.items() for text in (head, *keys))]
