"""`mpmgis timeseries`: a flow at points over time."""

import math
from pathlib import Path

from . import results_options
from .values import place

EXAMPLE = """
mpmgis timeseries results --points points.gpkg
mpmgis timeseries results --at 312900,4008450 --at 313100,4008160 --cs-e 5 -o series.csv
"""
DESCRIPTION = """
Flow depth h, thickness t, velocities Un and Ut and impact pressure p (density of the release times the squared speed)
in the cells that points lie in, for every frame. Points have the names of a column `name`, else numbers.
"""
HEADINGS = ("point", "arrival [s]", "largest h [m]", "at [s]", "largest Ut [m/s]", "at [s]")


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    results_options.add_arguments(parser)
    parser.add_argument("--points", type=Path, metavar="FILE", help="points, in any vector format")
    parser.add_argument(
        "--at",
        type=place,
        action="append",
        default=[],
        metavar="E,N",
        help="a point in the CRS of the DTM, as often as wanted",
    )
    results_options.add_output(parser, "timeseries", "plot (.png) and table (.csv)")


def run(arguments):
    """Write the series; a line a point and the paths go to stdout."""
    from ..workflows.timeseries import TimeseriesRequest, timeseries

    request = results_options.answer_request(TimeseriesRequest, arguments)
    found = results_options.tell(lambda progress: timeseries(request, progress))
    print("\n".join([*screen(found, arguments.min_depth), *map(str, found.files)]))
    return 0


def screen(found, min_depth):
    """Lines of text about a SeriesFound."""
    width = max(map(len, (*found.names, HEADINGS[0]))) + 2
    lines = [f"{HEADINGS[0]:<{width}}" + "".join(f"{word:>18}" for word in HEADINGS[1:])]
    for point, name in enumerate(found.names):
        numbers = found.arrival(point, min_depth), *found.peak("h", point), *found.peak("Ut", point)
        lines.append(f"{name:<{width}}" + "".join(f"{_text(value):>18}" for value in numbers))
    return lines


def _text(value):
    return f"{value:.4g}" if math.isfinite(value) else "-"
