"""Fields of a form as parameters of QGIS, and what the user chose as plain values."""

from __future__ import annotations

import json
import os

from qgis.core import (
    Qgis,
    QgsCoordinateReferenceSystem,
    QgsProcessingException,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterEnum,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterPoint,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
    QgsProcessingParameterVectorLayer,
    QgsProcessingUtils,
)

from . import fields, versions
from .verbs import QGIS_MIN

BANDS_KNOW_TIME = 33800  # from this QGIS on
VECTOR_FORMATS = ["gpkg", "shp", "geojson", "fgb"]  # read as they are; other layers are saved as the first of these
VECTOR_TYPES = {fields.POLYGONS: versions.POLYGONS, fields.LINES: versions.LINES, fields.POINTS: versions.POINTS}
DEGREES = "EPSG:4326"  # of a GeoJSON file


def parameter(field):
    """The QgsProcessingParameterDefinition of `field`."""
    made = _MAKERS[field.kind](field)
    if field.advanced:
        made.setFlags(made.flags() | versions.ADVANCED)
    made.setHelp(help_of(field))
    return made


def help_of(field):
    """What the field's tooltip says: its own help, and the command's option, which error lines speak of."""
    return f"{field.help} [{field.option}]" if field.option else field.help


def _raster(field):
    return QgsProcessingParameterRasterLayer(field.name, field.label, field.default, field.optional)


def _vector(field):
    kinds = [VECTOR_TYPES[field.kind]]
    return QgsProcessingParameterVectorLayer(field.name, field.label, kinds, field.default, field.optional)


def _file(field):
    made = QgsProcessingParameterFile(field.name, field.label, optional=field.optional)
    if field.kind == fields.FOLDER:
        made.setBehavior(versions.FOLDER)
    elif field.files:
        made.setFileFilter(field.files)
    return made


def _number(field):
    kind = versions.WHOLE if field.kind == fields.INTEGER else versions.ANY_NUMBER
    made = QgsProcessingParameterNumber(field.name, field.label, kind, field.default, field.optional)
    if field.least is not None:
        made.setMinimum(field.least)
    return made


def _text(field):
    several = field.kind == fields.TEXTS
    return QgsProcessingParameterString(field.name, field.label, field.default, several, field.optional)


def _files(field):
    return QgsProcessingParameterMultipleLayers(field.name, field.label, versions.FILES, None, field.optional)


def _place(field):
    return QgsProcessingParameterPoint(field.name, field.label, None, field.optional)


def _extent(field):
    return QgsProcessingParameterExtent(field.name, field.label, None, field.optional)


def _choice(field):
    default = oldest_qgis() if field.name == QGIS_MIN else field.default
    return QgsProcessingParameterEnum(
        field.name, field.label, list(field.choices), False, default, field.optional, usesStaticStrings=True
    )


def oldest_qgis():
    """The oldest QGIS that must open an export: one that shows time by band, unless this QGIS is older."""
    return "3.38" if Qgis.QGIS_VERSION_INT >= BANDS_KNOW_TIME else "3.22"


def _switch(field):
    return QgsProcessingParameterBoolean(field.name, field.label, field.default, field.optional)


def _crs(field):
    return QgsProcessingParameterCrs(field.name, field.label, field.default, field.optional)


def _new_file(field):
    return QgsProcessingParameterFileDestination(
        field.name, field.label, field.files, None, field.optional, not field.optional
    )


def _new_folder(field):
    return QgsProcessingParameterFolderDestination(field.name, field.label, None, field.optional, not field.optional)


_MAKERS = {
    fields.RASTER: _raster,
    fields.POLYGONS: _vector,
    fields.LINES: _vector,
    fields.POINTS: _vector,
    fields.FILE: _file,
    fields.FOLDER: _file,
    fields.NUMBER: _number,
    fields.INTEGER: _number,
    fields.TEXT: _text,
    fields.CHOICE: _choice,
    fields.SWITCH: _switch,
    fields.CRS: _crs,
    fields.TEXTS: _text,
    fields.FILES: _files,
    fields.PLACE: _place,
    fields.EXTENT: _extent,
    fields.NEW_FILE: _new_file,
    fields.NEW_FOLDER: _new_folder,
}


def plain_values(algorithm, form, parameters, context, feedback):
    """Dictionary name -> text, number, truth, list or None: what the user chose for the fields of `algorithm`.

    Raises
    ------
    QgsProcessingException
        A layer is no file that the command can read.
    """
    return {field.name: _value(algorithm, field, parameters, context, feedback) for field in form}


def _value(algorithm, field, parameters, context, feedback):
    name, kind = field.name, field.kind
    if kind == fields.SWITCH:
        return algorithm.parameterAsBool(parameters, name, context)
    if kind in (fields.NEW_FILE, fields.NEW_FOLDER):
        return algorithm.parameterAsString(parameters, name, context) or None
    given = parameters.get(name, algorithm.parameterDefinition(name).defaultValue())
    if given is None or given == "" or getattr(given, "isNull", bool)():
        return None
    if kind == fields.RASTER:
        return _raster_path(algorithm, field, parameters, context)
    if kind in VECTOR_TYPES:
        return _vector_path(algorithm, field, parameters, context, feedback)
    if kind == fields.NUMBER:
        return algorithm.parameterAsDouble(parameters, name, context)
    if kind == fields.INTEGER:
        return algorithm.parameterAsInt(parameters, name, context)
    if kind == fields.CHOICE:
        return algorithm.parameterAsEnumString(parameters, name, context)
    if kind == fields.CRS:
        return algorithm.parameterAsCrs(parameters, name, context).authid() or None
    if kind == fields.FILES:
        return algorithm.parameterAsFileList(parameters, name, context) or None
    if kind == fields.TEXTS:
        return split(algorithm.parameterAsString(parameters, name, context)) or None
    if kind == fields.PLACE:
        return _place_path(algorithm, field, parameters, context)
    if kind == fields.EXTENT:
        return _extent_text(algorithm, name, parameters, context)
    if kind in (fields.FILE, fields.FOLDER):
        return algorithm.parameterAsFile(parameters, name, context)
    return algorithm.parameterAsString(parameters, name, context).strip()


def _raster_path(algorithm, field, parameters, context):
    layer = algorithm.parameterAsRasterLayer(parameters, field.name, context)
    if layer is None:
        raise QgsProcessingException(f"{field.label}: {parameters.get(field.name)} is no raster that QGIS can read")
    if layer.providerType() != "gdal":
        raise QgsProcessingException(
            f"{field.label}: the layer {layer.name()} is no file (it comes from {layer.providerType()}); "
            "save it as GeoTIFF and take that"
        )
    return layer.source()


def _vector_path(algorithm, field, parameters, context, feedback):
    """File with the layer, and '|layername=' where it has several; what is no such file is saved as one."""
    path, layer = algorithm.parameterAsCompatibleSourceLayerPathAndLayerName(
        parameters, field.name, context, VECTOR_FORMATS, VECTOR_FORMATS[0], feedback
    )
    if not path or not os.path.exists(path):
        raise QgsProcessingException(f"{field.label}: the layer cannot be read or saved as {VECTOR_FORMATS[0]}")
    given = algorithm.parameterAsVectorLayer(parameters, field.name, context)
    if given is not None and given.providerType() != "ogr" and not given.crs().isValid():
        raise QgsProcessingException(f"{field.label}: the layer {given.name()} has no CRS; set it in its properties")
    return f"{path}|layername={layer}" if layer and path.endswith(".gpkg") else path


def split(text):
    """List of the texts in `text`, one a line or with semicolons between them."""
    return [part.strip() for part in text.replace(";", "\n").splitlines() if part.strip()]


def _place_path(algorithm, field, parameters, context):
    """Path of a file with the place that was clicked, which QGIS removes when it ends."""
    of_place = algorithm.parameterAsPointCrs(parameters, field.name, context)
    if not of_place.isValid():
        raise QgsProcessingException(
            f"{field.label}: neither the place nor the project has a CRS; set the project's, or write x,y [EPSG:n]"
        )
    point = algorithm.parameterAsPoint(parameters, field.name, context, QgsCoordinateReferenceSystem(DEGREES))
    path = QgsProcessingUtils.generateTempFilename("place.geojson")
    geometry = {"type": "Point", "coordinates": [point.x(), point.y()]}
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        json.dump({"type": "Feature", "properties": {"name": "place"}, "geometry": geometry}, file)
    return path


def _extent_text(algorithm, name, parameters, context):
    """West, south, east and north in the CRS of the terrain model, with commas."""
    terrain = algorithm.parameterAsRasterLayer(parameters, "DEM", context)
    crs = QgsCoordinateReferenceSystem() if terrain is None else terrain.crs()
    found = algorithm.parameterAsExtent(parameters, name, context, crs)
    return ",".join(
        fields.text(edge) for edge in (found.xMinimum(), found.yMinimum(), found.xMaximum(), found.yMaximum())
    )
