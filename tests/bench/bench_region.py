"""Many release areas on one large DTM: times of the plan, of windows, seeding, simulation and maps, and the memory.

`python tests/bench/bench_region.py [AREAS] [SIDE]` (default 1000 areas on 20000 x 20000 cells of 5 m, 2 workers);
`python tests/bench/run.py region` plans 10 000 areas without running them, and runs four.
The terrain is written to a temporary folder: parallel ridges with slopes of 30 degrees and bumps, tiled and compressed.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import geopandas
import numpy as np
import rasterio
import shapely
from affine import Affine

import mpmgis
from mpmgis.commands.region import VERB
from mpmgis.commands.verb_calls import complete
from mpmgis.frames.many_runs_folder import REGION, ManyRunsFolder
from mpmgis.studies.many_runs import ManyRuns
from mpmgis.studies.region_plan import PlannedRegion

AREAS, SIDE, CELL, WORKERS = 1000, 20_000, 5.0, 2
SMALL = (4, 3000)  # areas and cells a side of the table
MANY = (10_000, 8000)  # of the plan in the table
PLANNED = 10.0  # [s] required of this plan
WEST, NORTH, RIDGES, HEIGHT = 600_000.0, 5_300_000.0, 4000.0, 1000.0  # [m]; ridges are 4 km apart
SCENE = """
[terrain]
dem = "dtm.tif"
[release]
thickness = 1.0
density = 300
[friction]
law = "Voellmy"
mu = 0.25
xi = 1500
[numerics]
cell_size = 5.0
particles_per_cell = 4
[output]
end_time = 60
frame_interval = 30
"""


def write_dtm(path, side):
    """Ridges along north with bumps of 5 m, written in strips."""
    x = (np.arange(side) + 0.5) * CELL
    across = np.abs(x % RIDGES - RIDGES / 2) / (RIDGES / 2)  # 0 on a ridge, 1 in a valley
    profile = HEIGHT * np.cos(0.5 * np.pi * across) ** 2
    layout = {"driver": "GTiff", "dtype": "float32", "tiled": True, "compress": "deflate", "crs": "EPSG:32632"}
    layout["bigtiff"] = "yes"
    place = Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    with rasterio.open(path, "w", **layout, count=1, width=side, height=side, transform=place) as target:
        for first in range(0, side, 256):
            last = min(first + 256, side)
            y = (np.arange(first, last) + 0.5)[:, None] * CELL
            rows = profile + 5.0 * np.sin(x / 60.0) * np.sin(y / 80.0) + 500.0
            target.write(rows.astype(np.float32), 1, window=((first, last), (0, side)))


def write_areas(path, count, side):
    """Squares of 60 m on the upper slopes, drawn with a fixed seed."""
    draw, length = np.random.default_rng(1), side * CELL
    ridge = (draw.integers(0, int(length // RIDGES), count) + 0.5) * RIDGES
    east = ridge + draw.choice([-1, 1], count) * draw.uniform(400, 700, count)
    north = draw.uniform(0.02, 0.98, count) * length
    x, y = WEST + east, NORTH - north
    geopandas.GeoDataFrame(geometry=shapely.box(x, y, x + 60, y + 60), crs="EPSG:32632").to_file(path)


def write_site(folder, areas, side):
    """Terrain, release areas and scene of a region."""
    write_dtm(folder / "dtm.tif", side)
    write_areas(folder / "areas.gpkg", areas, side)
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")


def measured(areas, side):
    """(RegionFound, (peak memory of this process, of the largest worker) [MB], seconds to make the terrain)."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        began = time.perf_counter()
        write_site(folder, areas, side)
        made = time.perf_counter() - began
        found = mpmgis.region(folder / "scene.toml", folder / "areas.gpkg", folder / "out", workers=WORKERS)
    both = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return found, [resource.getrusage(who).ru_maxrss / 1e3 for who in both], made


def plan_seconds(areas, side):
    """Seconds that a region takes from its call to the start of its runs, with compiled kernels; nothing is run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_site(folder, areas, side)
        for output in (folder / "first", folder / "second"):  # the first time kernels are compiled
            given = {"scene": folder / "scene.toml", "releases": folder / "areas.gpkg", "output": output}
            asked = complete(VERB, {**given, "workers": WORKERS})
            began = time.perf_counter()
            plan = PlannedRegion.of(asked, output)
            ManyRunsFolder(REGION, output, plan.digest).refuse_inputs(plan.input_files())
            runs = ManyRuns(plan.tasks, "area", WORKERS, None)
            plan.prepare_samples(runs.to_run)
            runs.require_affordable(plan.cost, lambda question: True)
            seconds = time.perf_counter() - began
        assert len(runs.to_run) == areas
        return seconds


def rows():
    """Rows of the benchmark table: the plan of many areas, and a small region."""
    areas, side = MANY
    seconds = plan_seconds(areas, side)
    case = f"region, plan of {areas} areas, {side} x {side} cells"
    yield case, seconds, "s", f"required: {PLANNED:g} s", seconds / PLANNED
    areas, side = SMALL
    found, _, _ = measured(areas, side)
    simulated = found.member_seconds - found.window_seconds - found.prepare_seconds
    case = f"region, {areas} areas, {side} x {side} cells, s an area: "
    for part, seconds in (("window", found.window_seconds), ("seeding", found.prepare_seconds)):
        yield case + part, seconds / areas, "s", "simulation", seconds / simulated
    yield case + "simulation", simulated / areas, "s", "simulation", 1.0


def main(areas=AREAS, side=SIDE):
    """Print the times of the parts of a region."""
    found, memory, made = measured(areas, side)
    print(f"{areas} areas, {side} x {side} cells; synthetic DTM in {made:.1f} s", flush=True)
    simulated = found.member_seconds - found.window_seconds - found.prepare_seconds
    print(f"statuses {found.statuses}, run again in a larger window: {found.repeated}")
    print(f"wall: plan {found.plan_seconds:.1f} s, start {found.start_seconds:.1f} s")
    print(f"wall: runs {found.run_seconds:.1f} s, maps {found.map_seconds:.1f} s")
    print(
        f"sum over areas: window {found.window_seconds:.1f} s, seeding {found.prepare_seconds:.1f} s, "
        f"simulation {simulated:.1f} s"
    )
    print(f"peak memory: main process {memory[0]:.0f} MB, largest worker {memory[1]:.0f} MB")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
