"""`mpmgis calibrate` through the command line: known friction from outlines, values, deposits; several events."""

import csv
import json

import geopandas
import numpy as np
import pytest
import rasterio
import rasterio.features
import shapely
from slope_site import SCENE, write_raster, write_site

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.frames.ensemble_members import read_band, read_members
from mpmgis.results.path_bands import BANDS, PathBands
from mpmgis.scene.scene_reading import read_scene
from mpmgis.simulation.preparation import prepare_scene
from mpmgis.studies import ensemble_member
from mpmgis.studies.calibration_events import events_of
from mpmgis.studies.calibration_options import calibration_with
from mpmgis.studies.ensemble_options import ensemble_with
from mpmgis.studies.ensemble_runs import ensemble
from mpmgis.studies.event_comparison import EventOnGrid
from mpmgis.terrain.grid import Grid

TRUTH = 24.0  # [degrees]
COULOMB = SCENE.replace('law = "Voellmy"', 'law = "Coulomb"').replace("xi = 1000\n", "")
FEW = ("--samples", "10", "--refine", "4", "--workers", "1", "--vary", "friction.mu=0.3:0.6", "-q")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The scene, and observations of a run with a friction angle of 24 degrees."""
    folder = write_site(tmp_path_factory.mktemp("calibrate"))
    (folder / "scene.toml").write_text(COULOMB)
    vary = {"friction.mu": [float(np.tan(np.radians(TRUTH)))]}
    scene = folder / "scene.toml"
    truth = {"vary": vary, "sampling": "joint", "keep": "deposit"}
    ensemble(ensemble_with(scene=scene, output=folder / "truth", workers=1, **truth))
    truth = read_members(folder / "truth")
    covered, grid = np.nan_to_num(truth.band(0, "h_max")) >= 0.1, truth.grid()
    found = rasterio.features.shapes(covered.astype(np.uint8), transform=grid.transform)
    shapes = [shapely.geometry.shape(shape) for shape, value in found if value]
    geopandas.GeoDataFrame(geometry=shapes, crs=grid.crs).to_file(folder / "outline.gpkg")
    row, column = np.array([19, 19]), np.array([20, 30])
    columns = {name: truth.band(0, name)[row, column] for name in ("h_max", "Ut_max", "t_arrival")}
    places = shapely.points(*grid.xy(row, column))
    table = {"name": ["high", "low"], **columns, "h_max_sd": [0.05, 0.05]}
    geopandas.GeoDataFrame(table, geometry=places, crs=grid.crs).to_file(folder / "points.gpkg")
    deposit = np.nan_to_num(read_band(truth.deposit(0), "t_deposit"))
    write_raster(folder / "deposit.tif", deposit)
    return folder


def command(site, output, *options, observed=("--observed", "outline.gpkg")):
    """Exit code of `mpmgis calibrate` with a few runs in this process."""
    words = [str(site / word) if word.endswith((".gpkg", ".tif")) else word for word in (*observed, *options)]
    return main(["calibrate", str(site / "scene.toml"), "-o", str(output), *words])


def record(folder):
    return json.loads((folder / "calibrate.json").read_text())


def angle(mu):
    return np.degrees(np.arctan(mu))


@pytest.fixture(scope="module")
def done(site):
    assert command(site, site / "calibration", *FEW, "--predictive", "4") == 0
    return site / "calibration"


def test_coulomb_friction_is_recovered_within_a_degree_from_an_outline(done):
    found = record(done)["parameters"]["friction.mu"]
    assert angle(found["best_fit"]) == pytest.approx(TRUTH, abs=1.0)
    assert angle(found["median"]) == pytest.approx(TRUTH, abs=1.0)
    low, high = found["interval_90"]
    assert low < np.tan(np.radians(TRUTH)) < high and angle(high) - angle(low) < 4.0
    assert found["identified"] == "yes" and len(str(found["median"])) <= 6


def test_the_files_agree_with_the_runs(done, site):
    facts = record(done)
    with open(done / "runs.csv", newline="", encoding="utf-8") as file:
        runs = list(csv.DictReader(file))
    assert facts["runs"] == len(runs) == 14
    best = min(runs, key=lambda row: float(row["misfit"]))
    assert facts["parameters"]["friction.mu"]["best_fit"] == pytest.approx(float(best["friction.mu"]), abs=0.005)
    for one in facts["summaries"]:
        assert float(best[one["name"]]) == pytest.approx(one["best_run"], rel=1e-3)
    with open(done / "samples.csv", newline="", encoding="utf-8") as file:
        draws = np.array([float(row["friction.mu"]) for row in csv.DictReader(file)])
    np.testing.assert_allclose(
        np.quantile(draws, (0.05, 0.95)), facts["parameters"]["friction.mu"]["interval_90"], atol=0.003
    )
    with rasterio.open(done / "misfit.tif") as source:
        classes = source.read(1)
    outline = facts["best_run_outline"]["scene"]
    assert np.count_nonzero(classes == 1) * 100 == outline["missed_m2"]
    assert np.count_nonzero(classes == 2) * 100 == outline["over_covered_m2"] and outline["iou"] > 0.9
    assert (done / "pairs.png").stat().st_size > 10_000 and (done / "misfit.png").exists()


def test_the_hazard_map_is_of_runs_from_the_posterior(done):
    members = read_members(done / "predictive" / "scene")
    values = angle(members.values(["friction.mu"])[:, 0])
    assert len(values) == 4 and np.abs(values - TRUTH).max() < 4.0
    assert (done / "predictive/scene/maps/rasters/scene_probability.tif").exists()
    assert (done / "predictive/scene/maps/scene.qgz").exists()


def test_a_second_start_runs_nothing_and_gives_the_same_bytes(done, site, monkeypatch):
    before = {name: (done / name).read_bytes() for name in ("calibrate.json", "samples.csv", "runs.csv")}
    monkeypatch.setattr(ensemble_member, "run_task", lambda *_: pytest.fail("a finished run was run again"))
    assert command(site, done, *FEW, "--predictive", "4") == 0
    assert before == {name: (done / name).read_bytes() for name in before}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "observed",
    [("--points", "points.gpkg"), ("--observed", "outline.gpkg", "--deposit", "deposit.tif", "--volume", "20000:2000")],
)
def test_values_at_points_and_deposits_give_the_friction_too(site, tmp_path, observed):
    assert command(site, tmp_path / "out", *FEW, "--predictive", "0", observed=observed) == 0
    facts = record(tmp_path / "out")
    low, high = facts["parameters"]["friction.mu"]["interval_90"]
    assert low - 0.005 <= np.tan(np.radians(TRUTH)) <= high + 0.005 and high - low < 0.2
    names = [one["name"] for one in facts["summaries"]]
    assert ("scene: volume" in names) == ("--volume" in observed)
    assert ("scene: Ut_max at low" in names) == ("--points" in observed)


def test_the_kept_deposit_has_the_volume_of_the_release(site):
    truth = read_members(site / "truth")
    released = 2.0 * 100 * 100 * np.hypot(1, 0.5)  # 2 m normal to the slope of 0.5, over 100 x 100 m on the map
    assert np.nansum(read_band(truth.deposit(0), "t_deposit")) * 100 == pytest.approx(released, rel=0.02)


@pytest.mark.thorough
def test_several_events_share_their_parameters(site, tmp_path):
    (site / "second.toml").write_text('scene = "scene.toml"\npoints = "points.gpkg"\n')
    assert command(site, tmp_path / "out", *FEW, "--predictive", "2", "--event", str(site / "second.toml")) == 0
    facts = record(tmp_path / "out")
    assert {one["name"].split(":")[0] for one in facts["summaries"]} == {"scene", "second"}
    first, second = (read_members(tmp_path / f"out/runs/{name}/prior") for name in ("scene", "second"))
    np.testing.assert_array_equal(first.values(["friction.mu"]), second.values(["friction.mu"]))
    assert (tmp_path / "out/predictive/second/maps").is_dir()


@pytest.mark.thorough
def test_python_gives_the_same_result_as_the_command(done, site, tmp_path):
    found = mpmgis.calibrate(
        site / "scene.toml",
        done,
        observed=site / "outline.gpkg",
        vary={"friction.mu": "0.3:0.6"},
        samples=10,
        refine=4,
        predictive=4,
        workers=1,
    )
    assert found.result.parameters() == record(done)["parameters"]


@pytest.mark.parametrize(
    ("options", "observed", "word"),
    [
        (("--vary", "friction.mu=0.3:0.6"), (), "nothing observed"),
        (("--vary", "friction.mu=0.3:0.6", "--samples", "4"), ("--observed", "outline.gpkg"), "at least 8"),
        (("--vary", "friction.mu=0.3,0.6"), ("--observed", "outline.gpkg"), "is a list"),
        (("--vary", "friction.mu=0.3:0.6"), ("--deposit", "deposit.tif"), "path of the flow"),
        (("--vary", "friction.mu=0.3:0.6"), ("--volume", "much"), "VOLUME:SD"),
        (("--vary", "friction.mu=0.3:0.6"), ("--observed", "missing.gpkg"), "no such file"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_before_any_run(site, tmp_path, capsys, options, observed, word):
    assert command(site, tmp_path / "out", "--workers", "1", *options, observed=observed) == 2
    assert word in capsys.readouterr().err and not (tmp_path / "out").exists()


WRONG_PLACES = {
    "off.gpkg": ([shapely.box(500_000, 5_100_000, 500_100, 5_100_100)], "--observed", "outside the DTM"),
    "dot.gpkg": ([shapely.box(400_101, 5_100_101, 400_102, 5_100_102)], "--observed", "use smaller cells"),
    "lines.gpkg": ([shapely.LineString([(400_100, 5_100_100), (400_200, 5_100_200)])], "--observed", "polygons"),
    "away.gpkg": ([shapely.Point(500_000, 5_100_000)], "--points", "outside the DTM"),
}


@pytest.mark.parametrize("name", WRONG_PLACES)
def test_observations_in_wrong_places_are_refused_before_any_run(site, tmp_path, capsys, name):
    shapes, option, word = WRONG_PLACES[name]
    geopandas.GeoDataFrame({"h_max": [1.0]}, geometry=shapes, crs=32632).to_file(tmp_path / name)
    assert command(site, tmp_path / "out", *FEW, observed=(option, str(tmp_path / name))) == 2
    assert word in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("west", "east", "word"),
    [
        (400_250, 400_600, "does not contain 100% of the release"),
        (400_100, 400_600, "does not contain 30% of the release"),
        (400_000, 400_900, "of the area in"),
        (400_000, 400_600, None),
    ],
)
def test_an_outline_without_the_release_or_beyond_the_dtm_is_reported(site, caplog, west, east, word):
    path = site / f"outline_{west}_{east}.gpkg"
    geopandas.GeoDataFrame(geometry=[shapely.box(west, 5_100_120, east, 5_100_280)], crs=32632).to_file(path)
    asked = calibration_with(scene=site / "scene.toml", vary=("friction.mu=0.3:0.6",), observed=path)
    prepared = prepare_scene(read_scene(asked["scene"]))
    (event,) = events_of(asked)
    with caplog.at_level("INFO", "mpmgis"):
        EventOnGrid(event, prepared.terrain.grid, prepared.terrain, asked).report_outline(prepared.seen)
    assert (caplog.text == "") if word is None else (word in caplog.text and str(path) in caplog.text)


def test_summaries_of_a_rectangle_along_a_straight_path():
    """A strip of 600 x 40 m on cells of 10 m, its path along the lower third: exact areas by band and side."""
    grid = Grid.north_up(None, 0.0, 100.0, 10.0, (10, 60))
    strip = np.zeros(grid.shape, bool)
    strip[3:7] = True
    bands = PathBands.of(np.array([[0.0, 40.0], [600.0, 40.0]]), grid, strip)
    found = bands.of_mask(strip)
    np.testing.assert_allclose(found[:-1], [3000.0, 1000.0] * BANDS)  # left is north of a path to the east
    assert found[-1] == 595.0 and len(bands.names) == len(found)
    half = strip & (np.arange(60) < 30)
    np.testing.assert_allclose(bands.of_mask(half)[:-1], [3000.0, 1000.0] * 3 + [0.0] * 6)
    np.testing.assert_allclose(bands.of_volume(np.where(strip, 2.0, np.nan)), 8000.0)
    wider = np.zeros_like(strip)
    wider[2:8] = True
    wide = PathBands.of(np.array([[0.0, 40.0], [600.0, 40.0]]), grid, wider)
    np.testing.assert_allclose(wide.deviations(strip, wider, 5.0)[:-1], 500.0)  # an edge of 100 m by 5 m
