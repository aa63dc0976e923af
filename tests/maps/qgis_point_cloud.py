"""Opens a .las file in a real QGIS, offscreen, and prints as JSON what its point cloud provider sees."""

import json
import os
import sys
import tempfile

os.environ["QT_QPA_PLATFORM"] = "offscreen"
os.environ["QGIS_CUSTOM_CONFIG_PATH"] = os.environ["XDG_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="qgis_cloud_")

from qgis.core import QgsApplication, QgsPointCloudLayer, QgsProviderRegistry

if __name__ == "__main__":
    application = QgsApplication([], True)
    application.initQgis()
    found = {"pdal": "pdal" in QgsProviderRegistry.instance().providerList()}
    if found["pdal"]:
        layer = QgsPointCloudLayer(sys.argv[1], "cloud", "pdal")
        extent = layer.extent()
        found |= {"count": layer.pointCount(), "crs": layer.crs().authid(), "valid": layer.isValid()}
        found["extent"] = [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()]
    print("REPORT " + json.dumps(found), flush=True)
    os._exit(0)  # QGIS' own teardown may crash after the answer is out
