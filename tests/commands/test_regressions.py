"""Regressions: each test fails if one particular line of the program is missing."""

from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import rasterio
from slope_site import COLUMNS, ROWS, SCENE, write_raster, write_site

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.exchange.frame_list import list_frames
from mpmgis.frames.frame_files import read_frame
from mpmgis.frames.run_folder import RunFolder
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.run_extension import differences
from mpmgis.simulation.start_digest import start_digest
from mpmgis.simulation.step_retry import Guard
from mpmgis.system.errors import GeoreferenceError

SHORT = SCENE.replace("end_time = 30", "end_time = 8").replace("frame_interval = 5", "frame_interval = 2")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("watch"))
    (folder / "scene.toml").write_text(SHORT)
    assert main(["run", str(folder / "scene.toml"), "-q"]) == 0
    return folder


@pytest.fixture
def site(tmp_path):
    folder = write_site(tmp_path)
    (folder / "scene.toml").write_text(SHORT)
    return folder


# ---------------------------------------------------------------------------------------------------- frames and states


def with_state(folder):
    return [path.name for path in sorted(folder.glob("frame_*.h5")) if "state" in h5py.File(path)]


def test_after_every_frame_the_newest_two_have_their_state(made, tmp_path):
    """And so it is after a kill between a frame and the one whose state goes for it."""
    frame = read_frame(sorted((made / "results").glob("frame_*.h5"))[-1])
    folder = RunFolder(tmp_path / "new")
    with folder.held():
        folder.open()
        for number in range(5):
            folder.write_frame(replace(frame, time=float(number)))
            assert with_state(folder.path) == [f"frame_{k:06d}.h5" for k in range(max(number - 1, 0), number + 1)]
        folder.write_record(state="running")
    (tmp_path / "new" / "frame_000002.h5").unlink()
    killed = RunFolder.resumed(tmp_path / "new")
    with killed.held():
        killed.frames = 2
        killed.write_frame(frame)  # a third one with a state, as a kill leaves it
        killed.frames = 5
        assert len(with_state(killed.path)) == 3
        killed.open(anew=False)
        assert with_state(killed.path) == ["frame_000003.h5", "frame_000004.h5"]


# ---------------------------------------------------------------------------------------------- what a run starts from


def digest_of(prepared, terrain):
    return start_digest(terrain, prepared.frame, prepared.events, *(stage.places for stage in prepared.stages))


@pytest.mark.parametrize("place", [(0, 0), (ROWS - 1, COLUMNS - 1), (3, 70), (20, 12)])
def test_any_elevation_is_part_of_what_a_run_starts_from(made, place):
    """Far from the flow too, changed by as little as can be."""
    prepared = prepare(made / "scene.toml")
    heights = prepared.terrain.elevation.copy()
    heights[place] = np.nextafter(heights[place], np.inf)
    other = replace(prepared.terrain, elevation=heights)
    assert digest_of(prepared, prepared.terrain) != digest_of(prepared, other)
    assert digest_of(prepared, prepared.terrain) == digest_of(prepared, replace(prepared.terrain))


@pytest.mark.parametrize("what", ["transform", "crs"])
def test_where_the_terrain_lies_is_part_of_what_a_run_starts_from(made, what):
    prepared = prepare(made / "scene.toml")
    grid = prepared.terrain.grid
    if what == "transform":
        moved = replace(grid, transform=type(grid.transform).translation(0.001, 0.0) * grid.transform)
    else:
        moved = replace(grid, crs=type(grid.crs).from_epsg(32633))
    assert digest_of(prepared, prepared.terrain) != digest_of(prepared, replace(prepared.terrain, grid=moved))


def test_a_run_does_not_continue_over_other_elevations(site, capsys):
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    with rasterio.open(site / "dtm.tif", "r+") as target:
        heights = target.read(1)
        heights[-1, -1] += 1.0  # the flow does not come near
        target.write(heights, 1)
    capsys.readouterr()
    assert main(["run", str(site / "scene.toml"), "-q", "--resume"]) == 2
    assert "a run of another scene or of changed inputs: its input files have changed;" in capsys.readouterr().err


def test_what_differs_from_a_run_is_named_in_one_short_line():
    def given(tables):
        return SimpleNamespace(as_tables=lambda: tables)

    record = {"scene": {"solver": "columns", "output": {"end_time": 10.0}, "friction": {"mu": 0.2}, "barrier": [{}]}}
    same = {"solver": "columns", "output": {"end_time": 5.0}, "friction": {"mu": 0.2}, "barrier": [{}]}
    assert differences(record, given(same)) == "[output] end_time = 5 is earlier than 10"
    assert differences(record, given(same | {"output": {"end_time": 10.0}})) == "its input files have changed"
    many = {"barrier": [{"points": [[0.0, 1.0]] * 400, "height": 3.0, "mu": 0.1}]}
    words = differences(record, given(many))
    assert "[friction] mu = not given (was 0.2)" in words and "and 2 more" in words and len(words) < 300


def test_a_run_does_not_continue_with_other_keys_and_names_them(site, capsys):
    assert main(["run", str(site / "scene.toml"), "-q"]) == 0
    scene = (site / "scene.toml").read_text()
    assert "mu = 0.2\n" in scene and "[numerics]\n" in scene
    (site / "scene.toml").write_text(
        scene.replace("mu = 0.2\n", "mu = 0.25\n").replace("[numerics]\n", "[numerics]\ncfl = 0.4\n")
    )
    capsys.readouterr()
    assert main(["run", str(site / "scene.toml"), "-q", "--resume"]) == 2
    message = capsys.readouterr().err
    assert "[friction] mu = 0.25 (was 0.2), [numerics] cfl = 0.4 (was 0.6); " in message
    assert message.count("\n") == 1


# -------------------------------------------------------------------------------------------------- the DTM of frames


@pytest.mark.parametrize("same", [True, False])
def test_frames_with_another_dtm_than_theirs_are_reported(made, tmp_path, capsys, same):
    dem = made / "results" / "terrain.tif"
    if not same:
        with rasterio.open(dem) as source:
            heights = source.read(1)
        heights[0, 0] += 1.0
        dem = tmp_path / "other.tif"
        write_raster(dem, heights)
    words = ["export-raster", str(made / "results"), "--dem", str(dem), "-o", str(tmp_path / "gis"), "--no-qgis"]
    assert main(words) == 0
    assert ("is not the DTM of the run" in capsys.readouterr().err) == (not same)


@pytest.mark.parametrize("same", [True, False])
def test_columns_on_another_dtm_than_theirs_are_reported(site, capsys, same):
    seed = ["seed", "--dem", "dtm.tif", "--release", "release.geojson", "--thickness", "2", "-o", "columns.h5", "-q"]
    assert (
        main(
            [*seed[:2], str(site / "dtm.tif"), seed[3], str(site / seed[4]), *seed[5:8], str(site / "columns.h5"), "-q"]
        )
        == 0
    )
    if not same:
        with rasterio.open(site / "dtm.tif", "r+") as target:
            heights = target.read(1)
            heights[0, 0] += 1.0
            target.write(heights, 1)
    scene = SHORT.replace('source = "release.geojson"\nthickness = 2.0\ndensity = 1000', 'particles = "columns.h5"')
    (site / "scene.toml").write_text(scene)
    assert main(["run", str(site / "scene.toml")]) == 0
    assert ("was made with another DTM file than" in capsys.readouterr().err) == (not same)


# ------------------------------------------------------------------------------------------------------------------ CRS


def in_another_crs(site, tmp_path):
    """The DTM of the site, said to lie in the next zone."""
    with rasterio.open(site / "dtm.tif") as source:
        write_raster(tmp_path / "zone33.tif", source.read(1), crs="EPSG:32633")
    return tmp_path / "zone33.tif"


def test_an_export_over_a_dtm_in_another_crs_is_refused(made, tmp_path, capsys):
    words = ["export-raster", str(made / "results"), "--dem", str(in_another_crs(made, tmp_path)), "--no-qgis"]
    assert main([*words, "-o", str(tmp_path / "gis"), "-q"]) == 2
    assert "give the DTM that the run used" in capsys.readouterr().err
    assert not (tmp_path / "gis").exists()


def test_datasets_over_a_dtm_in_another_crs_are_refused(made, tmp_path):
    dem = in_another_crs(made, tmp_path)
    frame = mpmgis.read_frame(sorted((made / "results").glob("frame_*.h5"))[-1])
    with rasterio.open(dem) as source:
        heights, transform, crs = source.read(1), source.transform, source.crs
    pytest.importorskip("rioxarray")
    xarray = pytest.importorskip("xarray")
    rows, columns = heights.shape
    x, y = transform.c + transform.a * (np.arange(columns) + 0.5), transform.f + transform.e * (np.arange(rows) + 0.5)
    array = xarray.DataArray(heights, {"y": y, "x": x}, ("y", "x")).rio.write_crs(crs)
    with pytest.raises(GeoreferenceError, match="but the DTM given is in"):
        mpmgis.depth_average(frame, array)


def test_frames_of_two_crss_are_not_one_run(made, tmp_path):
    for number, path in enumerate(sorted((made / "results").glob("frame_*.h5"))[:2]):
        copy = tmp_path / path.name
        copy.write_bytes(path.read_bytes())
        if number:
            with h5py.File(copy, "r+") as file:
                file.attrs["crs"] = rasterio.crs.CRS.from_epsg(32633).to_wkt()
    with pytest.raises(GeoreferenceError, match="export one run at a time"):
        list_frames([tmp_path])


def test_columns_in_another_crs_than_the_terrain_are_refused(made, site, capsys):
    path = site / "columns.h5"
    path.write_bytes(sorted((made / "results").glob("frame_*.h5"))[0].read_bytes())
    with h5py.File(path, "r+") as file:
        file.attrs["crs"] = rasterio.crs.CRS.from_epsg(32633).to_wkt()
    scene = SHORT.replace('source = "release.geojson"\nthickness = 2.0\ndensity = 1000', 'particles = "columns.h5"')
    (site / "scene.toml").write_text(scene)
    assert main(["run", str(site / "scene.toml"), "-q"]) == 2
    assert "seed on this terrain" in capsys.readouterr().err


# ---------------------------------------------------------------------------------------------------------- the guard


def test_going_back_takes_events_back_too():
    """What has come in since the last good state comes in again, and areas set free since are watched again."""
    done = []

    class Told:
        """Notes what it is asked to do."""

        def __init__(self, name):
            self.name = name

        def __getattr__(self, asked):
            return lambda *given, **_: done.append((self.name, asked, given))

    solver, events = Told("solver"), Told("events")
    solver.step, solver.time, solver.energy_look = 7, 1.5, lambda: None
    stage_end = SimpleNamespace(calm_since=3.0)
    guard = Guard(solver, events, stage_end)
    frame = SimpleNamespace(time=1.0, state={"events": 4}, particles=SimpleNamespace(id=(1, 2)))
    guard.keep(frame)
    stage_end.calm_since = 9.0
    guard.go_back("too fast")
    names = [(name, asked) for name, asked, _ in done]
    assert names == [("solver", "restore"), ("events", "restore"), ("events", "arm"), ("solver", "share_step")]
    kept = done[0][2][0]
    assert done[1][2][0] is kept and kept.state == {"events": 4} and kept.time == 1.0
    assert done[2][2][0] is solver and done[3][2] == (0.5,) and stage_end.calm_since == 3.0
