"""`mpmgis run`: simulate a scene."""

import sys

from ..analysis.run_summary import account, extreme_lines
from . import talk
from .progress import interruptible, run_progress, without_bar

EXAMPLE = """
mpmgis run --template > scene.toml
mpmgis run scene.toml -o results
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument("scene", nargs="?", metavar="scene.toml", help="the scene to simulate")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for frames (default: results/ beside the scene)")
    parser.add_argument("--overwrite", action="store_true", help="replace the frames of an earlier run in that folder")
    parser.add_argument("--resume", action="store_true", help="go on after the last whole frame in that folder")
    parser.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="processor threads (default: one for every 10 000 particles, at most all); same result",
    )
    parser.add_argument("--yes", action="store_true", help="do not ask about predicted time and memory")
    parser.add_argument("--law", metavar="FILE.py", help="Python file with your own law of friction; it will be run")
    parser.add_argument("--template", action="store_true", help="print a commented scene and stop")


def run(arguments):
    """Run the scene, or print the template."""
    from ..errors import InputError

    if arguments.template:
        from ..scene import template

        if arguments.scene is not None or arguments.output is not None:
            raise InputError("--template takes neither scene nor -o; it prints: mpmgis run --template > scene.toml")
        print(template(), end="")
        return 0

    if arguments.scene is None:
        raise InputError("which scene? give scene.toml, or --template to see one")
    if arguments.threads is not None and arguments.threads < 1:
        raise InputError(f"--threads {arguments.threads}, wanted 1 or more")
    if arguments.resume and arguments.overwrite:
        raise InputError("--resume and --overwrite contradict each other; give one of them")
    from ..workflows.run import run as run_scene

    with run_progress() as shown, interruptible(shown) as watch:
        summary = run_scene(
            arguments.scene,
            arguments.output,
            overwrite=arguments.overwrite,
            resume=arguments.resume,
            threads=arguments.threads,
            laws=arguments.law,
            confirm=lambda question: arguments.yes or asked(question),
            watch=watch,
        )
    tell(summary)
    print(summary.folder)
    return 0


def asked(question):
    """Ask on a terminal; elsewhere nobody can answer, so it is no."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    with without_bar():
        print(f"{question}; go on? [y/N] ", end="", file=sys.stderr, flush=True)
        return sys.stdin.readline().strip().lower() in ("y", "yes")


def tell(summary):
    """The balances and the cost of a run, on stderr."""
    talk.say(f"ended: {summary.reason}")
    talk.say(f"t = {summary.time:.1f} s after {summary.steps} steps, {summary.frames} frames")
    for line in account(summary.balances, summary.solver, summary.mass):
        talk.say(line)
    if summary.mass is not None:
        for line in extreme_lines(summary.extremes):
            talk.say(line)
    if summary.result_digest:
        talk.say(f"digest of the result: {summary.result_digest}")
    _tell_cost(summary)
    for line in summary.unusable:  # last of all, so that nobody misses it
        talk.say(line)


def _tell_cost(summary):
    if not summary.wall_seconds:
        return
    rate = summary.particle_steps_per_second / 1e6
    predicted = summary.predicted_seconds
    foreseen = "" if predicted is None else f" (predicted {predicted:.2g} s)"
    talk.say(f"wall time {summary.wall_seconds:.1f} s{foreseen}, {rate:.1f} million particle-steps a second")
