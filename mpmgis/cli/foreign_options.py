"""Options for another code's particle files: what they do not say themselves."""

import argparse
from pathlib import Path

from .values import number, numbers, positive


def add_arguments(group, with_times=True):
    """Declare them; `with_times` where several files are given at once."""
    group.add_argument("--reader", metavar="NAME", help="code whose files these are (default: known by their contents)")
    group.add_argument("--origin", type=_origin, metavar="E,N,H", help="map position of the file's own origin [m]")
    group.add_argument(
        "--axes", type=_axes, metavar="X,Y,Z", help="where its x, y, z point: e,n,u; e,u,-n (y is up); .."
    )
    if with_times:
        group.add_argument("--times", type=numbers, metavar="T,..", help="time of each file [s], by their numbers")
    group.add_argument("--dt", type=positive, metavar="S", dest="frame_step", help="or: seconds from number to number")
    group.add_argument("--fps", type=positive, metavar="F", dest="frames_per_second", help="or: numbers a second")
    group.add_argument(
        "--columns",
        type=_columns,
        metavar="NAME=COL,..",
        default=(),
        help="the file's columns for x, y, z, vx, vy, vz, mass, volume, radius, diameter, id, active, time, where they "
        "have other names; of three components each: position, velocity",
    )
    group.add_argument("--particle-volume", type=positive, metavar="V", help="volume of every particle [m3]")
    group.add_argument(
        "--sidecar",
        type=Path,
        metavar="FILE",
        help="file that tells all this (default: <name>.georef.json or georef.json beside them); options override it",
    )


def terms(arguments):
    """Declarations of the parsed arguments."""
    from ..interop.declarations import Declarations

    return Declarations.named(vars(arguments) | {"time_step": arguments.frame_step}, arguments.crs)


def _origin(text):
    values = tuple(number(part) for part in text.split(","))
    if len(values) != 3:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted three numbers E,N,H")
    return values


def _axes(text):
    words = tuple(word.strip().lower() for word in text.split(","))
    if len(words) != 3:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted three directions, for example e,u,-n")
    return words


def _columns(text):
    pairs = tuple(tuple(word.strip() for word in part.split("=", 1)) for part in text.split(","))
    if not all(len(pair) == 2 and all(pair) for pair in pairs):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted NAME=COLUMN with commas between, for example mass=m")
    return pairs
