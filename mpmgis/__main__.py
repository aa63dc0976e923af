"""`python -m mpmgis` is the command `mpmgis`."""

import sys

from .cli.main import command

sys.exit(command())
