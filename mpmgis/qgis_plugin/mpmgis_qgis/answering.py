"""The verbs that ask results: maps, runout, sections, classes, comparison. Option by option as the command has them."""

from __future__ import annotations

from .fields import (
    CHOICE,
    FILE,
    FOLDER,
    INTEGER,
    LINES,
    NEW_FILE,
    NEW_FOLDER,
    NUMBER,
    PLACE,
    POINTS,
    POLYGONS,
    RASTER,
    SWITCH,
    TEXT,
    Field,
)
from .verbs import (
    BAND,
    CRS_OF_FILES,
    DASK,
    DEM_OF_FRAMES,
    DENSITY_OF_FRAMES,
    FOREIGN,
    FRAMES,
    OUTPUT,
    QGIS_MIN,
    TIMES,
    Verb,
    advanced,
    folder,
    load,
    optional,
    overwrite,
)

GROUP = "Maps and answers"

_MIN_DEPTH = advanced(
    "MIN_DEPTH", NUMBER, "Velocities of flow shallower than this [m] are left out", "--min-depth",
    "Metres; the velocity of a film of a few particles means little.", default=0.05, least=0,
)  # fmt: skip
_PERCENTILE = advanced(
    "PERCENTILE", NUMBER, "Percentile of the particles' heights taken as depth", "--percentile",
    "From 0 to 100 [%]; 100 is the highest particle.", default=100.0, least=0,
)  # fmt: skip
_STANDOFF = advanced(
    "STANDOFF", NUMBER, "Height over the terrain at which a 3D code's particles rest [m]", "--standoff",
    "Metres, for example half a particle.", default=0.0,
)  # fmt: skip

EXPORT = Verb(
    "export-raster",
    "Results to maps",
    GROUP,
    "Frames of particles to GeoTIFF bands (depth, thickness, velocities), their maxima and the deposit, opened as a "
    "styled group that moves: click the clock in QGIS' toolbar (Temporal Controller) and press play. One simulated "
    "second is shown as one minute.",
    (
        FRAMES,
        optional("CELL", TEXT, "Cell size [m], or auto", "--cs-e",
                 "Metres, or auto. Empty: the terrain's own cells."),
        optional("STEP", TEXT, "A map for each multiple of this time [s], or auto", "--dt-e",
                 "Seconds, or auto. Empty: every frame."),
        optional("EXTENT", CHOICE, "Cover the flow, or the whole terrain", "--extent", "Empty: the flow.",
                 choices=("flow", "dtm")),
        DEM_OF_FRAMES,
        advanced(
            "PRODUCTS", TEXT, "More bands, with commas", "--products",
            "t_vol, n, mass, p, detached, Ut_E, Ut_N; maxima: those so far.",
        ),
        _MIN_DEPTH,
        _PERCENTILE,
        advanced(
            "BED", CHOICE, "Bed under a particle", "--bed", "plane: the equations 4 and 6 of the paper to the letter.",
            default="bilinear", choices=("bilinear", "plane"),
        ),
        advanced(
            "STANDOFF", TEXT, "Height over the terrain at which a 3D code's particles rest [m], or auto", "--standoff",
            "Metres, or auto: taken from the frame with most mass below the bed.", default="0",
        ),
        advanced(
            "LAYOUT", CHOICE, "A file for each step, or a stack for each variable", "--layout",
            "steps: all variables at a time; stacks: all times of a variable.", default="steps",
            choices=("steps", "stacks"),
        ),
        advanced(
            "NAMING", CHOICE, "Names of the files", "--naming",
            "iseesnow: also peaks as ISeeSnow and AvaFrame name them.",
            default="mpmgis", choices=("mpmgis", "iseesnow"),
        ),
        advanced(
            "COG", SWITCH, "Cloud Optimized GeoTIFFs", "--cog", "With overviews, for a web server.", default=False
        ),
        advanced(
            "KML", SWITCH, "KMZ of release, largest depth and outlines", "--kml", "For Google Earth.", default=False
        ),
        advanced("STAC", SWITCH, "STAC item", "--stac", "Describes the folder for catalogues.", default=False),
        advanced(
            "NORTH_UP", SWITCH, "Cells along east and north", "--north-up",
            "Also where the terrain model is rotated. Off: cells lie along the axes of the terrain model.",
            default=False,
        ),
        advanced(
            "PAPER", SWITCH, "Depth averaging as printed in the paper", "--paper",
            "Vicari et al. (2025): tangent planes, no least depth, particles beyond the terrain in its nearest cell.",
            default=False,
        ),
        advanced("WORKERS", INTEGER, "Frames at a time", "--workers", "Processes. Empty: one for each core.", least=1),
        DASK,
        advanced(
            QGIS_MIN, CHOICE, "Oldest QGIS that must open it", "--qgis-min",
            "Before 3.38 an animation takes a layer for each step.", default="3.38", choices=("3.38", "3.22"),
        ),
        DENSITY_OF_FRAMES,
        CRS_OF_FILES,
        BAND,
        *FOREIGN,
        TIMES,
        overwrite("an earlier export"),
        folder("maps", "<name>_gis beside the results"),
        load("the maps"),
    ),
    project=True,
)  # fmt: skip

_RESULTS = Field(
    "FRAMES", FOLDER, "Results: folder of frames, or of maps", None,
    "The folder that a run, another code or 'Results to maps' wrote.",
)  # fmt: skip
_AVERAGED = (
    DEM_OF_FRAMES,
    advanced("CELL", NUMBER, "Cell size [m]", "--cs-e", "Metres. Empty: the terrain's own cells.", least=0),
    _MIN_DEPTH,
    _PERCENTILE,
    _STANDOFF,
    DENSITY_OF_FRAMES,
    CRS_OF_FILES,
    BAND,
    *FOREIGN,
    TIMES,
)  # fmt: skip


def _answer(word, files):
    """The last fields of a question: where its answer goes; `word` is the last one of the folder's name by itself."""
    return (overwrite("an earlier answer"), folder(files, f"<name>_{word} beside the results"))


def _reached(label):
    help = "Metres of flow depth or thickness."
    return optional("THRESHOLD", NUMBER, label, "--threshold", help, default=0.1, least=0)


_REACHED = _reached("Cells deeper than this were reached [m]")
_FLOW_LINE = optional("LINE", LINES, "Line that the flow took, from the top", "--line", "Empty: its own centre line.")

RUNOUT = Verb(
    "runout",
    "Runout and energy line",
    GROUP,
    "Runout, drop, angles of the energy line and of the centre of mass, and a longitudinal profile (.png) with tables "
    "(.csv). The figures are in the log.",
    (_RESULTS, _FLOW_LINE, _REACHED, *_AVERAGED, *_answer("runout", "profile and tables")),
    says=True,
    plots=True,
)

_AT_TIMES = optional(
    "AT_TIMES", TEXT, "Times [s], with commas", "--at-times", "Seconds; the nearest frames. Empty: five over the run."
)
_PLACES = (
    optional("POINTS", POINTS, "Points", "--points", "A layer; points have the names of its column 'name'."),
    optional("PLACE", PLACE, "or: one place on the map", "--points", "Click '...' and then the map."),
)

PROFILE = Verb(
    "profile",
    "Profile along a line",
    GROUP,
    "Flow depth, thickness and velocities along a line at chosen times, with terrain and free surface: a plot (.png) "
    "and a table (.csv).",
    (
        _RESULTS,
        Field("LINE", LINES, "Line", "--line", "One line; distances [m] begin at its first vertex."),
        _AT_TIMES,
        optional("SPACING", NUMBER, "Distance between places [m]", "--spacing", "Metres. Empty: a cell.", least=0),
        *_AVERAGED,
        *_answer("profile", "plot and table"),
    ),
    says=True,
    plots=True,
)

TIMESERIES = Verb(
    "timeseries",
    "Time series at points",
    GROUP,
    "Flow depth, thickness, velocities and impact pressure at points over time: a plot (.png, in the Results Viewer) "
    "and a table (.csv). The largest values are in the log.",
    (
        _RESULTS,
        *_PLACES,
        *_AVERAGED,
        *_answer("timeseries", "plot and table"),
    ),
    says=True,
    plots=True,
    one_of=("POINTS", "PLACE"),
)

VERTICAL = Verb(
    "vertical",
    "Density and velocity over the height",
    GROUP,
    "Density, velocities along and across the bed and impact pressure over the height above the bed, of a 3D "
    "simulation, in square cells around points: a plot (.png, in the Results Viewer) and tables (.csv). The sums of "
    "the pressure, force per width [kN/m] with the height at which it acts, are in the log.",
    (
        FRAMES,
        *_PLACES,
        _AT_TIMES,
        optional(
            "WIDTH", NUMBER, "Side of the cell around a point [m]", "--width",
            "Metres. Empty: four cells of the code's grid.", least=0,
        ),
        optional(
            "LAYER", NUMBER, "Height of a layer [m]", "--layer", "Metres. Empty: half a cell of that grid.", least=0
        ),
        DEM_OF_FRAMES,
        _PERCENTILE,
        _STANDOFF,
        DENSITY_OF_FRAMES,
        CRS_OF_FILES,
        BAND,
        *FOREIGN,
        TIMES,
        *_answer("vertical", "plot and tables"),
    ),
    says=True,
    plots=True,
    one_of=("POINTS", "PLACE"),
)  # fmt: skip

HYDROGRAPH = Verb(
    "hydrograph",
    "Hydrograph through a section",
    GROUP,
    "Volume and mass that go through a line across the flow, over time: a plot (.png) and a table (.csv). The sums are "
    "in the log.",
    (
        FRAMES,
        Field(
            "SECTION",
            LINES,
            "Section: one line across the flow",
            "--section",
            "A layer with one line. Positive [m3/s] is the way in which more mass went.",
        ),
        advanced(
            "METHOD",
            CHOICE,
            "Counted by",
            "--method",
            "auto: by particles, by cells where they have no ids.",
            default="auto",
            choices=("auto", "particles", "cells"),
        ),
        *_AVERAGED,
        *_answer("hydrograph", "plot and table"),
    ),
    says=True,
    plots=True,
)

INTENSITY = Verb(
    "intensity",
    "Intensity classes of a guideline",
    GROUP,
    "Puts every cell that the flow reached into a class of a named guideline, by the largest depth, speed, impact "
    "pressure or final depth. Areas are in the log. What a hazard zone is depends besides on the scenario's return "
    "period and on the authority: read the guideline.",
    (
        _RESULTS,
        optional(
            "GUIDELINE", CHOICE, "Guideline", "--guideline",
            "Its limits are of depth [m], speed [m/s], pressure [kPa].",
            choices=(
                "swiss-debris-flow", "swiss-flood", "swiss-avalanche", "swiss-hillslope-debris-flow",
                "austrian-avalanche", "austrian-torrent-deposit", "italian-avalanche-30", "italian-avalanche-100",
            ),
        ),
        advanced("OWN", TEXT, "or: name of one of your own", "--guideline", "As its file has it."),
        advanced(
            "GUIDELINES", FILE, "Your own guidelines", "--guidelines", "Tables of classes, in TOML.",
            files="Guidelines (*.toml)",
        ),
        *_AVERAGED,
        *_answer("intensity", "raster, polygons and table"),
        load("the classes"),
    ),
    says=True,
    layers=(".tif",),
    one_of=("GUIDELINE", "OWN"),
)  # fmt: skip

REPORT = Verb(
    "report",
    "Report",
    GROUP,
    "One HTML file with maps, figures of the runout with a profile, balances, warnings, effects and why they are on or "
    "off, parameters, versions and digests.",
    (
        FRAMES,
        optional("TITLE", TEXT, "Heading", "--title", "Empty: the name of the results, and what it is."),
        _FLOW_LINE,
        _REACHED,
        *_AVERAGED,
        overwrite("an earlier report"),
        Field(OUTPUT, NEW_FILE, "Report", "--output", "One file with all pictures in it.", files="HTML (*.html)"),
    ),
)

COMPARE = Verb(
    "compare",
    "Compare with another result or an observed outline",
    GROUP,
    "Area, runout, peaks, and how far two footprints overlap. The figures are in the log; with a folder also a map "
    "(.png), a table (.csv) and classes.tif (1 only the first, 2 only the second, 3 both).",
    (
        Field("FIRST", FOLDER, "Results: folder of maps or frames", None, "What a run or 'Results to maps' wrote."),
        optional("SECOND", FOLDER, "Compared with: folder of other results", None, "Differences: first minus this."),
        optional("OUTLINE", POLYGONS, "or: with an observed outline", None, "Polygons of where the event went."),
        _reached("Footprint: cells above this [m]"),
        advanced("BAND", TEXT, "Band whose footprint is compared", "--band", "Empty: the largest thickness."),
        optional("LINE", LINES, "Line along which runout is read, from the top", "--line",
                 "One line. Empty: the centre line of both flows together."),
        advanced("DEM", RASTER, "Terrain model, if not the one beside the results", "--dem", "Elevation in metres."),
        _STANDOFF,
        DENSITY_OF_FRAMES,
        CRS_OF_FILES,
        *FOREIGN,
        TIMES,
        overwrite("an earlier comparison"),
        optional(OUTPUT, NEW_FOLDER, "Folder for map, table and classes, if wanted", "--output",
                 "Empty: the figures in the log are all."),
        load("the classes"),
    ),
    says=True,
    plots=True,
    layers=(".tif",),
    palette=((1, "#d95f02", "only the first"), (2, "#1b6fc2", "only the second"), (3, "#7f5aa5", "both")),
    one_of=("SECOND", "OUTLINE"),
)  # fmt: skip

INFO = Verb(
    "info",
    "What is this file",
    GROUP,
    "One screen in the log about any file or folder of the chain: terrain, release, seed, frame, run, export.",
    (
        optional("FILE", FILE, "File", None, "Terrain, release, seed, frame, band, scene."),
        optional("FOLDER", FOLDER, "or: folder", None, "A run, an export, another code's files."),
        Field("JSON", SWITCH, "As JSON, in SI units", "--json", "For programs.", default=False),
        CRS_OF_FILES,
        DENSITY_OF_FRAMES,
        *FOREIGN,
    ),
    says=True,
    one_of=("FILE", "FOLDER"),
)
