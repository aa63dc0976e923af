"""Options that make `seed` and `convert` write what another 3D solver starts from."""

import argparse
from pathlib import Path

from .values import numbers

SOLVERS = ("kratos", "cbgeo", "geotaichi", "mpm-geomechanics", "houdini", "paraview")
_OPTIONS = {"material": "--material", "window": "--window"}


def add_arguments(parser):
    """Declare the options; answers their group."""
    group = parser.add_argument_group("for another 3D solver")
    group.add_argument(
        "--for",
        dest="solver",
        choices=SOLVERS,
        help="write a folder from which this solver starts: its own files in local coordinates, the ground, a sidecar "
        "that brings its results back to the map, README.txt (default: <name>_<solver>)",
    )
    group.add_argument(
        "--material",
        type=Path,
        metavar="FILE",
        help="with --for: scene with [material], or a TOML file with that table, maybe [friction], [output] end_time",
    )
    group.add_argument(
        "--window",
        type=_window,
        metavar="W,S,E,N",
        help="with --for: ground that the solver gets, in map coordinates [m] (default: the points' extent, as much "
        "again around them)",
    )
    return group


def _window(text):
    west, south, east, north = values = numbers(text) if text.count(",") == 3 else (None,) * 4
    if west is None or not (west < east and south < north):
        raise argparse.ArgumentTypeError(
            f"got {text!r}, wanted four numbers W,S,E,N, west below east, south below north"
        )
    return values


def refuse_without_solver(arguments):
    """Raise InputError for options that only mean something with --for."""
    from ..errors import InputError

    for name, option in _OPTIONS.items():
        if getattr(arguments, name) is not None:
            raise InputError(f"{option} belongs to --for; leave it out, or say for which solver")


def request_of(arguments):
    """The StartRequest in the options."""
    from ..workflows.solver_start import StartRequest

    return StartRequest(
        arguments.solver, arguments.output, arguments.overwrite, arguments.cell, arguments.window, arguments.material
    )
