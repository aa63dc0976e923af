"""`use` of all spatial features of a scene, lakes through the command, erodible rasters, barriers over a restart."""

import csv
import io

import numpy as np
import pytest
import shapely
from slope_site import (
    SCENE,
    contents,
    decisions,
    distances,
    record,
    refused,
    run,
    write_raster,
    write_shapes,
    write_site,
)

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.frames.run_folder import RunFolder

STIFF = SCENE.replace("mu = 0.2\n", "mu = 0.45\n")  # the energy line ends at 440 m
SHORT = SCENE.replace("end_time = 30", "end_time = 15")
ZONES = '[[zones]]\nsource = "zones.gpkg"\nmu = {mu}\n'
DAM = '[[barrier]]\nsource = "{name}.gpkg"\nheight = 6\n'
LOOSE = '[entrainment]\nlaw = "ErosionSpeed"\ncoefficient = 0.005\nsource = "loose.{kind}"\n'
LOWERED = "density = 1500\nlower_bed = true\n"


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """The slope with zones, a dam in reach and one far off, erodible ground; decided upon only, never run."""
    folder = write_site(tmp_path_factory.mktemp("places"))
    write_shapes(folder / "zones.gpkg", [shapely.box(200, 0, 800, 400)])
    write_shapes(folder / "dam.gpkg", [shapely.box(410, 100, 440, 300)])
    write_shapes(folder / "far.gpkg", [shapely.box(760, 10, 790, 40)])
    write_shapes(folder / "loose.gpkg", [shapely.box(200, 100, 300, 300)], depth=[0.5], trace=[0.001])
    return folder


@pytest.fixture
def site(tmp_path):
    """The slope, to run on."""
    return write_site(tmp_path)


# ------------------------------------------------------------------------------------------------------ auto, on, off

USES = {
    "zones that differ": ("zones", ZONES.format(mu=0.6), "on", "scene"),
    "zones that differ by too little": ("zones", ZONES.format(mu=0.453), "on", "scene"),
    "zones that differ, off": ("zones", ZONES.format(mu=0.6) + 'use = "off"\n', "off", "forced"),
    "zones that differ by too little, on": ("zones", ZONES.format(mu=0.453) + 'use = "on"\n', "on", "forced"),
    "a dam in reach": ("barrier", DAM.format(name="dam"), "on", "scene"),
    "a dam in reach, off": ("barrier", DAM.format(name="dam") + 'use = "off"\n', "off", "forced"),
    "a dam far off": ("barrier", DAM.format(name="far"), "on", "scene"),
    "a dam far off, on": ("barrier", DAM.format(name="far") + 'use = "on"\n', "on", "forced"),
    "much loose ground": ("entrainment", LOOSE.format(kind="gpkg") + 'thickness = "depth"\n', "on", "scene"),
    "much, off": ("entrainment", LOOSE.format(kind="gpkg") + 'thickness = "depth"\nuse = "off"\n', "off", "forced"),
    "little loose ground": ("entrainment", LOOSE.format(kind="gpkg") + 'thickness = "trace"\n', "on", "scene"),
    "little, on": ("entrainment", LOOSE.format(kind="gpkg") + 'thickness = "trace"\nuse = "on"\n', "on", "forced"),
}


@pytest.mark.parametrize("name", USES)
def test_what_a_scene_has_acts_unless_use_is_off(name, places, capsys):
    effect, tables, state, decided_by = USES[name]
    """Whatever the number of an automatic decision says: the reach of the flow is an estimate."""
    decision = decisions(places, STIFF + tables, capsys)[effect]
    assert (decision["state"], decision["decided_by"]) == (state, decided_by)
    assert decision["reason"] and decision["threshold"] is None
    assert ("before the nearest" in decision["reason"]) == (name.startswith("a dam far off"))


def test_of_several_one_that_is_off_is_left_out_and_the_others_hold(places, capsys):
    both = ZONES.format(mu=0.6) + 'use = "off"\n' + ZONES.format(mu=0.5)
    decision = decisions(places, STIFF + both, capsys)["zones"]
    assert decision["state"] == "on" and decision["indicator"] < 0.2
    walls = DAM.format(name="dam") + 'use = "off"\n' + DAM.format(name="far")
    assert "before the nearest" in decisions(places, STIFF + walls, capsys)["barrier"]["reason"]


def test_what_is_off_is_as_if_it_were_not_there_and_forced_on_as_if_it_were(site):
    """Off, or on where nothing differs: the bits of a run without."""
    write_shapes(site / "zones.gpkg", [shapely.box(200, 0, 800, 400)])
    write_shapes(site / "dam.gpkg", [shapely.box(250, 100, 280, 300)])
    write_shapes(site / "loose.gpkg", [shapely.box(200, 100, 300, 300)], depth=[0.5])
    assert run(site, SHORT, "-q") == 0
    plain = particles(site)
    tables = ZONES.format(mu=0.6), DAM.format(name="dam"), LOOSE.format(kind="gpkg") + 'thickness = "depth"\n'
    assert run(site, SHORT + "".join(table + 'use = "off"\n' for table in tables), "-q") == 0
    for name, values in particles(site).items():
        assert values.tobytes() == plain[name].tobytes(), name
    assert run(site, SHORT + ZONES.format(mu=0.2) + 'use = "on"\n', "-q") == 0
    assert {d["effect"]: d["state"] for d in record(site)["effects"]}["zones"] == "on"
    for name, values in particles(site).items():
        assert values.tobytes() == plain[name].tobytes(), name


def particles(site):
    return read_frame(sorted((site / "results").glob("frame_*.h5"))[-1]).particles.arrays()


def test_a_zone_off_the_terrain_is_refused(site, capsys):
    """Its neighbours on the terrain do not hide it; one feature of several may lie outside."""
    write_shapes(site / "zones.gpkg", [shapely.box(200, 0, 800, 400)])
    write_shapes(site / "far.gpkg", [shapely.box(20_000, 0, 20_800, 400)])
    far = ZONES.format(mu=0.6).replace("zones.gpkg", "far.gpkg")
    assert "[[zones]] number 2 covers no part" in refused(site, capsys, SCENE + ZONES.format(mu=0.6) + far)
    write_shapes(site / "far.gpkg", [shapely.box(20_000, 0, 20_800, 400), shapely.box(200, 0, 800, 400)])
    assert decisions(site, STIFF + far, capsys)["zones"]["state"] == "on"


# ------------------------------------------------------------------------------------------------- erodible rasters


def test_erodible_ground_from_a_raster_is_that_of_polygons(site, capsys):
    """Half a metre on the same cells, once drawn and once as a raster: the same bits."""
    x, y = distances()
    write_raster(site / "loose.tif", np.where((abs(x - 275) < 125) & (y > 100) & (y < 300), 0.5, np.nan))
    write_shapes(site / "loose.gpkg", [shapely.box(150, 100, 400, 300)])
    assert run(site, SHORT + LOOSE.format(kind="gpkg") + "thickness = 0.5\n" + LOWERED, "-q") == 0
    drawn = particles(site)
    assert run(site, SHORT + LOOSE.format(kind="tif") + LOWERED, "-q") == 0
    balances = record(site)["balances"]
    assert balances["mass_entrained"] > 0.02 * balances["mass_start"]
    assert abs(balances["mass_error_relative"]) <= 1e-12
    for name, values in particles(site).items():
        assert values.tobytes() == drawn[name].tobytes(), name


def test_erodible_ground_that_is_none_is_refused(site, capsys):
    x, _ = distances()
    write_raster(site / "loose.tif", np.where(x < 300, 0.5, -0.1))
    assert "reaches -0.1" in refused(site, capsys, SCENE + LOOSE.format(kind="tif"))
    write_raster(site / "loose.tif", np.where(x < 300, 0.5, 0.0))
    line = refused(site, capsys, SCENE + LOOSE.format(kind="tif") + 'thickness = "depth"\n')
    assert "names a column, and a raster has none" in line
    write_raster(site / "loose.tif", np.zeros(x.shape))
    assert "no erodible ground" in refused(site, capsys, SCENE + LOOSE.format(kind="tif"))
    write_shapes(site / "loose.gpkg", [shapely.box(150, 100, 400, 300)], depth=[-0.5])
    assert "polygons need thickness" in refused(site, capsys, SCENE + LOOSE.format(kind="gpkg"))
    line = refused(site, capsys, SCENE + LOOSE.format(kind="gpkg") + 'thickness = "depth"\n')
    assert "has thickness -0.5" in line
    line = refused(site, capsys, SCENE + LOOSE.format(kind="gpkg") + 'thickness = "dpeth"\n')
    assert "no column 'dpeth'" in line


# -------------------------------------------------------------------------------------------- barriers over a restart


@pytest.mark.thorough
@pytest.mark.parametrize("stopped", [2, 4])
def test_the_table_of_barriers_continues_where_the_frames_do(stopped, site, monkeypatch):
    """Stopped when the rows of a frame are written and the frame is not: these rows are there once in the end."""
    write_shapes(site / "dam.gpkg", [shapely.LineString([(300, 100), (300, 300)])])
    write_shapes(site / "side.gpkg", [shapely.box(200, 180, 220, 190)])
    text = SCENE + DAM.format(name="dam") + "width = 2\n" + DAM.format(name="side")
    assert run(site, text, "-q") == 0
    whole, frames = (site / "results" / "barriers.csv").read_bytes(), contents(site / "results")
    rows = list(csv.reader(io.StringIO(whole.decode())))[1:]
    assert [row[:2] for row in rows] == [[f"{t:.1f}", name] for t in range(0, 31, 5) for name in ("dam", "side")]
    assert float(rows[-2][3]) > 0.0 and float(rows[-1][3]) > 0.0
    write = RunFolder.write_frame

    def stop(folder, frame):
        if folder.frames == stopped:
            raise KeyboardInterrupt
        write(folder, frame)

    monkeypatch.setattr(RunFolder, "write_frame", stop)
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "cut")]) == 130
    monkeypatch.undo()
    assert (site / "cut" / "barriers.csv").read_bytes().count(b"\n") == 1 + 2 * (stopped + 1)
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(site / "cut"), "--resume"]) == 0
    assert (site / "cut" / "barriers.csv").read_bytes() == whole
    assert contents(site / "cut") == frames
    assert record(site, "cut")["balances"] == record(site)["balances"]


# --------------------------------------------------------------------------------------------------------------- lakes

WATER = """
[terrain]
dem = "dtm.tif"
[release]
source = "water.gpkg"
surface = "surface.tif"
[numerics]
form = "swe"
[output]
end_time = 30
frame_interval = 5
"""
LAKE = "[still_water]\nlevel = 110\n"


@pytest.fixture
def lake(tmp_path):
    """A hollow in level ground with water up to 110 m, and a dry one that is as low."""
    x, y = distances()
    bed = 115 - 15 * np.exp(-(((x - 250) / 80) ** 2) - ((y - 200) / 60) ** 2)
    bed -= 15 * np.exp(-(((x - 600) / 80) ** 2) - ((y - 200) / 60) ** 2)
    write_raster(tmp_path / "dtm.tif", bed)
    write_raster(tmp_path / "surface.tif", np.full(x.shape, 110.0))
    write_shapes(tmp_path / "water.gpkg", [shapely.box(100, 50, 400, 350)])
    write_shapes(tmp_path / "lakes.gpkg", [shapely.box(200, 150, 300, 250)], level=[110.0])
    return tmp_path


def test_a_lake_is_at_rest_unless_it_is_off(lake, capsys):
    for use, state, decided_by in (("auto", "on", "scene"), ("on", "on", "forced"), ("off", "off", "forced")):
        decision = decisions(lake, WATER + LAKE + f'use = "{use}"\n', capsys)["still_water"]
        assert (decision["state"], decision["decided_by"]) == (state, decided_by)
    drawn = '[still_water]\nsource = "lakes.gpkg"\nlevel = "level"\n'
    assert decisions(lake, WATER + drawn, capsys)["still_water"]["indicator"] == pytest.approx(1.0, abs=0.1)
    fastest = {}
    for use in ("auto", "off"):
        assert run(lake, WATER + LAKE + f'use = "{use}"\n', "-q") == 0
        fastest[use] = np.linalg.norm(particles(lake)["velocity"], axis=1).max()
    assert fastest["auto"] <= 1e-12 and fastest["off"] > 0.01


def test_a_lake_is_filled_to_its_level_over_the_bed_of_the_solver_and_that_is_reported(lake, capsys):
    """10 m cells smooth the hollow: with water measured on the DTM the surface would be off by centimetres."""
    (lake / "scene.toml").write_text(WATER + LAKE)
    assert main(["run", str(lake / "scene.toml"), "--overwrite"]) == 0
    assert "filled to the still level" in capsys.readouterr().err
    p = read_frame(lake / "results" / "frame_000000.h5").particles
    origin = read_frame(lake / "results" / "frame_000000.h5").origin
    np.testing.assert_allclose(p.position[:, 2] + origin[2] + p.thickness, 110.0, atol=1e-9)
    assert len(np.unique(p.id)) == len(p) and p.volume.sum() == pytest.approx(lake_volume(), rel=0.05)


def lake_volume():
    """Of the hollow below 110 m, by sums over a fine grid [m3]."""
    x, y = np.meshgrid(np.arange(0.5, 500), np.arange(0.5, 400))
    bed = 115 - 15 * np.exp(-(((x - 250) / 80) ** 2) - ((y - 200) / 60) ** 2)
    return float(np.maximum(110 - bed, 0.0).sum())


BAD_LAKES = {
    "below the ground": ("level = 90\n", "no water body below 90 m"),
    "above the water": ("level = 114\n", "the fullest holds"),
    "a column without polygons": ('level = "level"\n', "there is no source"),
    "no such column": ('source = "lakes.gpkg"\nlevel = "height"\n', "no column 'height'"),
    "no such file": ('source = "lake.gpkg"\nlevel = 110\n', "no such file"),
    "only the dry one": ('source = "dry.gpkg"\nlevel = 110\n', "no water body below 110 m"),
    "two levels for one": ('source = "two.gpkg"\nlevel = "level"\n', "are given for one water body"),
    "off the terrain": ('source = "off.gpkg"\nlevel = 110\n', "covers no cell"),
    "no level": ('source = "lakes.gpkg"\n', "level is missing"),
}


@pytest.mark.parametrize("name", BAD_LAKES)
def test_a_lake_that_is_none_is_refused(name, lake, capsys):
    write_shapes(lake / "dry.gpkg", [shapely.box(550, 150, 650, 250)])
    write_shapes(
        lake / "two.gpkg", [shapely.box(230, 180, 250, 220), shapely.box(250, 180, 270, 220)], level=[109.9, 110.0]
    )
    write_shapes(lake / "off.gpkg", [shapely.box(5000, 150, 5100, 250)])
    text, words = BAD_LAKES[name]
    assert words in refused(lake, capsys, WATER + "[still_water]\n" + text)


def test_a_lake_on_a_slope_form_is_refused(lake, capsys):
    slope = WATER.replace('form = "swe"', 'form = "slope"')
    assert "swe" in refused(lake, capsys, slope + LAKE)
    assert decisions(lake, slope + LAKE + 'use = "off"\n', capsys)["still_water"]["state"] == "off"
