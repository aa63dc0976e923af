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
    DEM_OF_FRAMES,
    DENSITY_OF_FRAMES,
    FOREIGN,
    FRAMES,
    OUTPUT,
    QGIS_MIN,
    TIMES,
    Verb,
    advanced,
    load,
    optional,
    overwrite,
)

GROUP = "Maps and answers"

EXPORT = Verb(
    "export-raster",
    "Results to maps",
    GROUP,
    "Frames of particles to GeoTIFF bands (depth, thickness, velocities), their maxima and the deposit, opened as a "
    "styled group that moves: click the clock in QGIS' toolbar (Temporal Controller) and press play. One simulated "
    "second is shown as one minute.",
    (
        FRAMES,
        optional("CELL", TEXT, "Cell size [m], or auto", "--cs-e", "Empty: the terrain's own cells."),
        optional("STEP", TEXT, "A map for each multiple of this time [s], or auto", "--dt-e", "Empty: every frame."),
        optional("EXTENT", CHOICE, "Cover the flow, or the whole terrain", "--extent", choices=("flow", "dtm")),
        DEM_OF_FRAMES,
        advanced(
            "PRODUCTS", TEXT, "More bands, with commas", "--products",
            "t_vol, n, mass, p, detached, Ut_E, Ut_N; maxima: those so far.",
        ),
        advanced(
            "MIN_DEPTH", NUMBER, "Velocities of flow shallower than this [m] are left out", "--min-depth", default=0.05,
            least=0,
        ),
        advanced(
            "PERCENTILE", NUMBER, "Percentile of the particles' heights taken as depth", "--percentile", default=100.0,
            least=0,
        ),
        advanced(
            "BED", CHOICE, "Bed under a particle", "--bed", "plane: the equations 4 and 6 of the paper to the letter.",
            default="bilinear", choices=("bilinear", "plane"),
        ),
        advanced(
            "STANDOFF", TEXT, "Height over the terrain at which a 3D code's particles rest [m], or auto", "--standoff",
            default="0",
        ),
        advanced(
            "LAYOUT", CHOICE, "A file for each step, or a stack for each variable", "--layout", default="steps",
            choices=("steps", "stacks"),
        ),
        advanced(
            "NAMING", CHOICE, "iseesnow: also peaks as ISeeSnow and AvaFrame name them", "--naming", default="mpmgis",
            choices=("mpmgis", "iseesnow"),
        ),
        advanced("COG", SWITCH, "Cloud Optimized GeoTIFFs", "--cog", default=False),
        advanced("WORKERS", INTEGER, "Frames at a time", "--workers", "Empty: one for each core.", least=1),
        advanced("DASK", TEXT, "Dask cluster: address of its scheduler", "--dask"),
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
        optional(OUTPUT, NEW_FOLDER, "Folder for maps, if not <name>_gis beside the results", "--output"),
        load("the maps"),
    ),
    project=True,
)  # fmt: skip

_RESULTS = Field("FRAMES", FOLDER, "Results: folder of frames, or of maps", None)
_AVERAGED = (
    DEM_OF_FRAMES,
    advanced("CELL", NUMBER, "Cell size [m]", "--cs-e", "Empty: the terrain's own cells.", least=0),
    advanced(
        "MIN_DEPTH", NUMBER, "Velocities of flow shallower than this [m] are left out", "--min-depth", default=0.05,
        least=0,
    ),
    advanced(
        "STANDOFF", NUMBER, "Height over the terrain at which a 3D code's particles rest [m]", "--standoff",
        default=0.0,
    ),
    DENSITY_OF_FRAMES,
    CRS_OF_FILES,
    BAND,
    *FOREIGN,
    TIMES,
)  # fmt: skip


def _answer(word, files):
    """The last fields of a question: where its answer goes; `word` is the last one of the folder's name by itself."""
    label = f"Folder for {files}, if not <name>_{word} beside the results"
    return (overwrite("an earlier answer"), optional(OUTPUT, NEW_FOLDER, label, "--output"))


def _reached(label):
    return optional("THRESHOLD", NUMBER, label, "--threshold", default=0.1, least=0)


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
)

PROFILE = Verb(
    "profile",
    "Profile along a line",
    GROUP,
    "Flow depth, thickness and velocities along a line at chosen times, with terrain and free surface: a plot (.png) "
    "and a table (.csv).",
    (
        _RESULTS,
        Field("LINE", LINES, "Line", "--line"),
        optional("AT_TIMES", TEXT, "Times [s], with commas", "--at-times", "Empty: five over the run."),
        optional("SPACING", NUMBER, "Distance between places [m]", "--spacing", "Empty: a cell.", least=0),
        *_AVERAGED,
        *_answer("profile", "plot and table"),
    ),
    says=True,
)

TIMESERIES = Verb(
    "timeseries",
    "Time series at points",
    GROUP,
    "Flow depth, thickness, velocities and impact pressure at points over time: a plot (.png) and a table (.csv). "
    "Points have the names of a column 'name'. The largest values are in the log.",
    (
        _RESULTS,
        Field("POINTS", POINTS, "Points", "--points"),
        *_AVERAGED,
        *_answer("timeseries", "plot and table"),
    ),
    says=True,
)

HYDROGRAPH = Verb(
    "hydrograph",
    "Hydrograph through a section",
    GROUP,
    "Volume and mass that go through a line across the flow, over time: a plot (.png) and a table (.csv). The sums are "
    "in the log.",
    (
        FRAMES,
        Field("SECTION", LINES, "Section: one line across the flow", "--section"),
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
)

INTENSITY = Verb(
    "intensity",
    "Intensity classes of a guideline",
    GROUP,
    "Puts every cell that the flow reached into a class of a named guideline, by the largest depth, speed, impact "
    "pressure or final depth. Areas are in the log. What a hazard zone is depends besides on the scenario's return "
    "period and on the authority: read the guideline. Names: swiss-debris-flow, swiss-flood, swiss-avalanche, "
    "swiss-hillslope-debris-flow, austrian-avalanche, austrian-torrent-deposit, italian-avalanche-30, "
    "italian-avalanche-100.",
    (
        _RESULTS,
        Field("GUIDELINE", TEXT, "Name of the guideline", "--guideline"),
        advanced("GUIDELINES", FILE, "Your own guidelines", "--guidelines", files="Guidelines (*.toml)"),
        *_AVERAGED,
        *_answer("intensity", "raster, polygons and table"),
        load("the classes"),
    ),
    says=True,
    layers=(".tif",),
)

REPORT = Verb(
    "report",
    "Report",
    GROUP,
    "One HTML file with maps, figures of the runout with a profile, balances, warnings, effects and why they are on or "
    "off, parameters, versions and digests.",
    (
        FRAMES,
        optional("TITLE", TEXT, "Heading", "--title"),
        _FLOW_LINE,
        _REACHED,
        *_AVERAGED,
        overwrite("an earlier report"),
        Field(OUTPUT, NEW_FILE, "Report", "--output", files="HTML (*.html)"),
    ),
)

COMPARE = Verb(
    "compare",
    "Compare with another result or an observed outline",
    GROUP,
    "Area, runout, peaks, and how far two footprints overlap. The figures are in the log; with a folder also a map "
    "(.png), a table (.csv) and classes.tif (1 only the first, 2 only the second, 3 both).",
    (
        Field("FIRST", FOLDER, "Results: folder of maps or frames", None),
        optional("SECOND", FOLDER, "Compared with: folder of other results", None),
        optional("OUTLINE", POLYGONS, "or: with an observed outline", None),
        _reached("Footprint: cells above this [m]"),
        advanced("BAND", TEXT, "Band whose footprint is compared", "--band", "Empty: the largest thickness."),
        optional("LINE", LINES, "Line along which runout is read, from the top", "--line"),
        advanced("DEM", RASTER, "Terrain model, if not the one beside the results", "--dem"),
        overwrite("an earlier comparison"),
        optional(OUTPUT, NEW_FOLDER, "Folder for map, table and classes, if wanted", "--output"),
    ),
    says=True,
    one_of=("SECOND", "OUTLINE"),
)  # fmt: skip

INFO = Verb(
    "info",
    "What is this file",
    GROUP,
    "One screen in the log about any file or folder of the chain: terrain, release, seed, frame, run, export.",
    (
        optional("FILE", FILE, "File", None),
        optional("FOLDER", FOLDER, "or: folder", None),
        Field("JSON", SWITCH, "As JSON, in SI units", "--json", default=False),
        CRS_OF_FILES,
        DENSITY_OF_FRAMES,
        *FOREIGN,
    ),
    says=True,
    one_of=("FILE", "FOLDER"),
)
