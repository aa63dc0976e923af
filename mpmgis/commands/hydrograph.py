"""Compute volume and mass through a section over time: `mpmgis hydrograph`."""

from typing import TYPE_CHECKING, Annotated, Literal, TypedDict, Unpack

from ..results.question_options import GROUPS, QuestionOptions
from ..system.messages import Progress, unwatched
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import Results, complete, python_words, several

if TYPE_CHECKING:
    import xarray

    from ..results.hydrograph_answer import HydrographFound


class HydrographSection(TypedDict, total=False):
    """The section of a hydrograph, a parameter of its own in Python."""

    section: Annotated[
        PathLike,
        Option(
            "one line across the flow; positive discharge is the direction of more mass",
            "FILE",
            required=True,
            kind="line layer",
            folded=False,
            label="Section: one line across the flow",
        ),
    ]


class HydrographOptions(QuestionOptions, total=False):
    """Options of `mpmgis.hydrograph`."""

    method: Annotated[
        Literal["auto", "particles", "cells"],
        Option(
            "count particles or integrate cells; auto: particles, or cells where particles have no ids",
            default="auto",
            label="Method",
        ),
    ]


class Arguments(HydrographSection, HydrographOptions, total=False):
    """Options of the command."""

    frames: Annotated[tuple[PathLike, ...], shared_options.RESULTS]
    json: Annotated[bool, shared_options.JSON]
    output: Annotated[PathLike, shared_options.output("hydrograph", "plot (.png) and table (.csv)", "plot and table")]


VERB = Verb(
    name="hydrograph",
    place=13,
    line="volume and mass through a section over time",
    options=HydrographOptions,
    arguments=Arguments,
    groups=GROUPS,
    example="""
mpmgis hydrograph results --section line.gpkg
mpmgis hydrograph results --section line.gpkg --method cells -o hydrograph.csv
""",
    description="""
Discharge of volume and mass through a section (one line across the flow), and the cumulative sums. By particles: the
straight path of a particle between two frames crosses the section or not. Mass is exact where the section cuts the
whole flow; the mass that passes around its ends is reported, and the sum is compared with the mass beyond the section.
By cells: momentum in the cells along the section at the frames, integrated over time by the trapezoidal rule. The table
contains both; `auto` counts particles, or uses cells where particles have no ids. An export is evaluated by the cells
of its steps, which need the bands mass, Ut_E and Ut_N (export-raster --products mass,Ut_E,Ut_N). Volume is the current
volume of the particles, for an export mass over density. Positive is the direction of more mass.
""",
    forms=(
        Form(
            "Show the hydrograph of a section",
            "Maps and answers",
            "Volume and mass that go through a line across the flow, over time: a plot (.png) and a table (.csv). The "
            "sums are in the log.",
            prints=True,
            plots=True,
        ),
    ),
)


def work(asked: Arguments, progress: Progress = unwatched) -> "HydrographFound":
    """Answer the question, and write plot and table.

    Parameters
    ----------
    asked : Arguments
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    HydrographFound
    """
    from ..results.hydrograph_answer import hydrograph

    return hydrograph(asked, asked["section"], asked["method"], progress)


def hydrograph(
    results: Results, section: PathLike, output: PathLike | None = None, **options: Unpack[HydrographOptions]
) -> "xarray.Dataset":
    """Compute volume and mass through a section over time, as `mpmgis hydrograph`.

    Parameters
    ----------
    results : path or several
        Frames or the folder that holds them, or an export with the bands mass, Ut_E and Ut_N.
    section : path
        Vector file with one line across the flow.
    output : path, optional
        Folder for the plot and the table, or one file by its suffix; default ``<name>_hydrograph`` beside the results.
    **options
        `HydrographOptions`: method, cell_size [m], ...

    Returns
    -------
    xarray.Dataset
        volume [m3] and mass [kg] of each interval that ends at time [s], and by_particles; its attributes have the
        direction `azimuth` [degrees] and the `files` that were written.

    Raises
    ------
    MpmgisError
        Unreadable input, a section that crosses itself or lies outside the raster, a single frame.

    Examples
    --------
    >>> mpmgis.hydrograph("results", "section.gpkg").volume.cumsum().plot()  # doctest: +SKIP
    """
    from ..results.answer_datasets import hydrograph_dataset

    with python_words(VERB):
        given = {"frames": several(results), "section": section, "output": output, **options}
        return hydrograph_dataset(work(complete(VERB, given)))
