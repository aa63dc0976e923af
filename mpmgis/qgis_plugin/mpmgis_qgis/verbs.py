"""What the forms of all verbs are made of: a verb as an algorithm, and the fields that several of them ask."""

from __future__ import annotations

from dataclasses import dataclass

from .fields import CHOICE, CRS, FILE, FOLDER, INTEGER, NEW_FOLDER, NUMBER, POLYGONS, RASTER, SWITCH, TEXT, Field

OUTPUT = "OUTPUT"
QGIS_MIN = "QGIS_MIN"  # its default is the QGIS that asks
LOAD = "LOAD"

SCENES = "Scenes (*.toml)"
PARTICLES = "GeoPackage (*.gpkg);;mpmgis frame (*.h5);;CSV (*.csv);;GeoJSON (*.json);;Parquet (*.parquet);;VTK (*.vtp)"
FRAME_FILES = "mpmgis frames (*.h5)"


@dataclass(frozen=True)
class Verb:
    """A verb of the command as an algorithm of the toolbox.

    `says` verbs answer with text on stdout, the others with the paths of what they wrote. `one_of` names fields of
    which exactly one is wanted. `project` verbs write a folder with a QGIS project; of other verbs' files those that
    end with one of `layers` are opened, rasters that bring no style of their own with `palette` (value, colour, label)
    on their first band. `plots` verbs write a picture, which is put into QGIS' Results Viewer. `name`
    tells two forms of one verb apart.
    """

    verb: str
    title: str
    group: str
    help: str
    fields: tuple[Field, ...]
    says: bool = False
    project: bool = False
    plots: bool = False
    layers: tuple[str, ...] = ()
    palette: tuple[tuple[int, str, str], ...] = ()
    one_of: tuple[str, ...] = ()
    name: str = ""

    @property
    def identifier(self):
        """The algorithm's id: the verb without its hyphens, or the form's own name."""
        return self.name or self.verb.replace("-", "")


def optional(name, kind, label, option, help="", **more):
    """A field that may be left empty."""
    return Field(name, kind, label, option, help, optional=True, **more)


def advanced(name, kind, label, option, help="", **more):
    """A field that may be left empty and is folded away."""
    return Field(name, kind, label, option, help, optional=True, advanced=True, **more)


def overwrite(what):
    """The switch without which nothing is replaced."""
    help = "Off: what exists is left as it is, and the command says so."
    return Field("OVERWRITE", SWITCH, f"Replace {what} of that name", "--overwrite", help, default=False)


def load(what):
    """The switch that loads the outputs."""
    return Field(LOAD, SWITCH, f"Open {what} in this project", help="With their styles and times.", default=True)


def scene():
    """The scene that a verb cannot do without."""
    return Field("SCENE", FILE, "Scene", None, "The scene.toml of a simulation.", files=SCENES)


def start_unasked(long):
    """The switch that stands for the answer to the question whether to start what will be `long`."""
    help = "Off: the command tells the time that it predicts, and ends before the first step."
    return Field("YES", SWITCH, f"Start even if predicted to take {long}", "--yes", help, default=False)


def folder(what, usual):
    """The folder for `what`, which is `usual` if none is named."""
    help = f"Empty: {usual}."
    return optional(OUTPUT, NEW_FOLDER, f"Folder for {what}, if not {usual}", "--output", help)


DEM = Field("DEM", RASTER, "Terrain model (DTM)", "--dem", "Elevation in metres, in a projected CRS in metres.")
RELEASE = Field(
    "RELEASE",
    POLYGONS,
    "Release areas",
    "--release",
    "Polygons where the mass starts; another CRS than the terrain's is reprojected.",
)
THICKNESS = optional(
    "THICKNESS",
    TEXT,
    "Release thickness: metres, or name of a column",
    "--thickness",
    "Empty: the first of the columns thickness, d0, relth [m]. Measured normal to the slope unless said otherwise.",
)
DENSITY = optional(
    "DENSITY",
    NUMBER,
    "Density [kg/m3]",
    "--density",
    "Of the release [kg/m3]: dense snow 200 to 400, debris 1600 to 2200.",
    default=1000.0,
    least=0,
)
DEM_OF_FRAMES = advanced(
    "DEM",
    RASTER,
    "Terrain model, if not the one that the frames name",
    "--dem",
    "Elevation in metres. Empty: the file that the run was made with.",
)
CRS_OF_FILES = advanced("CRS", CRS, "CRS, where the files carry none", "--crs", "A projected CRS in metres.")
BAND = advanced(
    "DEM_BAND",
    INTEGER,
    "Band of the terrain model with the elevation",
    "--dem-band",
    "Its number, from 1. Empty: the only one.",
    least=1,
)
FILL_NODATA = advanced(
    "FILL_NODATA",
    CHOICE,
    "Holes amid the terrain model",
    "--fill-nodata",
    "interpolate: heights from the ground around them. Empty: a release over one is refused.",
    choices=("interpolate",),
)
DENSITY_OF_FRAMES = advanced(
    "DENSITY",
    NUMBER,
    "Density [kg/m3], where the frames do not say it",
    "--density",
    "Of the release [kg/m3]; frames of mpmgis say it.",
    least=0,
)
FRAMES = Field(
    "FRAMES",
    FOLDER,
    "Results: folder of frames",
    None,
    "The folder that a run wrote, or the folder of another code's particle files.",
)
FOREIGN = (
    advanced("READER", TEXT, "Another code: name of its reader", "--reader", "Empty: known by the files' contents."),
    advanced(
        "ORIGIN", TEXT, "Another code: map position of its origin, E,N,H [m]", "--origin",
        "Easting, northing and height [m] of the files' own zero, with commas.",
    ),
    advanced(
        "AXES", TEXT, "Another code: where its x,y,z point, for example e,u,-n", "--axes",
        "e east, n north, u up, with a minus for the opposite. Empty: e,n,u.",
    ),
    advanced(
        "DT", NUMBER, "Another code: seconds from frame to frame", "--dt",
        "Time [s] between files that are numbered and tell no time.", least=0,
    ),
    advanced("FPS", NUMBER, "Another code: frames a second", "--fps", "Instead of seconds [1/s].", least=0),
    advanced(
        "COLUMNS", TEXT, "Another code: its columns, NAME=COLUMN with commas", "--columns",
        "Names: x, y, z, vx, vy, vz, mass, volume, radius, diameter, id, active, time; position, velocity.",
    ),
    advanced(
        "PARTICLE_VOLUME", NUMBER, "Another code: volume of a particle [m3]", "--particle-volume",
        "Of every particle [m3], where the files do not say it.", least=0,
    ),
    advanced(
        "SIDECAR", FILE, "Another code: file that tells all this", "--sidecar",
        "Empty: <name>.georef.json or georef.json beside its files.", files="Sidecars (*.json)",
    ),
)  # fmt: skip
TIMES = advanced(
    "TIMES", TEXT, "Another code: times of its files [s], with commas", "--times", "By the files' numbers."
)
LAW = advanced(
    "LAW",
    FILE,
    "Your own law of friction: Python file, which will be run",
    "--law",
    "Only for a scene that names a law of its own.",
    files="Python (*.py)",
)
THREADS = advanced("THREADS", INTEGER, "Processor threads", "--threads", "Empty: all. The result is the same.", least=1)
DASK = advanced("DASK", TEXT, "Dask cluster: address of its scheduler", "--dask", "For example tcp://10.0.0.1:8786.")
