"""`python -m mpmgis` is the command `mpmgis`."""

import sys

from .cli.main import main

sys.exit(main())
