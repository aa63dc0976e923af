"""`mpmgis report`: one HTML file about a run."""

from pathlib import Path

from . import results_options
from .values import positive

EXAMPLE = """
mpmgis report results
mpmgis report results --title "Rock avalanche, scenario 300 years" -o scenario_300.html
"""
DESCRIPTION = """
One HTML file with maps of the largest depth, speed and pressure and of the last depth, figures of the runout with a
longitudinal profile, balances, warnings, effects and why they are on or off, parameters, versions and digests. Pictures
are inside; it needs no network and no scripts. Print it from any browser to have a PDF. Of other codes' frames it tells
what the frames tell, of an export or rasters called <name>_pft, <name>_pfv [m/s], <name>_ppr [kPa] what these tell.
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    results_options.add_arguments(parser, rasters=True)
    parser.add_argument("--title", metavar="TEXT", help="heading of the report")
    parser.add_argument("--line", type=Path, metavar="FILE", help="line that the flow took, as of mpmgis runout")
    parser.add_argument(
        "--threshold", type=positive, metavar="M", default=0.1, help="cells deeper than this were reached (default 0.1)"
    )
    results_options.add_output(parser, "report", "report.html")


def run(arguments):
    """Write the report; its path goes to stdout."""
    from ..workflows.report import ReportRequest, report

    request = results_options.answer_request(ReportRequest, arguments)
    files = results_options.tell(lambda progress: report(request, progress))
    print("\n".join(str(file) for file in files))
    return 0
