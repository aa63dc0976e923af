"""`mpmgis hydrograph`: volume and mass through a section over time."""

from pathlib import Path

from . import results_options

EXAMPLE = """
mpmgis hydrograph results --section line.gpkg
mpmgis hydrograph results --section line.gpkg --method cells -o hydrograph.csv
"""
DESCRIPTION = """
Discharge of volume and mass through a section (one line across the flow), and the sums so far. By particles: each one's
straight way between two frames crosses the section or does not, which keeps mass exactly where the section cuts the
whole flow off; what went round its ends is told, and the mass beyond it is held against all of that. By cells: momentum
in the cells along the section at the frames, over time by the trapezoidal rule. The table has both; `auto` counts
particles and takes cells where they have no ids. Of an export it is the cells of its steps, which need the bands mass,
Ut_E and Ut_N (export-raster --products mass,Ut_E,Ut_N). Volume is the particles' own, current one, of an export mass
over density. Positive is the way in which more mass went.
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    results_options.add_arguments(parser)
    parser.add_argument("--section", type=Path, required=True, metavar="FILE", help="one line across the flow")
    parser.add_argument(
        "--method", choices=("auto", "particles", "cells"), default="auto", help="how it is counted (default auto)"
    )
    results_options.add_output(parser, "hydrograph", "plot (.png) and table (.csv)")


def run(arguments):
    """Write the hydrograph; figures and paths go to stdout."""
    from ..workflows.hydrograph import HydrographRequest, hydrograph

    request = results_options.answer_request(HydrographRequest, arguments)
    found = results_options.tell(lambda progress: hydrograph(request, progress))
    print("\n".join([*screen(found), *map(str, found.files)]))
    return 0


def screen(found):
    """Lines of text about a HydrographFound."""
    cells_volume, cells_mass = found.cells_totals()[-1]
    rate, time = found.peak()
    counted = f"{found.by_particles.sum()} of {len(found.by_particles)} intervals counted by particles"
    lines = [
        f"{found.name}: towards {found.azimuth:.0f} degrees from north; {counted}",
        f"through the section   {found.volume.sum():.6g} m3, {found.mass.sum():.6g} kg",
        f"by the cells' flux    {cells_volume:.6g} m3, {cells_mass:.6g} kg",
        f"largest discharge     {rate:.6g} m3/s, mean of the interval to {time:g} s",
    ]
    balance = found.balance
    if balance is not None:
        parts = f"{balance.crossed:.6g} through it, {balance.round_ends:.6g} round its ends, {balance.began:.6g}"
        lines.append(
            f"mass beyond it        {balance.beyond:+.6g} kg = {parts} begun there; error {balance.error:.1e} kg"
        )
    if found.unseen > 0:
        lines.append(f"up to {found.unseen:.6g} kg began or ended between two frames, and are counted from there on")
    return lines
