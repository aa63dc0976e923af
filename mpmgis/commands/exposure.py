"""Find what reaches roads, railways, masts and buildings: `mpmgis exposure`."""

from typing import TYPE_CHECKING, Annotated, TypedDict, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    from ..results.exposure_answer import ExposureFound


class ExposedObjects(TypedDict, total=False):
    """The objects, a parameter of its own in Python."""

    objects: Annotated[
        PathLike,
        Option(
            "roads, railways, masts, buildings: points, lines and polygons of any vector file",
            "FILE",
            required=True,
            keep_text=True,
            folded=False,
            kind="file",
            label="Objects: points, lines or polygons",
        ),
    ]


class ExposureOptions(QuestionOptions, total=False):
    """Options of `mpmgis.exposure`."""


class Arguments(ExposedObjects, ExposureOptions, total=False):
    """Options of the command."""

    frames: Annotated[
        tuple[PathLike, ...],
        Option(
            "one or several results, each a scenario: the folder of frames of a run or of another code, an export, "
            "(the beginning of the names of) rasters named *_pft, *_pfv, *_ppr, the folder of a region, or the "
            "beginning of the names of its maps of one scenario",
            "RESULTS",
            positional="many",
            kind="folder",
            folded=False,
            label="Results: folder of frames, of maps, or of a region",
        ),
    ]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[
        PathLike, shared_options.output("exposure", "tables (.csv) and objects (.gpkg)", "tables and objects")
    ]


VERB = Verb(
    name="exposure",
    place=18,
    line="what reaches roads, masts and buildings, by scenario and by release area",
    options=ExposureOptions,
    arguments=Arguments,
    groups=GROUPS,
    example="""
mpmgis exposure results --objects roads.gpkg
mpmgis exposure run_30 run_100 run_300 --objects buildings.gpkg -o exposure
mpmgis exposure region --objects railway.geojson
mpmgis exposure region/maps/scenario_30 region/maps/scenario_100 --objects roads.gpkg
""",
    description="""
For each object and result: the length of lines or area of polygons that the flow reached, the largest depth, speed and
pressure there, and the time of first arrival. A cell counts as reached from --min-depth. Lines and polygons are cut at
the borders of cells, a point has the values of its cell. Each result is a scenario. For a region the release areas that
reach each object are listed, and release_areas.csv has the figures of each of them. exposure.gpkg has the objects with
the largest values of all scenarios. Depth is normal to the slope; the objects do not change the flow.
""",
    forms=(
        Form(
            "Find objects at risk",
            "Maps and answers",
            "What reaches roads, railways, masts and buildings: length or area, largest depth, speed and pressure, "
            "time of first arrival; of a region also the release areas that reach each object. The figures are in the "
            "log.",
            prints=True,
            layers=(".gpkg",),
            load="the objects",
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "ExposureFound":
    """Answer the question, and write tables and layer.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    ExposureFound
    """
    from ..results.exposure_answer import exposure

    return exposure(asked, asked["objects"], progress)


def exposure(
    results: Results, objects: PathLike, output: PathLike | None = None, **options: Unpack[ExposureOptions]
) -> "ExposureFound":
    """Find what reaches roads, railways, masts and buildings, as `mpmgis exposure`.

    Parameters
    ----------
    results : path or several
        Each is a scenario: a folder of frames, an export, rasters of peaks of another code, or a region.
    objects : path
        Points, lines and polygons of any vector file.
    output : path, optional
        Folder for the tables and the objects, or one file by its suffix; default ``<name>_exposure`` beside the first
        result.
    **options
        `ExposureOptions`: min_depth [m], cell_size [m], dem, ...

    Returns
    -------
    ExposureFound
        With `rows()`: a row for each scenario and object, `area_rows()`: one for each object and release area of a
        region that reaches it, and the `files`.

    Raises
    ------
    MpmgisError
        Unreadable input, or no object; nothing is written then.

    Examples
    --------
    >>> found = mpmgis.exposure(["run_30", "run_100"], "roads.gpkg")  # doctest: +SKIP
    >>> pandas.DataFrame(found.rows(), columns=[name for name, _ in found.columns()])  # doctest: +SKIP
    """
    with python_words(VERB):
        given = {"frames": several(results), "objects": objects, "output": output, **options}
        return work(complete(VERB, given))
