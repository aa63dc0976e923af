"""Make fields of a form parameters of QGIS, and the user's input plain values."""

from __future__ import annotations

import json
import os

from qgis.core import (
    Qgis,
    QgsCoordinateReferenceSystem,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterExtent,
    QgsProcessingParameterField,
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

from . import forms, versions

BANDS_HAVE_TIME = 33800  # version of QGIS from which on bands of a raster can have times
VECTOR_FORMATS = ["gpkg", "shp", "geojson", "fgb"]  # read directly; other layers are saved as the first of these
VECTOR_TYPES = {forms.POLYGONS: versions.POLYGONS, forms.LINES: versions.LINES, forms.POINTS: versions.POINTS}
SCENARIO_WIDGET = f"{__package__}.scenario_table.ScenarioWrapper"  # as QGIS loads it where it shows forms
COLUMNS_OF = "RELEASE"  # field with the layer whose columns are offered
DEGREES = "EPSG:4326"  # of a GeoJSON file


def parameter(field: forms.Field) -> QgsProcessingParameterDefinition:
    """Return the parameter of QGIS for a field.

    Parameters
    ----------
    field : Field

    Returns
    -------
    QgsProcessingParameterDefinition
    """
    made = _MAKERS[field.kind](field)
    if field.advanced:
        made.setFlags(made.flags() | versions.ADVANCED)
    made.setHelp(help_of(field))
    return made


def help_of(field: forms.Field) -> str:
    """Return the tooltip of a field: its help, and the command's option, which error messages name.

    Parameters
    ----------
    field : Field

    Returns
    -------
    str
    """
    return f"{field.help} [{field.option}]" if field.option else field.help


def _raster(field):
    return QgsProcessingParameterRasterLayer(field.name, field.label, field.default, field.optional)


def _vector(field):
    kinds = [VECTOR_TYPES[field.kind]]
    return QgsProcessingParameterVectorLayer(field.name, field.label, kinds, field.default, field.optional)


def _file(field):
    made = QgsProcessingParameterFile(field.name, field.label, optional=field.optional)
    if field.kind in (forms.FOLDER, forms.NEW_FOLDER):
        made.setBehavior(versions.FOLDER)
    elif field.files:
        made.setFileFilter(field.files)
    return made


def _number(field):
    kind = versions.WHOLE if field.kind == forms.INTEGER else versions.ANY_NUMBER
    made = QgsProcessingParameterNumber(field.name, field.label, kind, field.default, field.optional)
    if field.least is not None:
        made.setMinimum(field.least)
    if field.most is not None:
        made.setMaximum(field.most)
    return made


def _text(field):
    several = field.kind in (forms.TEXTS, forms.SCENARIOS)
    return QgsProcessingParameterString(field.name, field.label, field.default, several, field.optional)


def _files(field):
    return QgsProcessingParameterMultipleLayers(field.name, field.label, versions.FILES, None, field.optional)


def _place(field):
    return QgsProcessingParameterPoint(field.name, field.label, None, field.optional)


def _column(field):
    made = QgsProcessingParameterField(field.name, field.label, field.default, COLUMNS_OF, optional=field.optional)
    if field.kind == forms.COLUMN:
        made.setDataType(versions.NUMERIC)
    return made


def _scenarios(field):
    made = _text(field)
    made.setMetadata({"widget_wrapper": {"class": SCENARIO_WIDGET}})
    return made


def _extent(field):
    return QgsProcessingParameterExtent(field.name, field.label, None, field.optional)


def _choice(field):
    default = oldest_qgis() if field.name == forms.QGIS_MIN else field.default
    return QgsProcessingParameterEnum(
        field.name, field.label, list(field.choices), False, default, field.optional, usesStaticStrings=True
    )


def _choices(field):
    names = list(field.choices)
    return QgsProcessingParameterEnum(
        field.name, field.label, names, True, field.default, field.optional, usesStaticStrings=True
    )


def oldest_qgis() -> str:
    """Return the oldest QGIS that must open an export: one that supports time by band, unless this QGIS is older."""
    return "3.38" if Qgis.QGIS_VERSION_INT >= BANDS_HAVE_TIME else "3.22"


def _switch(field):
    return QgsProcessingParameterBoolean(field.name, field.label, field.default, field.optional)


def _crs(field):
    return QgsProcessingParameterCrs(field.name, field.label, field.default, field.optional)


def _new_file(field):
    return QgsProcessingParameterFileDestination(
        field.name, field.label, field.files, None, field.optional, not field.optional
    )


def _new_folder(field):
    """An optional folder is a plain field, because QGIS writes "skip output" into an empty destination."""
    if field.optional:
        return _file(field)
    return QgsProcessingParameterFolderDestination(field.name, field.label)


_MAKERS = {
    forms.RASTER: _raster,
    forms.POLYGONS: _vector,
    forms.LINES: _vector,
    forms.POINTS: _vector,
    forms.FILE: _file,
    forms.FOLDER: _file,
    forms.NUMBER: _number,
    forms.INTEGER: _number,
    forms.TEXT: _text,
    forms.CHOICE: _choice,
    forms.CHOICES: _choices,
    forms.SWITCH: _switch,
    forms.CRS: _crs,
    forms.TEXTS: _text,
    forms.FILES: _files,
    forms.PLACE: _place,
    forms.EXTENT: _extent,
    forms.COLUMN: _column,
    forms.ANY_COLUMN: _column,
    forms.SCENARIOS: _scenarios,
    forms.NEW_FILE: _new_file,
    forms.NEW_FOLDER: _new_folder,
}


def plain_values(
    algorithm: QgsProcessingAlgorithm,
    form: tuple[forms.Field, ...],
    parameters: dict,
    context: QgsProcessingContext,
    feedback: QgsProcessingFeedback,
) -> dict[str, object]:
    """Return the user's input in the fields of an algorithm.

    Parameters
    ----------
    algorithm : QgsProcessingAlgorithm
    form : tuple of Field
    parameters : dict
    context : QgsProcessingContext
    feedback : QgsProcessingFeedback

    Returns
    -------
    dict
        Name of a field -> text, number, bool, list or None.

    Raises
    ------
    QgsProcessingException
        A layer is not a file that the command can read.
    """
    return {field.name: _value(algorithm, field, parameters, context, feedback) for field in form}


def _value(algorithm, field, parameters, context, feedback):
    name, kind = field.name, field.kind
    if kind == forms.SWITCH:
        return algorithm.parameterAsBool(parameters, name, context)
    if kind in (forms.NEW_FILE, forms.NEW_FOLDER):
        return algorithm.parameterAsString(parameters, name, context) or None
    given = parameters.get(name, algorithm.parameterDefinition(name).defaultValue())
    if given is None or given == "" or getattr(given, "isNull", bool)():
        return None
    if kind == forms.RASTER:
        return _raster_path(algorithm, field, parameters, context)
    if kind in VECTOR_TYPES:
        return _vector_path(algorithm, field, parameters, context, feedback)
    if kind == forms.NUMBER:
        return algorithm.parameterAsDouble(parameters, name, context)
    if kind == forms.INTEGER:
        return algorithm.parameterAsInt(parameters, name, context)
    if kind == forms.CHOICE:
        return algorithm.parameterAsEnumString(parameters, name, context)
    if kind == forms.CHOICES:
        return algorithm.parameterAsEnumStrings(parameters, name, context) or None
    if kind == forms.CRS:
        return algorithm.parameterAsCrs(parameters, name, context).authid() or None
    if kind == forms.FILES:
        return algorithm.parameterAsFileList(parameters, name, context) or None
    if kind in (forms.TEXTS, forms.SCENARIOS):
        return split(algorithm.parameterAsString(parameters, name, context)) or None
    if kind == forms.PLACE:
        return _place_path(algorithm, field, parameters, context)
    if kind == forms.EXTENT:
        return _extent_text(algorithm, name, parameters, context)
    if kind in (forms.FILE, forms.FOLDER):
        return algorithm.parameterAsFile(parameters, name, context)
    return algorithm.parameterAsString(parameters, name, context).strip()


def _raster_path(algorithm, field, parameters, context):
    layer = algorithm.parameterAsRasterLayer(parameters, field.name, context)
    if layer is None:
        raise QgsProcessingException(f"{field.label}: {parameters.get(field.name)} is not a raster that QGIS can read")
    if layer.providerType() != "gdal":
        raise QgsProcessingException(
            f"{field.label}: the layer {layer.name()} is not a file (its source is {layer.providerType()}); "
            "save it as GeoTIFF and use that"
        )
    return layer.source()


def _vector_path(algorithm, field, parameters, context, feedback):
    """File with the layer, with '|layername=' for one of several; another kind of layer is saved as a file."""
    path, layer = algorithm.parameterAsCompatibleSourceLayerPathAndLayerName(
        parameters, field.name, context, VECTOR_FORMATS, VECTOR_FORMATS[0], feedback
    )
    if not path or not os.path.exists(path):
        raise QgsProcessingException(f"{field.label}: the layer cannot be read or saved as {VECTOR_FORMATS[0]}")
    given = algorithm.parameterAsVectorLayer(parameters, field.name, context)
    if given is not None and given.providerType() != "ogr" and not given.crs().isValid():
        raise QgsProcessingException(f"{field.label}: the layer {given.name()} has no CRS; set it in its properties")
    return f"{path}|layername={layer}" if layer and path.endswith(".gpkg") else path


def split(text: str) -> list[str]:
    """Return the texts that are separated by line ends or semicolons.

    Parameters
    ----------
    text : str

    Returns
    -------
    list of str
    """
    return [part.strip() for part in text.replace(";", "\n").splitlines() if part.strip()]


def _place_path(algorithm, field, parameters, context):
    """Path of a temporary file with the clicked point."""
    of_place = algorithm.parameterAsPointCrs(parameters, field.name, context)
    if not of_place.isValid():
        raise QgsProcessingException(
            f"{field.label}: neither the point nor the project has a CRS; set the project CRS, or enter x,y [EPSG:n]"
        )
    point = algorithm.parameterAsPoint(parameters, field.name, context, QgsCoordinateReferenceSystem(DEGREES))
    path = QgsProcessingUtils.generateTempFilename("place.geojson")
    geometry = {"type": "Point", "coordinates": [point.x(), point.y()]}
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        json.dump({"type": "Feature", "properties": {"name": "place"}, "geometry": geometry}, file)
    return path


def _extent_text(algorithm, name, parameters, context):
    """West, south, east and north in the CRS of the terrain model, separated by commas."""
    terrain = algorithm.parameterAsRasterLayer(parameters, "DEM", context)
    crs = QgsCoordinateReferenceSystem() if terrain is None else terrain.crs()
    found = algorithm.parameterAsExtent(parameters, name, context, crs)
    return ",".join(
        forms.text(edge) for edge in (found.xMinimum(), found.yMinimum(), found.xMaximum(), found.yMaximum())
    )
