"""Spatial features of a scene, from files to results: friction zones, barriers, erodible ground, lakes, cliffs."""

import csv

import numpy as np
import pytest
import shapely
from slope_site import FOOT, SCENE, WEST, distances, record, refused, run, write_raster, write_shapes, write_site

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame


@pytest.fixture
def site(tmp_path):
    """A slope of 27 degrees that runs out on level ground."""
    return write_site(tmp_path)


def state_of(site, effect):
    """(state, decided by, number) of an effect in the record."""
    decision = {d["effect"]: d for d in record(site)["effects"]}[effect]
    return decision["state"], decision["decided_by"], decision["indicator"]


def centre(site):
    """Mean distance east of the last frame's mass from the site's corner [m]."""
    frame = read_frame(sorted((site / "results").glob("frame_*.h5"))[-1])
    return float(np.average(frame.map_xy()[0], weights=frame.particles.mass)) - WEST


def test_zones_slow_the_flow_where_they_lie(site, capsys):
    assert run(site, SCENE) == 0
    plain = centre(site)
    write_shapes(site / "zones.gpkg", [shapely.box(0, 0, 800, 400), shapely.box(300, 0, 800, 400)], rough=[0.2, 0.4])
    zones = SCENE + '[[zones]]\nsource = "zones.gpkg"\nmu = "rough"\n'
    assert run(site, zones) == 0
    assert state_of(site, "zones")[:2] == ("on", "scene")
    assert centre(site) < plain - 5.0
    assert run(site, SCENE + '[[zones]]\nsource = "zones.gpkg"\nmu = 0.2\n') == 0
    assert state_of(site, "zones") == ("on", "scene", 0.0)
    assert centre(site) == plain


def test_zones_from_a_raster_and_their_gaps(site, capsys):
    """mu = 0 is a value; nodata in reach is refused unless [friction] has a default; another CRS is refused."""
    x, _ = distances()
    alone = SCENE.replace("mu = 0.2\n", "")
    write_raster(site / "mu.tif", np.where(x < 300, 0.0, 0.4))
    assert run(site, alone + '[[zones]]\nmu = "mu.tif"\n') == 0
    assert state_of(site, "zones")[0] == "on"
    (site / "results").rename(site / "earlier")
    write_raster(site / "mu.tif", np.where(x < 300, 0.2, np.nan))
    line = refused(site, capsys, alone + '[[zones]]\nmu = "mu.tif"\n')
    assert "mu has no value" in line and "E 400" in line
    write_raster(site / "mu.tif", np.where(x < 300, 0.2, 0.4), crs="EPSG:32633")
    assert "EPSG:32633" in refused(site, capsys, SCENE + '[[zones]]\nmu = "mu.tif"\n')
    write_raster(site / "mu.tif", np.where(x < 300, 0.2, -0.4))
    assert "reaches -0.4" in refused(site, capsys, SCENE + '[[zones]]\nmu = "mu.tif"\n')
    assert "no parameter 'mue'" in refused(site, capsys, SCENE + '[[zones]]\nmue = "mu.tif"\n')


def test_zones_in_another_crs_are_reprojected_and_that_is_reported(site, capsys):
    write_shapes(site / "zones.geojson", [shapely.box(300, 0, 800, 400)], crs="EPSG:4326")
    assert run(site, SCENE + '[[zones]]\nsource = "zones.geojson"\nmu = 0.4\n') == 0
    assert "reprojected from EPSG:4326" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_high_barrier_holds_everything_and_books_its_load(site, capsys):
    write_shapes(site / "dam.gpkg", [shapely.LineString([(450, -50), (450, 450)])], name=["dam"])
    dam = SCENE + '[[barrier]]\nsource = "dam.gpkg"\nwidth = 2\nheight = 50\n'
    assert run(site, dam) == 0
    err = capsys.readouterr().err
    assert "estimates; loads need a 3D run" in err and "thinner than a cell" in err
    frame = read_frame(sorted((site / "results").glob("frame_*.h5"))[-1])
    assert frame.map_xy()[0].max() < WEST + 450
    taken = record(site)["balances"]["barriers"]["dam"]
    assert taken["impulse_east"] > 0 and taken["overtopped_mass"] == 0.0
    with open(site / "results" / "barriers.csv", newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert [float(row["time [s]"]) for row in rows] == [0, 5, 10, 15, 20, 25, 30]
    assert float(rows[-1]["normal impulse [N s]"]) == taken["normal_impulse"]
    impulse = sum(5.0 * float(row["mean normal force [N]"]) for row in rows)
    assert impulse == pytest.approx(taken["normal_impulse"], rel=1e-12)
    written = (site / "results" / "scene.toml").read_text()
    assert main(["effects", str(site / "results" / "scene.toml")]) == 0 and "../dam.gpkg" in written


def test_the_highest_barrier_stands_on_any_ground(site, capsys):
    """Its crest less the ground is more than its height by rounding."""
    x, y = distances()
    write_raster(site / "dtm.tif", np.maximum(0.5 * (FOOT - x), 0.0) + 100.1 + 0.037 * y)
    write_shapes(site / "dam.gpkg", [shapely.box(450, 100, 460, 300)])
    (site / "scene.toml").write_text(SCENE + '[[barrier]]\nsource = "dam.gpkg"\nheight = 1000\n')
    assert main(["effects", str(site / "scene.toml")]) == 0


def test_barriers_that_cannot_stand_are_refused(site, capsys):
    write_shapes(site / "dam.gpkg", [shapely.box(450, 100, 460, 300)])
    assert "below the terrain" in refused(site, capsys, SCENE + '[[barrier]]\nsource = "dam.gpkg"\ncrest = 90\n')
    assert "either height or crest" in refused(site, capsys, SCENE + '[[barrier]]\nsource = "dam.gpkg"\n')
    assert "width" in refused(site, capsys, SCENE + '[[barrier]]\nsource = "dam.gpkg"\nheight = 3\nwidth = 2\n')
    dam = '[[barrier]]\nsource = "dam.gpkg"\n'
    assert "height = 1e+07, expected at most 1000" in refused(site, capsys, SCENE + dam + "height = 1e7\n")
    said = refused(site, capsys, SCENE + dam + "crest = 1e9\n")
    assert "its crest at 1e+09 m is 1e+09 m above the terrain, expected at most 1000 m" in said
    same = 'name = "upper"\n'
    said = refused(site, capsys, SCENE + dam + "height = 5\n" + dam + "height = 7\n" + same)
    assert "barrier 'upper' is completely inside barrier 'dam'; remove one of them, or change their outlines" in said
    write_shapes(site / "dam.gpkg", [shapely.box(450, 100, 460, 300)], high=[1e7])
    assert "has height 1e+07, expected metres above 0, at most 1000" in refused(
        site, capsys, SCENE + dam + 'height = "high"\n'
    )
    write_shapes(site / "dam.gpkg", [shapely.box(100, 100, 110, 300)])
    assert "is on the release" in refused(site, capsys, SCENE + '[[barrier]]\nsource = "dam.gpkg"\nheight = 3\n')
    assert "no such file" in refused(site, capsys, SCENE + '[[barrier]]\nsource = "wall.gpkg"\nheight = 3\n')


def test_a_release_on_a_cliff_is_refused(site, capsys):
    x, _ = distances()
    write_raster(site / "dtm.tif", np.where(x < 110, 700.0, 100.0))
    assert "starts on a cliff" in refused(site, capsys, SCENE)


def test_entrainment_grows_the_flow_and_closes_the_ledger(site, capsys):
    write_shapes(site / "loose.gpkg", [shapely.box(150, 0, 400, 400)], depth=[0.5])
    table = '[entrainment]\nlaw = "ErosionSpeed"\ncoefficient = 0.005\nsource = "loose.gpkg"\nthickness = "depth"\n'
    assert run(site, SCENE + table + "density = 1500\nlower_bed = true\n") == 0
    assert "entrained" in capsys.readouterr().err
    balances = record(site)["balances"]
    assert balances["mass_entrained"] > 0.05 * balances["mass_start"]
    assert abs(balances["mass_error_relative"]) <= 1e-12
    assert balances["mass_now"] == pytest.approx(balances["mass_start"] + balances["mass_entrained"], rel=1e-9)
