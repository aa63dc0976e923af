"""Define the form for a usual simulation, and make the scene file of it."""

from __future__ import annotations

import json
from dataclasses import replace

from .forms import (
    CHOICE,
    COLUMN,
    INTEGER,
    LOAD,
    NEW_FOLDER,
    NUMBER,
    OUTPUT,
    POLYGONS,
    RASTER,
    SWITCH,
    TEXT,
    Field,
    text,
)

IDENTIFIER, GROUP = "simulate", "Simulate"
TITLE = "Simulate from a form"
HELP = (
    "From a terrain model and release areas to an animated map: writes scene.toml into the folder, simulates it "
    "depth-averaged with Voellmy friction, and makes the maps. mu and xi must be calibrated by the user; usual values: "
    "{ranges}. You can edit the scene in the folder, for example add entrainment, forest, "
    "barriers, inflow, friction zones or 3D, and run it again with 'Simulate a scene file'."
)
NAMES = ("scene.toml", "results", "results_gis")  # in the folder: scene, frames, maps
RELEASE_FILE = "release.gpkg"
OWN_FRICTION = "own values: mu and xi below"
PRESETS = {  # (mu, xi [m s-2]); the middle of the range of docs/limits.md where no published value was read
    "extreme snow avalanche: mu 0.16 and xi 1360 (Buser and Frutiger 1980)": (0.16, 1360.0),
    "large snow avalanche: mu 0.15 and xi 1400 (Martinelli et al. 1980: 1200 to 1600)": (0.15, 1400.0),
    "debris flow: mu 0.12 and xi 300 (middle of the usual range; no source read)": (0.12, 300.0),
    "rock avalanche: mu 0.2 and xi 900 (middle of the usual range; no source read)": (0.2, 900.0),
}
_FIELDS = (
    Field("DEM", RASTER, "Terrain model (DTM)", help="Elevation in metres, in a projected CRS in metres."),
    Field(
        "RELEASE",
        POLYGONS,
        "Release areas",
        help="Polygons where the mass starts; reprojected if their CRS is not the terrain's.",
    ),
    Field(
        "THICKNESS",
        TEXT,
        "Release thickness: metres, or name of a column",
        help="Empty: the first of the columns thickness, d0, relth [m]. Normal to the slope.",
        optional=True,
    ),
    Field(
        "THICKNESS_COLUMN",
        COLUMN,
        "or: column of the release areas with the thickness [m]",
        help="One of the numeric columns of the release areas, in metres, normal to the slope.",
        optional=True,
    ),
    Field(
        "FILL_NODATA",
        SWITCH,
        "Fill holes of the terrain model",
        help="Elevations in holes inside the terrain are interpolated from the ground around them; off: flow that "
        "enters a hole has left the terrain.",
        default=False,
        optional=True,
        advanced=True,
    ),
    Field("DENSITY", NUMBER, "Density"),
    Field(
        "PRESET",
        CHOICE,
        "Friction for a kind of process",
        help="Starting values for a calibration, not a substitute for one. Only with own values mu and xi are used.",
        default=OWN_FRICTION,
        choices=(OWN_FRICTION, *PRESETS),
        optional=True,
    ),
    Field("MU", NUMBER, "Dry friction mu [1]", help="Tangent of the bed friction angle [1].", default=0.2),
    Field(
        "XI",
        NUMBER,
        "Turbulent friction xi [m/s2]",
        help="[m/s2]; larger is more mobile. Empty: none, Coulomb friction.",
        default=1000.0,
        optional=True,
    ),
    Field("CELL_SIZE", NUMBER, "Cell size [m]", help="Metres. Empty: the terrain's own cells.", optional=True),
    Field(
        "END_TIME",
        NUMBER,
        "Simulate until [s]",
        help="Seconds; it ends earlier if the flow comes to rest.",
        default=300.0,
    ),
    Field("FRAME_INTERVAL", NUMBER, "A map every [s]", help="Seconds of simulated time.", default=2.0),
    Field(
        "YES",
        SWITCH,
        "Start even if predicted to take over an hour",
        help="Off: the predicted time is shown, and nothing is started.",
        default=False,
    ),
    Field(
        "THREADS",
        INTEGER,
        "Processor threads",
        help="Empty: all. The result does not depend on it.",
        optional=True,
        advanced=True,
        least=1,
    ),
    Field(
        "OVERWRITE",
        SWITCH,
        "Replace an earlier simulation in the folder",
        help="Off: an earlier simulation is an error.",
        default=False,
    ),
    Field(
        OUTPUT,
        NEW_FOLDER,
        "Folder for scene, frames and maps",
        help="It will contain scene.toml, results and results_gis.",
    ),
    Field(LOAD, SWITCH, "Open the maps in this project", help="With their styles and times.", default=True),
)


def fields(data: dict[str, object]) -> tuple[Field, ...]:
    """Return the fields of the form.

    Parameters
    ----------
    data : dict
        What the scene states (`forms.read_scene_data`): limits of numbers, and all words about the density.
    """
    return tuple(replace(field, **data["fields"].get(field.name, {})) for field in _FIELDS)


def help_text(data: dict[str, object]) -> str:
    """Return the help of the form.

    Parameters
    ----------
    data : dict
        What the scene states (`forms.read_scene_data`): ranges of friction.
    """
    return HELP.format(ranges=data["friction_ranges"])


def scene_text(values: dict[str, object]) -> str:
    """Return the text of the scene file, in TOML.

    Parameters
    ----------
    values : dict
        Name of a field -> value; paths as text.

    Returns
    -------
    str
    """
    preset = values.get("PRESET")
    mu, xi = PRESETS.get(preset, (values["MU"], values.get("XI")))
    friction = {"law": "Coulomb", "mu": mu}
    if xi is not None:  # the command refuses 0
        friction = {"law": "Voellmy", "mu": mu, "xi": xi}
    tables = {
        "terrain": {"dem": values["DEM"], "fill_nodata": "interpolate" if values.get("FILL_NODATA") else None},
        "release": {
            "source": values["RELEASE"],
            "thickness": _number_or_name(values.get("THICKNESS") or values.get("THICKNESS_COLUMN")),
            "density": values["DENSITY"],
        },
        "friction": friction,
        "numerics": {"cell_size": values.get("CELL_SIZE")},
        "output": {"end_time": values["END_TIME"], "frame_interval": values["FRAME_INTERVAL"], "maxima": True},
    }
    lines = ["# Written by the QGIS toolbox; `mpmgis run --template` explains every key. SI units."]
    if preset in PRESETS:
        lines.append(f"# Friction: {preset}")
    for table, keys in tables.items():
        given = [f"{key} = {_toml(value)}" for key, value in keys.items() if value is not None]
        lines += ["", f"[{table}]", *given] if given else []
    return "\n".join(lines) + "\n"


def _number_or_name(word):
    """A typed thickness: metres as a number, else the name of a column; None for an empty field."""
    word = (word or "").strip()
    try:
        return float(word)
    except ValueError:
        return word or None


def _toml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # also a TOML basic string
    return text(value)
