"""Options of start folders for other 3D solvers."""

from typing import Annotated, Literal, TypedDict

from ..system.option import Option, PathLike


def _window(values: tuple[float, ...]) -> str:
    west, south, east, north = values
    return "" if west < east and south < north else "four numbers W,S,E,N, west below east, south below north"


class SolverOptions(TypedDict, total=False):
    """Start files of another 3D solver."""

    solver: Annotated[
        Literal["kratos", "cbgeo", "geotaichi", "mpm-geomechanics", "houdini", "paraview"],
        Option(
            "write a start folder <name>_<solver> for this solver: its input files in local coordinates, the "
            "ground, a sidecar with the georeference for its results, README.txt",
            flag="--for",
            folded=False,
            usual="none",
            label="Code to start",
        ),
    ]
    material: Annotated[
        PathLike,
        Option(
            "with --for: scene with [material], or a TOML file with that table, optionally [friction] and [output] "
            "end_time [s]",
            "FILE",
            folded=False,
            label="Material",
            files="Materials (*.toml)",
        ),
    ]
    window: Annotated[
        tuple[float, float, float, float],
        Option(
            "with --for: extent of the ground for the solver, in map coordinates",
            "W,S,E,N",
            unit="m",
            check=_window,
            kind="extent",
            usual="the points' extent with a margin of its size",
            label="Extent of the ground for the code",
        ),
    ]
