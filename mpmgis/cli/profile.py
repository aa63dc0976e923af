"""`mpmgis profile`: a flow along a line."""

from pathlib import Path

from . import results_options
from .values import numbers, positive

EXAMPLE = """
mpmgis profile results --line line.gpkg
mpmgis profile results --line line.gpkg --at-times 20,40,60 --cs-e 2 -o profile.csv
mpmgis profile results_gis --line line.gpkg -o profile.png
"""
DESCRIPTION = """
Flow depth h, thickness t, velocities Un and Ut along a line as it is drawn, with terrain and free surface (the bed plus
h upright), as figure 2h and i of Vicari et al. (2025). Every place has the value of the cell that it lies in: nothing
is blended. The table has a row for each time and place.
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    results_options.add_arguments(parser)
    parser.add_argument("--line", type=Path, required=True, metavar="FILE", help="one line, in any vector format")
    parser.add_argument(
        "--at-times", type=numbers, metavar="T,..", help="times [s]; the nearest frames (default: five over the run)"
    )
    parser.add_argument("--spacing", type=positive, metavar="M", help="between places [m] (default: a cell)")
    results_options.add_output(parser, "profile", "plot (.png) and table (.csv)")


def run(arguments):
    """Write the profile; the paths go to stdout."""
    from ..workflows.profile import ProfileRequest, profile

    request = results_options.answer_request(ProfileRequest, arguments)
    found = results_options.tell(lambda progress: profile(request, progress))
    print("\n".join(str(file) for file in found.files))
    return 0
