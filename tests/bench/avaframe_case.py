"""A case of `study.py` for AvaFrame's com1DFA, run in a separate environment and resampled to the same cells.

com1DFA runs with the settings that its authors use for this kind of case (`ana1Tests`: simiSolTest and damBreak), with
three sizes of kernel and cells. Particles start at random places, as in these tests, or on triangles, which gives
smaller errors here. Time steps are those of the tests, rounded so that the last one ends at the end of the case.
"""

import csv
import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import geopandas
import numpy as np
import rasterio
import shapely
from scipy.ndimage import map_coordinates

RUNNER = Path(__file__).with_name("com1dfa_run.py")
FINE = 5  # points along a cell's side of which a mean is taken
SETTINGS = """[GENERAL]
simTypeList = null
resType = FT
tSteps = {end}
tEnd = {past_end}
sphKernelRadiusTimeStepping = False
dt = {step}
sphOption = 2
sphKernelRadius = {kernel}
meshCellSize = {kernel}
massPerParticleDeterminationMethod = MPPKR
initPartDistType = {start}
sphKR0 = 5
nPPK0 = 20
aPPK = -1
frictModel = Coulomb
explicitFriction = 1
mucoulomb = {mu}
relThFromFile = {raster}
{own}
"""


class AvaframeCase(NamedTuple):
    """Input of com1DFA.

    bed, thickness : (x, y) [m] -> [m]; the thickness normal to the slope, or None if there is an `outline`.
    outline : (west, south, east, north) [m] of a release with the thickness `relTh` in `own`.
    bounds : (west, south, east, north) [m]
    mu, end : friction coefficient, time [s].
    slope : angle of the bed [degrees].
    courant : cMax of com1DFA: the time step over the kernel radius [s m-1].
    own : lines of the settings for this case.
    """

    bed: Callable
    bounds: tuple
    slope: float
    mu: float
    end: float
    courant: float
    own: str
    thickness: Callable | None = None
    outline: tuple | None = None


TRIED = (("random", 5.0), ("random", 3.0), ("triangular", 5.0), ("triangular", 3.0), ("triangular", 2.0))


def beside(folder, python, case, exact, repeats):
    """Path of the table for `mpmgis study --beside`: results of com1DFA on the cells of the raster `exact`."""
    rows = []
    for start, kernel in TRIED:
        place = (folder / f"{start}{kernel:g}").resolve()
        prepare(place, case, start, kernel)
        found = ran(python, place, case.end, repeats)
        write_on_cells(place / "thickness.tif", found, exact, np.cos(np.radians(case.slope)))
        seconds = found["seconds"]
        rows.append(
            {
                "code": f"AvaFrame {found['version']} com1DFA",
                "setting": f"{kernel:g} m, {start}",
                "seconds": np.median(seconds),
                "seconds_min": seconds.min(),
                "seconds_max": seconds.max(),
                "particles": found["particles"],
                "steps": found["steps"],
                "thickness": (place / "thickness.tif").relative_to(folder.resolve()),
            }
        )
    path = folder / "beside.csv"
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
    return path


def prepare(folder, case, start, kernel):
    """Write terrain, release and settings for a kernel radius and cells of `kernel` [m]."""
    releases = folder / "Inputs" / "REL"
    releases.mkdir(parents=True, exist_ok=True)
    write_grid(folder / "Inputs" / "terrain.asc", case.bed, case.bounds, kernel)
    if case.thickness is not None:
        write_grid(releases / "release.asc", case.thickness, case.bounds, kernel)
    else:
        table = geopandas.GeoDataFrame({"name": ["release"]}, geometry=[shapely.box(*case.outline)])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # no CRS: none is wanted
            table.to_file(releases / "release.shp")
    steps = np.ceil(case.end / (case.courant * kernel) - 1e-9)
    text = SETTINGS.format(
        end=case.end,
        past_end=case.end * (1.0 + 1e-6),
        step=case.end / steps,
        kernel=kernel,
        mu=case.mu,
        own=case.own,
        start=start,
        raster=case.thickness is not None,
    )
    (folder / "Inputs" / "settings.ini").write_text(text)


def write_grid(path, function, bounds, cell):
    """Write `function(x, y)` at nodes `cell` [m] apart as an ASCII grid; the nodes are the centres of its cells."""
    west, south, east, north = bounds
    x = west + cell * np.arange(round((east - west) / cell) + 1)
    y = south + cell * np.arange(round((north - south) / cell) + 1)
    values = np.asarray(function(*np.meshgrid(x, y)), float) + np.zeros((len(y), len(x)))
    head = f"ncols {len(x)}\nnrows {len(y)}\nxllcenter {west}\nyllcenter {south}\ncellsize {cell}\nNODATA_value -9999\n"
    with open(path, "w", encoding="ascii") as file:
        file.write(head)
        np.savetxt(file, values[::-1], fmt="%.9f")


def ran(python, folder, end, repeats):
    """Results of `com1dfa_run.py`, run by the `python` that has AvaFrame."""
    log = folder / "com1DFA.log"
    with open(log, "w", encoding="utf-8") as file:
        command = [python, str(RUNNER), str(folder), repr(end), str(repeats)]
        if subprocess.run(command, stdout=file, stderr=subprocess.STDOUT).returncode != 0:
            raise SystemExit(f"com1DFA failed; see {log}")
    with np.load(folder / "found.npz") as arrays:
        return dict(arrays)


def write_on_cells(path, found, like, cos):
    """Write the vertical thickness on the cells of the raster `like`: means of the interpolated values of com1DFA."""
    with rasterio.open(like) as source:
        profile, (rows, columns), transform = source.profile, source.shape, source.transform
    x = transform.c + transform.a * (np.arange(columns * FINE) + 0.5) / FINE
    y = transform.f + transform.e * (np.arange(rows * FINE) + 0.5) / FINE
    fine = between_nodes(found["thickness"] / cos, found["east"], found["north"], *np.meshgrid(x, y))
    with rasterio.open(path, "w", **profile) as target:
        target.write(fine.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3)), 1)


def between_nodes(values, east, north, x, y):
    """`values` [rows, columns] at nodes `east`, `north` [m], with bilinear interpolation as in com1DFA."""
    places = [(y - north[0]) / (north[1] - north[0]), (x - east[0]) / (east[1] - east[0])]
    return map_coordinates(values, places, order=1, mode="constant")
