"""The verbs of the command `mpmgis` as forms: for each what it asks, under which option, and what it writes.

A new verb is a new row of VERBS. A test holds every option, choice and default here against the command's own parser.
"""

from __future__ import annotations

from dataclasses import dataclass

from .fields import (
    CHOICE,
    CRS,
    FILE,
    FOLDER,
    INTEGER,
    LINES,
    NEW_FILE,
    NEW_FOLDER,
    NUMBER,
    POLYGONS,
    RASTER,
    SWITCH,
    TEXT,
    Field,
)

OUTPUT = "OUTPUT"
QGIS_MIN = "QGIS_MIN"  # its default is the QGIS that asks
LOAD = "LOAD"

SCENES = "Scenes (*.toml)"
PARTICLES = "GeoPackage (*.gpkg);;mpmgis frame (*.h5);;CSV (*.csv);;GeoJSON (*.json);;Parquet (*.parquet);;VTK (*.vtp)"
FRAMES = "mpmgis frames (*.h5)"


@dataclass(frozen=True)
class Verb:
    """A verb of the command as an algorithm of the toolbox.

    `says` verbs answer with text on stdout, the others with the paths of what they wrote. `one_of` names fields of
    which exactly one is wanted. `project` verbs write a folder with a QGIS project, `layers` ones files to load.
    """

    verb: str
    title: str
    group: str
    help: str
    fields: tuple[Field, ...]
    says: bool = False
    project: bool = False
    layers: bool = False
    one_of: tuple[str, ...] = ()

    @property
    def identifier(self):
        """The algorithm's id: the verb without its hyphens."""
        return self.verb.replace("-", "")


def _optional(name, kind, label, option, help="", **more):
    return Field(name, kind, label, option, help, optional=True, **more)


def _advanced(name, kind, label, option, help="", **more):
    return Field(name, kind, label, option, help, optional=True, advanced=True, **more)


def _overwrite(what):
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
THICKNESS = _optional(
    "THICKNESS",
    TEXT,
    "Release thickness: metres, or name of a column",
    "--thickness",
    "Empty: the first of the columns thickness, d0, relth. Measured normal to the slope unless said otherwise.",
)
_DEM_OF_FRAMES = _advanced("DEM", RASTER, "Terrain model, if not the one that the frames name", "--dem")
_CRS = _advanced("CRS", CRS, "CRS, where the files carry none", "--crs")
_BAND = _advanced("DEM_BAND", INTEGER, "Band of the terrain model with the elevation", "--dem-band", least=1)
_DENSITY_OF_FRAMES = _advanced(
    "DENSITY", NUMBER, "Density [kg/m3], where the frames do not say it", "--density", least=0
)
_FRAMES = Field(
    "FRAMES",
    FOLDER,
    "Results: folder of frames",
    None,
    "The folder that a run wrote, or the folder of another code's particle files.",
)
_FOREIGN = (
    _advanced("READER", TEXT, "Another code: name of its reader", "--reader", "Empty: known by the files' contents."),
    _advanced("ORIGIN", TEXT, "Another code: map position of its origin, E,N,H [m]", "--origin"),
    _advanced("AXES", TEXT, "Another code: where its x,y,z point, for example e,u,-n", "--axes"),
    _advanced("DT", NUMBER, "Another code: seconds from frame to frame", "--dt", least=0),
    _advanced("FPS", NUMBER, "Another code: frames a second", "--fps", least=0),
    _advanced("COLUMNS", TEXT, "Another code: its columns, NAME=COLUMN with commas", "--columns"),
    _advanced("PARTICLE_VOLUME", NUMBER, "Another code: volume of a particle [m3]", "--particle-volume", least=0),
)
_TIMES = _advanced("TIMES", TEXT, "Another code: times of its files [s], with commas", "--times")
_LAW = _advanced(
    "LAW", FILE, "Your own law of friction: Python file, which will be run", "--law", files="Python (*.py)"
)

SEED = Verb(
    "seed",
    "Seed particles on release areas",
    "Simulate",
    "Particles of the release: columns of material on the terrain, from a DTM and polygons (Algorithm 1 of MOX report "
    "15/2025). To look at a release, or to start another code; a simulation seeds by itself. "
    "Choose a .h5 file to simulate or convert from it.",
    (
        DEM,
        RELEASE,
        THICKNESS,
        _optional("DENSITY", NUMBER, "Density [kg/m3]", "--density", default=1000.0, least=0),
        _optional("PER_CELL", INTEGER, "Columns in each cell of the terrain", "--per-cell", "Empty: 16.", least=1),
        _optional("COUNT", INTEGER, "or: columns in all", "--count", least=1),
        _optional("SPACING", NUMBER, "or: spacing of the columns [m]", "--spacing", least=0),
        _advanced(
            "THICKNESS_MODE", CHOICE, "Thickness is measured", "--thickness-mode", "Empty: normal to the slope.",
            choices=("normal", "vertical"),
        ),
        _advanced(
            "SURFACE", RASTER, "Instead of a thickness: surface of the material", "--surface",
            "The thickness is this raster minus the terrain.",
        ),
        _advanced(
            "VELOCITY", TEXT, "Initial velocity to the east and north, E,N [m/s]", "--velocity", default="0,0"
        ),
        _advanced(
            "POINTS", CHOICE, "How the columns lie", "--points", "A lattice has the least noise at the start.",
            default="lattice", choices=("lattice", "staggered", "jittered", "halton", "random"),
        ),
        _advanced(
            "MASS", CHOICE, "Mass of the columns", "--mass",
            "From thickness and area; equal, dense where it is thick; or equal and spread uniformly, as the report "
            "prints it.",
            default="thickness", choices=("thickness", "equal", "paper"),
        ),
        _advanced("REFINE_SLOPE", NUMBER, "More columns on steep ground, 0 to 3", "--refine-slope", default=0.0),
        _advanced("SEED", INTEGER, "Seed of the random numbers", "--seed", default=0, least=0),
        _CRS,
        _BAND,
        _overwrite("an earlier file"),
        Field(OUTPUT, NEW_FILE, "Particles", "--output", "The suffix picks the format.", files=PARTICLES),
        load("the particles"),
    ),
    layers=True,
)  # fmt: skip

RUN = Verb(
    "run",
    "Simulate a scene file",
    "Simulate",
    "Simulates a scene.toml, depth-averaged or in 3D: frames of particles, with balances of mass and energy in the "
    "log. Everything that the program can do is said in a scene; 'mpmgis run --template' prints one with every key "
    "explained. 'Simulate from a form' needs no scene. Then 'Results to maps' makes GeoTIFFs.",
    (
        Field("SCENE", FILE, "Scene", None, files=SCENES),
        Field(
            "RESUME", SWITCH, "Go on after the last whole frame", "--resume",
            "Of a run that was cancelled or stopped.", default=False,
        ),
        _overwrite("the frames of an earlier run in the folder"),
        Field(
            "YES", SWITCH, "Start even if predicted to take over an hour", "--yes", default=False
        ),
        _advanced("THREADS", INTEGER, "Processor threads", "--threads", "Empty: all. The result is the same.", least=1),
        _LAW,
        _optional(OUTPUT, NEW_FOLDER, "Folder for frames, if not results beside the scene", "--output"),
    ),
)  # fmt: skip

EXPORT = Verb(
    "export-raster",
    "Results to maps",
    "Maps and answers",
    "Frames of particles to GeoTIFF bands (depth, thickness, velocities), their maxima and the deposit, opened as a "
    "styled group that moves: click the clock in QGIS' toolbar (Temporal Controller) and press play. One simulated "
    "second is shown as one minute.",
    (
        _FRAMES,
        _optional("CELL", TEXT, "Cell size [m], or auto", "--cs-e", "Empty: the terrain's own cells."),
        _optional("STEP", TEXT, "A map for each multiple of this time [s], or auto", "--dt-e", "Empty: every frame."),
        _optional("EXTENT", CHOICE, "Cover the flow, or the whole terrain", "--extent", choices=("flow", "dtm")),
        _DEM_OF_FRAMES,
        _advanced(
            "PRODUCTS", TEXT, "More bands, with commas", "--products",
            "t_vol, n, mass, p, detached, Ut_E, Ut_N; maxima: those so far.",
        ),
        _advanced(
            "MIN_DEPTH", NUMBER, "Velocities of flow shallower than this [m] are left out", "--min-depth", default=0.05,
            least=0,
        ),
        _advanced(
            "PERCENTILE", NUMBER, "Percentile of the particles' heights taken as depth", "--percentile", default=100.0,
            least=0,
        ),
        _advanced(
            "BED", CHOICE, "Bed under a particle", "--bed", "plane: the equations 4 and 6 of the paper to the letter.",
            default="bilinear", choices=("bilinear", "plane"),
        ),
        _advanced(
            "STANDOFF", TEXT, "Height over the terrain at which a 3D code's particles rest [m], or auto", "--standoff",
            default="0",
        ),
        _advanced(
            "LAYOUT", CHOICE, "A file for each step, or a stack for each variable", "--layout", default="steps",
            choices=("steps", "stacks"),
        ),
        _advanced(
            "NAMING", CHOICE, "iseesnow: also peaks as ISeeSnow and AvaFrame name them", "--naming", default="mpmgis",
            choices=("mpmgis", "iseesnow"),
        ),
        _advanced("COG", SWITCH, "Cloud Optimized GeoTIFFs", "--cog", default=False),
        _advanced("WORKERS", INTEGER, "Frames at a time", "--workers", "Empty: one for each core.", least=1),
        _advanced("DASK", TEXT, "Dask cluster: address of its scheduler", "--dask"),
        _advanced(
            QGIS_MIN, CHOICE, "Oldest QGIS that must open it", "--qgis-min",
            "Before 3.38 an animation takes a layer for each step.", default="3.38", choices=("3.38", "3.22"),
        ),
        _DENSITY_OF_FRAMES,
        _CRS,
        _BAND,
        *_FOREIGN,
        _TIMES,
        _overwrite("an earlier export"),
        _optional(OUTPUT, NEW_FOLDER, "Folder for maps, if not <name>_gis beside the results", "--output"),
        load("the maps"),
    ),
    project=True,
)  # fmt: skip

EFFECTS = Verb(
    "effects",
    "Which effects a scene calls for",
    "Simulate",
    "Which effects (curvature, entrainment, barriers, ...) are on in a scene, and the number that decided. The answer "
    "is in the log. Without a scene: the catalogue of all effects.",
    (
        _optional("SCENE", FILE, "Scene", None, files=SCENES),
        Field(
            "MEASURE", SWITCH, "Measure what share of the computing time each effect takes", "--measure",
            "Runs the scene's first steps; half a minute for each effect where that is new.", default=False,
        ),
        _LAW,
    ),
    says=True,
)  # fmt: skip

CONVERT = Verb(
    "convert",
    "Columns to 3D points, and back",
    "Simulate",
    "A frame of depth-averaged columns filled with 3D points (Algorithm 2 of MOX report 15/2025), or points gathered "
    "into columns. Mass and momentum are kept.",
    (
        Field("FRAME", FILE, "Frame of columns or points", None, files=FRAMES),
        _optional("TO", CHOICE, "What to make of it", "--to", "Empty: the other kind.", choices=("points", "columns")),
        _optional("CELL", NUMBER, "Cell size of the 3D grid to fill, or of the bins [m]", "--cell", least=0),
        _optional("SPACING", NUMBER, "To points: their vertical distance [m]", "--spacing", least=0),
        _advanced(
            "VERTICAL_VELOCITY", CHOICE, "To points: vertical velocity", "--vertical-velocity",
            choices=("tangent", "paper", "linear"),
        ),
        _advanced("RELEVEL", SWITCH, "To points: raise columns that lie over each other", "--relevel", default=False),
        _advanced("PAPER", SWITCH, "To points: every choice as the report prints it", "--paper", default=False),
        _advanced("BY", CHOICE, "To columns: gather points by", "--by", choices=("parent", "cell")),
        _advanced(
            "DETACHED", CHOICE, "To columns: mass that has left the bed", "--detached", choices=("refuse", "keep")
        ),
        _advanced("DEM", RASTER, "Terrain model, if not the one that the frame names", "--dem"),
        _CRS,
        _BAND,
        _overwrite("an earlier file"),
        Field(OUTPUT, NEW_FILE, "Converted frame", "--output", files=FRAMES),
    ),
)  # fmt: skip

RUNOUT = Verb(
    "runout",
    "Runout and energy line",
    "Maps and answers",
    "Runout, drop, angles of the energy line and of the centre of mass, and a longitudinal profile (.png) with tables "
    "(.csv). The figures are in the log.",
    (
        Field("FRAMES", FOLDER, "Results: folder of frames, or of maps", None),
        _optional("LINE", LINES, "Line that the flow took, from the top", "--line", "Empty: its own centre line."),
        _optional(
            "THRESHOLD", NUMBER, "Cells deeper than this were reached [m]", "--threshold", default=0.1, least=0
        ),
        _DEM_OF_FRAMES,
        _advanced("CELL", NUMBER, "Cell size [m]", "--cs-e", "Empty: the terrain's own cells.", least=0),
        _advanced(
            "MIN_DEPTH", NUMBER, "Velocities of flow shallower than this [m] are left out", "--min-depth", default=0.05,
            least=0,
        ),
        _advanced(
            "STANDOFF", NUMBER, "Height over the terrain at which a 3D code's particles rest [m]", "--standoff",
            default=0.0,
        ),
        _DENSITY_OF_FRAMES,
        _CRS,
        _BAND,
        *_FOREIGN,
        _TIMES,
        _overwrite("an earlier answer"),
        _optional(
            OUTPUT, NEW_FOLDER, "Folder for profile and tables, if not <name>_runout beside the results", "--output"
        ),
    ),
    says=True,
)  # fmt: skip

COMPARE = Verb(
    "compare",
    "Compare with another result or an observed outline",
    "Maps and answers",
    "Area, runout, peaks, and how far two footprints overlap. The figures are in the log; with a folder also a map "
    "(.png), a table (.csv) and classes.tif (1 only the first, 2 only the second, 3 both).",
    (
        Field("FIRST", FOLDER, "Results: folder of maps or frames", None),
        _optional("SECOND", FOLDER, "Compared with: folder of other results", None),
        _optional("OUTLINE", POLYGONS, "or: with an observed outline", None),
        _optional(
            "THRESHOLD", NUMBER, "Footprint: cells above this [m]", "--threshold", default=0.1, least=0
        ),
        _advanced("BAND", TEXT, "Band whose footprint is compared", "--band", "Empty: the largest thickness."),
        _optional("LINE", LINES, "Line along which runout is read, from the top", "--line"),
        _advanced("DEM", RASTER, "Terrain model, if not the one beside the results", "--dem"),
        _overwrite("an earlier comparison"),
        _optional(OUTPUT, NEW_FOLDER, "Folder for map, table and classes, if wanted", "--output"),
    ),
    says=True,
    one_of=("SECOND", "OUTLINE"),
)  # fmt: skip

INFO = Verb(
    "info",
    "What is this file",
    "Maps and answers",
    "One screen in the log about any file or folder of the chain: terrain, release, seed, frame, run, export.",
    (
        _optional("FILE", FILE, "File", None),
        _optional("FOLDER", FOLDER, "or: folder", None),
        Field("JSON", SWITCH, "As JSON, in SI units", "--json", default=False),
        _CRS,
        _DENSITY_OF_FRAMES,
        *_FOREIGN,
    ),
    says=True,
    one_of=("FILE", "FOLDER"),
)

VERBS = (SEED, RUN, EXPORT, EFFECTS, CONVERT, RUNOUT, COMPARE, INFO)
