"""Every verb of the command `mpmgis` that the toolbox has; a new one is a row here and in one of the tables.

A test holds every verb, option, choice and default of them against the command's own parser.
"""

from __future__ import annotations

from .answering import COMPARE, EXPORT, HYDROGRAPH, INFO, INTENSITY, PROFILE, REPORT, RUNOUT, TIMESERIES, VERTICAL
from .handing_over import CONVERT_FOR, SEED_FOR
from .many_runs import ENSEMBLE, STUDY
from .simulating import CONVERT, DEMO, EFFECTS, RUN, SEED

VERBS = (
    *(DEMO, SEED, RUN, EFFECTS, CONVERT, SEED_FOR, CONVERT_FOR, EXPORT, RUNOUT, PROFILE, TIMESERIES, HYDROGRAPH),
    *(VERTICAL, INTENSITY, COMPARE, REPORT, INFO, STUDY, ENSEMBLE),
)
# what the command has and no form asks -> why
LEFT_OUT_VERBS = {"qgis-plugin": "it makes this toolbox"}
LEFT_OUT_OPTIONS = {
    ("run", "--template"): "the form that simulates writes a scene to begin from",
    ("export-raster", "--no-qgis"): "the project is what is opened here",
    ("export-raster", "--animation"): "the temporal controller of QGIS exports the map that is seen there",
    ("timeseries", "--at"): "a place is clicked on the map, in whatever CRS that has",
    ("vertical", "--at"): "a place is clicked on the map, in whatever CRS that has",
    ("runout", "--json"): "for programs; the figures are in the log and in the tables",
    ("compare", "--json"): "for programs; the figures are in the log and in the table",
    ("effects", "--json"): "for programs; the answer is in the log",
    ("effects", "--output"): "the answer is in the log, which can be saved",
    ("effects", "--overwrite"): "there is no file",
    ("info", "--output"): "the answer is in the log, which can be saved",
    ("info", "--overwrite"): "there is no file",
    ("convert", "--window"): "frames have an extent of their own",
}
