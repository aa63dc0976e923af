"""Write one HTML file about a run, or a hazard map of several scenarios: `mpmgis report`."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypedDict, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, answer, called

if TYPE_CHECKING:
    from ..results.hazard.hazard_map import HazardFound

HAZARD = ("map", "scenario", "scale", "min_area", "sheet", "matrices", "guidelines")


class HazardOptions(TypedDict, total=False):
    """Options of a hazard map."""

    map: Annotated[
        str,
        Option(
            "a hazard map of the scenarios instead of a report: a matrix of return period and intensity of the list "
            "above, or of --matrices",
            "MATRIX",
            kind="choice",
            folded=False,
            label="Matrix",
            also=(
                {
                    "name": "OWN",
                    "kind": "text",
                    "label": "or: name of one of your own",
                    "advanced": True,
                    "help": "As its file has it.",
                },
            ),
        ),
    ]
    scenario: Annotated[
        tuple[str, ...],
        Option(
            "return period in years and results: frames, an export, the beginning of the names of rasters, or an "
            "ensemble; repeatable",
            "T=RESULTS",
            default=(),
            repeat=True,
            folded=False,
            label="Scenarios: return period in years = results, one a line",
        ),
    ]
    scale: Annotated[
        str,
        Option(
            "scale of the printed map, to which outlines are simplified",
            "1:N",
            usual="the largest usual one that fits on the paper",
            folded=False,
            label="Scale of the map, 1:N",
        ),
    ]
    min_area: Annotated[
        float,
        Option(
            "smallest area of the zones; smaller gaps are filled, smaller parts enlarged",
            "A",
            unit="m2",
            least=0,
            usual="that of 2 mm x 2 mm on the map",
            label="Smallest area of the zones",
        ),
    ]
    sheet: Annotated[
        Literal["A4", "A3"], Option("paper of the printed map", flag="--paper", default="A4", label="Paper")
    ]
    matrices: Annotated[
        PathLike,
        Option(
            "your own matrices, as TOML (docs/guide/hazard-map)",
            "FILE",
            label="Your own matrices",
            files="Matrices (*.toml)",
        ),
    ]
    guidelines: Annotated[
        PathLike,
        Option(
            "your own intensity classes for them, as TOML (docs/guide/hazard-map)",
            "FILE",
            label="Your own intensity classes",
            files="Guidelines (*.toml)",
        ),
    ]


class ReportOptions(QuestionOptions, total=False):
    """Options of `mpmgis.report`."""

    title: Annotated[
        str, Option("heading of the report", "TEXT", usual="the name of the results", folded=False, label="Heading")
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
    workflow="results.reports.run_report:report",
    options=ReportOptions,
    arguments=Arguments,
    groups=(("hazard map", HazardOptions), *GROUPS),
    example="""
mpmgis report results
mpmgis report results --title "Rock avalanche, scenario 300 years" -o scenario_300.html
mpmgis report --map swiss-debris-flow --scenario 30=results_30 --scenario 300=results_300 --scale 1:5000 -o map
""",
    description="""
One HTML file with maps of the largest depth, speed and pressure and of the last depth, figures of the runout with a
longitudinal profile, places (largest depth and speed, where mass left), a page for each barrier (loads over time,
run-up, overtopping, whether its loads are usable, plan, section), balances, warnings, effects and why they are on or
off, parameters, versions and digests. Pictures are embedded; it needs no network and no scripts. Print it from any
browser to get a PDF. For frames of other codes, an export or rasters named <name>_pft, <name>_pfv [m/s], <name>_ppr
[kPa] it is limited to the contents of these files.

With --map: a hazard map of several scenarios as raster (.tif, .qml), zones (.gpkg), table (.csv) and printed map (.pdf,
.png). Every cell has the highest level of the matrix of a guideline over all scenarios. What could make a level too low
is reported: cells without data, return periods without a scenario. The matrices have sources in summaries, and marks
where a number was not read: check them in the guideline.
""",
    forms=(
        Form(
            "Report",
            "Maps and answers",
            "One HTML file with maps, figures of the runout with a profile, balances, warnings, effects and why they "
            "are on or off, parameters, versions and digests.",
            without=HAZARD,
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
            "Hazard map of scenarios",
            "Maps and answers",
            "Assigns every cell the highest hazard level of a guideline's matrix of return period and intensity over "
            "all scenarios, and writes raster, zones, table and a printed map (PDF). What could make a level too low "
            "is in the log: cells without data, return periods without a scenario.",
            name="hazard",
            prints=True,
            layers=(".tif", ".gpkg"),
            load="the map",
            one_of=("MAP", "OWN"),
            without=("frames", "line", "threshold"),
            changes=(
                ("scenario", {"optional": False}),
                ("output", {"label": "Folder for raster, zones, table and printed map"}),
            ),
        ),
    ),
)


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
    files: tuple[Path, ...] = answer(VERB, results, output, options)
    return files[0]


class HazardMapOptions(HazardOptions, QuestionOptions, total=False):
    """Options of `mpmgis.hazard_map`."""

    title: str


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
        `HazardMapOptions`: scale ("1:5000"), min_area [m2], sheet ("A3"), title, dem, min_depth [m], ...

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
    return called(VERB, {**options, "map": matrix, "scenario": given, "frames": (), "output": output})
