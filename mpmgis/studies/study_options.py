"""Options of a study of accuracy against computing time."""

from typing import Annotated, Literal

from ..simulation.simulation_options import LAW, THREADS
from ..system.option import Option, PathLike
from ..system.work_options import OverwriteOptions


class StudyOptions(OverwriteOptions, total=False):
    """Options of `mpmgis.study`."""

    target_error: Annotated[
        float,
        Option(
            "print the settings for this error; 0.05 is 5 %%, with --measure reach in metres",
            "E",
            above=0,
            folded=False,
            label="Find the settings for this error [1, or m]",
        ),
    ]
    knobs: Annotated[
        tuple[str, ...],
        Option(
            "change only these settings: cell_size, particles_per_cell, cfl; in 3D also points_per_cell, precision, "
            "stiffness",
            "NAME,..",
            usual="all settings of the scene",
            folded=False,
            label="Change only these settings, with commas",
        ),
    ]
    cell_sizes: Annotated[
        tuple[float, ...],
        Option(
            "cell sizes to run",
            "M,..",
            unit="m",
            above=0,
            usual="2, 1.4, 1, 0.7 times the scene's",
            folded=False,
            label="Cell sizes to run, with commas",
        ),
    ]
    repeats: Annotated[
        int,
        Option(
            "runs of each setting; the time is their median",
            "N",
            default=3,
            above=0,
            folded=False,
            label="Runs of each setting",
        ),
    ]
    measure: Annotated[
        Literal["thickness", "momentum", "area", "reach"],
        Option("error measure; reach in m, the others relative", default="thickness", label="Error measure"),
    ]
    exact: Annotated[
        PathLike,
        Option(
            "raster of the exact vertical thickness at end_time",
            "FILE",
            unit="m",
            usual="a finer run",
            kind="raster layer",
            label="Exact solution: vertical thickness at the end",
        ),
    ]
    refinement: Annotated[
        float,
        Option(
            "the cell size of the finer run is the scene's divided by this number",
            "F",
            above=0,
            usual="the smallest cell size over 1.4",
            label="Cell size of the finer run: the scene's divided by",
        ),
    ]
    beside: Annotated[
        tuple[PathLike, ...],
        Option(
            "also show these results of other codes: columns setting, seconds and error_thickness, or thickness; "
            "repeatable",
            "CSV",
            default=(),
            repeat=True,
            label="Also show these results of other codes",
        ),
    ]
    full: Annotated[
        bool,
        Option(
            "also run all combinations of three values of each",
            default=False,
            label="All combinations of three values of each setting",
        ),
    ]
    exports: Annotated[
        bool,
        Option(
            "do not study cell size and time step of exports",
            default=True,
            flag="--no-exports",
            turned_off=True,
            field="NO_EXPORTS",
            label="Do not study cell size and time step of exports",
        ),
    ]
    threads: Annotated[int, THREADS]
    law: Annotated[PathLike, LAW]


class AskedStudy(StudyOptions, total=False):
    """A study: options, the scene and the folder to write."""

    scene: PathLike
    output: PathLike
