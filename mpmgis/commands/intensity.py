"""Assign intensity classes of a named guideline to cells: `mpmgis intensity`."""

from typing import TYPE_CHECKING, Annotated, TypedDict, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    from ..results.hazard.intensity_answer import IntensityFound


class IntensityGuideline(TypedDict, total=False):
    """The guideline, a parameter of its own in Python."""

    guideline: Annotated[
        str,
        Option(
            "a guideline of the list above, or of --guidelines",
            "NAME",
            required=True,
            folded=False,
            kind="choice",
            label="Guideline",
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


class IntensityOptions(QuestionOptions, total=False):
    """Options of `mpmgis.intensity`."""

    guidelines: Annotated[
        PathLike,
        Option(
            "your own guidelines, as TOML (docs/formats)",
            "FILE",
            label="Your own guidelines",
            files="Guidelines (*.toml)",
        ),
    ]
    buildings: Annotated[
        PathLike,
        Option(
            "polygons of buildings: also buildings.gpkg, their copy with the largest depth, speed, pressure, force "
            "and moment of each and the times of these; needs frames, or an export with Ut_E and Ut_N",
            "FILE",
            kind="polygon layer",
            label="Buildings, for estimates of their loads",
        ),
    ]
    drag: Annotated[
        float,
        Option(
            "coefficient C_d of the dynamic pressure C_d rho v^2 / 2 on --buildings; 2 is the momentum flux of a "
            "flow that a wall stops",
            "C",
            default=2.0,
            unit="1",
            above=0,
            label="Coefficient of the dynamic pressure on buildings",
        ),
    ]


class Arguments(IntensityGuideline, IntensityOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], shared_options.RESULTS_OR_RASTERS]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[
        PathLike,
        shared_options.output(
            "intensity",
            "raster (.tif), style (.qml), polygons (.gpkg), table (.csv) and map (.png)",
            "raster, polygons, table and map",
        ),
    ]


VERB = Verb(
    name="intensity",
    place=15,
    line="intensity classes of a named guideline, as raster and polygons",
    options=IntensityOptions,
    arguments=Arguments,
    groups=GROUPS,
    example="""
mpmgis intensity results --guideline swiss-debris-flow
mpmgis intensity results_gis --guideline austrian-avalanche -o zones
mpmgis intensity results --guideline swiss-debris-flow --buildings houses.gpkg
mpmgis intensity results --guideline mine --guidelines my_guidelines.toml -o classes.tif
""",
    description="""
Assigns every cell that the flow reached to a class of a named guideline, by the largest depth, speed, impact pressure
or final depth of the cell. The maxima of a cell can be from different times, so classes from two of them are
conservative. Depth is normal to the slope. Pressure is the density of the release times the squared mean speed.
A hazard zone also depends on the scenario's return period and on the authority: read the guideline.
""",
    forms=(
        Form(
            "Classify intensity by a guideline",
            "Maps and answers",
            "Assigns every cell that the flow reached to a class of a named guideline, by the largest depth, speed, "
            "pressure or final depth. Areas are in the log. A hazard zone also depends on the scenario's return period "
            "and on the authority: read the guideline.",
            prints=True,
            layers=(".tif",),
            load="the classes",
            one_of=("GUIDELINE", "OWN"),
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "IntensityFound":
    """Answer the question, and write plot and table.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    IntensityFound
    """
    from ..results.hazard.intensity_answer import intensity

    own = asked["guidelines"], asked["buildings"]
    return intensity(asked, asked["guideline"], *own, asked["drag"], progress)


def intensity(
    results: Results, guideline: str, output: PathLike | None = None, **options: Unpack[IntensityOptions]
) -> "IntensityFound":
    """Assign intensity classes of a named guideline to cells, as `mpmgis intensity`.

    Parameters
    ----------
    results : path or several
        Frames or the folder that holds them, an export, or rasters of peaks of another code.
    guideline : str
        A shipped one, for example "swiss-debris-flow", or one of the file `guidelines`.
    output : path, optional
        Folder for raster, style, polygons, table and map, or one file by its suffix; default ``<name>_intensity``
        beside the results.
    **options
        `IntensityOptions`: guidelines, min_depth [m], density [kg m-3], ...

    Returns
    -------
    IntensityFound
        With the `guideline`, the plan `areas` of its classes [m2], and the `files`.

    Raises
    ------
    MpmgisError
        An unknown guideline, unreadable input, or a flow that reached no cell; nothing is written then.

    Examples
    --------
    >>> found = mpmgis.intensity("results_gis", "austrian-avalanche")  # doctest: +SKIP
    >>> rioxarray.open_rasterio(found.files[0]).plot()  # doctest: +SKIP
    """
    with python_words(VERB):
        given = {"frames": several(results), "guideline": guideline, "output": output, **options}
        return work(complete(VERB, given))
