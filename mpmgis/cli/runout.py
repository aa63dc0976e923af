"""`mpmgis runout`: how far a flow ran, how deep it fell, and the angles of it."""

import argparse
import json
import math
from pathlib import Path

from . import results_options
from .values import positive

EXAMPLE = """
mpmgis runout results
mpmgis runout results --line flow_path.gpkg --threshold 0.5 -o runout
mpmgis runout results --json -o profile.png
"""
DESCRIPTION = """
Runout along the flow line from the highest to the farthest cell that the flow ever covered, drop height, angle of the
energy line (Fahrboeschung) between the two; the same for what lies at the end; the angle under which the centre of mass
travelled, which for Coulomb friction alone has the tangent mu; and up to where 99 % of the mass lie at the end. Without
--line the line is the flow's own centre line, from its highest part. Distances are horizontal and along the line;
runout_straight is as the crow flies, runout_along_ground along the terrain. Of an export the way of the mass is not
known.
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    results_options.add_arguments(parser, rasters=True)
    parser.add_argument("--line", type=Path, metavar="FILE", help="line that the flow took, from the top")
    parser.add_argument(
        "--threshold", type=positive, metavar="M", default=0.1, help="cells deeper than this were reached (default 0.1)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    results_options.add_output(parser, "runout", "plot (.png) and tables (.csv)")


def run(arguments: argparse.Namespace):
    """Find the figures; they go to stdout, then the paths of the files."""
    from ..workflows.runout import RunoutRequest, runout

    request = results_options.answer_request(RunoutRequest, arguments)
    found = results_options.tell(lambda progress: runout(request, progress))
    print(json.dumps(found.facts(), indent=1, allow_nan=False) if arguments.json else "\n".join(screen(found)))
    return 0


def screen(found):
    """Lines of text about a RunoutFound."""
    lines = [f"{found.name}: cells deeper than {found.threshold:g} m, along {found.line_source}"]
    for quantity, unit, value in found.rows():
        head = f"{quantity.replace('_', ' ')} [{unit}]" if unit != "1" else quantity.replace("_", " ")
        lines.append(f"{head:<40}{_text(value):>10}")
    return lines + [str(file) for file in found.files]


def _text(value):
    if not math.isfinite(value):
        return "-"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3f}"
