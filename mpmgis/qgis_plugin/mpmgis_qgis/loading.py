"""What the command wrote, as layers of the open project."""

from __future__ import annotations

import os
import zipfile

from qgis.core import QgsLayerDefinition, QgsPathResolver, QgsRasterLayer, QgsReadWriteContext, QgsVectorLayer
from qgis.PyQt.QtXml import QDomDocument


def add_project(path, project):
    """Add the layers of the exported project file `path` (.qgz) to `project` as a group on top, styled and timed.

    Times of the project, which the animation runs through, are taken where `project` has none yet.
    Returns what went wrong as text, empty where nothing did.
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
    return "" if loaded else trouble


def _definition(root):
    """The layers of a project's XML as a layer definition, which is what QGIS adds to another project."""
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


def layer_of(path):
    """A layer of the file `path` with the style that lies beside it, or None where QGIS cannot draw it."""
    name, suffix = os.path.splitext(os.path.basename(path))
    layer = QgsRasterLayer(path, name) if suffix == ".tif" else QgsVectorLayer(path, name, "ogr")
    return layer if layer.isValid() and layer.isSpatial() else None
