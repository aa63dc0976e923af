"""Opens an exported folder in QGIS, offscreen, and prints facts as one JSON object on stdout.

Run by a Python that has PyQGIS: `python3 qgis_check.py PROJECT FILE...`; FILE is a raster, a .gpkg or a mesh (.nc).
"""

import json
import os
import shutil
import sys
import tempfile

os.environ["QT_QPA_PLATFORM"] = "offscreen"
os.environ["QGIS_CUSTOM_CONFIG_PATH"] = os.environ["XDG_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="qgis_check_")

from qgis.core import (
    Qgis,
    QgsApplication,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextScope,
    QgsExpressionContextUtils,
    QgsInterval,
    QgsLayerTreeModel,
    QgsLayoutExporter,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutItemRegistry,
    QgsLayoutItemScaleBar,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsMeshLayer,
    QgsProject,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsTemporalNavigationObject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QRectF, QSize
from qgis.PyQt.QtGui import QColor, QImage

LAYOUT_ITEMS = QgsLayoutItemRegistry.LayoutMap  # types from here on are items on a page


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


def open_project(path):
    """Facts about the project and its animation."""
    project = QgsProject.instance()
    read = project.read(path)
    root, layers = project.layerTreeRoot(), list(project.mapLayers().values())
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
    for span in spans:
        frames.append(picture(shown, extent, project.crs(), span))
        for layer in moving:
            lone[layer.name()].append(picture([layer], extent, project.crs(), span))
    return {
        "read": read,
        "title": project.title(),
        "crs": project.crs().authid(),
        "crs_valid": project.crs().isValid(),
        "lost": [node.layerId() for node in root.findLayers() if node.layer() is None],
        "layers": [(layer.name(), layer.isValid(), layer.crs().isValid()) for layer in layers],
        "visible": [layer.name() for layer in shown],
        "frames": count,
        "mode": project.readNumEntry("TemporalControllerWidget", "/NavigationMode")[0],
        "painted": [frame[1] for frame in frames],
        "differ": len({frame[0] for frame in frames}),
        "moving": {name: [len({p[0] for p in pictures}), [p[1] for p in pictures]] for name, pictures in lone.items()},
        "map_title": [map_title(project, span, shown) for span in spans],
        "still_title": map_title(project, spans[0], [layer for layer in layers if " max " in layer.name()]),
        "legends": legends(root),
        "layouts": layouts(project),
    }


def map_title(project, span, layers):
    """The text of the title decoration in a frame with `layers`."""
    scope = QgsExpressionContextScope()
    scope.setVariable("map_start_time", span.begin())
    settings = QgsMapSettings()
    settings.setLayers(layers)
    context = QgsExpressionContext()
    context.appendScope(QgsExpressionContextUtils.mapSettingsScope(settings))
    context.appendScope(scope)
    return QgsExpression.replaceExpressionText(project.readEntry("TitleLabel", "/Label")[0], context)


def legends(root):
    """Layer name -> texts of its legend entries."""
    model = QgsLayerTreeModel(root)
    return {row.name(): [str(entry.data(0)) for entry in model.layerLegendNodes(row)] for row in root.findLayers()}


def frame(item):
    """The frame of an item on the page; its bounds can be larger."""
    return item.mapRectToScene(item.rect())


def layouts(project):
    """Name -> facts about the print layouts: their page as a picture and as a PDF."""
    found = {}
    for layout in project.layoutManager().printLayouts():
        exporter, path = QgsLayoutExporter(layout), os.path.join(tempfile.mkdtemp(prefix="qgis_layout_"), "page.pdf")
        page = exporter.renderPageToImage(0, QSize(594, 420)).convertToFormat(QImage.Format.Format_ARGB32)
        done = exporter.exportToPdf(path, QgsLayoutExporter.PdfExportSettings()) == QgsLayoutExporter.Success
        (shown,) = [item for item in layout.items() if isinstance(item, QgsLayoutItemMap)]
        (legend,) = [item for item in layout.items() if isinstance(item, QgsLayoutItemLegend)]
        (bar,) = [item for item in layout.items() if isinstance(item, QgsLayoutItemScaleBar)]
        with open(path, "rb") as file:
            pdf = done and file.read(5) == b"%PDF-"
        area = frame(shown)
        boxes = [frame(item) for item in layout.items() if item.type() >= LAYOUT_ITEMS]
        size = layout.pageCollection().page(0).pageSize()
        found[layout.name()] = {
            "pdf": pdf,
            "page": [size.width(), size.height()],
            "colours": len({page.pixel(x, y) for x in range(594) for y in range(420)}),
            "layers": [layer.name() for layer in shown.layers()],
            "legend": [row.name() for row in legend.model().rootGroup().findLayers()],
            "linked": legend.linkedMap() is shown and bar.linkedMap() is shown,
            "over_map": sum(area.intersects(box) for box in boxes) - 1,
            "outside": sum(not QRectF(0, 0, size.width(), size.height()).contains(box) for box in boxes),
            "texts": [item.text() for item in layout.items() if isinstance(item, QgsLayoutItemLabel)],
            "extent": [shown.extent().xMinimum(), shown.extent().yMinimum(), shown.extent().xMaximum()],
            "scale": round(shown.scale(), 3),
            "grid": shown.grid().intervalX() if shown.grid().enabled() else 0.0,
            "bar": bar.unitsPerSegment() * bar.numberOfSegments(),
        }
        shutil.rmtree(os.path.dirname(path))
    return found


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
