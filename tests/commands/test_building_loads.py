"""`intensity --buildings`: a uniform flow of known depth and speed loads a square building by the closed form."""

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from block_frames import CRS, DENSITY, MIDDLE, SIDE, THICKNESS, write_block_run
from shapely import affinity
from slope_site import write_shapes

from mpmgis.commands.shell.main import main
from mpmgis.laws.quantities import GRAVITY
from mpmgis.results.barrier_loads import BANDS, largest_loads, outline_of

PLACES, SPEEDS, EDGE = (500.0, 650.0), (10.0, 0.0), 20.0  # on the flat: the first fast, the second at rest
TIMES = (5.0, 10.0)
SQUARE = shapely.box(PLACES[0] - EDGE / 2, MIDDLE - EDGE / 2, PLACES[0] + EDGE / 2, MIDDLE + EDGE / 2)
TURNED, STILL = affinity.rotate(SQUARE, 45.0), affinity.translate(SQUARE, PLACES[1] - PLACES[0])
DRY = affinity.translate(SQUARE, 0.0, 150.0)


def closed_form(speed, drag=2.0):
    """(force, moment) per width, pressure at the foot."""
    dynamic, static = 0.5 * drag * DENSITY * speed**2, DENSITY * GRAVITY * THICKNESS
    force = dynamic * THICKNESS + static * THICKNESS / 2
    return force, dynamic * THICKNESS**2 / 2 + static * THICKNESS**2 / 6, dynamic + static


@pytest.fixture
def run(tmp_path):
    return write_block_run(tmp_path, PLACES, TIMES, SPEEDS)


@pytest.fixture
def houses(tmp_path):
    path = tmp_path / "houses.gpkg"
    write_shapes(path, [SQUARE, TURNED, STILL, DRY], owner=["a", "b", "c", "d"])
    return path


def ask(source, houses, folder, *options):
    given = ["--guideline", "swiss-debris-flow", "--buildings", str(houses), "-o", str(folder)]
    return main(["intensity", str(source), *given, *options])


@pytest.mark.parametrize("exported", [False, True])
def test_uniform_flow_on_square_buildings(tmp_path, run, houses, exported):
    source = run
    if exported:
        assert main(["export-raster", str(run), "--no-qgis", "--products", "Ut_E,Ut_N"]) == 0
        source = tmp_path / "run_gis"
    assert ask(source, houses, tmp_path / "found") == 0
    table = geopandas.read_file(tmp_path / "found" / "buildings.gpkg").set_index("owner")
    assert table.crs == CRS and table.loc["a"].geometry.area == pytest.approx(EDGE**2)
    for owner, width, speed, time in (
        ("a", EDGE, SPEEDS[0], TIMES[0]),
        ("b", EDGE * np.sqrt(2), SPEEDS[0], TIMES[0]),  # as wide as it looks from upstream
        ("c", EDGE * np.sqrt(2), 0.0, TIMES[1]),  # at rest: two faces, in the worst direction
    ):
        found = table.loc[owner]
        force, moment, pressure = closed_form(speed)
        assert found.flow_depth == pytest.approx(THICKNESS, rel=1e-6)
        assert found.flow_speed == pytest.approx(speed, rel=1e-6)
        assert found.flow_press == pytest.approx(pressure, rel=1e-6)
        assert found.flow_fwidth == pytest.approx(force, rel=1e-6)
        assert found.flow_force == pytest.approx(force * width, rel=1e-6)
        assert found.flow_moment == pytest.approx(moment * width, rel=1e-6)
        assert found.flow_height == pytest.approx(moment / force, rel=1e-6)
        assert {found[f"flow_{name}_t"] for name in ("depth", "press", "fwidth", "force", "moment")} == {time}
    dry = table.loc["d"]
    assert dry.flow_force == dry.flow_depth == 0.0 and np.isnan(dry.flow_force_t) and np.isnan(dry.flow_height)


def test_the_coefficient_scales_the_dynamic_part_only(tmp_path, run, houses):
    assert ask(run, houses, tmp_path / "found", "--drag", "1.25") == 0
    found = geopandas.read_file(tmp_path / "found" / "buildings.gpkg").set_index("owner").loc["a"]
    assert found.flow_force == pytest.approx(EDGE * closed_form(SPEEDS[0], 1.25)[0], rel=1e-6)


def test_each_largest_value_has_its_own_time():
    outline = outline_of(shapely.box(0, 0, 10, 10), 5.0)
    ones = np.ones(len(outline.x))
    values = {name: np.zeros((3, len(outline.x))) for name in BANDS}
    for k, (depth, speed) in enumerate(((1.0, 8.0), (4.0, 1.0), (2.0, 5.0))):
        values["h"][k], values["Ut"][k], values["Ut_E"][k] = depth * ones, speed * ones, -speed * ones
    found = largest_loads(outline, (1.0, 2.0, 3.0), values, 1000.0, 2.0, 0.05)
    assert (found["flow_speed_t"], found["flow_depth_t"], found["flow_moment_t"]) == (1.0, 2.0, 2.0)
    by_time = [1000 * (h * v**2 + GRAVITY * h**2 / 2) for h, v in ((1, 8), (4, 1), (2, 5))]
    assert found["flow_force"] == pytest.approx(10 * max(by_time))
    assert found["flow_force_t"] == 1.0 + int(np.argmax(by_time))


def test_courtyards_parts_and_orientation_do_not_matter():
    plain = outline_of(SQUARE, 10.0)
    yard = shapely.MultiPolygon([SQUARE.difference(SQUARE.buffer(-5.0)).reverse()])
    for outline in (plain, outline_of(yard, 10.0)):
        assert outline.length.sum() == pytest.approx(4 * EDGE)
        assert outline.normal.T @ outline.length == pytest.approx(0.0, abs=1e-9)
        assert not shapely.contains_xy(SQUARE, outline.x, outline.y).any()


def test_refusals_are_one_line(tmp_path, run, houses, capsys):
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    lines = tmp_path / "lines.gpkg"
    write_shapes(lines, [shapely.LineString([(0, 0), (9, 9)])])
    for source, layer, output, words in (
        (tmp_path / "run_gis", houses, "x", "--products Ut_E,Ut_N"),
        (run, lines, "x", "lines"),
        (run, houses, "x.tif", "give a folder"),
    ):
        capsys.readouterr()
        assert ask(source, layer, tmp_path / output) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and words in said[0], said
        assert not (tmp_path / output).exists()


def test_the_map_shows_every_class_in_its_colour_and_nothing_lies_on_it(tmp_path, run, capsys):
    assert main(["intensity", str(run), "--guideline", "swiss-debris-flow", "-o", str(tmp_path / "map.png")]) == 0
    with rasterio.open(tmp_path / "map.png") as source:
        picture = source.read([1, 2, 3]).astype(int)
    share = SIDE / 300.0  # rough size of the block on the map
    for colour in ((0xFF, 0xB0, 0x00), (0xC1, 0x27, 0x2D)):
        near = (np.abs(picture - np.array(colour)[:, None, None]).max(axis=0) < 60).sum()
        assert near > 0.02 * share * picture[0].size


def test_buildings_outside_the_dtm_have_no_loads(tmp_path, run, capsys):
    """800 m x 400 m of DTM: nothing is known of a house beyond it, and of the outer part of one on its edge."""
    path, beyond = tmp_path / "houses.gpkg", affinity.translate(SQUARE, 500.0, 0.0)
    write_shapes(path, [SQUARE, beyond, shapely.box(790, 200, 820, 220)], owner=["a", "b", "c"])
    assert ask(run, path, tmp_path / "found") == 0
    assert "1 of 3 buildings are outside the DTM and are written without loads; of 1 a part" in capsys.readouterr().err
    table = geopandas.read_file(tmp_path / "found" / "buildings.gpkg").set_index("owner")
    assert np.isnan(table.loc["b", "flow_force"]) and np.isnan(table.loc["b", "flow_depth"])
    assert table.loc["a", "flow_force"] > 0 and table.loc["c", "flow_force"] == 0
