"""Compare two results, or a result and an observed outline, in numbers and on a map: `mpmgis compare`."""

from typing import TYPE_CHECKING, Annotated, Unpack

from ..frames.frame_options import MetricTerrainOptions
from ..results.question_options import ReadingOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from ..system.work_options import OverwriteOptions
from .verb import Form, Verb
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    from ..results.comparison_answer import Comparison


class CompareOptions(OverwriteOptions, ReadingOptions, MetricTerrainOptions, total=False):
    """Options of `mpmgis.compare`."""

    threshold: Annotated[
        float,
        Option(
            "footprint: cells above this [m, or the unit of --band]",
            "M",
            default=0.1,
            least=0,
            folded=False,
            label="Footprint: cells above this [m]",
        ),
    ]
    band: Annotated[
        str,
        Option(
            "band whose footprint is compared, for example h_deposit with a mapped deposit",
            "NAME",
            usual="peak thickness, pft or h_max",
            label="Band whose footprint is compared",
        ),
    ]
    line: Annotated[
        PathLike,
        Option(
            "line along which runout is measured, from its top",
            "FILE",
            usual="the centre line of both flows",
            kind="line layer",
            folded=False,
            label="Line along which runout is measured, from its top",
        ),
    ]
    dem: Annotated[
        PathLike,
        Option(
            "DTM for the line, the map and the export of runs",
            "FILE",
            usual="that of the results",
            kind="raster layer",
            label="Terrain model, if not that of the results",
        ),
    ]


class Arguments(CompareOptions, total=False):
    """Options of the command."""

    first: Annotated[
        PathLike,
        Option(
            "a result or an outline",
            "A",
            positional="one",
            kind="folder",
            folded=False,
            label="Results: folder of maps or frames",
        ),
    ]
    second: Annotated[
        PathLike,
        Option(
            "the other one; differences are A - B",
            "B",
            positional="one",
            kind="folder",
            folded=False,
            label="Compared with: folder of other results",
            also=(
                {
                    "name": "OUTLINE",
                    "kind": "polygon layer",
                    "label": "or: with an observed outline",
                    "help": "Polygons of the area that the event reached.",
                },
            ),
        ),
    ]
    json: Annotated[
        bool,
        Option(
            "print JSON, in SI units",
            default=False,
            no_form="for programs; the figures are in the log and in the table",
        ),
    ]
    output: Annotated[
        PathLike,
        Option(
            "write a map (.png), a table (.csv), classes (.tif: 1 only A, 2 only B, 3 both), or a folder of all",
            "PATH",
            short="-o",
            folded=False,
            kind="new folder",
            label="Folder for map, table and classes, if any",
        ),
    ]


VERB = Verb(
    name="compare",
    place=16,
    line="two results, or a result and an observed outline, in numbers and on a map",
    options=CompareOptions,
    arguments=Arguments,
    groups=(("another code's particle files, of either side", ReadingOptions),),
    example="""
mpmgis compare results_gis other_gis
mpmgis compare results_gis mapped_outline.gpkg --line flow_path.shp -o comparison
mpmgis compare results_gis reference/com1DFA --threshold 0.1 -o map.png
mpmgis compare results matter --axes e,u,-n --origin 600000,5170000,0 --density 1500 --dem dtm.tif
""",
    description="""
Area, runout, peaks, and the overlap of the footprints (IoU: the area in both over the area in either). A and B are
each an export (results_gis), the folder of a run, another code's particles (a folder or a file), rasters named *_pft,
*_pfv, *_ppr as ISeeSnow and AvaFrame do (their folder, or the beginning of their names), one raster, or an outline as
polygons. The maxima of another code's particles are those of the existing frames. Each side's area, runout and
peaks are taken on its own cells; overlap and differences on the cells of the finer side, with the other side's value
at the cell centre (nearest, without interpolation). With an outline, area that only the result covers is
overestimated, area that only the outline covers underestimated. Distances between outlines go from points on one, half
a cell apart, to the nearest point on the other; a raster's outline runs along its cells. Runout is the distance along
the line, from its start, to the farthest cell of the footprint; each cell counts at the nearest point of the line,
which is extended straight at its end. Without --line the line is the centre line of both flows together, from their
highest part.
""",
    forms=(
        Form(
            "Compare with a result or an outline",
            "Maps and answers",
            "Compares a result with another one or with an observed outline: area, runout, peaks, and the overlap of "
            "the two footprints. The figures are in the log; with a folder also a map (.png), a table (.csv) and "
            "classes.tif (1 only the first, 2 only the second, 3 both).",
            prints=True,
            plots=True,
            layers=(".tif",),
            load="the classes",
            palette=((1, "#d95f02", "only the first"), (2, "#1b6fc2", "only the second"), (3, "#7f5aa5", "both")),
            one_of=("SECOND", "OUTLINE"),
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "Comparison":
    """Answer the question, and write plot and table.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Not called.

    Returns
    -------
    Comparison
    """
    from ..results.comparison_answer import compare

    return compare(
        asked["first"],
        asked["second"],
        asked,
        threshold=asked["threshold"],
        band=asked["band"],
        line=asked["line"],
        dem=asked["dem"],
        to_crs=asked["to_crs"],
        output=asked["output"],
        overwrite=asked["overwrite"],
    )


def compare(
    first: PathLike, second: PathLike, output: PathLike | None = None, **options: Unpack[CompareOptions]
) -> "Comparison":
    """Compare two results, or a result and an observed outline, in numbers and on a map, as `mpmgis compare`.

    Parameters
    ----------
    first, second : path
        Each an export, the folder of a run, another code's particles, rasters of peaks, one raster, or an outline as
        polygons.
    output : path, optional
        Folder for map, table and classes, or one of them by its suffix; default: nothing is written.
    **options
        `CompareOptions`: threshold [m], band, line, dem, ...

    Returns
    -------
    Comparison
        With `sides`, `overlap`, `bands`, `rows()` and `facts()`, a dictionary for pandas.

    Raises
    ------
    MpmgisError
        An input cannot be read or does not match, or the output exists; nothing is written then.

    Examples
    --------
    >>> mpmgis.compare("results_gis", "mapped_outline.gpkg").overlap.iou  # doctest: +SKIP
    """
    with python_words(VERB):
        return work(complete(VERB, {"first": first, "second": second, "output": output, **options}))
