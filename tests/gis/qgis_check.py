"""Opens an exported folder in QGIS, offscreen, and prints facts as one JSON object on stdout.

Run by a Python that has PyQGIS: `python3 qgis_check.py PROJECT FILE...`; FILE is a raster, a .gpkg or a mesh (.nc).
"""

import json
import os
import re
import shutil
import sys
import tempfile
import zipfile

os.environ["QT_QPA_PLATFORM"] = "offscreen"
os.environ["QGIS_CUSTOM_CONFIG_PATH"] = os.environ["XDG_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="qgis_check_")

from qgis.core import (
    Qgis,
    QgsApplication,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextScope,
    QgsInterval,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsMeshLayer,
    QgsProject,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsTemporalNavigationObject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize, Qt
from qgis.PyQt.QtGui import QColor, QImage

BANDS_KNOW_TIME = Qgis.QGIS_VERSION_INT >= 33800


def picture(layers, extent, crs, span=None):
    """Image bytes of a rendering without background, numbers of painted pixels and of colours."""
    settings = QgsMapSettings()
    settings.setLayers(layers)
    settings.setDestinationCrs(crs)
    settings.setOutputSize(QSize(300, 220))
    settings.setExtent(extent)
    settings.setBackgroundColor(QColor(0, 0, 0, 0))
    if span is not None:
        settings.setIsTemporal(True)
        settings.setTemporalRange(span)
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    image = job.renderedImage().convertToFormat(QImage.Format.Format_ARGB32)
    bits = image.constBits()
    bits.setsize(image.sizeInBytes())
    data = bytes(bits)
    pixels = [data[k : k + 4] for k in range(0, len(data), 4)]
    painted = [pixel for pixel in pixels if pixel[3]]
    return data, len(painted), len(set(painted))


def seen(layer, styled):
    """Facts about one layer."""
    extent = layer.extent()
    box = [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()]
    extent.grow(0.05 * max(extent.width(), extent.height()))
    _, painted, colours = picture([layer], extent, layer.crs())
    return {
        "name": layer.name(),
        "valid": layer.isValid(),
        "crs": layer.crs().authid(),
        "crs_valid": layer.crs().isValid(),
        "extent": box,
        "painted": painted,
        "colours": colours,
        "styled": styled,
    }


def open_file(path):
    """Facts about the layers of a file opened without a project."""
    if path.endswith(".nc"):
        layer = QgsMeshLayer(path, "mesh", "mdal")
        provider = layer.dataProvider()
        groups = [provider.datasetGroupMetadata(k) for k in range(provider.datasetGroupCount())]
        facts = [(group.name(), group.isVector(), provider.datasetCount(k)) for k, group in enumerate(groups)]
        return [{**seen(layer, None), "groups": facts, "faces": provider.faceCount()}]
    if path.endswith(".gpkg"):
        layers = []
        for part in QgsProviderRegistry.instance().querySublayers(path):
            layer = QgsVectorLayer(part.uri(), part.name(), part.providerKey())
            features = list(layer.getFeatures())
            sound = sum(f.geometry().isGeosValid() for f in features)
            styled = layer.loadDefaultStyle()[1]
            layers.append({**seen(layer, styled), "features": len(features), "sound": sound})
        return layers
    layer = QgsRasterLayer(path, "raster")
    styled = QgsRasterLayer(path, "probe").loadDefaultStyle()[1]
    renderer = layer.renderer().type()
    names = [layer.bandName(k + 1) for k in range(layer.bandCount())]
    return [{**seen(layer, styled), "renderer": renderer, "bands": names}]


def band_times(path):
    """Layer id -> [(begin, end, band)] of the layers with time by band, which QGIS before 3.38 does not read."""
    with zipfile.ZipFile(path) as archive:
        text = archive.read(archive.namelist()[0]).decode()
    found = {}
    for layer in re.findall(r"<maplayer .*?</maplayer>", text, re.S):
        spans = [
            (
                re.search(r'begin="(.*?)"', span)[1],
                re.search(r'end="(.*?)"', span)[1],
                int(re.search(r'band="(\d+)"', span)[1]),
            )
            for span in re.findall(r"<range [^>]*>", layer)
        ]
        if spans:
            found[re.search(r"<id>(.*?)</id>", layer)[1]] = spans
    return found


def open_project(path):
    """Facts about the project and its animation."""
    project = QgsProject.instance()
    read = project.read(path)
    root = project.layerTreeRoot()
    visible = {node.layerId() for node in root.findLayers() if node.isVisible()}
    shown = [layer for layer in root.layerOrder() if layer.id() in visible]
    settings = project.timeSettings()
    navigation = QgsTemporalNavigationObject()
    navigation.setNavigationMode(QgsTemporalNavigationObject.Animated)
    navigation.setTemporalExtents(settings.temporalRange())
    navigation.setFrameDuration(QgsInterval(settings.timeStep(), settings.timeStepUnit()))
    count = navigation.totalFrameCount()
    spans = [navigation.dateTimeRangeForFrameNumber(k) for k in (0, count // 2, count - 1)]
    extent = project.viewSettings().defaultViewExtent()
    moving = [layer for layer in shown if layer.temporalProperties() and layer.temporalProperties().isActive()]
    frames, lone = [], {layer.name(): [] for layer in moving}
    by_band = {} if BANDS_KNOW_TIME else band_times(path)
    for span in spans:
        switch_bands(moving, by_band, span)
        frames.append(picture(shown, extent, project.crs(), span))
        for layer in moving:
            lone[layer.name()].append(picture([layer], extent, project.crs(), span))
    return {
        "read": read,
        "title": project.title(),
        "crs": project.crs().authid(),
        "crs_valid": project.crs().isValid(),
        "lost": [node.layerId() for node in root.findLayers() if node.layer() is None],
        "layers": [(layer.name(), layer.isValid(), layer.crs().isValid()) for layer in project.mapLayers().values()],
        "visible": [layer.name() for layer in shown],
        "frames": count,
        "mode": project.readNumEntry("TemporalControllerWidget", "/NavigationMode")[0],
        "painted": [frame[1] for frame in frames],
        "differ": len({frame[0] for frame in frames}),
        "moving": {name: [len({p[0] for p in pictures}), [p[1] for p in pictures]] for name, pictures in lone.items()},
        "map_title": [map_title(project, span) for span in spans],
    }


def switch_bands(layers, by_band, span):
    """For an old QGIS: show the band of the time, as a new QGIS does automatically."""
    at = span.begin().toUTC().toString(Qt.DateFormat.ISODate)
    for layer in layers:
        for begin, end, band in by_band.get(layer.id(), ()):
            if begin <= at < end:
                layer.renderer().setBand(band)


def map_title(project, span):
    """The text of the title decoration in a frame."""
    scope = QgsExpressionContextScope()
    scope.setVariable("map_start_time", span.begin())
    context = QgsExpressionContext()
    context.appendScope(scope)
    return QgsExpression.replaceExpressionText(project.readEntry("TitleLabel", "/Label")[0], context)


def main():
    application = QgsApplication([], True)
    application.initQgis()
    report = {"version": Qgis.QGIS_VERSION, "project": open_project(sys.argv[1])}
    report["files"] = {os.path.basename(path): open_file(path) for path in sys.argv[2:]}
    print("REPORT " + json.dumps(report), flush=True)
    shutil.rmtree(os.environ["QGIS_CUSTOM_CONFIG_PATH"], ignore_errors=True)
    os._exit(0)  # QGIS' own teardown may crash after the answer is out


if __name__ == "__main__":
    main()
