"""Features placed on the map whose effect is off: whatever the flow does, it is on before the flow touches them.

The energy line is made blind in these scenes: it sees the release alone, so that every feature is off at the start.
"""

import json
import shutil

import numpy as np
import pytest
import shapely
from slope_site import FOOT, SOUTH, WEST, contents, distances, record, write_raster, write_shapes

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.simulation import preparation as preparing
from mpmgis.simulation.stage_sequence import StageSequence
from mpmgis.solvers.columns.column_solver import ColumnSolver
from mpmgis.solvers.columns.column_time_step import RUNNING
from mpmgis.solvers.points.point_solver import PointSolver

BESIDE = "points beside columns"
MATERIAL = '[material]\nlaw = "Fluid"\nbulk_modulus = 2e6\n'
HEAD = """
[terrain]
dem = "dtm.tif"
{release}
{material}
[friction]
law = "Coulomb"
mu = {mu}
{curvature}
[numerics]
cell_size = {cell}
{grain}
[output]
end_time = {end}
frame_interval = 2
"""


@pytest.fixture
def blind(monkeypatch):
    """An energy line that ends where it begins."""
    see = preparing.reach_of

    def reach_of(*given, **named):
        reach = see(*given, **named)
        nothing = np.zeros_like(reach.line)
        at = np.unravel_index(np.nanargmax(np.where(reach.line, reach.height, -np.inf)), nothing.shape)
        nothing[at] = True
        return reach._replace(line=nothing, inside=nothing, near=nothing)

    monkeypatch.setattr(preparing, "reach_of", reach_of)


class Scene:
    """A random scene: ground, what moves and how fast, features with openings, solver and stages."""

    def __init__(self, folder, seed, kinds, solvers, end=8.0):
        rng = np.random.default_rng(seed)
        self.folder, self.seed, self.kinds = folder, seed, [kind for kind in kinds if rng.random() < 0.8] or kinds[:1]
        self.solver = solvers[seed % len(solvers)]
        x, y = distances()
        bend = rng.uniform(-0.1, 0.1)
        bed = np.maximum(rng.uniform(0.05, 0.6) * (FOOT - x), bend * (FOOT - x)) + rng.uniform(-0.05, 0.05) * y
        write_raster(folder / "dtm.tif", bed + 500.0)
        west, south = rng.uniform(60, 180), rng.uniform(120, 200)
        release = shapely.box(west, south, west + rng.uniform(20, 60), south + rng.uniform(20, 60))
        write_shapes(folder / "release.geojson", [release])
        self.release = release
        self.masks = self._features(rng, release, self.kinds)
        self.text = self._text(rng, end)
        for kind in self.kinds:
            self.text += self._table(kind, rng)

    def _features(self, rng, release, kinds):
        """effect -> shapely area, at random places off the release; a barrier has an opening."""
        masks = {}
        for kind in kinds:
            west = release.bounds[2] + rng.uniform(35.0, 180.0)
            south, width = rng.uniform(20, 150), rng.uniform(3.0 if kind == "barrier" else 25.0, 60.0)
            north = south + rng.uniform(40, 200)
            opening, middle = rng.uniform(0.0, 40.0), rng.uniform(south, north)
            pieces = [shapely.box(west, south, west + width, middle - opening / 2)]
            pieces += [shapely.box(west, middle + opening / 2, west + width, north)]
            least = 50.0 if kind == "barrier" else 600.0  # [m2], for some nodes of the grid
            pieces = [piece for piece in pieces if piece.is_valid and piece.area > least and piece.bounds[3] > south]
            pieces = pieces or [shapely.box(west, south, west + width, north)]
            write_shapes(self.folder / f"{kind}.gpkg", pieces)
            masks[kind] = shapely.union_all(pieces)
        return masks

    def _text(self, rng, end):
        speed = f"speed = {rng.uniform(1, 40):.3g}\n" if rng.random() < 0.7 else ""
        inflow = self.solver in ("columns", BESIDE) and rng.random() < 0.4
        thickness = f"thickness = {rng.uniform(2, 8):.3g}\n"
        release = f'[release]\nsource = "release.geojson"\n{thickness}{speed}'
        if inflow:
            release = '[hydrograph]\nsource = "release.geojson"\nfile = "inflow.csv"\n'
            rows = f"0,{rng.uniform(50, 600):.3g},{rng.uniform(0, 30):.3g}\n5,100,5\n"
            (self.folder / "inflow.csv").write_text("time,discharge,speed\n" + rows)
        three = "points" in self.solver
        text = HEAD.format(
            release=release,
            material=MATERIAL if three else "",
            mu=f"{rng.uniform(0.0, 0.3):.3g}",
            cell=10.0,
            end=end,
            curvature="" if self.solver == "points" else '[curvature]\nuse = "off"',
            grain="" if self.solver == "points" else "particles_per_cell = 4",
        )
        if self.solver == "points":
            return 'solver = "points"\n' + text
        if self.solver == "points after columns":
            text += f'[[stage]]\nsolver = "columns"\nuntil = {{time = {rng.uniform(0.5, 4.0):.3g}}}\n'
            text += '[[stage]]\nsolver = "points"\n'
        if self.solver == BESIDE:
            west, south, _, north = self.release.bounds
            west, east = west + rng.uniform(-40.0, 20.0), west + rng.uniform(150.0, 350.0)
            window = shapely.box(west, south - rng.uniform(20.0, 110.0), east, north + rng.uniform(20.0, 110.0))
            write_shapes(self.folder / "window.geojson", [window])
            text += f'[[stage]]\nsolver = "columns"\nuntil = {{time = {rng.uniform(0.5, 2.5):.3g}}}\n'
            text += '[[stage]]\nsolver = "points"\nwindow = "window.geojson"\noutside = "columns"\n'
        return text

    def _table(self, kind, rng):
        return {
            "barrier": f'[[barrier]]\nsource = "barrier.gpkg"\nheight = {rng.uniform(2, 20):.3g}\n',
            "zones": f'[[zones]]\nsource = "zones.gpkg"\nmu = {rng.uniform(0.4, 0.8):.3g}\n',
            "entrainment": '[entrainment]\nlaw = "ErosionSpeed"\ncoefficient = 0.01\nsource = "entrainment.gpkg"\n'
            "thickness = 0.5\n",
        }[kind]

    def run(self, *options, output="results", use=None):
        """Exit code of the command; with `use` = "on" of the same scene with its features forced on."""
        text = self.text if use is None else self.text.replace('.gpkg"\n', f'.gpkg"\nuse = "{use}"\n')
        (self.folder / "scene.toml").write_text(text)
        return main(["run", str(self.folder / "scene.toml"), "-q", "--yes", "-o", str(self.folder / output), *options])


ACTIVE = {
    "barrier": lambda effects: effects.barrier.barrier_active(),
    "zones": lambda effects: type(effects.zones).__name__ == "FrictionZones",
    "entrainment": lambda effects: not hasattr(effects, "entrainment") or effects.entrainment.entrainment_active(),
}


@pytest.fixture
def checked(monkeypatch):
    """Every step of every solver is looked at: (features to look at, [how often each was off and on])."""
    masks, seen = {}, {}
    originals = {solver: solver.advance for solver in (ColumnSolver, PointSolver)}

    def stepwise(solver_class):
        march = originals[solver_class]

        def advance(solver, *given, **named):
            """Step by step: `given` are until, after (of points alone) and max_steps."""
            if solver_class is ColumnSolver and len(given) == 3:
                named["may_stop"] = given[2]
            count = 2 if solver_class is PointSolver else 1
            most, code = named.pop("max_steps", given[count] if len(given) > count else 1 << 62), 0
            while code == RUNNING and most > 0:
                before, most = solver.step, most - 1
                code = march(solver, *given[:count], **(named | {"max_steps": 1}))
                if solver._watch is not None and solver.step > before:
                    look(solver)
            return code

        return advance

    def look(solver):
        """What has just been stepped was nowhere near a feature that is off; spline nodes are up to 1.5 cells away."""
        x, y = solver.frame().map_xy()
        for kind, area in masks.items():
            on = ACTIVE[kind](solver.effects)
            seen.setdefault(kind, set()).add(on)
            if not on and len(x):
                inside = shapely.contains_xy(area, x - WEST, y - SOUTH)
                assert not inside.any(), f"{kind} is off and {int(inside.sum())} particles stand on it, {solver.time} s"

    for solver in originals:
        monkeypatch.setattr(solver, "advance", stepwise(solver))
    return masks, seen


def holds(folder, seed, kinds, solvers, checked, compare=True):
    """A random scene's features are on before the flow is there, which is as good as on from the start."""
    masks, _ = checked
    scene = Scene(folder, seed, kinds, solvers)
    masks.clear()
    masks.update(scene.masks)
    code = scene.run("--overwrite")
    assert code in (0, 3), f"seed {seed}: exit code {code}"  # 3: unphysical, told with its place
    if code or not compare:
        return None
    told = json.loads((folder / "results" / "run.json").read_text())
    masks.clear()
    assert scene.run("--overwrite", output="on", use="on") == 0
    one, other = (last_frame(folder / name) for name in ("results", "on"))
    assert one.time == other.time and len(one.particles) == len(other.particles), f"seed {seed}"
    order, again = (np.argsort(frame.particles.id) for frame in (one, other))
    np.testing.assert_allclose(
        one.particles.position[order], other.particles.position[again], atol=1e-6, err_msg=f"seed {seed}"
    )
    return told


def last_frame(folder):
    return read_frame(sorted(folder.glob("frame_*.h5"))[-1])


@pytest.mark.parametrize("seed", range(8))
def test_no_flow_passes_a_barrier_that_is_off(seed, tmp_path, blind, checked):
    """Columns with speeds and inflows: every step is looked at, and the end is that of a barrier forced on."""
    told = holds(tmp_path, seed, ["barrier"], ["columns"], checked)
    states = {decision["effect"]: decision for decision in told["effects"]}
    taken = [one["effect"] for one in told["taken_in"]]
    assert (states["barrier"]["decided_by"] == "flow") == ("barrier" in taken)
    assert (states["barrier"]["state"] == "on") == ("barrier" in taken)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 1])
def test_no_flow_of_points_passes_a_barrier_that_is_off(seed, tmp_path, blind, checked):
    holds(tmp_path, seed, ["barrier"], ["points"], checked)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 3))])
def test_no_flow_of_columns_beside_points_passes_a_feature_that_is_off(seed, tmp_path, blind, checked):
    """outside = "columns": those in the window are points, and both look out for the features."""
    holds(tmp_path, 500 + seed, ["barrier", "zones"], [BESIDE], checked)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_no_flow_touches_a_feature_that_is_off(seed, tmp_path, blind, checked):
    """200 scenes: all features, speeds, inflows, openings, both solvers, stages, columns beside points."""
    solvers = ["columns", "points", "columns", "points after columns", BESIDE]
    erodes = seed % 2 == 0 and seed % 4 != 3 and solvers[seed % 5] not in ("points", BESIDE)  # these refuse erosion
    kinds = ["barrier", "zones"] + (["entrainment"] if erodes else [])
    holds(tmp_path, 1000 + seed, kinds, solvers, checked)


def fast_slide(folder):
    """A release at 40 m/s on a slope, with a dam that a blind energy line does not see."""
    scene = Scene(folder, 0, ["barrier"], ["columns"])
    x, _ = distances()
    write_raster(folder / "dtm.tif", np.maximum(0.3 * (FOOT - x), 0.0) + 100.0)
    write_shapes(folder / "release.geojson", [shapely.box(60, 150, 160, 250)])
    write_shapes(folder / "barrier.gpkg", [shapely.box(420, 100, 450, 300)])
    scene.text = (
        HEAD.format(
            release='[release]\nsource = "release.geojson"\nthickness = 2.0\nspeed = 40\n',
            material="",
            mu=0.2,
            cell=10.0,
            end=8.0,
            curvature='[curvature]\nuse = "off"',
            grain="particles_per_cell = 4",
        )
        + '[[barrier]]\nsource = "barrier.gpkg"\nheight = 8\n'
    )
    return scene


def test_what_is_turned_on_is_reported_and_recorded(tmp_path, blind, checked, capsys):
    """A line with time and place; run.json; the table of barriers from then on. It was off, and then on."""
    scene = fast_slide(tmp_path)
    masks, seen = checked
    masks["barrier"] = shapely.box(420, 100, 450, 300)
    assert main_with_words(scene) == 0
    words = capsys.readouterr().err
    assert "the flow comes to barrier 'barrier', off until now" in words and "'barrier' is on from here" in words
    assert seen["barrier"] == {False, True}
    told = record(tmp_path)["taken_in"]
    assert [one["effect"] for one in told] == ["barrier"] and 0.0 < told[0]["time"] < 8.0
    assert WEST + 200.0 < told[0]["east"] < WEST + 420.0
    assert record(tmp_path)["balances"]["barriers"]["barrier"]["normal_impulse"] > 0.0
    rows = (tmp_path / "results" / "barriers.csv").read_text().splitlines()
    assert len(rows) > 2 and float(rows[1].split(",")[0]) >= told[0]["time"]


def main_with_words(scene):
    (scene.folder / "scene.toml").write_text(scene.text)
    return main(["run", str(scene.folder / "scene.toml"), "--yes", "--overwrite"])


@pytest.mark.parametrize("kept", [1, 2, 3])
def test_a_resumed_run_has_the_effects_that_were_turned_on(kept, tmp_path, blind):
    """Killed before and after the flow came to the dam: bitwise the frames of the run that was never stopped."""
    scene = fast_slide(tmp_path)
    assert scene.run() == 0
    shutil.copytree(tmp_path / "results", tmp_path / "cut")
    frames = sorted((tmp_path / "cut").glob("frame_*.h5"))
    for path in frames[kept:]:
        path.unlink()
    stopped = json.loads((tmp_path / "cut" / "run.json").read_text())
    (tmp_path / "cut" / "run.json").write_text(json.dumps(stopped | {"state": "running", "frames": kept}))
    assert scene.run("--resume", output="cut") == 0
    assert contents(tmp_path / "cut") == contents(tmp_path / "results")
    assert record(tmp_path, "cut")["taken_in"] == record(tmp_path)["taken_in"]


def test_a_scene_without_such_features_watches_nothing(tmp_path):
    """No mark, no state in its frames."""
    scene = fast_slide(tmp_path)
    scene.text = scene.text.partition("[[barrier]]")[0]
    (tmp_path / "scene.toml").write_text(scene.text)
    sequence = StageSequence(preparing.prepare(tmp_path / "scene.toml"))
    assert sequence.solver._watch is None and sequence.solver._watched.size == 0
    assert "taken_in" not in sequence.solver.frame().state
