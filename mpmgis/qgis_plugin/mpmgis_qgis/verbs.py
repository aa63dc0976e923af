"""What the forms of all verbs are made of: a verb as an algorithm, and the fields that several of them ask."""

from __future__ import annotations

from dataclasses import dataclass

from .fields import CRS, FILE, FOLDER, INTEGER, NUMBER, POLYGONS, RASTER, SWITCH, TEXT, Field

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
    end with one of `layers` are opened.
    """

    verb: str
    title: str
    group: str
    help: str
    fields: tuple[Field, ...]
    says: bool = False
    project: bool = False
    layers: tuple[str, ...] = ()
    one_of: tuple[str, ...] = ()

    @property
    def identifier(self):
        """The algorithm's id: the verb without its hyphens."""
        return self.verb.replace("-", "")


def optional(name, kind, label, option, help="", **more):
    """A field that may be left empty."""
    return Field(name, kind, label, option, help, optional=True, **more)


def advanced(name, kind, label, option, help="", **more):
    """A field that may be left empty and is folded away."""
    return Field(name, kind, label, option, help, optional=True, advanced=True, **more)


def overwrite(what):
    """The switch without which nothing is replaced."""
    return Field("OVERWRITE", SWITCH, f"Replace {what} of that name", "--overwrite", default=False)


def load(what):
    """The switch that loads the outputs."""
    return Field(LOAD, SWITCH, f"Open {what} in this project", default=True)


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
    "Empty: the first of the columns thickness, d0, relth. Measured normal to the slope unless said otherwise.",
)
DEM_OF_FRAMES = advanced("DEM", RASTER, "Terrain model, if not the one that the frames name", "--dem")
CRS_OF_FILES = advanced("CRS", CRS, "CRS, where the files carry none", "--crs")
BAND = advanced("DEM_BAND", INTEGER, "Band of the terrain model with the elevation", "--dem-band", least=1)
DENSITY_OF_FRAMES = advanced("DENSITY", NUMBER, "Density [kg/m3], where the frames do not say it", "--density", least=0)
FRAMES = Field(
    "FRAMES",
    FOLDER,
    "Results: folder of frames",
    None,
    "The folder that a run wrote, or the folder of another code's particle files.",
)
FOREIGN = (
    advanced("READER", TEXT, "Another code: name of its reader", "--reader", "Empty: known by the files' contents."),
    advanced("ORIGIN", TEXT, "Another code: map position of its origin, E,N,H [m]", "--origin"),
    advanced("AXES", TEXT, "Another code: where its x,y,z point, for example e,u,-n", "--axes"),
    advanced("DT", NUMBER, "Another code: seconds from frame to frame", "--dt", least=0),
    advanced("FPS", NUMBER, "Another code: frames a second", "--fps", least=0),
    advanced("COLUMNS", TEXT, "Another code: its columns, NAME=COLUMN with commas", "--columns"),
    advanced("PARTICLE_VOLUME", NUMBER, "Another code: volume of a particle [m3]", "--particle-volume", least=0),
)
TIMES = advanced("TIMES", TEXT, "Another code: times of its files [s], with commas", "--times")
LAW = advanced("LAW", FILE, "Your own law of friction: Python file, which will be run", "--law", files="Python (*.py)")
