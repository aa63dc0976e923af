"""Constants of QGIS that have another name by version: its own up to 3.34, in Qgis from 3.36 on and in QGIS 4.

All with the enumeration that they belong to, because Qt 6 knows no others. No other module names one.
"""

from __future__ import annotations

from qgis.core import (
    Qgis,
    QgsProcessing,
    QgsProcessingParameterDefinition,
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
CLOCK_OFF = _constant(
    "TemporalNavigationMode", "NavigationOff", lambda: QgsTemporalNavigationObject.NavigationMode.NavigationOff
)
CLOCK_ANIMATED = _constant(
    "TemporalNavigationMode", "Animated", lambda: QgsTemporalNavigationObject.NavigationMode.Animated
)
