"""`mpmgis run` with solver = "points" through the command line: a slide in 3D, killed, resumed, exported, refused."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import rasterio
import shapely
from slope_site import SOUTH, WEST, contents, decisions, record, refused, run, slide, write_block_site, write_shapes

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.simulation.preparation import prepare
from mpmgis.system.messages import collected

SCENE = slide(4.0, 3, 0.5) + "maxima = true\n"
ZONES = '[[zones]]\nsource = "ice.geojson"\nmu = 0.1\n'
DAM = '[[barrier]]\nsource = "dam.geojson"\nheight = 20\nname = "dam"\n'
SOFTENING = "[softening]\nresidual_friction_angle = 20\n"


@pytest.fixture(scope="module")
def shared_site(tmp_path_factory):
    """The slope with a block of 40 x 40 m, and one run on it."""
    site = write_block_site(tmp_path_factory.mktemp("slope"))
    write_shapes(site / "ice.geojson", [shapely.box(140, 100, 260, 300)])
    write_shapes(site / "dam.geojson", [shapely.box(200, 120, 220, 280)])
    assert run(site, SCENE, "-q") == 0
    return site


@pytest.fixture
def site(shared_site, tmp_path):
    """The same files in a folder without results."""
    for path in shared_site.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def frames(site):
    return [read_frame(path) for path in sorted((site / "results").glob("frame_*.h5"))]


def test_a_slide_in_3d_writes_frames_of_points(shared_site):
    shown, written = frames(shared_site), record(shared_site)
    assert [frame.time for frame in shown] == [0.5 * k for k in range(7)]
    first, last = shown[0], shown[-1]
    assert (last.dimension, last.solver, last.dem, last.digest) == (3, "points", "terrain.tif", written["digest"])
    assert last.header["cell_size"] == 4.0 and last.header["density"] == 1500.0
    columns = (40 / 2) ** 2
    assert len(first.particles) == written["particles"] == columns * round(12.0 * np.sqrt(1.25) / 2.0)
    assert first.particles.mass.sum() == pytest.approx(1500 * 40 * 40 * 12 * np.sqrt(1.25), rel=1e-6)
    assert [bool(frame.state) for frame in shown] == [False] * 5 + [True] * 2
    assert written["state"] == "finished" and written["scene"]["material"]["friction_angle"] == 35.0
    assert {e["effect"]: e["state"] for e in written["effects"]}["plasticity"] == "on"


def test_the_slide_is_held_by_coulombs_law(shared_site):
    """Along the slope of 26.6 degrees the ground gives mu times what it gives across, less where the block slumps."""
    last, balances = frames(shared_site)[-1].particles, record(shared_site)["balances"]
    sine, cosine = 1 / np.sqrt(5), 2 / np.sqrt(5)

    def split(vector):
        return vector[0] * cosine - vector[2] * sine, vector[0] * sine + vector[2] * cosine

    along, across = split((last.mass[:, None] * last.velocity).sum(axis=0) / last.mass.sum())
    assert 9.81 * (sine - 0.3 * cosine) * 3.0 < along < 9.81 * (sine - 0.25 * cosine) * 3.0
    assert -1.5 < across < 0.0  # slumping, neither flying nor sinking in
    held, borne = split(balances["ground_impulse"])
    assert 0.25 < -held / borne <= 0.3
    assert borne == pytest.approx(last.mass.sum() * (9.81 * cosine * 3.0 + across), rel=1e-6)


def test_balances_of_a_run_close(shared_site):
    balances = record(shared_site)["balances"]
    assert balances["mass_error_relative"] == 0.0 and abs(balances["momentum_error_relative"]) <= 1e-10
    assert 0.0 < balances["mach_max"] < 0.3 and balances["mass_lifted_onto_ground"] == 0.0
    takers = [balances[f"energy_lost_to_{name}"] for name in ("ground", "yielding", "barriers")]
    assert 0.0 < balances["energy_lost"] < 1e10
    assert min(takers[:2]) > 0.0 and takers[2] == 0.0
    assert 0.8 < sum(takers) / balances["energy_lost"] < 1.0  # the rest goes to blows and the grid


def test_the_flow_starts_under_its_own_weight(shared_site):
    """Without the stress of its weight every layer would first fall onto its own elasticity, at about g h / c_p;
    without the shear stress of friction, mu = 0.3 on a slope of 0.5, it would first slide on its own."""
    prepared = prepare(shared_site / "scene.toml")
    stress, weight = prepared.stress, prepared.vertical_stress
    assert weight.min() == pytest.approx(-1500 * 9.81 * 0.8 * 12 * np.sqrt(1.25), rel=0.1)
    sine, cosine = np.sqrt(0.2), np.sqrt(0.8)
    traction = (
        stress[:, [0, 3, 4]] * sine + stress[:, [4, 5, 2]] * cosine
    )  # on planes along the slope, down to the east
    np.testing.assert_allclose(traction[:, 0] * sine + traction[:, 2] * cosine, weight, rtol=1e-6)
    np.testing.assert_allclose(traction[:, 0] * cosine - traction[:, 2] * sine, -0.3 * weight, rtol=1e-6)
    np.testing.assert_allclose(traction[:, 1], 0.0, atol=1e-6 * np.abs(weight).max())


def test_the_resolved_scene_runs_again_to_the_same_bytes(shared_site, tmp_path):
    again = ["run", str(shared_site / "results" / "scene.toml"), "-q", "-o", str(tmp_path / "again"), "--threads", "2"]
    assert main(again) == 0
    one, two = contents(tmp_path / "again"), contents(shared_site / "results")
    assert one.keys() == two.keys()
    assert all(one[key] == two[key] for key in one if key[1] != "time")  # whose digest names the files


@pytest.mark.thorough
def test_a_killed_run_resumes_to_the_same_bytes(shared_site, site):
    (site / "scene.toml").write_text(SCENE)
    command = [sys.executable, "-m", "mpmgis", "run", str(site / "scene.toml"), "-q"]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 300
    while not (site / "results" / "frame_000002.h5").exists() and time.monotonic() < deadline and child.poll() is None:
        time.sleep(0.001)
    child.send_signal(signal.SIGKILL)
    child.wait()
    whole = [read_frame(path).time for path in sorted((site / "results").glob("frame_*.h5"))]
    assert whole == [0.5 * k for k in range(len(whole))]
    assert main(["run", str(site / "scene.toml"), "-q", "--resume"]) == 0
    assert contents(site / "results") == contents(shared_site / "results")


def test_resume_is_held_against_the_scene(shared_site, capsys):
    scene = shared_site / "scene.toml"
    assert main(["run", str(scene), "--resume"]) == 0
    assert "is finished: end_time reached" in capsys.readouterr().err
    try:
        scene.write_text(SCENE.replace("friction_angle = 35", "friction_angle = 36"))
        assert main(["run", str(scene), "--resume", "-q"]) == 2
        assert "another scene" in capsys.readouterr().err
    finally:
        scene.write_text(SCENE)


def test_frames_export_to_rasters(shared_site, tmp_path, capsys):
    paths = map(str, sorted((shared_site / "results").glob("*.h5")))
    assert main(["export-raster", *paths, "-o", str(tmp_path / "gis"), "--cs-e", "4", "--products", "t_vol", "-q"]) == 0
    steps = sorted((tmp_path / "gis" / "rasters").glob("results_000?.tif"))
    assert len(steps) == 7
    depth, volume = [], []
    for path in (steps[0], steps[-1]):
        with rasterio.open(path) as file:
            bands = [name.split()[0] for name in file.descriptions]
            depth.append(file.read(bands.index("h") + 1, masked=True).max())
            volume.append(file.read(bands.index("t_vol") + 1, masked=True).sum() * 16)
    assert depth[0] == pytest.approx(12.0 * (1 - 1 / 14), rel=0.01)  # the topmost of 7 points stands half a slice lower
    assert 6.0 < depth[1] < 12.5
    assert volume[1] == pytest.approx(volume[0], rel=1e-6)


@pytest.mark.thorough
def test_what_is_beyond_words_of_a_table_is_refused(site, capsys):
    """What only the files tell."""
    far = SCENE.replace(f"window = [{WEST}", "window = [0").replace(
        f"{WEST + 400}, {SOUTH + 300}", f"900, {SOUTH + 300}"
    )
    assert "does not overlap the DTM" in refused(site, capsys, far)
    narrow = SCENE.replace(f"{WEST + 400}", f"{WEST + 120}")
    assert "release" in refused(site, capsys, narrow) or "terrain" in refused(site, capsys, narrow)
    assert "3 x 3 at least" in refused(site, capsys, SCENE.replace("cell_size = 4.0", "cell_size = 90"))
    stiff = SCENE.replace("bulk_modulus = 4e6", "bulk_modulus = 5e10").replace("end_time = 3", "end_time = 300")
    assert "stiffness = 'scaled'" in refused(site, capsys, stiff.replace("cell_size = 4.0", "cell_size = 1.0"))
    gap = SCENE.replace("mu = 0.3\n", "") + ZONES
    assert "mu has no value" in refused(site, capsys, gap)
    columns = SCENE.replace('source = "block.geojson"\nthickness = 12.0\ndensity = 1500', 'particles = "dtm.tif"')
    assert "HDF5" in refused(site, capsys, columns)


def test_more_points_than_memory_holds_are_refused_before_they_are_made(site, capsys, monkeypatch):
    monkeypatch.setattr("mpmgis.system.memory.available_memory", lambda: 1e6)
    assert "GB are free; take larger cells" in refused(site, capsys, SCENE)


def test_effects_of_places_are_decided_and_laid_on_the_grid(site, capsys):
    text = SCENE + ZONES + DAM + SOFTENING
    found = decisions(site, text, capsys)
    assert {name: found[name]["state"] for name in ("zones", "barrier", "softening")} == dict.fromkeys(
        ("zones", "barrier", "softening"), "on"
    )
    prepared = prepare(site / "scene.toml")
    assert [wall.name for wall in prepared.walls] == ["dam"]
    assert prepared.places.zone_values.shape == (200 / 4 + 3, 400 / 4 + 3, 1)
    assert set(np.unique(prepared.places.zone_values)) == {0.1, 0.2, 0.3}  # 0.2 at nodes on the edge of the zone
    assert prepared.digest != prepare_text(site, text.replace("mu = 0.1", "mu = 0.2")).digest
    off = decisions(site, SCENE + DAM.replace("[[barrier]]", '[[barrier]]\nuse = "off"'), capsys)
    assert off["barrier"]["state"] == "off"


def prepare_text(site, text):
    (site / "scene.toml").write_text(text)
    return prepare(site / "scene.toml")


def test_a_run_starts_from_a_seed_or_from_points(site, capsys):
    """Columns of `seed` become points; points of `convert` keep their stress; who has none reports it."""
    seed, points = str(site / "seed.h5"), str(site / "points.h5")
    release = ["--release", str(site / "block.geojson"), "--thickness", "12", "--density", "1500"]
    assert main(["seed", "--dem", str(site / "dtm.tif"), *release, "--spacing", "4", "-o", seed, "-q"]) == 0
    assert main(["convert", seed, "--cell", "4", "-o", points, "-q"]) == 0
    start = SCENE.replace('source = "block.geojson"\nthickness = 12.0\ndensity = 1500', 'particles = "{}"')
    of_columns, of_points = (prepare_text(site, start.format(name)) for name in ("seed.h5", "points.h5"))
    mass = read_frame(seed).particles.mass.sum()
    for prepared in (of_columns, of_points):
        assert prepared.frame.dimension == 3 and prepared.numerics.density == pytest.approx(1500)
        assert prepared.frame.particles.mass.sum() == pytest.approx(mass, rel=1e-6)
        assert prepared.stress[:, 2].min() < -1e5
        assert prepared.facts.release_thickness == pytest.approx(13.4, rel=0.05)
    bare = read_frame(points, with_state=False)
    write_frame(site / "bare.h5", bare)
    (site / "scene.toml").write_text(start.format("bare.h5"))
    with collected() as said:
        assert prepare(site / "scene.toml").stress is None
    assert any("no stress" in line for line in said)
    bare.particles.position[:, 2] -= 30.0
    write_frame(site / "deep.h5", bare)
    assert "under the ground" in refused(site, capsys, start.format("deep.h5"))


def test_a_window_takes_a_part_of_a_run_of_columns(site, capsys):
    """Depth-averaged first, then 3D in a window: mass and momentum inside are kept, what is left out is reported."""
    slow = SCENE.replace('solver = "points"\n', "").replace("end_time = 3", "end_time = 1").split("[material]")[0]
    columns = slow + "[friction]" + SCENE.split("[friction]")[1].replace("end_time = 3", "end_time = 1")
    assert run(site, columns, "-q") == 0
    write_shapes(site / "box.geojson", [shapely.box(80, 100, 122, 300)])
    last = sorted((site / "results").glob("frame_*.h5"))[-1].name
    start = f'particles = "results/{last}"\nwindow = "box.geojson"'
    text = SCENE.replace('source = "block.geojson"\nthickness = 12.0\ndensity = 1500', start)
    (site / "scene.toml").write_text(text)
    with collected() as said:
        prepared = prepare(site / "scene.toml")
    frame = read_frame(site / "results" / last)
    inside = frame.map_xy()[0] < WEST + 122
    whole, part = frame.particles.mass.sum(), prepared.frame.particles.mass.sum()
    assert part == pytest.approx(frame.particles.mass[inside].sum(), rel=0.05)
    assert any(f"leaves out {whole - part:.6g} of {whole:.6g} kg" in line for line in said)
    assert any("are kept to" in line for line in said)
    assert any("their sha256 differ, the ground under its columns by 0.000 m" in line for line in said)  # a run's copy
    momentum = (prepared.frame.particles.mass[:, None] * prepared.frame.particles.velocity).sum(axis=0)
    assert momentum[0] == pytest.approx((frame.particles.mass * frame.particles.velocity[:, 0])[inside].sum(), rel=0.06)
    assert prepared.affine.shape == (len(prepared.frame.particles), 3, 3) and np.abs(prepared.affine).max() < 5.0
    assert "none of" in refused_text(site, capsys, text, shapely.box(300, 100, 390, 300))


def refused_text(site, capsys, text, box):
    """The line with which `text` is refused with another window."""
    write_shapes(site / "box.geojson", [box])
    (site / "scene.toml").write_text(text)
    capsys.readouterr()
    assert main(["effects", str(site / "scene.toml"), "-q"]) == 2
    return capsys.readouterr().err


def test_a_flow_too_fast_for_its_stiffness_is_reported_once(site, capsys):
    soft = SCENE.replace("bulk_modulus = 4e6", "bulk_modulus = 2e5").replace(
        "shear_modulus = 2e6", "shear_modulus = 1e5"
    )
    assert run(site, soft) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if "larger [material] bulk_modulus" in line]
    assert len(told) == 1 and record(site)["balances"]["mach_max"] > 0.3


def test_measure_is_for_columns(site, capsys):
    (site / "scene.toml").write_text(SCENE)
    assert main(["effects", str(site / "scene.toml"), "--measure", "-q"]) == 2
    assert "solver = 'columns' only" in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_with_all_spatial_features(site):
    """Zones, a dam and softening: the dam takes up what stops before it, in a table with forces and moments."""
    assert run(site, SCENE.replace("end_time = 3", "end_time = 8") + ZONES + DAM + SOFTENING, "-q") == 0
    table = (site / "results" / "barriers.csv").read_text().splitlines()
    assert table[0].startswith("time [s],barrier,mean normal force [N],mean force east [N]")
    assert "mean moment up [N m]" in table[0] and len(table) == 1 + len(frames(site))
    taken = record(site)["balances"]["barriers"]["dam"]
    assert taken["impulse_east"] > 0.0 and taken["normal_impulse"] > 0.0
    assert float(table[-1].split(",")[3 + 6 + 1]) == pytest.approx(taken["impulse_east"])
    assert json.loads((site / "results" / "run.json").read_text())["balances"]["momentum_error_relative"] <= 1e-10


def test_the_clearance_is_a_key_of_the_scene(site):
    for text, clearance in ((SCENE, 0.5), (SCENE.replace("[numerics]", "[numerics]\nclearance = 0"), 0.0)):
        (site / "scene.toml").write_text(text)
        assert prepare(site / "scene.toml").solver().numerics.clearance == clearance
