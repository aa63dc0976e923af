"""`mpmgis vertical`: what a 3D flow is like over the height above its bed."""

import math
from pathlib import Path

from . import results_options
from .values import numbers, place, positive

EXAMPLE = """
mpmgis vertical results --at 312900,4008450
mpmgis vertical results --points points.gpkg --at-times 4,6,8 --width 10 --layer 1
"""
DESCRIPTION = """
Density, velocities along (Ut) and across the bed (Un) and impact pressure over the height above the bed, of 3D frames,
in square cells around points. Heights are along the bed's normal. Layer by layer a cell is averaged as in an export;
the pressure p of a layer is its density times the square of its mean speed, and its sum over the height the flux of
momentum: a force per width, with the height at which it acts. It does not hold the pressure of the weight above, which
presses at rest, too: that is the overburden, with a force per width and a height of its own. These are the flow's own
values where it passes: a wall would change them (a [[barrier]] in a run of points has forces in barriers.csv).
"""
HEADINGS = (
    "time [s]", "h normal [m]", "momentum [kN/m]", "at height [m]", "largest p [kPa]", "overburden [kN/m]",
    "at height [m]",
)  # fmt: skip
COLUMN_WIDTH = 19


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    results_options.add_arguments(parser, exports=False, cells=False)
    parser.add_argument("--points", type=Path, metavar="FILE", help="points, in any vector format")
    parser.add_argument(
        "--at", type=place, action="append", default=[], metavar="E,N", help="a point in the CRS of the DTM, repeatable"
    )
    parser.add_argument(
        "--at-times", type=numbers, metavar="T,..", help="times [s]; the nearest frames (default: five over the run)"
    )
    parser.add_argument("--width", type=positive, metavar="M", help="of the cell (default: 4 cells of the code's grid)")
    parser.add_argument(
        "--layer", type=positive, metavar="M", help="height of a layer (default: half a cell of that grid)"
    )
    results_options.add_output(parser, "vertical", "plot (.png) and tables (.csv)")


def run(arguments):
    """Write the profiles; loads and paths go to stdout."""
    from ..workflows.vertical import VerticalRequest, vertical

    request = results_options.answer_request(VerticalRequest, arguments)
    found = results_options.tell(lambda progress: vertical(request, progress))
    print("\n".join([*screen(found), *map(str, found.files)]))
    return 0


def screen(found):
    """Lines of text about a VerticalFound."""
    width = max(map(len, (*found.names, "point"))) + 2
    lines = [f"{'point':<{width}}" + "".join(f"{word:>{COLUMN_WIDTH}}" for word in HEADINGS)]
    for name, _, _, time, depth, momentum, height, largest, weight, height_of_weight in found.load_rows():
        cells = (time, depth, momentum / 1e3, height, largest / 1e3, weight / 1e3, height_of_weight)
        lines.append(f"{name:<{width}}" + "".join(f"{_text(value):>{COLUMN_WIDTH}}" for value in cells))
    return lines


def _text(value):
    return f"{value:.4g}" if math.isfinite(value) else "-"
