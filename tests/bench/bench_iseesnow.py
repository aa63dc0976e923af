"""Effect of cell size, particles per cell, CFL and the clamp on ISeeSnow IdealizedTopo, against the twelve codes.

The case is ISeeSnow 1.0's: mu 0.4, xi 2000 m s-2, 1.5 m normal thickness, 5 m DTM. One number is changed at a time from
5 m cells, 9 particles per cell, CFL 0.6, no clamp. Each run uses the commands of mpmgis: `run` (timed, with seeding and
files), `export-raster` and `compare`, which gives the overlap of the cells above 0.1 m with the median of the ensemble,
the area above 0.1 m, the runout of the cells above 1 m/s along the path of the intercomparison, and the largest speed.
Ratios are to the median of the twelve codes; for the overlap to the best of them, each of which was compared with the
median of the others; for the time to that of the base. `--markdown` prints the base alone, for validation.md.
"""

import csv
import math
import tempfile
import time
from pathlib import Path
from statistics import median

from mpmgis.maps.export.export_options import export_with
from mpmgis.maps.export.map_export import export_raster
from mpmgis.results.comparison_answer import compare
from mpmgis.simulation.scene_run import run

DATA = Path(__file__).parents[2] / "../shared/data/iseesnow_idealized"
THICK, FAST = 0.1, 1.0  # [m], [m s-1] above which the intercomparison counts area and runout
END, WARM_UP = 400.0, 1.0  # [s]: more than any of the runs takes to come to rest; enough to compile
INTERVAL = 20.0  # [s] between frames; peaks are the solver's own, of every step
BASE = {"cell_size": 5.0, "particles_per_cell": 9, "cfl": 0.6, "clamp": 0.0}
STUDY = {
    "cell_size": ("cells of {} m", (10.0, 7.5, 5.0, 3.75, 2.5)),
    "particles_per_cell": ("{} particles a cell", (4, 9, 16, 36)),
    "cfl": ("CFL {}", (0.1, 0.3, 0.6, 0.9)),
    "clamp": ("clamp {}", (0.0, 4.0, 2.0)),
}
SCENE = """
[terrain]
dem = "{data}/dem.tif"
crs = "local"
[release]
source = "{data}/release.shp"
thickness = 1.5
density = 200
[friction]
law = "Voellmy"
mu = 0.4
xi = 2000
[numerics]
{numerics}
[output]
end_time = {end}
frame_interval = {interval}
maxima = true
"""
MEASURES = (  # name, unit, column of ensemble.csv
    ("IoU with the median", "1", "iou_vs_leave_one_out_median"),
    ("area above 0.1 m", "ha", "area_pft_gt_0p1_ha"),
    ("runout above 1 m/s", "m", "runout_s_pfv_gt_1_m"),
    ("largest speed", "m s-1", "max_pfv_ms"),
)
HEADINGS = ("measure", "mpmgis", "the 12 codes", "their median")
ABSENT = "skipped: no ../shared/data/iseesnow_idealized"


def rows():
    """Rows of the table: four measures and the computing time of each run of the study."""
    if not DATA.exists():
        yield "ISeeSnow IdealizedTopo", None, "", ABSENT, None
        return
    published = _published()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        _simulated(BASE, folder / "warm", WARM_UP)  # compiles, or loads what was compiled
        base = _studied(BASE, folder / "base")
        for key, (words, values) in STUDY.items():
            for value in values:
                same = value == BASE[key]
                found, seconds, cost = base if same else _studied(BASE | {key: value}, folder / f"{key}_{value}")
                case = words.format(value) + (", the base" if same else "")
                for (name, unit, _), number, (reference, against) in zip(MEASURES, found, published, strict=True):
                    yield f"{case}: {name}", number, unit, reference, number / against
                yield f"{case}: run, seeding and files included", seconds, "s", f"base; {cost}", seconds / base[1]


def summary():
    """(headings, rows of words): the base alone, for validation.md."""
    if not DATA.exists():
        return HEADINGS, [("ISeeSnow IdealizedTopo", ABSENT, "", "")]
    return HEADINGS, [
        (f"{name} [{unit}]", f"{ours:.4g}", f"{min(codes):g} to {max(codes):g}", f"{median(codes):.4g}")
        for name, unit, ours, codes in base_beside_codes()
    ]


def base_beside_codes():
    """(name, unit, our value, values of the twelve codes) of each measure of the base."""
    with tempfile.TemporaryDirectory() as folder:
        found, *_ = _studied(BASE, Path(folder) / "base")
    return [(name, unit, ours, codes) for (name, unit, _), ours, codes in zip(MEASURES, found, _codes(), strict=True)]


def _codes():
    """Values of the twelve codes for each measure."""
    with open(DATA / "ensemble.csv", newline="", encoding="utf-8") as file:
        codes = list(csv.DictReader(file))
    return [[float(code[column]) for code in codes] for *_, column in MEASURES]


def _published():
    """(reference in words, value for the ratio) of each measure, from the twelve codes."""
    found = []
    for (name, *_), values in zip(MEASURES, _codes(), strict=True):
        against = max(values) if name.startswith("IoU") else median(values)
        found.append((f"12 codes {min(values):g} to {max(values):g}", against))
    return found


def _simulated(numerics, folder, end=END):
    """(folder of the frames, total time [s], cost of the time loop in words) of a run with these numerics."""
    folder.mkdir()
    lines = "\n".join(f"{key} = {value}" for key, value in numerics.items())
    scene = folder / "scene.toml"
    words = {"data": DATA.resolve().as_posix(), "numerics": lines, "end": end, "interval": min(INTERVAL, end)}
    scene.write_text(SCENE.format(**words), encoding="utf-8")
    began = time.perf_counter()
    done = run(scene, folder / "frames")
    seconds = time.perf_counter() - began
    return done.folder, seconds, f"{done.steps} steps, {1e9 / done.particle_steps_per_second:.0f} ns a column and step"


def _studied(numerics, folder):
    """((IoU, area [ha], runout [m], largest speed [m s-1]), time [s], cost) of a run, from `compare` of its export."""
    frames, seconds, cost = _simulated(numerics, folder)
    exported = folder / "gis"
    export_raster(export_with(frames=(frames,), output=exported, time_step=math.inf, naming="iseesnow", qgis=False))
    ensemble = DATA / "ensemble_median"
    thick = compare(exported, ensemble, threshold=THICK, band="pft")
    path = DATA / "LINES/path_aimec.shp"
    fast = compare(exported, ensemble, threshold=FAST, band="pfv", line=path)
    speed = next(band.peak[0] for band in fast.bands if band.names[0] == "pfv")
    return (thick.overlap.iou, thick.sides[0].area / 1e4, fast.sides[0].farthest_along, speed), seconds, cost
