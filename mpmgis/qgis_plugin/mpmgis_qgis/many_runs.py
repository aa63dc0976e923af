"""The verbs that run a scene many times: study, ensemble. Option by option as the command has them."""

from __future__ import annotations

from .fields import CHOICE, FILE, FILES, INTEGER, NUMBER, RASTER, SWITCH, TEXT, TEXTS, Field
from .verbs import DASK, LAW, THREADS, Verb, advanced, folder, load, optional, overwrite, scene, start_unasked

GROUP = "Many runs"

STUDY = Verb(
    "study",
    "What accuracy costs in time",
    GROUP,
    "Runs a scene with each of its numerical settings turned alone (cell size, particles a cell, Courant number, ...), "
    "each several times, and holds the results against a finer run or an exact answer: a table (study.csv), the plot "
    "of error against time (study.png, in the Results Viewer) and what an export loses (export.csv). Says in the log "
    "which settings are worth their time. It runs the scene some dozens of times: begin with a short one.",
    (
        scene(),
        optional(
            "TARGET_ERROR", NUMBER, "Find the settings for this error", "--target-error",
            "0.05 is 5 %; where the reach decides, metres. The log then tells the settings for it.", least=0,
        ),
        optional(
            "KNOBS", TEXT, "Turn only these settings, with commas", "--knobs",
            "cell_size, particles_per_cell, cfl; in 3D also points_per_cell, precision, stiffness. Empty: all it has.",
        ),
        optional(
            "CELL_SIZES", TEXT, "Cell sizes to try [m], with commas", "--cell-sizes",
            "Metres. Empty: 2, 1.4, 1 and 0.7 times the scene's.",
        ),
        optional(
            "REPEATS", INTEGER, "Runs of each setting", "--repeats", "The time is their median.", default=3, least=1
        ),
        advanced(
            "MEASURE", CHOICE, "Error that decides", "--measure",
            "Of thickness, momentum or area [1], or of the reach [m].", default="thickness",
            choices=("thickness", "momentum", "area", "reach"),
        ),
        advanced(
            "EXACT", RASTER, "Exact answer: vertical thickness at the end", "--exact",
            "Raster [m]. Empty: a finer run is the truth.",
        ),
        advanced(
            "REFINEMENT", NUMBER, "Cells of the finer run: the scene's divided by", "--refinement",
            "A number [1]. Empty: the smallest that are tried, divided by 1.4.", least=0,
        ),
        advanced(
            "BESIDE", FILES, "Results of other codes, to be shown too", "--beside",
            "CSV with the columns setting, seconds [s] and error_thickness, or thickness (a raster [m]).",
        ),
        advanced(
            "FULL", SWITCH, "Three values of each setting with those of each other", "--full", "Takes much longer.",
            default=False,
        ),
        advanced(
            "NO_EXPORTS", SWITCH, "Leave out what exports lose", "--no-exports",
            "Cells and time steps of an export are not tried.", default=False,
        ),
        start_unasked("over ten minutes"),
        THREADS,
        LAW,
        overwrite("an earlier study"),
        folder("table and plot", "study beside the scene"),
    ),
    says=True,
    plots=True,
)  # fmt: skip

ENSEMBLE = Verb(
    "ensemble",
    "Probability maps from many runs",
    GROUP,
    "Runs a scene many times with other values of what is not known well, and maps what the runs say together: the "
    "probability that depths, speeds or pressures are reached, means, percentiles and envelopes, opened as a styled "
    "group. What varies is written as in friction.mu=0.15:0.3 (uniform from 0.15 to 0.3) or "
    "release.thickness=normal:1.5:0.3; the tooltip has the others. Cancelled, it goes on where it stopped when it is "
    "started again into the same folder.",
    (
        scene(),
        optional(
            "VARY", TEXTS, "What varies: KEY=VALUES, one a line", "--vary",
            "KEY is TABLE.KEY of the scene, in its units. VALUES: LOW:HIGH (uniform), A,B,C (a list), normal:MEAN:SD, "
            "lognormal:MEAN:SD (both also with :LOW:HIGH to cut them), triangular:LOW:MODE:HIGH. For example "
            "friction.mu=0.15:0.3; on one line with semicolons between them.",
        ),
        optional(
            "PLAN", FILE, "or: plan in a file", "--plan",
            "TOML with [vary] and these options; the form goes before it.", files="Plans (*.toml)",
        ),
        optional(
            "SAMPLES", INTEGER, "Runs", "--samples", "A number. Empty: 32; on a grid the values of each range, 5.",
            least=1,
        ),
        optional(
            "EXCEED", TEXTS, "Thresholds: NAME=A,B, one a line", "--exceed",
            "Peaks of h [m], Ut [m/s] or p [Pa] that count as exceeded. Empty: h=0.5,1,2.",
        ),
        optional(
            "PERCENTILES", TEXT, "Percentiles, with commas", "--percentiles",
            "Of the runs' peaks and arrivals [%]. Empty: 5,50,95.",
        ),
        optional("CELL", NUMBER, "Cell size of the maps [m]", "--cs-e", "Metres. Empty: the terrain's own.", least=0),
        advanced(
            "SAMPLING", CHOICE, "How values are drawn", "--sampling",
            "lhs is a Latin hypercube. Empty: a grid of lists alone, else lhs.",
            choices=("lhs", "sobol", "random", "grid"),
        ),
        advanced(
            "SEED", INTEGER, "Seed of the random numbers", "--seed", "The same runs for the same number. Empty: 0.",
            least=0,
        ),
        advanced(
            "MIN_DEPTH", NUMBER, "Flow this deep counts as arrived [m]", "--min-depth",
            "Metres; thinner flow has no velocity.", default=0.05, least=0,
        ),
        advanced(
            "KEEP", CHOICE, "Of each run keep", "--keep", "Its peaks, or all of its frames.", default="maxima",
            choices=("maxima", "frames"),
        ),
        advanced(
            "TOLERATE", NUMBER, "Share of the runs that may fail", "--tolerate",
            "From 0 to below 1 [1]; those that became unphysical are left out.", default=0.1, least=0,
        ),
        start_unasked("over an hour, or most of the memory"),
        advanced("WORKERS", INTEGER, "Runs at a time", "--workers", "Processes. Empty: one for each core.", least=1),
        DASK,
        LAW,
        Field(
            "OVERWRITE", SWITCH, "Replace the ensemble of another plan in the folder", "--overwrite",
            "Runs of both plans are kept.", default=False,
        ),
        folder("runs and maps", "ensemble beside the scene"),
        load("the maps"),
    ),
    project=True,
)  # fmt: skip
