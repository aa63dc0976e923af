"""Write one HTML file about a run, or a hazard map of several scenarios: `mpmgis report`."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack, cast

from ..results.hazard.hazard_options import HazardOptions, given_hazard_options
from ..results.question_options import GROUPS, QuestionOptions
from ..system.errors import InputError
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike, options_of
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    from ..results.hazard.hazard_map import HazardFound

OF_ONE_RUN = ("line", "threshold", "client", "date", "player")  # options that a hazard map does not take


class ReportOptions(QuestionOptions, total=False):
    """Options of `mpmgis.report`."""

    title: Annotated[
        str, Option("heading of the report", "TEXT", usual="the name of the results", folded=False, label="Heading")
    ]
    author: Annotated[str, Option("author, printed on the report or the hazard map", "TEXT", label="Author")]
    client: Annotated[str, Option("client of the report, printed at its head", "TEXT", label="Client")]
    date: Annotated[str, Option("date of the report, printed at its head", "TEXT", usual="today", label="Date")]
    player: Annotated[
        bool,
        Option(
            "without the player of the flow, which needs scripts in the browser",
            default=True,
            flag="--no-player",
            turned_off=True,
            no_form="the page also reads without scripts",
        ),
    ]
    line: Annotated[PathLike, shared_options.LINE]
    threshold: Annotated[float, shared_options.THRESHOLD]


class Arguments(ReportOptions, HazardOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], replace(shared_options.RESULTS_OR_RASTERS, positional="any")]
    output: Annotated[PathLike, shared_options.output("report", "report.html", "report.html")]


VERB = Verb(
    name="report",
    place=17,
    line="one HTML file about a run: maps, runout, balances, effects; or a printed hazard map of scenarios",
    options=ReportOptions,
    arguments=Arguments,
    groups=(("hazard map", HazardOptions), *GROUPS),
    example="""
mpmgis report results
mpmgis report results --title "Rock avalanche, scenario 300 years" -o scenario_300.html
mpmgis report --map swiss-debris-flow --scenario 30=results_30 --scenario 300=results_300 --scale 1:5000 -o map
""",
    description="""
One HTML file with warnings, the flow over time, maps of the largest depth, speed and pressure and of the last depth,
figures of the runout with a longitudinal profile, places (largest depth and speed, where mass left), a page for each
barrier (loads over time, run-up, overtopping, whether its loads are usable, plan, section), balances, effects and why
they are on or off, parameters, versions and digests. Everything is embedded; it needs no network. Print it from any
browser to get a PDF.

The flow over time (pip install "mpmgis[player]") plays depth and speed over a hillshade; a click on the map gives their
values at a place and their curve. It needs scripts in the browser, and is not printed.

For frames of other codes, an export or rasters named <name>_pft, <name>_pfv [m/s], <name>_ppr [kPa] the report is
limited to the contents of these files.

With --map: a hazard map of several scenarios as raster (.tif, .qml), zones (.gpkg), table (.csv) and printed map (.pdf,
.png). Every cell has the highest level of the matrix of a guideline over all scenarios. What could make a level too low
is reported: cells without data, return periods without a scenario. The matrices have sources in summaries, and marks
where a number was not read: check them in the guideline.
""",
    forms=(
        Form(
            "Write a report",
            "Maps and answers",
            "One HTML file with maps, figures of the runout with a profile, balances, warnings, effects and why they "
            "are on or off, parameters, versions and digests.",
            without=tuple(options_of(HazardOptions)),
            changes=(
                ("frames", {"label": "Results: folder of frames", "optional": False}),
                (
                    "output",
                    {
                        "kind": "new file",
                        "label": "Report",
                        "files": "HTML (*.html)",
                        "optional": False,
                        "help": "One file with all pictures in it.",
                    },
                ),
            ),
        ),
        Form(
            "Map the hazard of scenarios",
            "Maps and answers",
            "Assigns every cell the highest hazard level of a guideline's matrix of return period and intensity over "
            "all scenarios, and writes raster, zones, table and a printed map (PDF). What could make a level too low "
            "is in the log: cells without data, return periods without a scenario.",
            name="hazard",
            prints=True,
            layers=(".tif", ".gpkg"),
            load="the map",
            one_of=("MAP", "OWN"),
            without=("frames", *OF_ONE_RUN),
            changes=(
                ("scenario", {"optional": False, "kind": "scenarios", "label": "Scenarios"}),
                ("output", {"label": "Folder for raster, zones, table and printed map"}),
            ),
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "tuple[Path, ...] | HazardFound":
    """Write the report, or with `map` the hazard map.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    tuple of Path, or HazardFound
    """
    _require_one_kind(asked)
    if asked["map"] is not None:
        from ..results.hazard.hazard_map import hazard_map as mapped

        return mapped(asked, progress)
    from ..results.reports.run_report import report as reported

    about = {"date": asked["date"] or date.today().isoformat(), "author": asked["author"], "client": asked["client"]}
    return reported(asked, asked["title"], asked["line"], asked["threshold"], about, asked["player"], progress)


def _require_one_kind(asked: Arguments) -> None:
    """Refuse options of a hazard map in a report of one run, and the other way round."""
    frames, given = asked["frames"], given_hazard_options(asked)
    if asked["map"] is None:
        if given:
            raise InputError(f"`{given[0]}` is for hazard maps; give `map` too, for example swiss-avalanche")
        if not frames:
            raise InputError("no results were given; give a folder of frames, an export or rasters")
        return
    if frames:
        raise InputError(f"{frames[0]}: a hazard map takes its results by `scenario`, for example 100={frames[0]}")
    for name in OF_ONE_RUN:
        if asked.get(name) != VERB.named()[name].default:
            instead = "; a hazard map takes `min_depth`" if name == "threshold" else ""
            raise InputError(f"`{name}` is for the report of one run{instead}")


def report(results: Results, output: PathLike | None = None, **options: Unpack[ReportOptions]) -> Path:
    """Write one HTML file about a run, as `mpmgis report`.

    Parameters
    ----------
    results : path or several
        Frames or the folder that holds them, an export, or rasters of peaks of another code.
    output : path, optional
        The file (.html) or a folder for it; default ``<name>_report`` beside the results.
    **options
        `ReportOptions`: title, line, threshold [m], ...

    Returns
    -------
    Path
        The HTML file.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> mpmgis.report("results", "report.html")  # doctest: +SKIP
    """
    with python_words(VERB):
        files = work(complete(VERB, {"frames": several(results), "output": output, **options}))
    return cast("tuple[Path, ...]", files)[0]


class HazardMapOptions(HazardOptions, QuestionOptions, total=False):
    """Options of `mpmgis.hazard_map`."""

    title: str
    author: str


def hazard_map(
    matrix: str,
    scenarios: Mapping[float, PathLike] | Iterable[tuple[float, PathLike]],
    output: PathLike | None = None,
    **options: Unpack[HazardMapOptions],
) -> "HazardFound":
    """Write a hazard map of several scenarios, as `mpmgis report --map`.

    Parameters
    ----------
    matrix : str
        A shipped one, for example "swiss-avalanche", or one of the file `matrices`.
    scenarios : dict of float to path, or iterable of (float, path)
        Return period [years] -> frames, an export, rasters of another code, or an ensemble; pairs for several results
        of one return period.
    output : path, optional
        Folder for all files, or one file by its suffix; default ``hazard_map`` beside the first results.
    **options
        `HazardMapOptions`: scale ("1:5000"), min_area [m2], sheet ("A3"), title, author, dem, min_depth [m], ...

    Returns
    -------
    HazardFound
        With the `matrix`, the plan `areas` of its levels [m2], the area `not_assessed` [m2], and the `files`.

    Raises
    ------
    MpmgisError
        An unknown matrix, unreadable input, or no cell with a level; nothing is written then.

    Examples
    --------
    >>> mpmgis.hazard_map("swiss-debris-flow", {30: "run_30", 300: "run_300"}, "map", scale="1:5000")  # doctest: +SKIP
    """
    pairs = scenarios.items() if isinstance(scenarios, Mapping) else scenarios
    given = tuple(f"{years}={path}" for years, path in pairs)
    with python_words(VERB):
        found = work(complete(VERB, {**options, "map": matrix, "scenario": given, "frames": (), "output": output}))
    return cast("HazardFound", found)
