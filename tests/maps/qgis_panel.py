"""Loads rasters in a real QGIS, offscreen, and prints as JSON what its information panel and legend show of each."""

import json
import os
import sys
import tempfile

os.environ["QT_QPA_PLATFORM"] = "offscreen"
os.environ["QGIS_CUSTOM_CONFIG_PATH"] = os.environ["XDG_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="qgis_panel_")

from qgis.core import QgsApplication, QgsRasterLayer


def shown(path):
    layer = QgsRasterLayer(path, "raster")
    extent = layer.extent()
    return {
        "renderer": layer.renderer().type(),
        "band": layer.renderer().usesBands(),
        "panel": layer.htmlMetadata(),
        "legend": [str(text) for text, _ in layer.legendSymbologyItems()],
        "bands": [layer.bandName(number + 1) for number in range(layer.bandCount())],
        "crs": layer.crs().authid(),
        "extent": [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()],
    }


if __name__ == "__main__":
    application = QgsApplication([], True)
    application.initQgis()
    print("REPORT " + json.dumps({os.path.basename(path): shown(path) for path in sys.argv[1:]}), flush=True)
    os._exit(0)  # QGIS' own teardown may crash after the answer is out
