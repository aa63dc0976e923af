"""Ensembles: speed-up by a second worker, and memory and time of the statistics of many members.

`python tests/bench/run.py ensemble`. Runs of the sample site: the same members in one process without Dask and with two
workers, without start-up (imports, loading compiled code, processes of Dask). Another program on the machine makes two
workers appear slower than they are; the head of the table shows the load.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from mpmgis.commands.demo_site import sample_folder
from mpmgis.frames.member_stack import STACK_BYTES
from mpmgis.laws.quantities import BAND, MEMBER_BANDS
from mpmgis.studies.ensemble_options import ensemble_with
from mpmgis.studies.ensemble_runs import ensemble
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

MEMBERS, END_TIME = 10, 60
EFFICIENCY = 0.85  # required of two workers
FEW, MANY, SIDE = 50, 400, 600  # numbers of members for the statistics, cells along a side
DIFFERENT = 50  # number of different rasters, which are reused for all members

# Maps of many members from the same few rasters: prints the time [s] and the peak of the memory [MB].
CHILD = """
import sys, time
from functools import partial
from pathlib import Path
import pyproj
from mpmgis.terrain.grid import Grid
from mpmgis.frames.member_stack import MemberStack
from mpmgis.terrain.raster_output import write_rows
from mpmgis.studies.ensemble_statistics import Products, statistics
from mpmgis.laws.quantities import MEMBER_BANDS
folder, count, side = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
grid = Grid.north_up(pyproj.CRS.from_epsg(32632), 6e5, 5.2e6, 5.0, (side, side))
files = sorted(folder.glob("*_max.tif"))
stack = MemberStack([files[k % len(files)] for k in range(count)], grid, (0, side, 0, side), MEMBER_BANDS, 2)
bands = Products.of().rasters()["h"]
def peak():
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]) / 1000
before = peak()
began = time.perf_counter()
if count:
    write_rows(folder / "h.tif", grid, [b.quantity for b in bands], {},
               stack.rows_of(len(bands), ["h_max"], partial(statistics, bands)))
print(time.perf_counter() - began, peak(), before)
"""


def rows():
    """Rows of the benchmark table."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _workers(Path(folder))
        yield from _statistics(Path(folder))


def _workers(folder):
    site = folder / "site"
    shutil.copytree(sample_folder(), site)
    text = (site / "scene.toml").read_text(encoding="utf-8").replace("end_time = 240", f"end_time = {END_TIME}")
    (site / "scene.toml").write_text(text, encoding="utf-8")
    found = {
        workers: ensemble(
            ensemble_with(
                scene=site / "scene.toml",
                output=folder / f"by_{workers}",
                vary=("friction.mu=0.2:0.3",),
                samples=MEMBERS,
                workers=workers,
            )
        )
        for workers in (1, 2)
    }
    one, two = found[1], found[2]
    case = f"ensemble, {MEMBERS} members of the shipped site, {END_TIME} s each"
    yield f"{case}, one process", one.run_seconds, "s", None, None
    yield (
        f"{case}, two workers",
        two.run_seconds,
        "s",
        f"one process {one.run_seconds:.1f} s",
        (two.run_seconds / one.run_seconds),
    )
    busy = two.member_seconds / (2 * two.run_seconds)
    yield "share of that time in which the two workers are at work", busy, "1", None, None
    dearer = two.processor_seconds / one.processor_seconds
    yield "processor time of a member, by one of two workers", dearer, "1", "by one process", dearer
    efficiency = one.run_seconds / (2 * two.run_seconds)
    yield "efficiency of two workers", efficiency, "1", f"asked {EFFICIENCY}", efficiency / EFFICIENCY
    yield "start of two workers, imports and kernels included", two.start_seconds, "s", None, None
    yield f"maps of {MEMBERS} members", two.map_seconds, "s", None, None


def _statistics(folder):
    members = folder / "members"
    members.mkdir()
    source = np.random.default_rng(0)
    grid = Grid.north_up(None, 6e5, 5.2e6, 5.0, (SIDE, SIDE))
    for k in range(DIFFERENT):
        values = source.gamma(2.0, 1.0, grid.shape)
        values[source.random(grid.shape) < 0.3] = np.nan
        write_geotiff(members / f"{k}_max.tif", grid, [(BAND[name], values) for name in MEMBER_BANDS[:1]], {})
    peaks = {}
    for count in (FEW, MANY):
        words = [sys.executable, "-c", CHILD, str(members), str(count), str(SIDE)]
        told = subprocess.run(words, capture_output=True, text=True, check=True, env=os.environ).stdout.split()
        seconds, peaks[count], before = map(float, told)
        reference = f"{peaks[FEW]:.0f} MB with {FEW}" if count == MANY else f"window of {STACK_BYTES / 1e6:.0f} MB"
        ratio = peaks[MANY] / peaks[FEW] if count == MANY else None
        case = f"statistics of {count} members on {SIDE} x {SIDE} wet cells"
        yield f"{case}, time", seconds, "s", f"{1e9 * seconds / count / SIDE**2:.1f} ns a member and cell", None
        yield f"{case}, peak memory", peaks[count], "MB", f"{reference}; imports {before:.0f} MB", ratio
