"""Load results of the command as layers of the open project."""

from __future__ import annotations

import os
import zipfile

from qgis import utils
from qgis.core import (
    QgsInterval,
    QgsLayerDefinition,
    QgsMapLayer,
    QgsPalettedRasterRenderer,
    QgsPathResolver,
    QgsProject,
    QgsProjectTimeSettings,
    QgsRasterLayer,
    QgsReadWriteContext,
    QgsVectorLayer,
)
from qgis.PyQt.QtGui import QColor
from qgis.PyQt.QtXml import QDomDocument

from . import versions


def add_project(path: str, project: QgsProject) -> str:
    """Add the layers of an exported project to the open one, as the first group, with styles and times.

    The time range of the animation is set where the open project has none yet.

    Parameters
    ----------
    path : str
        Project file (.qgz).
    project : QgsProject
        The open one.

    Returns
    -------
    str
        The error; "" without one.
    """
    with zipfile.ZipFile(path) as archive:
        text = archive.read(archive.namelist()[0])
    exported = QDomDocument()
    exported.setContent(text)
    root = exported.documentElement()
    group = project.layerTreeRoot().insertGroup(0, root.firstChildElement("title").text())
    context = QgsReadWriteContext()
    context.setPathResolver(QgsPathResolver(path))
    loaded, trouble = QgsLayerDefinition.loadLayerDefinition(_definition(root), project, group, context)
    if project.timeSettings().temporalRange().begin().isNull():
        project.timeSettings().readXml(root.firstChildElement("ProjectTimeSettings"), context)
        start_clock(project.timeSettings())
    return "" if loaded else trouble


def start_clock(times: QgsProjectTimeSettings) -> None:
    """Show the map at the first time, if the Temporal Controller is off, which would show all times.

    Parameters
    ----------
    times : QgsProjectTimeSettings
    """
    canvas = utils.iface.mapCanvas() if utils.iface is not None else None
    clock = canvas.temporalController() if canvas is not None else None
    if clock is None or clock.navigationMode() != versions.CLOCK_OFF or times.temporalRange().begin().isNull():
        return
    clock.setTemporalExtents(times.temporalRange())
    clock.setFrameDuration(QgsInterval(times.timeStep(), times.timeStepUnit()))
    clock.setNavigationMode(versions.CLOCK_ANIMATED)
    clock.rewindToStart()


def _definition(root):
    """The layers of a project's XML as a layer definition, which QGIS can add to another project."""
    document = QDomDocument()
    top = document.createElement("qlr")
    document.appendChild(top)
    top.appendChild(document.importNode(root.firstChildElement("layer-tree-group"), True))
    layers = document.createElement("maplayers")
    layer = root.firstChildElement("projectlayers").firstChildElement("maplayer")
    while not layer.isNull():
        layers.appendChild(document.importNode(layer, True))
        layer = layer.nextSiblingElement("maplayer")
    top.appendChild(layers)
    return document


def layer_of(path: str, palette: tuple[tuple[int, str, str], ...] = ()) -> QgsMapLayer | None:
    """Return a layer of a file, or None if QGIS cannot draw it.

    It has the style file of the same name. A raster without one gets the palette on its first band, because QGIS would
    draw several bands as a colour image.

    Parameters
    ----------
    path : str
    palette : tuple of (int, str, str)
        Value, colour, label.

    Returns
    -------
    QgsMapLayer or None
    """
    base, suffix = os.path.splitext(path)
    name = os.path.basename(base)
    if suffix != ".tif":
        layer = QgsVectorLayer(path, name, "ogr")
        return layer if layer.isValid() and layer.isSpatial() else None
    layer = QgsRasterLayer(path, name)
    if layer.isValid() and palette and not os.path.exists(base + ".qml"):
        classes = [QgsPalettedRasterRenderer.Class(value, QColor(colour), label) for value, colour, label in palette]
        layer.setRenderer(QgsPalettedRasterRenderer(layer.dataProvider(), 1, classes))
    return layer if layer.isValid() else None
