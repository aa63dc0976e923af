"""A scene without writing TOML: the form for the usual case, and the scene file that comes of it."""

from __future__ import annotations

import json

from .fields import INTEGER, NEW_FOLDER, NUMBER, RASTER, SWITCH, Field, text
from .verbs import OUTPUT, RELEASE, THICKNESS, load

IDENTIFIER = "simulate"
TITLE = "Simulate from a form"
HELP = (
    "From a terrain model and release areas to an animated map: writes scene.toml into the folder, simulates it "
    "depth-averaged with Voellmy friction, and makes the maps. mu and xi are calibrated values and yours to choose: "
    "snow avalanches mu 0.15 to 0.4, xi 1000 to 3000 m/s2; debris flows 0.05 to 0.2, 100 to 500; rock and rock-ice "
    "avalanches 0.1 to 0.3, 300 to 1500. The scene in the folder can be edited and run again with 'Simulate a scene "
    "file'; there it can have entrainment, barriers, inflow, friction by place, 3D."
)
NAMES = ("scene.toml", "results", "results_gis")  # in the folder: scene, frames, maps
RELEASE_FILE = "release.gpkg"
FIELDS = (
    Field("DEM", RASTER, "Terrain model (DTM)", help="Elevation in metres, in a projected CRS in metres."),
    Field("RELEASE", RELEASE.kind, RELEASE.label, help=RELEASE.help),
    Field("THICKNESS", THICKNESS.kind, THICKNESS.label, help=THICKNESS.help, optional=True),
    Field("FILL_NODATA", SWITCH, "Fill holes of the terrain model",
          help="Heights without data amid the terrain are interpolated from the ground around them; off: what flows "
          "into a hole has left the terrain.", default=False, optional=True, advanced=True),
    Field("DENSITY", NUMBER, "Density [kg/m3]",
          help="Of the release [kg/m3]: dense snow 200 to 400, debris 1600 to 2200.",
          default=1000.0, least=0),
    Field("MU", NUMBER, "Dry friction mu [1]", help="Tangent of the bed friction angle [1].", default=0.2, least=0),
    Field("XI", NUMBER, "Turbulent friction xi [m/s2]",
          help="[m/s2]; larger is more mobile. Empty: none, Coulomb friction.", default=1000.0, optional=True, least=0),
    Field("CELL_SIZE", NUMBER, "Cell size [m]", help="Metres. Empty: the terrain's own cells.", optional=True, least=0),
    Field("END_TIME", NUMBER, "Simulate until [s]",
          help="Seconds; it ends before if the flow comes to rest.", default=300.0, least=0),
    Field("FRAME_INTERVAL", NUMBER, "A map every [s]", help="Seconds of simulated time.", default=2.0, least=0),
    Field("YES", SWITCH, "Start even if predicted to take over an hour",
          help="Off: the predicted time is told, and nothing is started.", default=False),
    Field("THREADS", INTEGER, "Processor threads", help="Empty: all. The result is the same.", optional=True,
          advanced=True, least=1),
    Field("OVERWRITE", SWITCH, "Replace an earlier simulation in the folder",
          help="Off: an earlier simulation is left as it is.", default=False),
    Field(OUTPUT, NEW_FOLDER, "Folder for scene, frames and maps",
          help="scene.toml, results and results_gis go into it."),
    load("the maps"),
)  # fmt: skip


def scene_text(values):
    """The scene file for `values` (name -> value, paths as text), in TOML."""
    friction = {"law": "Coulomb", "mu": values["MU"]}
    if values.get("XI") is not None:  # 0 is refused by the command, not another law
        friction = {"law": "Voellmy", "mu": values["MU"], "xi": values["XI"]}
    tables = {
        "terrain": {"dem": values["DEM"], "fill_nodata": "interpolate" if values.get("FILL_NODATA") else None},
        "release": {
            "source": values["RELEASE"],
            "thickness": _number_or_name(values.get("THICKNESS")),
            "density": values["DENSITY"],
        },
        "friction": friction,
        "numerics": {"cell_size": values.get("CELL_SIZE")},
        "output": {"end_time": values["END_TIME"], "frame_interval": values["FRAME_INTERVAL"], "maxima": True},
    }
    lines = ["# Written by the QGIS toolbox; `mpmgis run --template` explains every key. SI units."]
    for table, keys in tables.items():
        given = [f"{key} = {_toml(value)}" for key, value in keys.items() if value is not None]
        lines += ["", f"[{table}]", *given] if given else []
    return "\n".join(lines) + "\n"


def _number_or_name(word):
    """A thickness that was typed: metres as a number, else the name of a column; None where nothing was."""
    word = (word or "").strip()
    try:
        return float(word)
    except ValueError:
        return word or None


def _toml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # what TOML's basic strings are, too
    return text(value)
