"""`mpmgis qgis-plugin`: the toolbox for QGIS as a zip."""

import shutil
import sys
from pathlib import Path

from . import talk

EXAMPLE = """
mpmgis qgis-plugin
mpmgis qgis-plugin -o toolbox/mpmgis_qgis.zip
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("mpmgis_qgis.zip"),
        metavar="FILE.zip",
        help="zip to write (default: mpmgis_qgis.zip)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier file of that name")
    group = parser.add_argument_group("for the plugin repository")
    group.add_argument("--homepage", metavar="URL", help="of the source code; its issues are at URL/issues")
    group.add_argument("--email", metavar="ADDRESS", help="of who publishes the plugin")


def run(arguments):
    """Write the zip; prints its path."""
    from ..gis.plugin_zip import write_plugin_zip

    write_plugin_zip(arguments.output, arguments.homepage, arguments.email, arguments.overwrite)
    talk.say("in QGIS: Plugins > Manage and Install Plugins > Install from ZIP; then Processing > Toolbox > mpmgis")
    command = shutil.which("mpmgis", path=str(Path(sys.executable).parent))
    if command is not None:
        talk.say(f"if it does not find the command, give it {command} in Settings > Options > Processing > Providers")
    print(arguments.output)
    return 0
