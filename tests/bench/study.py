"""Accuracy against computing time of the shipped cases: `python tests/bench/study.py [CASE...] [-o DIR]`, `make study`.

Each case is a folder with a terrain, a release, a scene and the exact solution if there is one; `mpmgis study` runs it.
The program prints the table of the page performance.md; the table and the plot of each case are in its folder.

With `--avaframe PYTHON`, the Python of a separate environment with AvaFrame (`make study AVAFRAME=2.1` creates one),
com1DFA runs two of the cases too and is added to their tables and plots.
"""

import argparse
import csv
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rasterio
from affine import Affine

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
sys.path.insert(0, str(Path(__file__).parent))
from avaframe_case import AvaframeCase, beside
from exact_solutions import SimilarityCap, ThackerBowl, mangeney
from run import machine, markdown

from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.shell.main import main as mpmgis

NODATA = -9999.0
FINE = 25  # points along a pixel's side of which a mean is taken
HEADINGS = (
    "case",
    "the scene's settings",
    "error",
    "time of the steps",
    "time over the Pareto front",
    "order",
    "best next refinement",
    "no finer than",
)


def write_raster(path, function, west, south, east, north, pixel, means=False):
    """Write `function(x, y)` at the centres of the pixels, or its `means` over them; NaN is nodata."""
    rows, columns = round((north - south) / pixel), round((east - west) / pixel)
    part = FINE if means else 1
    x = west + (np.arange(columns * part) + 0.5) * pixel / part
    y = north - (np.arange(rows * part) + 0.5) * pixel / part
    values = np.asarray(function(*np.meshgrid(x, y)), float) + np.zeros((rows * part, columns * part))
    values = values.reshape(rows, part, columns, part).mean(axis=(1, 3))
    profile = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": 1,
        "dtype": "float64",
        "nodata": NODATA,
        "transform": Affine(pixel, 0, west, 0, -pixel, north),
    }
    with rasterio.open(path, "w", **profile) as target:
        target.write(np.where(np.isfinite(values), values, NODATA), 1)


def write_case(folder, bed, thickness, bounds, pixel, scene, exact=None, cell=None):
    """Terrain `bed(x, y)`, release `thickness(x, y)` (vertical; 0 is none), `scene` text, exact thickness if any."""
    folder.mkdir(parents=True, exist_ok=True)
    write_raster(folder / "dtm.tif", bed, *bounds, pixel)
    write_raster(folder / "release.tif", lambda x, y: np.where((h := thickness(x, y)) > 0, h, np.nan), *bounds, pixel)
    if exact is not None:
        write_raster(folder / "exact.tif", exact, *bounds, cell, means=True)
    head = '[terrain]\ndem = "dtm.tif"\ncrs = "local"\n[release]\nsource = "release.tif"\nthickness = "release.tif"\n'
    head += 'thickness_mode = "vertical"\n'
    (folder / "scene.toml").write_text(scene.replace("[terrain]\n[release]\n", head))


WATER = """
[terrain]
[release]
density = 1000
[numerics]
form = "swe"
edges = "wall"
cell_size = {cell}
[output]
end_time = {end}
frame_interval = {interval}
"""


def dam(folder):
    """A dam of 5 m breaks onto dry ground; the exact solution after 2.5 s (Ritter 1892)."""

    def exact(x, y):
        return mangeney(x - 50.0, 2.5, 5.0, 0.0, 0.0)[0]

    scene = WATER.format(cell=1.0, end=2.5, interval=0.625)
    write_case(folder, lambda x, y: 0 * x, lambda x, y: 5.0 * (x < 50), (0, 0, 100, 8), 1.0, scene, exact, 1.0)


COULOMB = """
[terrain]
[release]
density = 1000
[friction]
law = "Coulomb"
mu = {mu}
[numerics]
cell_size = {cell}
[output]
end_time = 5
frame_interval = 1.25
stop_at_rest = false
"""


def plane(degrees):
    """(bed(x, y) of a plane that falls to the east, cosine of its angle)."""
    angle = np.radians(degrees)
    return lambda x, y: -np.tan(angle) * x, np.cos(angle)


def slope(folder):
    """A dam of 1 m breaks down 22 degrees with friction 21, for 5 s (Faccanoni and Mangeney 2012, test 2, 1.2).

    A block of 60 x 60 m; the error is measured in its middle, which waves from its other sides do not reach.
    """
    bed, cos = plane(22)

    def exact(x, y):
        depth = mangeney(x / cos, 5.0, 1.0, np.radians(22), np.radians(21))[0]
        return np.where((np.abs(y) < 10) & (x > -40), depth / cos, np.nan)

    def block(x, y):
        return np.where((x > -60) & (x < 0) & (np.abs(y) < 30), 1.0 / cos, 0.0)

    scene = COULOMB.format(mu=np.tan(np.radians(21)), cell=1.0)
    write_case(folder, bed, block, (-110, -70, 60, 70), 1.0, scene, exact, 1.0)


def cap(folder):
    """Hutter's cap of 4 m, 160 m across, slides 5 s down 35 degrees with friction 25 (Hutter et al. 1993)."""
    bed, cos = plane(35)
    solution = SimilarityCap(np.radians(35), np.radians(25), 80.0, 80.0, 4.0, 5.0)
    scene = COULOMB.format(mu=np.tan(np.radians(25)), cell=4.0)
    write_case(
        folder,
        bed,
        lambda x, y: solution(x / cos, y, 0.0)[0] / cos,
        (-80, -144, 240, 144),
        4.0,
        scene,
        lambda x, y: solution(x / cos, y, 5.0)[0] / cos,
        4.0,
    )


def avaframe_slope():
    """The slope with the settings of damBreak of AvaFrame; its start with `iniStep` is not in version 2.1."""
    return AvaframeCase(
        bed=plane(22)[0],
        bounds=(-110, -70, 60, 70),
        mu=np.tan(np.radians(21)),
        end=5.0,
        courant=0.01,
        own="relTh = 1\nviscOption = 0\nthresholdMassSplit = 10",
        outline=(-60, -30, 0, 30),
        slope=22,
    )


def avaframe_cap():
    """The cap with the settings of simiSolTest of AvaFrame."""
    bed, cos = plane(35)
    return AvaframeCase(
        bed=bed,
        bounds=(-100, -144, 240, 144),
        mu=np.tan(np.radians(25)),
        end=5.0,
        courant=0.02,
        own="viscOption = 1\nsubgridMixingFactor = 10\nthresholdMassSplit = 5",
        slope=35,
        thickness=lambda x, y: np.maximum(4.0 * (1.0 - (x / cos / 80.0) ** 2 - (y / 80.0) ** 2), 0.0),
    )


def bowl(folder):
    """A round pool oscillates in a bowl of 10 m; the exact solution after a period (Thacker 1981)."""
    water = ThackerBowl(1.0, 10.0)
    period, solution = water.breathe(8.0)
    scene = WATER.format(cell=0.4, end=period, interval=period / 4)
    write_case(
        folder,
        water.bed,
        lambda x, y: solution(x, y, 0.0)[0],
        (-14.4, -14.4, 14.4, 14.4),
        0.2,
        scene,
        lambda x, y: solution(x, y, period)[0],
        0.4,
    )


def wall(folder):
    """A wedge of water flows down a ramp and hits the wall of section 4.4.1 of the MOX report."""

    def bed(x, y):
        return np.maximum(10.0 - x / 3.0, 6.67)

    def wedge(x, y):
        return np.where((x >= 1.5) & (x <= 5.0), np.maximum(9.5 - bed(x, y), 0.0), 0.0)

    write_case(folder, bed, wedge, (0, 0, 20, 1.6), 0.1, WATER.format(cell=0.2, end=3.0, interval=0.25))


SOLID = """
solver = "points"
[terrain]
[release]
density = {density}
[material]
law = "DruckerPrager"
bulk_modulus = {bulk}
shear_modulus = {shear}
friction_angle = {angle}
cohesion = {cohesion}
[friction]
law = "Coulomb"
mu = {mu}
[numerics]
cell_size = {cell}
[output]
end_time = {end}
frame_interval = {interval}
stop_at_rest = false
"""


def block(folder):
    """A block, 8 x 4 m and 2 m high, slides down 30 degrees with mu = 0.3 for 1.5 s, in 3D."""
    slope, mu, time = np.radians(30), 0.3, 1.5
    moved = 0.5 * 9.81 * (np.sin(slope) - mu * np.cos(slope)) * time**2 * np.cos(slope)

    def thickness(x, y):
        return np.where((np.abs(x) <= 4) & (np.abs(y) <= 2), 2.0 / np.cos(slope), 0.0)

    scene = SOLID.format(
        density=1500, bulk=8e6, shear=4e6, angle=60, cohesion=1e6, mu=mu, cell=0.5, end=time, interval=0.375
    )
    write_case(
        folder,
        lambda x, y: -np.tan(slope) * x,
        thickness,
        (-8, -6, 16, 6),
        0.5,
        scene,
        lambda x, y: thickness(x - moved, y),
        0.5,
    )


def collapse(folder):
    """A column of sand 1 m wide and 2 m high collapses between smooth sides, in 3D."""
    scene = SOLID.format(
        density=1500, bulk=1.5e6, shear=7e5, angle=30, cohesion=0, mu=1.0, cell=0.125, end=1.2, interval=0.15
    ).replace("[output]", 'edges = "wall"\n[output]')
    write_case(folder, lambda x, y: 0 * x, lambda x, y: 2.0 * (x < 1.0), (0, 0, 6, 0.75), 0.125, scene)


def demo(folder):
    """The sample site, Lava Falls: a rock avalanche on real terrain."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sample_folder().iterdir():
        (folder / path.name).write_bytes(path.read_bytes())


class Case(NamedTuple):
    """A case of the chapter: the function that writes it, its cell sizes [m], and its reference.

    `finer` are the options of a finer run, or None if there is an exact solution; cells fit between walls. `avaframe`
    writes the same case for com1DFA of AvaFrame. com1DFA runs on one thread, so mpmgis also does in such a case.
    """

    words: str
    write: Callable
    cells: str
    finer: tuple | None = None
    exports: bool = False
    avaframe: Callable | None = None


CASES = {
    "dam": Case("water from a dam onto dry ground", dam, "2,1,0.5"),
    "slope": Case("dam break down 22 degrees with friction 21", slope, "2,1,0.5", avaframe=avaframe_slope),
    "cap": Case("cap on 35 degrees with friction 25", cap, "8,4,2", avaframe=avaframe_cap),
    "bowl": Case("pool that breathes in a bowl", bowl, "0.8,0.4,0.2"),
    "wall": Case("wedge of water against a wall", wall, "0.4,0.2,0.1", ("--refinement", "4")),
    "block": Case("3D: block that slides", block, "1,0.5,0.25"),
    "collapse": Case("3D: column of sand that collapses", collapse, "0.25,0.125", ("--refinement", "2")),
    "demo": Case("the shipped site", demo, "10,7,5,3.5", (), True),
}


def studied(name, folder, repeats, avaframe=None):
    """Run the study of a case in `folder`; `avaframe` is a Python with AvaFrame for the results of com1DFA."""
    case, folder = CASES[name], folder / name
    case.write(folder)
    options = ["--cell-sizes", case.cells, "--repeats", str(repeats), "--yes", "--overwrite", "-q"]
    options += ["--exact", str(folder / "exact.tif")] if case.finer is None else case.finer
    options += [] if case.exports else ["--no-exports"]
    options += ["--threads", "1"] if case.avaframe is not None else []
    if case.avaframe is not None and avaframe is not None:
        options += [
            "--beside",
            str(beside(folder / "avaframe", avaframe, case.avaframe(), folder / "exact.tif", repeats)),
        ]
    if mpmgis(["study", str(folder / "scene.toml"), *options]) != 0:
        raise SystemExit(f"the study of {name} failed")
    return row(case, folder / "study")


def row(case, folder):
    """Row of a case in the table of performance.md, from its files."""
    with open(folder / "study.csv", newline="", encoding="utf-8") as file:
        scene = next(csv.DictReader(file))
    with open(folder / "summary.csv", newline="", encoding="utf-8") as file:
        found = {entry["what"]: entry["value"] for entry in csv.DictReader(file)}
    settings = f"{float(scene['cell_size_m']):g} m, {scene['particles_per_cell']} a cell, cfl {float(scene['cfl']):g}"
    return (
        case.words,
        settings,
        f"{100 * float(scene['error_with_reference']):.2g} %",
        f"{float(scene['seconds']):.2g} s",
        f"{float(scene['time_over_front']):.2g}",
        found["order"],
        found["best next refinement"],
        found["refinement worthwhile down to"],
    )


def main():
    """Study the cases named on the command line, or all."""
    parser = argparse.ArgumentParser(description="Accuracy against computing time of the shipped cases.")
    parser.add_argument("names", nargs="*", metavar="CASE", help=f"cases: {', '.join(CASES)} (default: all)")
    parser.add_argument("-o", "--output", type=Path, default=Path("study"), help="output folder (default: study)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each setting (default 3)")
    parser.add_argument("--avaframe", metavar="PYTHON", help="Python of an environment with AvaFrame, to run com1DFA")
    asked = parser.parse_args()
    unknown = [name for name in asked.names if name not in CASES]
    if unknown:
        parser.error(f"no case {unknown[0]!r}; there are: {', '.join(CASES)}")
    rows = [studied(name, asked.output, asked.repeats, asked.avaframe) for name in asked.names or CASES]
    print(machine())
    print("\n".join(markdown(HEADINGS, rows)))


if __name__ == "__main__":
    main()
