"""Plan a region: its areas, their scenes and digests, scenarios, predicted cost."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from .. import __version__
from ..compiled.cache_folder import source_digest
from ..frames.many_runs_folder import REGION, RunFiles
from ..laws import friction
from ..laws.own_law import NO_OWN_LAWS, load_laws
from ..laws.quantities import GRAVITY
from ..scene import mu_least, scene_from_tables
from ..scene.scene_reading import read_toml
from ..simulation.companion_run import has_companion
from ..simulation.cost_prediction import predicted
from ..simulation.scene_files import input_files
from ..solvers.features.features_by_place import with_friction
from ..system.errors import InputError, MpmgisError, SceneError
from ..system.messages import log, muted
from ..system.source_names import file_of, source_of
from ..terrain.dtm import TerrainFile
from ..terrain.raster_input import RASTER_SUFFIXES, file_sha256
from .area_run import AreaTask
from .ensemble_member import MemberTask
from .ensemble_plan import with_peaks
from .many_runs import digest_of
from .region_areas import read_areas
from .region_options import AskedRegion

if TYPE_CHECKING:
    from ..scene import Scene
    from ..terrain.grid import Grid
    from .region_areas import RegionAreas

SAMPLES = 3  # number of areas whose runs are prepared for the prediction
LEAST_MU = 0.1  # [1] smallest slope of the energy line
USUAL_MU = 0.2  # [1] slope of the energy line, where the law has no friction coefficient


@dataclass(frozen=True)
class PlannedRegion:
    """Checked scenes of all areas.

    Parameters
    ----------
    asked : AskedRegion
    scene : Scene
        With the file of all areas as release.
    grid : Grid
        Of the DTM.
    areas : RegionAreas
    tasks : list of AreaTask
    scenarios : list of str
        Of each area.
    frequencies : list of float [a-1]
    samples : list of (MemberTask, Prepared)
        Of a few areas, filled by `prepare_samples`.
    """

    asked: AskedRegion
    scene: "Scene"
    grid: "Grid"
    areas: "RegionAreas"
    tasks: list
    scenarios: list
    frequencies: list
    samples: list = field(default_factory=list)

    @classmethod
    def of(cls, asked: AskedRegion, output: str | Path) -> "PlannedRegion":
        """Read the scene, the grid of the DTM and all areas; nothing is written.

        Parameters
        ----------
        asked : AskedRegion
        output : path
            Folder of the results.

        Raises
        ------
        InputError
            No release areas, a rotated DTM, or an invalid file.
        """
        if asked["releases"] is None:
            raise InputError("no release areas are given; give `releases`")
        scene = _scene(asked)
        for name in scene.files():  # once, and not once for each area
            found = source_of(scene.path(name))
            if found.is_plain and found.file.suffix.lower() in RASTER_SUFFIXES and not found.file.exists():
                raise InputError(f"{found.file}: no such file")
        table, release = scene.terrain, scene.release
        terrain = TerrainFile(scene.path(table.dem), table.crs, table.band, table.fill_nodata, table.to_crs)
        if terrain.grid.is_rotated:
            raise InputError(f"{terrain.path} is rotated, a region requires rows and columns along east and north")
        thickness = release.thickness
        of_raster = release.surface is not None or (
            isinstance(thickness, str) and file_of(scene.path(thickness)).exists()
        )
        areas = read_areas(Path(asked["releases"]), terrain, 1.0 if of_raster else thickness)
        scenarios = ["all"] * len(areas.parts)
        if asked["scenario"] is not None:
            scenarios = _scenarios(areas.column(asked["scenario"], "scenario"), asked["scenario"])
        often = (
            [0.0] * len(areas.parts) if asked["frequency"] is None else areas.frequencies(asked["frequency"]).tolist()
        )
        tasks = _tasks(asked, scene, terrain, areas, not of_raster, Path(output).resolve() / REGION.runs)
        return cls(asked, scene, terrain.grid, areas, tasks, scenarios, often)

    @property
    def digest(self) -> str:
        """Digest of all areas, scenarios and frequencies in order."""
        return digest_of([[task.digest for task in self.tasks], self.scenarios, self.frequencies])

    def input_files(self) -> Iterator[Path]:
        """Yield the path of every file that a run reads."""
        yield from input_files(self.asked["scene"], self.scene, self.asked["law"])

    def bounds(self, window: tuple | None) -> tuple[float, float, float, float]:
        """Return the bounds of a window of the DTM.

        Parameters
        ----------
        window : (int, int, int, int) or None
            Top, bottom, left, right.

        Returns
        -------
        (float, float, float, float) [m]
            West, south, east, north; NaN without a window.
        """
        if window is None:
            return (math.nan,) * 4
        top, bottom, left, right = window
        return self.grid.part(top, left, (bottom - top, right - left)).bounds

    def prepare_samples(self, tasks: list[AreaTask]) -> None:
        """Prepare a few areas, evenly chosen, for the prediction and for compiling.

        Parameters
        ----------
        tasks : list of AreaTask

        Raises
        ------
        MpmgisError
            The scene is invalid, or no area can be prepared.
        """
        chosen = np.unique(np.linspace(0, len(tasks) - 1, SAMPLES + 2)[1:-1].round().astype(int))
        problems = {}
        for number in chosen:
            try:
                self.samples.append(_prepared(tasks[number]))
            except SceneError:
                raise
            except MpmgisError as error:
                problems[tasks[number].number] = error
        if len(problems) == len(tasks):
            raise next(iter(problems.values()))
        for number, error in problems.items():
            log.info(f"area {number} cannot be prepared: {error}")

    def cost(self, tasks: list[AreaTask]) -> tuple[float, float]:
        """Predict the cost of tasks from the samples.

        Parameters
        ----------
        tasks : list of AreaTask

        Returns
        -------
        seconds : float [s]
            Of all tasks in sequence.
        memory : float [bytes]
            Of one.
        """
        if not self.samples:
            return 0.0, 0.0
        ahead = [predicted(prepared, 1) for _, prepared in self.samples]
        return len(tasks) * float(np.mean([one.seconds for one in ahead])), max(one.memory for one in ahead)


@muted()
def _prepared(task):
    """Return (MemberTask in its first window, Prepared)."""
    terrain = task.terrain()
    member = task.within(terrain, task.first_window(terrain))
    return member, member.prepared()


def _scene(asked):
    """Return the Scene with the file of all areas as its release."""
    tables, path = dict(read_toml(asked["scene"])), Path(asked["scene"])
    release = dict(tables.get("release", {}))
    for key in ("particles", "window"):
        if key in release:
            raise SceneError(f"{path.name}: [release] {key} has no use in a region; its areas are `releases`")
    for name in ("hydrograph", "secondary_release"):
        if name in tables:
            raise SceneError(f"{path.name}: a region cannot use the table {name}; every run has one release area")
    if "window" in tables.get("terrain", {}):
        raise SceneError(f"{path.name}: [terrain] window has no use in a region; every area has its own")
    tables["release"] = release | {"source": str(Path(asked["releases"]).resolve())}
    own = NO_OWN_LAWS if asked["law"] is None else load_laws(asked["law"])
    return scene_from_tables(tables, path.parent, path.name, own)


def _scenarios(values, name):
    """Return a text for each value that can be part of a file name."""
    words = [f"{value:g}" if isinstance(value, float) else str(value) for value in values.tolist()]
    texts = [re.sub(r"[^\w.+-]+", "_", word) for word in words]
    if len(set(texts)) < len(set(values.tolist())):
        raise InputError(f"`scenario={name}`: two values give the same file name; use other values")
    return texts


def _slope(asked, scene):
    """Return the slope of the energy line of the first window."""
    return first_mu(scene) if asked["angle"] is None else math.tan(math.radians(asked["angle"]))


def first_mu(scene: "Scene") -> float:
    """Return the slope of the energy line of the first window: the least friction of the scene, at least LEAST_MU.

    Zones count with their numbers, and with LEAST_MU where a column or a raster has them. A law whose friction vanishes
    with the load, as Bingham's, gives USUAL_MU.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float [1]
    """
    table = scene.friction
    if table is None or table.use == "off":
        return LEAST_MU
    zones = [zone.parameters for zone in scene.zones if zone.use != "off"]
    if any(isinstance(value, str) for values in zones for value in values.values()):
        return LEAST_MU
    scenes = [scene, *(with_friction(scene, values) for values in zones)]
    complete = [one for one in scenes if set(one.friction.parameters) >= set(scene.laws[table.law][1])]
    least = min((mu_least(one) for one in complete), default=LEAST_MU)
    has_mu = scene.friction_value(friction.DRY) is not None or least > 0.0
    return max(LEAST_MU, least) if has_mu else USUAL_MU


def _head(release):
    """Return v^2 / 2g [m] of the release."""
    speed = release.speed if release.speed is not None else math.hypot(*release.velocity)
    return speed * speed / (2.0 * GRAVITY)


def _tasks(asked, scene, terrain, areas, own_thickness, runs):
    """Return an AreaTask for each area; equal areas share a digest and one run, that of the first has a companion."""
    name, folder = Path(asked["scene"]).name, Path(scene.folder).resolve()
    law = None if asked["law"] is None else str(Path(asked["law"]).resolve())
    tables, mu, head = with_peaks(scene, asked["min_depth"]), _slope(asked, scene), _head(scene.release)
    crs = None if areas.crs is None else areas.crs.to_wkt()
    known = [__version__, source_digest(), asked["min_depth"], mu, crs, terrain.sha256]
    known += _other_inputs(asked, scene, terrain)
    tasks = []
    for number, part in enumerate(areas.parts, 1):
        shape = shapely.to_wkb(part.polygon)
        release = tables["release"] | ({"thickness": part.thickness} if own_thickness else {})
        release.pop("source")
        digest = digest_of([tables | {"release": release}, shape.hex(), *known])
        release["source"] = str(RunFiles(runs, digest).release)
        run = MemberTask(
            number,
            digest,
            tables | {"release": release},
            str(folder),
            f"{name}, area {number}",
            law,
            str(runs),
            None,
            asked["min_depth"],
            companion=has_companion(scene) and (not tasks or digest == tasks[0].digest),
        )
        tasks.append(AreaTask(number, run, shape, crs, mu, head))
    return tasks


def _other_inputs(asked, scene, terrain):
    """Return digests of the files that runs read, other than the scene, the DTM and the areas."""
    areas = file_of(asked["releases"]).resolve()
    files = {path.resolve() for path in input_files(asked["scene"], scene, asked["law"])}
    files -= {Path(asked["scene"]).resolve(), file_of(terrain.path).resolve()}
    stem = areas.name.partition(".")[0]
    return sorted(
        file_sha256(path) for path in files if (path.parent, path.name.partition(".")[0]) != (areas.parent, stem)
    )
