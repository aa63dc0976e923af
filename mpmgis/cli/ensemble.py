"""`mpmgis ensemble`: many runs over parameter ranges."""

import argparse

from . import talk
from .progress import interruptible, member_progress
from .values import count, number, positive

EXAMPLE = """
mpmgis ensemble scene.toml --vary friction.mu=0.15:0.3 --vary release.thickness=normal:1.5:0.3:0.5:3
mpmgis ensemble scene.toml --plan plan.toml --exceed h=0.5,1 --exceed p=10000 -o ensemble
"""
DESCRIPTION = """
Runs the scene many times with other values of the keys that vary, and writes what the runs say together: maps of the
probability that thresholds are reached, of means, percentiles and envelopes, with styles and a QGIS project. Keys are
TABLE.KEY, or zones.1.KEY for the first [[zones]]. Values are LOW:HIGH (uniform), A,B,C (a list),
normal:MEAN:SD, lognormal:MEAN:SD (both also with :LOW:HIGH to cut them), triangular:LOW:MODE:HIGH. A second start goes
on where the first one stopped: members that are done are known by a digest of their scene, their inputs and the
program, and are not run again. A Python program that calls pipeline.ensemble with more than one worker does so under
if __name__ == "__main__".
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    parser.add_argument("scene", metavar="scene.toml", help="the scene to run")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder (default: ensemble/ beside the scene)")
    parser.add_argument(
        "--overwrite", action="store_true", help="replace the ensemble of another plan; members of both are kept"
    )
    _add_plan_options(parser.add_argument_group("what varies"))
    _add_product_options(parser.add_argument_group("maps"))
    _add_machine_options(parser.add_argument_group("machine"))


def _add_plan_options(group):
    group.add_argument(
        "--vary", action="append", default=[], metavar="KEY=VALUES", help="a key and its values; as often as needed"
    )
    group.add_argument("--plan", metavar="FILE", help="TOML file with [vary] and these options; options go before it")
    group.add_argument(
        "--sampling",
        metavar="HOW",
        help="lhs (Latin hypercube), sobol, random, or grid: all values with all others, ranges at --samples values "
        "in the middle of parts that are equally likely (default: grid of lists alone, else lhs)",
    )
    group.add_argument(
        "--samples", type=count, metavar="N", help="runs (default 32); on a grid values of each range (default 5)"
    )
    group.add_argument(
        "--seed", type=_seed, metavar="N", help="of the sampling (default 0); the same runs for the same"
    )


def _add_product_options(group):
    group.add_argument(
        "--exceed",
        action="append",
        metavar="NAME=A,B",
        help="probability that the peak of h [m], Ut [m/s] or p [Pa] is at least this (default h=0.5,1,2)",
    )
    group.add_argument(
        "--percentiles", type=_numbers, metavar="P,..", help="of the members' peaks and arrivals (default 5,50,95)"
    )
    group.add_argument("--cs-e", type=positive, metavar="M", dest="cell_size", help="cells [m] (default: the DTM's)")
    group.add_argument(
        "--min-depth",
        type=positive,
        metavar="D",
        default=0.05,
        help="flow this deep [m] counts as arrived, thinner flow has no velocity (default 0.05)",
    )
    group.add_argument(
        "--keep", choices=("maxima", "frames"), default="maxima", help="of each run: its peaks, or all (default maxima)"
    )
    group.add_argument(
        "--tolerate",
        type=_share,
        default=0.1,
        metavar="SHARE",
        help="of the runs that may be left out because they became unphysical or failed (default 0.1)",
    )


def _add_machine_options(group):
    group.add_argument(
        "--workers", type=count, metavar="N", help="processes (default: one per core; 1: this one); same results"
    )
    group.add_argument("--dask", metavar="ADDRESS", help="run on the Dask cluster with this scheduler")
    group.add_argument("--yes", action="store_true", help="do not ask about predicted time and memory")
    group.add_argument("--law", metavar="FILE.py", help="Python file with your own law of friction; it will be run")


def run(arguments):
    """Run the ensemble; the paths written go to stdout, one a line."""
    from ..workflows.ensemble import EnsembleRequest, ensemble
    from .run import asked

    request = {name: value for name, value in vars(arguments).items() if name in EnsembleRequest.__dataclass_fields__}
    request["vary"] = tuple(request["vary"])
    with member_progress() as shown, interruptible(shown) as look:
        found = ensemble(
            EnsembleRequest(**request),
            confirm=lambda question: arguments.yes or asked(question),
            look=look,
        )
    tell(found)
    for file in found.files:
        print(file)
    return 0


def tell(found):
    """What the runs came to and cost, on stderr."""
    counts = ", ".join(f"{number} {status}" for status, number in found.statuses.items())
    talk.say(f"members: {counts}" + (f"; {found.before} of them before this start" if found.before else ""))
    if found.run_seconds:
        talk.say(
            f"wall time {found.run_seconds:.1f} s for runs of {found.member_seconds:.1f} s, {found.map_seconds:.1f} s "
            f"for the maps, {found.start_seconds:.1f} s to start"
        )


def _seed(text):
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted a whole number from 0")
    return int(text)


def _numbers(text):
    return tuple(number(value.strip()) for value in text.split(","))


def _share(text):
    value = number(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"got {text}, wanted a number from 0 to below 1")
    return value
