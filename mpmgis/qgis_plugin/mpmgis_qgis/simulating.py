"""The verbs that make something move: demo, seed, run, effects, convert. Option by option as the command has them."""

from __future__ import annotations

from .fields import CHOICE, FILE, INTEGER, NEW_FILE, NEW_FOLDER, NUMBER, RASTER, SWITCH, TEXT, Field
from .verbs import (
    BAND,
    CRS_OF_FILES,
    DEM,
    DENSITY,
    DENSITY_OF_FRAMES,
    FILL_NODATA,
    FOREIGN,
    FRAME_FILES,
    LAW,
    OUTPUT,
    PARTICLES,
    RELEASE,
    SCENES,
    THICKNESS,
    THREADS,
    TIMES,
    Verb,
    advanced,
    folder,
    load,
    optional,
    overwrite,
    scene,
    start_unasked,
)

GROUP = "Simulate"

DEMO = Verb(
    "demo",
    "Try it on the shipped site",
    GROUP,
    "The whole chain on a sample site that comes with the program (Lava Falls, Grand Canyon): seeds, simulates, makes "
    "the maps and opens them. Under two minutes; the first time it also compiles, some 40 seconds more.",
    (
        overwrite("an earlier demo"),
        THREADS,
        Field(OUTPUT, NEW_FOLDER, "Folder for site, frames and maps", "--output", "The site's scene.toml is in it."),
        load("the maps"),
    ),
    project=True,
    plots=True,
)

SEED = Verb(
    "seed",
    "Seed particles on release areas",
    GROUP,
    "Particles of the release: columns of material on the terrain, from a DTM and polygons (Algorithm 1 of MOX report "
    "15/2025). To look at a release, or to start another code; a simulation seeds by itself. "
    "Choose a .h5 file to simulate or convert from it.",
    (
        DEM,
        RELEASE,
        THICKNESS,
        DENSITY,
        optional(
            "PER_CELL", INTEGER, "Columns in each cell of the terrain", "--per-cell", "A number. Empty: 16.", least=1
        ),
        optional("COUNT", INTEGER, "or: columns in all", "--count", "Met within 1 %.", least=1),
        optional(
            "SPACING", NUMBER, "or: spacing of the columns [m]", "--spacing", "Horizontal distance [m].", least=0
        ),
        advanced(
            "THICKNESS_MODE", CHOICE, "Thickness is measured", "--thickness-mode", "Empty: normal to the slope.",
            choices=("normal", "vertical"),
        ),
        advanced(
            "SURFACE", RASTER, "Instead of a thickness: surface of the material", "--surface",
            "Elevation [m]; the thickness is this raster minus the terrain.",
        ),
        advanced(
            "VELOCITY", TEXT, "Initial velocity to the east and north, E,N [m/s]", "--velocity",
            "Two numbers [m/s] with a comma.", default="0,0",
        ),
        advanced(
            "POINTS", CHOICE, "How the columns lie", "--points", "A lattice has the least noise at the start.",
            default="lattice", choices=("lattice", "staggered", "jittered", "halton", "random"),
        ),
        advanced(
            "MASS", CHOICE, "Mass of the columns", "--mass",
            "From thickness and area; equal, dense where it is thick; or equal and spread uniformly, as the report "
            "prints it.",
            default="thickness", choices=("thickness", "equal", "paper"),
        ),
        advanced(
            "REFINE_SLOPE", NUMBER, "More columns on steep ground, 0 to 3", "--refine-slope",
            "b [1]: 1 + b times the tangent of the slope, up to 1 + b, as many.", default=0.0,
        ),
        advanced(
            "SEED", INTEGER, "Seed of the random numbers", "--seed", "The same columns for the same number.", default=0,
            least=0,
        ),
        CRS_OF_FILES,
        BAND,
        FILL_NODATA,
        overwrite("an earlier file"),
        Field(OUTPUT, NEW_FILE, "Particles", "--output", "The suffix picks the format.", files=PARTICLES),
        load("the particles"),
    ),
    layers=(".gpkg", ".json", ".parquet"),
)  # fmt: skip

RUN = Verb(
    "run",
    "Simulate a scene file",
    GROUP,
    "Simulates a scene.toml, depth-averaged or in 3D: frames of particles, with balances of mass and energy in the "
    "log. Everything that the program can do is said in a scene; 'mpmgis run --template' prints one with every key "
    "explained. 'Simulate from a form' needs no scene. Then 'Results to maps' makes GeoTIFFs.",
    (
        scene(),
        Field(
            "RESUME", SWITCH, "Go on after the last whole frame", "--resume",
            "Of a run that was cancelled or stopped.", default=False,
        ),
        overwrite("the frames of an earlier run in the folder"),
        start_unasked("over an hour"),
        THREADS,
        LAW,
        folder("frames", "results beside the scene"),
    ),
)  # fmt: skip

EFFECTS = Verb(
    "effects",
    "Which effects a scene calls for",
    GROUP,
    "Which effects (curvature, entrainment, barriers, ...) are on in a scene, and the number that decided. The answer "
    "is in the log. Without a scene: the catalogue of all effects.",
    (
        optional("SCENE", FILE, "Scene", None, "The scene.toml of a simulation. Empty: the catalogue.", files=SCENES),
        Field(
            "MEASURE", SWITCH, "Measure what share of the computing time each effect takes", "--measure",
            "Runs the scene's first steps; half a minute for each effect where that is new.", default=False,
        ),
        LAW,
    ),
    says=True,
)  # fmt: skip

CONVERT = Verb(
    "convert",
    "Columns to 3D points, and back",
    GROUP,
    "A frame of depth-averaged columns filled with 3D points (Algorithm 2 of MOX report 15/2025), or points, those of "
    "another code too, gathered into columns. Mass and momentum are kept.",
    (
        Field(
            "FRAME", FILE, "Frame of columns or points", None, "A file of a run or a seed, or of another 3D code.",
            files=FRAME_FILES + ";;All files (*)",
        ),
        optional("TO", CHOICE, "What to make of it", "--to", "Empty: the other kind.", choices=("points", "columns")),
        optional(
            "CELL", NUMBER, "Cell size of the 3D grid to fill, or of the bins [m]", "--cell",
            "To points: columns wider than half of it are split. Empty: never split; bins as the terrain's cells.",
            least=0,
        ),
        optional(
            "SPACING", NUMBER, "To points: their vertical distance [m]", "--spacing",
            "Empty: half of the cell size; without one the median column's side.", least=0,
        ),
        advanced(
            "VERTICAL_VELOCITY", CHOICE, "To points: vertical velocity", "--vertical-velocity",
            "tangent: along the bed (as if empty); paper: 0; linear: along the bed and linear above it.",
            choices=("tangent", "paper", "linear"),
        ),
        advanced(
            "RELEVEL", SWITCH, "To points: raise columns that lie over each other", "--relevel",
            "To what their mass fills; needs a cell size.", default=False,
        ),
        advanced(
            "PAPER", SWITCH, "To points: every choice as the report prints it", "--paper", "With its defects.",
            default=False,
        ),
        advanced(
            "BY", CHOICE, "To columns: gather points by", "--by",
            "Empty: by the column that they came from, where they know it and still stand together.",
            choices=("parent", "cell"),
        ),
        advanced(
            "DETACHED", CHOICE, "To columns: mass that has left the bed", "--detached",
            "Empty: refuse. keep: as points in a second file, <name>_points.h5.", choices=("refuse", "keep"),
        ),
        advanced(
            "DEM", RASTER, "Terrain model, if not the one that the frame names", "--dem", "Elevation in metres."
        ),
        CRS_OF_FILES,
        BAND,
        advanced(
            "AT_TIME", NUMBER, "Frame of this time [s]", "--at-time", "Seconds, where the file holds several frames."
        ),
        *FOREIGN,
        TIMES,
        DENSITY_OF_FRAMES,
        overwrite("an earlier file"),
        Field(
            OUTPUT, NEW_FILE, "Converted frame", "--output", "Columns also as .gpkg, .csv, .json, .parquet, .vtp.",
            files=FRAME_FILES + ";;" + PARTICLES.replace("mpmgis frame (*.h5);;", ""),
        ),
        load("columns that are a layer"),
    ),
    layers=(".gpkg", ".json", ".parquet"),
)  # fmt: skip
