"""The forms that start another 3D solver from a release or from frames: seed --for, convert --for."""

from __future__ import annotations

from .fields import CHOICE, EXTENT, FILE, FILES, NEW_FOLDER, NUMBER, Field
from .verbs import (
    BAND,
    CRS_OF_FILES,
    DEM,
    DEM_OF_FRAMES,
    DENSITY,
    FILL_NODATA,
    FRAME_FILES,
    OUTPUT,
    RELEASE,
    THICKNESS,
    Verb,
    advanced,
    optional,
    overwrite,
)

GROUP = "Other 3D codes"
SOLVERS = ("kratos", "cbgeo", "geotaichi", "mpm-geomechanics", "houdini", "paraview")
_WRITES = (
    "Writes a folder from which that code starts: its own files in local coordinates, the ground, a sidecar that "
    "brings its results back to the map, and README.txt. Its results are read by 'Results to maps' and the other "
    "questions."
)
_SOLVER = Field("SOLVER", CHOICE, "Code to start", "--for", "Whose files to write.", choices=SOLVERS)
_MATERIAL = optional(
    "MATERIAL", FILE, "Material", "--material",
    "Scene with [material], or a TOML file with that table, maybe [friction] and [output] end_time [s].",
    files="Materials (*.toml)",
)  # fmt: skip
_WINDOW = advanced(
    "WINDOW", EXTENT, "Ground that the code gets", "--window",
    "Map coordinates [m]. Empty: the points' extent, as much again around them.",
)  # fmt: skip
_OUTPUT = (
    overwrite("an earlier folder"),
    Field(OUTPUT, NEW_FOLDER, "Folder for the code's files", "--output", "README.txt in it tells how to start."),
)

SEED_FOR = Verb(
    "seed",
    "Release for another 3D code",
    GROUP,
    "Fills a release with 3D points for another code. " + _WRITES,
    (
        _SOLVER,
        DEM,
        RELEASE,
        THICKNESS,
        DENSITY,
        Field("CELL", NUMBER, "Side of the cells of the code's grid [m]", "--cell", "Metres; points fill it.", least=0),
        _MATERIAL,
        _WINDOW,
        CRS_OF_FILES,
        BAND,
        FILL_NODATA,
        *_OUTPUT,
    ),
    name="seedfor",
)

CONVERT_FOR = Verb(
    "convert",
    "Frames for another 3D code",
    GROUP,
    "Hands frames of a run over to another code or viewer. " + _WRITES,
    (
        _SOLVER,
        Field("FRAMES", FILES, "Frames of columns or points", None, "Files (*.h5) of a run or a seed.",
              files=FRAME_FILES),
        optional("CELL", NUMBER, "Side of the cells of the code's grid [m]", "--cell",
                 "Metres; columns become points that fill it.", least=0),
        optional("SPACING", NUMBER, "Vertical distance of points [m]", "--spacing", "Metres. Empty: half of the cells.",
                 least=0),
        _MATERIAL,
        DEM_OF_FRAMES,
        CRS_OF_FILES,
        BAND,
        *_OUTPUT,
    ),
    name="convertfor",
)  # fmt: skip
