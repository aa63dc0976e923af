"""The plugin is imported as QGIS does it: by its own name, from the folder that holds it."""

import sys
from pathlib import Path

import mpmgis

sys.path.insert(0, str(Path(mpmgis.__file__).parent / "qgis_plugin"))
