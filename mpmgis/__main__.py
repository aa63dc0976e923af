"""`python -m mpmgis` is the command `mpmgis`."""

import sys

from .commands.shell.main import command

sys.exit(command())
