"""`mpmgis profile` and `mpmgis timeseries` for a block of known thickness and speed, from frames and from an export."""

import math

import geopandas
import numpy as np
import pytest
import shapely
from block_frames import CRS, DENSITY, MIDDLE, START, TANGENT, THICKNESS, bed, table, write_block_run, write_line
from slope_site import SOUTH, WEST

from mpmgis.commands.shell.main import main

SPEED = 8.0  # [m s-1], horizontal
UPRIGHT = 1 / math.hypot(1, TANGENT)


def write_points(path, *places, crs=CRS, **columns):
    points = shapely.points(np.array(places, float) + np.array([WEST, SOUTH]))
    geopandas.GeoDataFrame(columns, geometry=points, crs=CRS).to_crs(crs).to_file(path)
    return path


def numbers(rows, *names):
    """float[rows, names] of a table's columns, NaN where a cell is empty."""
    return np.array([[float(row[name]) if row[name] else np.nan for name in names] for row in rows])


def refusal(capsys, *arguments):
    """The one line with which a command is refused."""
    capsys.readouterr()
    try:
        code = main([*map(str, arguments)])
    except SystemExit as stop:
        code = stop.code
    said = capsys.readouterr().err.splitlines()
    assert code == 2 and len(said) == 1, said
    return said[0]


@pytest.fixture
def run(tmp_path):
    return write_block_run(tmp_path, places=(START, 250.0, 600.0), speeds=(0.0, SPEED, SPEED))


@pytest.mark.parametrize(("percentile", "height"), [(100, 1.75), (76, 1.75), (75, 1.25), (50, 0.75), (20, 0.25)])
def test_a_percentile_is_taken_as_depth(tmp_path, percentile, height):
    """Of points in four layers of equal mass, as in figure S2 of Vicari et al. (2025)."""
    run = write_block_run(tmp_path, places=(250.0, 600.0), times=(0.0, 10.0), dimension=3)
    line = write_line(tmp_path / "line.gpkg")
    assert main(["profile", str(run), "--line", str(line), "--at-times", "10", "--percentile", str(percentile)]) == 0
    along, h, t = numbers(table(tmp_path / "run_profile" / "profile.csv"), "along_m", "h_m", "t_m").T
    level = (along + 20 > 560) & (along + 20 < 640)
    assert h[level] == pytest.approx(height, abs=1e-6)
    assert t[level] == pytest.approx(height - 0.25, abs=1e-6)


def test_a_percentile_of_columns_is_reported_as_without_effect(tmp_path, run, capsys):
    line = write_line(tmp_path / "line.gpkg")
    assert main(["profile", str(run), "--line", str(line), "--percentile", "50"]) == 0
    assert "--percentile and --standoff have no effect" in capsys.readouterr().err


def test_a_percentile_of_an_export_is_refused(tmp_path, run, capsys):
    assert main(["export-raster", str(run), "-o", str(tmp_path / "gis"), "--cs-e", "10"]) == 0
    line = write_line(tmp_path / "line.gpkg")
    said = refusal(capsys, "profile", tmp_path / "gis", "--line", line, "--percentile", "50")
    assert "--percentile requires frames" in said


def test_a_uniform_block_has_its_thickness_speed_and_surface_exactly(tmp_path, run):
    line = write_line(tmp_path / "line.gpkg")
    assert main(["profile", str(run), "--line", str(line), "--at-times", "10", "--cs-e", "5"]) == 0
    rows = table(tmp_path / "run_profile" / "profile.csv")
    along, terrain, surface, h, t, un, ut = numbers(
        rows, "along_m", "terrain_m", "surface_m", "h_m", "t_m", "Un_m_s", "Ut_m_s"
    ).T
    x = along + 20  # the line's own start
    inside, outside = (x > 201) & (x < 299), (x < 199) | (x > 301)
    assert h[inside] == pytest.approx(THICKNESS * UPRIGHT, rel=1e-6)
    assert (h[outside] == 0).all() and np.isnan(ut[outside]).all()
    assert t == pytest.approx(h)
    assert (surface - terrain)[inside] == pytest.approx(THICKNESS, rel=1e-6)
    assert ut[inside] == pytest.approx(SPEED / UPRIGHT, rel=1e-6)
    assert un[inside] == pytest.approx(0, abs=1e-6)
    assert terrain[x < 390] == pytest.approx(bed(x[x < 390]), abs=1e-5)
    assert (tmp_path / "run_profile" / "profile.png").stat().st_size > 10_000


def test_of_points_h_is_the_highest_and_t_what_lies_between(tmp_path):
    run = write_block_run(tmp_path, dimension=3)
    line = write_line(tmp_path / "line.gpkg")
    assert main(["profile", str(run), "--line", str(line), "--at-times", "0", "-o", str(tmp_path / "p.csv")]) == 0
    x, h, t = numbers(table(tmp_path / "p.csv"), "along_m", "h_m", "t_m").T
    inside = (x + 20 > 101) & (x + 20 < 199)
    assert h[inside] == pytest.approx(THICKNESS * 7 / 8 * UPRIGHT, rel=1e-6)  # four layers
    assert t[inside] == pytest.approx(THICKNESS * 6 / 8 * UPRIGHT, rel=1e-6)


def test_an_export_reports_the_same_along_a_line_and_at_points(tmp_path, run, capsys):
    for layout in ("steps", "stacks"):
        gis = tmp_path / layout
        arguments = ["export-raster", run, "--no-qgis", "--layout", layout, "--products", "p", "-o", gis]
        assert main([*map(str, arguments)]) == 0
        line = write_line(tmp_path / "line.gpkg")
        points = write_points(tmp_path / "points.gpkg", (250, MIDDLE), (600, MIDDLE), name=["slope", "flat"])
        for verb, options in (("profile", ("--line", line)), ("timeseries", ("--points", points))):
            tables = []
            for source in (run, gis):
                file = tmp_path / f"{verb}.csv"
                assert main([verb, str(source), *map(str, options), "-o", str(file), "--overwrite"]) == 0
                tables.append(table(file))
            assert len(tables[0]) == len(tables[1])
            names = [name for name in tables[0][0] if name != "point"]
            found, exported = (numbers(rows, *names) for rows in tables)
            assert found == pytest.approx(exported, rel=1e-5, abs=1e-3, nan_ok=True)


def test_points_have_the_cells_values_over_time_with_pressure(tmp_path, run, capsys):
    points = write_points(tmp_path / "p.gpkg", (250, MIDDLE), (250, 20), name=["in", "beside"], crs="EPSG:4326")
    options = ["--points", points, "--at", f"{WEST + 600},{SOUTH + MIDDLE}"]
    assert main(["timeseries", str(run), *map(str, options)]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[-1].endswith("timeseries.csv") and shown[1].split()[:2] == ["in", "10"]
    assert shown[2].split()[1] == "-" and shown[3].split()[:2] == ["400600,5100200", "20"]
    rows = table(tmp_path / "run_timeseries" / "timeseries.csv")
    assert [row["point"] for row in rows[::3]] == ["in", "beside", "400600,5100200"]
    time, h, ut, p = numbers(rows, "time_s", "h_m", "Ut_m_s", "p_Pa").T
    assert time.tolist() == [0, 10, 20] * 3
    assert h == pytest.approx([0, THICKNESS * UPRIGHT, 0, 0, 0, 0, 0, 0, THICKNESS], rel=1e-6)
    assert ut[[1, 8]] == pytest.approx([SPEED / UPRIGHT, SPEED], rel=1e-6)
    assert p[[1, 8]] == pytest.approx(DENSITY * np.array([SPEED / UPRIGHT, SPEED]) ** 2, rel=1e-6)


def test_times_are_those_of_the_nearest_frames_and_that_is_reported(tmp_path, run, capsys):
    line = write_line(tmp_path / "line.gpkg")
    assert main(["profile", str(run), "--line", str(line), "--at-times", "9,11,20", "-o", str(tmp_path / "p.csv")]) == 0
    assert "no frame at 9, 11 s" in capsys.readouterr().err
    assert sorted({row["time_s"] for row in table(tmp_path / "p.csv")}) == ["10", "20"]


def test_what_is_outside_the_raster_is_reported_or_refused(tmp_path, run, capsys):
    line = write_line(tmp_path / "off.gpkg", (-100, MIDDLE), (300, MIDDLE))
    assert main(["profile", str(run), "--line", str(line), "-o", str(tmp_path / "p.csv")]) == 0
    assert "100 m of it are outside the raster" in capsys.readouterr().err
    assert table(tmp_path / "p.csv")[0]["h_m"] == ""
    line = write_line(tmp_path / "gone.gpkg", (-100, MIDDLE), (-20, MIDDLE))
    points = write_points(tmp_path / "points.gpkg", (250, MIDDLE), (900, MIDDLE))
    for arguments, words in (
        (("profile", run, "--line", line), "is outside the raster"),
        (("profile", run, "--line", points), "expected lines"),
        (("profile", run, "--line", write_line(tmp_path / "l.gpkg"), "--at-times", "50"), "from 0 to 20 s"),
        (("profile", run), "--line"),
        (("profile", run, "--line", write_line(tmp_path / "l2.gpkg"), "--spacing", "1e-4"), "a larger --spacing"),
        (("profile", run, "--line", write_line(tmp_path / "l3.gpkg"), "--spacing", "761"), "a smaller --spacing"),
        (("timeseries", run, "--points", points), "'feature 2' (E 400900.0, N 5100200.0) is outside"),
        (("timeseries", run, "--points", line), "expected points"),
        (("timeseries", run), "--points FILE or --at E,N"),
        (("timeseries", run, "--at", "3"), "expected two numbers"),
        (("timeseries", run, "--at", "1,2", "--standoff", "no"), "expected a number"),
    ):
        assert words in refusal(capsys, *arguments), arguments
    assert not (tmp_path / "run_profile").exists() and not (tmp_path / "run_timeseries").exists()
