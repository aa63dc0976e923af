"""Name constants of QGIS that depend on the version: in their class up to 3.34, in Qgis from 3.36 and in QGIS 4.

All are written with their enumeration, as Qt 6 requires. No other module uses such constants.
"""

from __future__ import annotations

from qgis.core import (
    Qgis,
    QgsProcessing,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterField,
    QgsProcessingParameterFile,
    QgsProcessingParameterNumber,
    QgsTemporalNavigationObject,
)


def _constant(enumeration, name, earlier):
    """`name` of the `enumeration` in Qgis, else what `earlier()` gives."""
    found = getattr(Qgis, enumeration, None)
    return earlier() if found is None else getattr(found, name)


POLYGONS = _constant("ProcessingSourceType", "VectorPolygon", lambda: QgsProcessing.SourceType.TypeVectorPolygon)
LINES = _constant("ProcessingSourceType", "VectorLine", lambda: QgsProcessing.SourceType.TypeVectorLine)
POINTS = _constant("ProcessingSourceType", "VectorPoint", lambda: QgsProcessing.SourceType.TypeVectorPoint)
FILES = _constant("ProcessingSourceType", "File", lambda: QgsProcessing.SourceType.TypeFile)
ADVANCED = _constant("ProcessingParameterFlag", "Advanced", lambda: QgsProcessingParameterDefinition.Flag.FlagAdvanced)
FOLDER = _constant("ProcessingFileParameterBehavior", "Folder", lambda: QgsProcessingParameterFile.Behavior.Folder)
WHOLE = _constant("ProcessingNumberParameterType", "Integer", lambda: QgsProcessingParameterNumber.Type.Integer)
ANY_NUMBER = _constant("ProcessingNumberParameterType", "Double", lambda: QgsProcessingParameterNumber.Type.Double)
NUMERIC = _constant("ProcessingFieldParameterDataType", "Numeric", lambda: QgsProcessingParameterField.DataType.Numeric)
CLOCK_OFF = _constant(
    "TemporalNavigationMode", "NavigationOff", lambda: QgsTemporalNavigationObject.NavigationMode.NavigationOff
)
CLOCK_ANIMATED = _constant(
    "TemporalNavigationMode", "Animated", lambda: QgsTemporalNavigationObject.NavigationMode.Animated
)
INFORMATION = Qgis.MessageLevel.Info
