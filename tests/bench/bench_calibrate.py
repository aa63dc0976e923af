"""Calibration to synthetic outlines: recovery of known friction, and the time of 200 runs of a slope.

`python tests/bench/run.py calibrate`. A flow on a slope of 27 degrees that runs out on level ground, in cells of 10 m
(the site of the command's tests). The outline of a run with known parameters is the observation; mu and xi of 20 runs
are drawn from the prior with a fixed seed. With exact 90 % intervals, 18 or more of 20 are within them with a
probability of 68 %, so the ranks of 40 more runs (self-test) are the stronger check.
"""

import sys
import tempfile
import time
from pathlib import Path

import geopandas
import numpy as np
import rasterio.features
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "commands"))
from slope_site import SCENE, write_site

from mpmgis.frames.ensemble_members import read_members
from mpmgis.studies import calibration
from mpmgis.studies.calibration import calibrate
from mpmgis.studies.calibration_options import calibration_with
from mpmgis.studies.calibration_priors import priors
from mpmgis.studies.ensemble_options import ensemble_with
from mpmgis.studies.ensemble_runs import ensemble
from mpmgis.studies.sampling_plan import SamplingPlan

PAIRS, NEEDED, SEED = 20, 18, 2026
VARY = ("friction.mu=0.1:0.4", "friction.xi=500:3000")
COULOMB = SCENE.replace('law = "Voellmy"', 'law = "Coulomb"').replace("xi = 1000\n", "")
ANGLES = (16.0, 22.0, 26.0)  # [degrees] of Coulomb friction
TIME = 1800.0  # [s] required of 200 runs
WORKERS = 1


def rows():
    """Rows of the benchmark table."""
    with tempfile.TemporaryDirectory() as folder:
        site = write_site(Path(folder))
        yield from _coulomb(site)
        yield from _voellmy(site)


def truths(site, scene, values):
    """Outlines (paths) of runs of `scene` with `values` by key."""
    joint = {"vary": values, "sampling": "joint", "workers": WORKERS, "overwrite": True}
    ensemble(ensemble_with(scene=scene, output=site / "truth", **joint))
    members = read_members(site / "truth")
    for k in range(len(members)):
        mask = (np.nan_to_num(members.band(k, "h_max")) >= 0.1).astype(np.uint8)
        found = rasterio.features.shapes(mask, transform=members.grid().transform)
        shapes = [shapely.geometry.shape(shape) for shape, value in found if value]
        path = site / f"outline_{k}.gpkg"
        geopandas.GeoDataFrame(geometry=shapes, crs=members.grid().crs).to_file(path)
        yield path


def _coulomb(site):
    scene = site / "coulomb.toml"
    scene.write_text(COULOMB)
    worst = 0.0
    for angle, outline in zip(
        ANGLES, truths(site, scene, {"friction.mu": list(np.tan(np.radians(ANGLES)))}), strict=True
    ):
        asked = calibration_with(
            scene=scene,
            output=site / "coulomb",
            vary=("friction.mu=0.2:0.6",),
            observed=outline,
            samples=30,
            refine=10,
            predictive=0,
            workers=WORKERS,
        )
        (figures,) = calibrate(asked).result.parameters().values()
        worst = max(worst, abs(np.degrees(np.arctan(figures["best_fit"])) - angle))
    yield (
        "calibrate, Coulomb friction by an outline, largest error of the best fit",
        worst,
        "degree",
        "required 1",
        worst,
    )


def _voellmy(site):
    scene = site / "scene.toml"
    scene.write_text(SCENE)
    plan = SamplingPlan.of(priors(VARY, None), "random", PAIRS, SEED)
    values = np.array(plan.values())
    outlines = truths(site, scene, dict(zip(plan.varied, values.T.tolist(), strict=True)))
    outlines = list(outlines)
    yield from _whole(site, scene, outlines[0])
    calibration.TESTED = 0  # the self-test of the whole calibration is enough
    inside = np.zeros(2, int)
    for truth, outline in zip(values, outlines, strict=True):
        asked = calibration_with(
            scene=scene,
            output=site / "pairs",
            vary=VARY,
            observed=outline,
            samples=60,
            refine=20,
            predictive=0,
            workers=WORKERS,
        )
        low, _, high = calibrate(asked).result.intervals()
        inside += (low <= truth) & (truth <= high)
        print(outline.stem, truth, low, high, inside, file=sys.stderr, flush=True)
    for name, count in zip(("mu", "xi"), inside, strict=True):
        case = f"calibrate, {name} of {PAIRS} outlines within its 90 % interval"
        yield case, count, "", f"required {NEEDED}", count / NEEDED


def _whole(site, scene, outline):
    """Time and self-test of a calibration with 200 runs."""
    began = time.perf_counter()
    asked = calibration_with(scene=scene, output=site / "whole", vary=VARY, observed=outline, workers=WORKERS)
    test = calibrate(asked).result.test
    seconds = time.perf_counter() - began
    case = "calibrate, 200 runs of a slope in cells of 10 m, one process"
    yield case, seconds, "s", f"required {TIME:.0f} s", seconds / TIME
    for name, share, p in zip(("mu", "xi"), test.covered, test.uniform, strict=True):
        case = f"calibrate, self-test of {len(test.ranks)} runs, {name} within its 90 % interval"
        yield case, share, "1", f"0.90; ranks uniform with p = {p:.2f}", share / 0.9


if __name__ == "__main__":
    for row in rows():
        print(*row, sep=" | ", flush=True)
