"""`mpmgis study`: what accuracy costs in time."""

from .progress import run_progress
from .values import count, positive

EXAMPLE = """
mpmgis study scene.toml
mpmgis study scene.toml --knobs cell_size,cfl --target-error 0.05
mpmgis study scene.toml --exact exact_thickness.tif --beside other_codes.csv -o study
"""
DESCRIPTION = """
Runs the scene with each of its knobs (cell size, particles a cell, Courant number; in 3D precision and stiffness too;
of a scene in stages the cells of all and of each, points a cell being the spacing of what is converted) turned alone,
each setting several times, and holds all runs against a finer one, or against an exact answer. Writes the
table (study.csv), the work-precision plot (study.png: what no other setting beats is the front) and what cells and time
steps of an export lose (export.csv). Times are those of the loop over steps, medians; compiling is apart. What a finer
run is itself off by is estimated from the order of the others (Richardson). Results of other codes are shown beside
these with --beside: a CSV with columns setting, seconds and error_thickness (or another of study.csv), or thickness, a
raster as that of --exact, whose error is then taken on the same cells; code names whose they are.
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    parser.add_argument("scene", metavar="scene.toml", help="the scene to study")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for table and plot (default: study/ beside it)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier study of that name")
    parser.add_argument("--knobs", type=_names, metavar="NAME,..", help="turn only these (default: all it has)")
    parser.add_argument(
        "--cell-sizes", type=_sizes, metavar="M,..", help="try these [m] (default: 2, 1.4, 1, 0.7 times)"
    )
    parser.add_argument("--full", action="store_true", help="besides, three values of each combined with each other")
    parser.add_argument("--repeats", type=count, default=3, metavar="N", help="runs of each setting (default 3)")
    parser.add_argument(
        "--measure", default="thickness", metavar="ERROR", help="thickness (default), momentum, area or reach decides"
    )
    parser.add_argument("--exact", metavar="FILE", help="raster of the exact vertical thickness at end_time [m]")
    parser.add_argument(
        "--beside", action="append", default=[], metavar="CSV", help="results of others, to be shown too; repeatable"
    )
    parser.add_argument(
        "--refinement",
        type=positive,
        metavar="F",
        help="the finer run has the scene's cells over F (default: the smallest that are tried over 1.4)",
    )
    parser.add_argument(
        "--target-error", type=positive, metavar="E", help="print the settings for this error: 0.05 is 5 %%; reach in m"
    )
    parser.add_argument("--no-exports", dest="exports", action="store_false", help="leave cs_e and dt_e out")
    parser.add_argument(
        "--threads",
        type=count,
        metavar="N",
        help="processor threads (default: one for every 10 000 particles, at most all)",
    )
    parser.add_argument("--yes", action="store_true", help="do not ask about predicted time")
    parser.add_argument("--law", metavar="FILE.py", help="Python file with your own law of friction; it will be run")


def _names(text):
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _sizes(text):
    return tuple(positive(size.strip()) for size in text.split(",") if size.strip())


def run(arguments):
    """Study; the table goes to stdout."""
    from ..workflows.study import StudyRequest, study
    from .run import asked

    request = {name: value for name, value in vars(arguments).items() if name in StudyRequest.__dataclass_fields__}
    with run_progress() as watch:
        found = study(
            StudyRequest(**request),
            confirm=lambda question: arguments.yes or asked(question),
            watch=watch,
        )
    print("\n".join([*table(found.study), "", *found.lines, *target(arguments.target_error, found.choice)]))
    for file in found.files:
        print(file)
    return 0


def table(study):
    """Lines: a row a setting, the quickest first; * on the front, + of others."""
    from ..experiments.report import value_words

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
        lines.append((
            study.seconds[k],
            f"{'*' if study.front[k] else '':<2}{names[k]:<{width}}{outcome.particles:>10}{outcome.steps:>8}"
            f"{study.seconds[k]:>10.3g}{100 * spread:>6.0f} %{outcome.predicted:>10.3g}"
            f"{value_words(study.measure, study.errors[k]):>10}",
        ))  # fmt: skip
    for other, error in zip(study.beside, study.beside_errors(), strict=True):
        typical, least, most = other.seconds
        lines.append((
            typical,
            f"{'+':<2}{other.name:<{width}}{'':>18}{typical:>10.3g}{100 * (most - least) / typical:>6.0f} %{'':>10}"
            f"{value_words(study.measure, error):>10}",
        ))  # fmt: skip
    return [head, *(line for _, line in sorted(lines))]


def target(error, choice):
    """Lines about the settings for the `error` asked for."""
    if error is None:
        return []
    if choice is None:
        return [f"no setting that was run reaches an error of {error:g}, and nothing tells which would"]
    lines = [f"for an error of at most {error:g}: about {choice.seconds:.3g} s of steps"]
    if choice.estimated:
        lines[0] += ", continued beyond what was run by the law above: try it before you trust it"
    if not choice.changes:
        return [lines[0] + ", with the scene as it is"]
    tables = {}
    for key, value in choice.changes.items():
        stage, _, own = key.rpartition(".")
        head = f"[[stage]] number {stage.removeprefix('stage')}" if stage else "[numerics]"
        tables.setdefault(head, []).append(f"{own} = {value!r}".replace("'", '"'))
    return [*lines, *(text for head, keys in tables.items() for text in (head, *keys))]
