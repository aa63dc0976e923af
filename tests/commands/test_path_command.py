"""`mpmgis path`: blocks of known depth and speed along a straight path, alone, together and with an outline."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
from block_frames import MIDDLE, SIDE, table, write_block_run, write_line
from slope_site import write_raster, write_shapes

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame, write_frame

PLACES = (150.0, 450.0, 600.0)  # middles of the block in each frame
SPEEDS = (0.0, 10.0, 0.0)
START = 20.0  # of the line of `write_line` from the corner


@pytest.fixture
def run(tmp_path):
    folder = write_block_run(tmp_path, PLACES, speeds=SPEEDS)
    write_line(tmp_path / "line.geojson")
    return folder


def test_a_straight_path_has_the_edges_of_the_block(tmp_path, run, capsys):
    assert main(["path", str(run), "--line", str(tmp_path / "line.geojson")]) == 0
    shown = capsys.readouterr()
    (row,) = table(tmp_path / "run_path" / "path.csv")
    cell = 0.5 * 10.0  # to the centre of a cell
    assert float(row["runout_m"]) == pytest.approx(PLACES[2] + SIDE / 2 - START, abs=cell + 1e-6)
    assert float(row["begin_m"]) == pytest.approx(PLACES[0] - SIDE / 2 - START, abs=cell + 1e-6)
    assert float(row["area_m2"]) == pytest.approx(3 * SIDE**2)
    assert float(row["growth_index"]) == pytest.approx(1.0)
    assert float(row["Ut_max_m_s"]) == pytest.approx(10.0, rel=1e-6)
    assert float(row["runout_difference_m"]) == 0.0 and float(row["overestimated_area_m2"]) == 0.0
    assert "h_max >= 0.1 m" in shown.out
    along = table(tmp_path / "run_path" / "along_path.csv")
    assert sum(float(one["area_m2"]) for one in along) == pytest.approx(3 * SIDE**2)
    assert max(float(one["l_left_m"]) for one in along) == pytest.approx(SIDE / 2 - cell, abs=cell)
    assert min(float(one["l_right_m"]) for one in along) == pytest.approx(cell - SIDE / 2, abs=cell)


@pytest.mark.parametrize("limit", [{"speed": 5.0}, {"pressure": 5e4}])
def test_the_runout_at_a_speed_or_pressure_is_that_of_the_moving_block(tmp_path, run, limit):
    found = mpmgis.path(run, tmp_path / "o", line=tmp_path / "line.geojson", **limit)
    side = found.sides[0]
    assert side.runout == pytest.approx(PLACES[1] + SIDE / 2 - START, abs=5.0 + 1e-6)
    assert side.area == pytest.approx(SIDE**2)


def test_the_thalweg_time_diagram_has_the_block_at_its_times(tmp_path, run):
    time = mpmgis.path(run, tmp_path / "o", line=tmp_path / "line.geojson").time
    for k, place in enumerate(PLACES):
        there = np.abs(time.bins.middles + START - place) < 0.4 * SIDE
        np.testing.assert_allclose(time.values["h"][k][there], 2.0, rtol=0.2)
        assert (time.arrival()[there] == time.times[k]).all()
    assert np.isnan(time.arrival()).any()
    rows = table(tmp_path / "o" / "thalweg_time.csv")
    assert {float(row["time_s"]) for row in rows} == set(time.times) and (tmp_path / "o" / "thalweg_time.png").is_file()


def test_coarser_cells_have_the_diagram_too(tmp_path, run):
    time = mpmgis.path(run, tmp_path / "o.csv", line=tmp_path / "line.geojson", cell_size=20.0).time
    there = np.abs(time.bins.middles + START - PLACES[0]) < 0.25 * SIDE
    np.testing.assert_allclose(time.values["h"][0][there], 2.0, rtol=0.2)


def test_many_results_and_an_outline_in_one_table(tmp_path, run, capsys):
    (tmp_path / "b").mkdir()
    other = write_block_run(tmp_path / "b", (150.0, 450.0, 500.0), speeds=SPEEDS)
    assert main(["export-raster", str(other), "--no-qgis", "-o", str(tmp_path / "short")]) == 0
    observed = shapely.box(450, MIDDLE - 50, 650, MIDDLE + 50)
    write_shapes(tmp_path / "observed.geojson", [observed])
    capsys.readouterr()
    words = ["--line", str(tmp_path / "line.geojson"), "--outline", str(tmp_path / "observed.geojson")]
    assert main(["path", str(run), str(tmp_path / "short"), *words, "-o", "-", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert list(rows) == ["run", "short", "observed"]
    assert rows["observed"]["area_m2"] == pytest.approx(observed.area)
    assert rows["run"]["runout_difference_m"] == pytest.approx(0.0, abs=1e-6)
    assert rows["short"]["runout_difference_m"] == pytest.approx(-100.0, abs=1e-6)
    assert rows["run"]["common_area_m2"] == pytest.approx((50 + 100) * SIDE)
    assert rows["run"]["underestimated_area_m2"] == pytest.approx(50 * SIDE)
    assert rows["run"]["overestimated_area_m2"] == pytest.approx(3 * SIDE**2 - 150 * SIDE)
    assert rows["short"]["growth_index"] is None
    found = mpmgis.path([run, tmp_path / "short"], tmp_path / "o", line=tmp_path / "line.geojson")
    assert found.reference.name == "run" and found.time is None
    assert sorted(file.name for file in found.files) == ["along_path.csv", "path.csv", "path.png"]


def test_the_growth_index_is_the_ratio_of_the_masses(tmp_path, run):
    last = sorted(run.glob("*.h5"))[-1]
    frame = read_frame(last)
    particles = replace(frame.particles, mass=1.5 * frame.particles.mass, volume=1.5 * frame.particles.volume)
    write_frame(last, replace(frame, particles=particles))
    found = mpmgis.path(run, tmp_path / "o.csv", line=tmp_path / "line.geojson")
    assert found.sides[0].growth == pytest.approx(1.5)
    for frame in sorted(run.glob("*.h5"))[1:]:
        frame.unlink()
    alone = mpmgis.path(run, tmp_path / "a", line=tmp_path / "line.geojson")
    assert np.isnan(alone.sides[0].growth) and len(alone.time.times) == 1


def test_an_export_agrees_with_its_frames_and_rasters_need_no_terrain_with_a_line(tmp_path, run):
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    line = tmp_path / "line.geojson"
    own, export = (
        mpmgis.path(result, tmp_path / f"{result.name}.csv", line=line) for result in (run, tmp_path / "run_gis")
    )
    assert own.sides[0].runout == export.sides[0].runout and own.sides[0].area == export.sides[0].area
    np.testing.assert_allclose(own.time.values["h"], export.time.values["h"], rtol=1e-6)
    np.testing.assert_allclose(own.time.values["Ut"], export.time.values["Ut"], rtol=1e-6)
    side = own.sides[0]
    depth = np.full(side.grid.shape, np.nan)
    row, column = np.rint(side.grid.rowcol(side.x, side.y)).astype(int)
    depth[row, column] = side.values
    (tmp_path / "theirs").mkdir()
    write_raster(tmp_path / "theirs" / "run_pft.tif", depth)
    rasters = mpmgis.path(tmp_path / "theirs", tmp_path / "r.csv", line=line)
    assert rasters.sides[0].runout == side.runout and rasters.time is None
    for words, part in (({"line": None}, "no DTM beside"), ({"line": line, "pressure": 1.0}, "has no p_max")):
        with pytest.raises(mpmgis.MpmgisError, match=part):
            mpmgis.path(tmp_path / "theirs", tmp_path / "s.csv", **words)


def test_the_centre_line_gives_nearly_the_straight_path(tmp_path, run):
    found = mpmgis.path(run, tmp_path / "o.csv")
    assert found.line_source == "centre line of the flow"
    first = mpmgis.path(run, tmp_path / "p.csv", line=tmp_path / "line.geojson")
    length = first.sides[0].runout - first.sides[0].place()[4]
    assert found.sides[0].runout == pytest.approx(length, rel=0.03)
    assert found.sides[0].area == first.sides[0].area


def test_a_short_line_is_reported_by_any_name(tmp_path, run, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("centre.geojson", "short.geojson"):
        write_line(tmp_path / name, (20, MIDDLE), (400, MIDDLE))
        assert main(["path", "run", "--line", name, "-o", f"{name}.csv"]) == 0
        assert f"{name} ends" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--line", "missing.gpkg"), "missing.gpkg"),
        (("--outline", "line.geojson"), "expected polygons"),
        (("--pressure", "1e9"), "the largest is"),
        (("--speed", "1", "--depth", "1"), "not allowed with"),
        (("--spacing", "1e-9"), "--spacing"),
        (("-o", "o.tif"), "expected .png, .csv or a folder"),
    ],
)
def test_bad_input_has_one_line(tmp_path, run, capsys, monkeypatch, words, part):
    monkeypatch.chdir(tmp_path)
    try:
        assert main(["path", "run", *words]) == 2
    except SystemExit as end:
        assert end.code == 2
    assert part in capsys.readouterr().err.splitlines()[-1] and not (tmp_path / "run_path").exists()


def test_two_limits_in_python_have_one_line(tmp_path, run):
    with pytest.raises(mpmgis.MpmgisError, match="`speed` and `pressure` are given; expected one limit"):
        mpmgis.path(run, tmp_path / "o", speed=1.0, pressure=1.0)
