"""`mpmgis compare` through the command line: known numbers, written files, refused inputs."""

import csv
import json
import math
from pathlib import Path

import geopandas
import matplotlib.image
import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from affine import Affine
from exporting import write_run

from mpmgis.commands.shell.main import main
from mpmgis.laws.quantities import Quantity
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_ascii_grid, write_geotiff

CRS = pyproj.CRS.from_epsg(32632)
WEST, SOUTH = 600000.0, 5170000.0
ISEESNOW = Path(__file__).parents[2] / "../shared/data/iseesnow_idealized"
needs_iseesnow = pytest.mark.skipif(not ISEESNOW.exists(), reason="no ../shared/data/iseesnow_idealized")


def grid_of(cell=2.0, width=400.0, west=WEST, south=SOUTH, crs=CRS):
    count = round(width / cell)
    return Grid.north_up(crs, west, south + width, cell, (count, count))


def disc(grid, x, y, radius=60.0, top=3.0):
    """A cap of thickness `top` in its middle and 1 at its rim, 0 outside."""
    easting, northing = grid.xy(*np.indices(grid.shape))
    away = np.hypot(easting - WEST - x, northing - SOUTH - y)
    return np.where(away < radius, top - (top - 1) * away / radius, 0.0)


def write_peak(path, values, grid, name="h_max", unit="m"):
    write_geotiff(path, grid, [(Quantity(name, unit, ""), values)], {})
    return path


def write_shapes(path, *shapes, crs=CRS):
    moved = [shapely.affinity.translate(shape, WEST, SOUTH) for shape in shapes]
    geopandas.GeoDataFrame(geometry=moved, crs=CRS).to_crs(crs).to_file(path)
    return path


def dtm(path, grid=None, crs=CRS):
    """A slope down to the east, 0.5 steep."""
    grid = grid or grid_of(5.0, crs=crs)
    x, _ = grid.xy(*np.indices(grid.shape))
    return write_peak(path, 1000 - 0.5 * (x - WEST), grid, "elevation")


def compared(capsys, *arguments):
    """Facts that the command prints with --json, and its messages."""
    code = main(["compare", *map(str, arguments), "--json"])
    out, said = capsys.readouterr()
    assert code == 0, said
    return json.loads(out), said


@pytest.fixture
def discs(tmp_path):
    """Two rasters of overlapping caps, 60 m in radius and 50 m apart."""
    grid = grid_of()
    first = write_peak(tmp_path / "first.tif", disc(grid, 150, 200), grid)
    second = write_peak(tmp_path / "second.tif", disc(grid, 200, 200, top=4.0), grid)
    return first, second


# ------------------------------------------------------------------------------------------------------------- numbers


def test_two_discs(discs, capsys, tmp_path):
    found, said = compared(capsys, *discs, "--dem", dtm(tmp_path / "dtm.tif"))
    both = 2 * 3600 * math.acos(50 / 120) - 25 * math.sqrt(4 * 3600 - 2500)
    whole = math.pi * 3600
    assert found["iou"] == pytest.approx(both / (2 * whole - both), rel=0.01)
    assert found["both_m2"] == pytest.approx(both, rel=0.01)
    assert found["only_a_m2"] == pytest.approx(whole - both, rel=0.02)
    assert found["a"]["area_m2"] == pytest.approx(whole, rel=0.01)
    assert found["b"]["runout_m"] == pytest.approx(found["a"]["runout_m"], abs=2)  # from the top of each
    farther = found["b"]["farthest_along_line_m"] - found["a"]["farthest_along_line_m"]
    assert farther == pytest.approx(50, abs=2)  # down the slope, to the east
    (band,) = found["bands"]
    assert (band["a"], band["unit"]) == ("h_max", "m")
    assert band["peak_a"] == pytest.approx(3.0, abs=0.06) and band["peak_b"] == pytest.approx(4.0, abs=0.08)
    assert band["rms_difference"] > abs(band["mean_difference"]) > 0
    assert found["line"]["source"] == "centre line of both flows" and said == ""


def test_what_the_screen_shows(discs, capsys):
    assert main(["compare", *map(str, discs)]) == 0
    out, said = capsys.readouterr()
    rows = {line.split("  ")[0]: line.split() for line in out.splitlines()}
    assert rows["area [ha]"][2:5] == ["1.131", "1.131", "0"]
    assert float(rows["overlap (IoU)"][-1]) == pytest.approx(0.3204, abs=0.002)
    assert rows["h_max peak [m]"][-1].startswith("-2")
    assert "runout needs --line" in said


def test_a_line_decides_what_runout_is(discs, capsys, tmp_path):
    """Along a line to the north both reach equally far, along one to the east they are 50 m apart; bends count."""
    north = write_shapes(tmp_path / "north.gpkg", shapely.LineString([(175, 100), (175, 300)]))
    east = write_shapes(tmp_path / "east.gpkg", shapely.LineString([(50, 150), (50, 200), (350, 200)]))
    for line, first, second in ((north, 160, 160), (east, 50 + 160, 50 + 210)):
        found, _ = compared(capsys, *discs, "--line", line)
        assert found["a"]["farthest_along_line_m"] == pytest.approx(first, abs=2)
        assert found["b"]["farthest_along_line_m"] == pytest.approx(second, abs=2)
        assert found["a"]["runout_m"] is None  # no DTM tells where the flow begins


def test_a_line_drawn_uphill_is_taken_the_other_way(discs, capsys, tmp_path):
    up = write_shapes(tmp_path / "up.gpkg", shapely.LineString([(300, 200), (50, 200)]), crs=4326)
    found, said = compared(capsys, *discs, "--line", up, "--dem", dtm(tmp_path / "dtm.tif"))
    assert found["a"]["farthest_along_line_m"] == pytest.approx(160, abs=2)
    assert found["a"]["runout_m"] == pytest.approx(120, abs=2)
    assert "runs uphill" in said and "reprojected from EPSG:4326" in said
    short = write_shapes(tmp_path / "short.gpkg", shapely.LineString([(50, 200), (230, 200)]))
    found, said = compared(capsys, *discs, "--line", short)
    assert found["b"]["farthest_along_line_m"] == pytest.approx(210, abs=2) and "ends 29 m before the flow does" in said


@pytest.mark.parametrize("start", [40, 80, 95])
def test_runout_and_compare_report_the_same_runout(discs, capsys, tmp_path, start):
    """Wherever the line begins above the flow, it counts from the flow's highest place, of a deposit too."""
    line = write_shapes(tmp_path / "line.gpkg", shapely.LineString([(start, 190), (330, 215)]))
    terrain = dtm(tmp_path / "dtm.tif")
    grid = grid_of()
    for name, centre in (("one", 150), ("two", 200)):
        write_peak(tmp_path / f"{name}_pft.tif", disc(grid, centre, 200), grid, "pft")
    given = ["--line", line, "--dem", terrain, "--threshold", 0.5]
    found, _ = compared(capsys, tmp_path / "one", tmp_path / "two", *given)
    for side, name in (("a", "one"), ("b", "two")):
        asked = [tmp_path / name, *given, "-o", tmp_path / f"{name}.csv"]
        assert main(["runout", *map(str, asked), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        for key in ("runout_m", "farthest_along_line_m"):
            assert told[key] == found[side][key] > 0, key
        if name == "one":
            assert (told["farthest_along_line_m"] > told["runout_m"]) == (start < 90)  # where the flow begins
    deposit = write_peak(tmp_path / "lying.tif", disc(grid, 200, 200, radius=30), grid, "value")
    found, _ = compared(capsys, tmp_path / "one", deposit, *given)
    behind = found["b"]["farthest_along_line_m"] - found["a"]["farthest_along_line_m"]
    assert found["b"]["runout_m"] - found["a"]["runout_m"] == pytest.approx(behind, abs=1e-9)


def write_plain(path, values, grid, nodata=-9999.0):
    """A raster that does not say what it holds."""
    rows, columns = grid.shape
    profile = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": 1,
        "dtype": "float32",
        "crs": grid.crs,
        "transform": grid.transform,
        "nodata": nodata,
    }
    with rasterio.open(path, "w", **profile) as target:
        target.write(np.where(np.isfinite(values), values, np.nan if nodata is None else nodata).astype("float32"), 1)
    return path


@pytest.fixture
def export(tmp_path):
    """An export of two bands, in which what lies at the end is 30 m in radius, down the slope."""
    grid, rasters = grid_of(), tmp_path / "run_gis" / "rasters"
    rasters.mkdir(parents=True)
    write_peak(rasters / "run_max.tif", disc(grid, 150, 200), grid)
    write_peak(rasters / "run_deposit.tif", disc(grid, 180, 200, radius=30.0), grid, "h")
    dtm(tmp_path / "run_gis" / "dtm.tif")
    return tmp_path / "run_gis"


def test_a_difference_of_dems_is_compared_with_the_deposit(export, capsys, tmp_path):
    grid = grid_of()
    lying, taken = disc(grid, 185, 200, radius=30.0), disc(grid, 120, 200, radius=20.0, top=2.0)
    dod = write_plain(tmp_path / "dod.tif", np.where(taken > 0, -taken, lying), grid)
    for swap in (False, True):
        found, said = compared(capsys, *([dod, export] if swap else [export, dod]))
        ours, theirs = ("b", "a") if swap else ("a", "b")
        assert found[ours]["band"] == "h_deposit" and found[theirs]["kind"] == "difference of DEMs"
        assert found[theirs]["area_m2"] == pytest.approx(math.pi * 900, rel=0.02)
        assert "taken as a difference of DEMs" in said and "vertical" in said
        assert 0.7 < found["iou"] < 0.95
        (band,) = [band for band in found["bands"] if None not in (band["a"], band["b"])]
        assert abs(band["mean_difference"]) < 0.2
        assert found[theirs]["runout_m"] == pytest.approx(found[ours]["runout_m"] + 5.0, abs=2.0)  # of the flow's top
    whole, _ = compared(capsys, export, dod, "--band", "h_max")
    assert whole["a"]["band"] == "h_max" and whole["a"]["area_m2"] == pytest.approx(math.pi * 3600, rel=0.02)
    alone = tmp_path / "alone.tif"
    write_peak(alone, disc(grid, 150, 200), grid)
    assert main(["compare", str(alone), str(dod)]) == 2
    assert "no h_deposit to compare with a difference of DEMs" in capsys.readouterr().err


@pytest.mark.parametrize(
    "outside", [0.0, np.nan, -9999.0, -32768.0, 9999.0, 65535.0, 1e20, -3.4028235e38, 3.4028235e38]
)
@pytest.mark.parametrize("value", [1.0, 255.0])
def test_a_mask_is_compared_as_the_outline_that_it_is(export, capsys, tmp_path, value, outside):
    """Whatever is outside, without a word that it is nodata."""
    grid = grid_of()
    mask = write_plain(tmp_path / "mask.tif", np.where(disc(grid, 170, 200) > 0, value, outside), grid, nodata=None)
    found, said = compared(capsys, export, mask)
    assert "is a mask" in said and found["b"]["kind"] == "outline" and found["observed"] == "b"
    assert found["b"]["area_m2"] == pytest.approx(np.count_nonzero(disc(grid, 170, 200)) * 4.0)
    assert all(band["mean_difference"] is None for band in found["bands"])


def test_elevations_are_refused_and_a_thickness_without_a_name_is_taken(export, capsys, tmp_path):
    grid = grid_of()
    x, _ = grid.xy(*np.indices(grid.shape))
    ground = write_plain(tmp_path / "ground.tif", 1000 - 0.5 * (x - WEST), grid)
    assert main(["compare", str(export), str(ground)]) == 2
    assert "contains elevations (800." in capsys.readouterr().err
    plain = write_plain(tmp_path / "plain.tif", disc(grid, 150, 200), grid)
    found, _ = compared(capsys, export, plain)
    assert found["iou"] == 1.0 and found["a"]["band"] == "h_max" and found["b"]["band"] == "value"
    found, _ = compared(capsys, export, plain, "--band", "h_deposit")
    assert found["a"]["band"] == "h_deposit" and found["iou"] < 0.5


def test_the_deposit_has_one_name_and_the_old_one_is_refused_with_it(export, capsys, tmp_path):
    grid = grid_of()
    plain = write_plain(tmp_path / "plain.tif", disc(grid, 180, 200, radius=30.0), grid)
    assert main(["compare", str(export), str(plain), "--band", "deposit_h"]) == 2
    assert "is now named 'h_deposit'" in capsys.readouterr().err
    found, said = compared(capsys, export / "rasters" / "run_deposit.tif", plain, "--band", "h_deposit")
    assert found["a"]["band"] == "h_deposit" and found["iou"] == 1.0 and "no DTM" not in said


def test_an_observed_outline(discs, capsys, tmp_path):
    """The exact circle of the first disc, in degrees: IoU is that of cells with their centre inside, so nearly 1."""
    circle = shapely.Point(150, 200).buffer(60, quad_segs=64)
    outline = write_shapes(tmp_path / "mapped.gpkg", circle, crs=4326)
    found, said = compared(capsys, discs[0], outline)
    assert found["iou"] > 0.995 and "reprojected from EPSG:4326" in said
    assert found["b"] == found["b"] | {"name": "mapped", "kind": "outline", "band": None}
    assert found["b"]["area_m2"] == pytest.approx(circle.area, rel=1e-3)
    assert found["bands"][0]["peak_b"] is None
    turned, _ = compared(capsys, outline, discs[0])
    assert turned["iou"] == found["iou"] and turned["only_a_m2"] == found["only_b_m2"]


def test_an_outline_beyond_the_raster_counts_whole(discs, capsys, tmp_path):
    half = write_shapes(tmp_path / "half.shp", shapely.box(-100, 140, 100, 260))
    found, said = compared(capsys, discs[0], half)
    assert found["only_b_m2"] + found["both_m2"] == pytest.approx(200 * 120, rel=0.02)
    assert "12000 m2 of half are outside the raster of first" in said


def test_two_places_of_one_crs_share_nothing(discs, capsys, tmp_path):
    far = grid_of(west=WEST + 5000)
    away = write_peak(tmp_path / "away.tif", disc(far, 5200, 200), far)
    found, said = compared(capsys, discs[0], away, "-o", tmp_path / "run_1.5")  # a folder with a dot in its name
    assert found["iou"] == found["both_m2"] == 0 and found["only_b_m2"] == pytest.approx(math.pi * 3600, rel=0.01)
    assert "do not overlap" in said and (tmp_path / "run_1.5" / "map.png").is_file()


def test_coarser_and_shifted_cells_and_a_missing_crs(discs, capsys, tmp_path):
    coarse = grid_of(5.0, west=WEST - 3.7, south=SOUTH + 1.3, crs=None)
    rough = write_peak(tmp_path / "rough.tif", disc(coarse, 150, 200), coarse)
    found, said = compared(capsys, discs[0], rough)
    assert found["cell_size_m"] == 2.0 and found["iou"] > 0.93
    assert "rough has no CRS; EPSG:32632 of the other side is assumed" in said
    assert compared(capsys, rough, discs[0])[0]["iou"] == found["iou"]


@pytest.mark.parametrize("transform", [Affine(2, 0, WEST, 0, 2, SOUTH), Affine(1.6, 1.2, WEST - 20, 1.2, -1.6, 0)])
def test_rasters_that_are_not_north_up(discs, capsys, tmp_path, transform):
    """South-up, and turned by 37 degrees: the same disc; the written rasters are north-up and as large."""
    transform = Affine(*transform[:5], SOUTH + 160 if transform.b else SOUTH)
    grid = Grid(CRS, transform, (200, 200) if transform.b == 0 else (260, 260))
    turned = write_peak(tmp_path / "turned.tif", disc(grid, 150, 200), grid)
    found, _ = compared(capsys, turned, discs[0], "--dem", dtm(tmp_path / "dtm.tif"), "-o", tmp_path / "out")
    assert found["iou"] > 0.96 and found["a"]["area_m2"] == pytest.approx(math.pi * 3600, rel=0.01)
    with rasterio.open(tmp_path / "out" / "classes.tif") as source:
        assert source.transform.b == 0 and source.transform.e < 0
        area = np.count_nonzero(source.read(1) == 3) * abs(source.transform.a * source.transform.e)
    assert area == pytest.approx(found["both_m2"], rel=0.02)


def test_the_threshold_and_the_band(capsys, tmp_path):
    grid = grid_of()
    values = disc(grid, 200, 200)
    bands = [(Quantity("h_max", "m", ""), values), (Quantity("Ut_max", "m s-1", ""), 10 * values)]
    write_geotiff(tmp_path / "ours.tif", grid, bands, {})
    write_peak(tmp_path / "theirs_pft.tif", values, grid, "x")
    write_peak(tmp_path / "theirs_pfv.tif", 10 * values, grid, "x")
    ours, theirs = tmp_path / "ours.tif", tmp_path / "theirs"
    inner = compared(capsys, ours, theirs, "--threshold", 2)[0]
    assert inner["a"]["area_m2"] == pytest.approx(math.pi * 30**2, rel=0.03) and inner["iou"] == 1.0
    fast = compared(capsys, ours, theirs, "--band", "pfv", "--threshold", "20")[0]
    assert fast["unit"] == "m s-1" and fast["a"]["area_m2"] == pytest.approx(inner["a"]["area_m2"], rel=0.01)
    assert [(band["a"], band["b"]) for band in fast["bands"]] == [("h_max", "pft"), ("Ut_max", "pfv")]


def test_a_band_without_a_value_is_empty_and_stops_nothing(discs, capsys, tmp_path):
    """A footprint that is nodata everywhere has no area and overlaps with nothing; so has one band among others."""
    nothing = write_peak(tmp_path / "nothing.tif", np.full((200, 200), np.nan), grid_of())
    for sides in ((discs[0], nothing), (nothing, discs[0])):
        found, said = compared(capsys, *sides, "--dem", dtm(tmp_path / "dtm.tif"))
        lines = [line for line in said.splitlines() if "taken as empty" in line]
        assert lines == ["nothing: every cell of h_max is nodata; taken as empty"]
        empty, flowed = (found["a"], found["b"])[:: 1 if sides[0] is nothing else -1]
        assert empty["area_m2"] == 0 and flowed["area_m2"] == pytest.approx(math.pi * 60**2, rel=0.01)
        assert found["iou"] == 0 and found["both_m2"] == 0
    assert main(["compare", str(discs[0]), str(nothing), "-o", str(tmp_path / "out")]) == 0
    assert sorted(path.name for path in (tmp_path / "out").glob("*.*") if path.suffix) == [
        "classes.qml",
        "classes.tif",
        "map.png",
        "table.csv",
    ]
    capsys.readouterr()
    assert main(["compare", str(nothing), str(nothing)]) == 2
    assert "no cell of either is above --threshold" in capsys.readouterr().err.splitlines()[-1]


def test_iseesnow_names_in_a_folder_and_kilopascals(capsys, tmp_path):
    grid, folder = grid_of(5.0), tmp_path / "peaks"
    folder.mkdir()
    for kind, factor in (("pft", 1), ("pfv", 10), ("ppr", 50)):
        write_ascii_grid(folder / f"release_1a2b_null_model_{kind}.asc", grid, factor * disc(grid, 200, 200))
    ours = write_peak(tmp_path / "p.tif", 40e3 * disc(grid, 200, 200), grid, "p_max", "Pa")
    found, _ = compared(capsys, ours, folder, "--band", "ppr")
    (pressure,) = (band for band in found["bands"] if band["b"] == "ppr")
    assert pressure["a"] == "p_max" and pressure["peak_b"] / pressure["peak_a"] == pytest.approx(50 / 40, rel=1e-4)
    write_ascii_grid(folder / "other_pft.asc", grid, disc(grid, 210, 200))
    assert compared(capsys, folder / "other", folder / "release_1a2b_null_model")[0]["iou"] < 1
    assert main(["compare", str(ours), str(folder)]) == 2
    assert "contains 2 *_pft rasters" in capsys.readouterr().err


def test_a_run_its_export_and_the_same_run_drifting_further(capsys, tmp_path):
    """Frames are exported on the way; a run is identical with its own export, and differs from another one."""
    write_run(tmp_path / "slow", drift=2.0)
    write_run(tmp_path / "fast", drift=15.0)
    main(["export-raster", str(tmp_path / "slow"), "--no-qgis", "-q"])
    capsys.readouterr()
    same, said = compared(capsys, tmp_path / "slow", tmp_path / "slow_gis")
    assert same["iou"] == 1.0 and same["a"]["kind"] == "run" and "its frames are averaged" in said
    assert all(band["rms_difference"] == 0 for band in same["bands"])
    assert same["a"]["runout_m"] == same["b"]["runout_m"] > 0
    other, _ = compared(capsys, tmp_path / "fast", tmp_path / "slow_gis" / "rasters")
    assert 0.2 < other["iou"] < 0.95 and other["a"]["runout_m"] > other["b"]["runout_m"]
    last, _ = compared(capsys, tmp_path / "fast", tmp_path / "slow_gis", "--band", "h_last")
    assert last["a"]["area_m2"] < other["a"]["area_m2"]
    assert not list(tmp_path.glob("*compare*"))


# --------------------------------------------------------------------------------------------------------------- files


def test_a_folder_of_map_table_and_classes(discs, capsys, tmp_path):
    folder = tmp_path / "out"
    found, _ = compared(capsys, *discs, "--dem", dtm(tmp_path / "dtm.tif"), "-o", folder)
    assert {Path(file).name for file in found["files"]} == {"map.png", "table.csv", "classes.tif", "classes.qml"}
    with open(folder / "table.csv", newline="", encoding="utf-8") as file:
        table = {row[0]: row[1:] for row in csv.reader(file)}
    assert float(table["area"][1]) == found["a"]["area_m2"] and table["name"][1:3] == ["first", "second"]
    assert float(table["runout"][3]) == pytest.approx(found["a"]["runout_m"] - found["b"]["runout_m"], rel=1e-6)
    assert float(table["overlap (IoU)"][4]) == pytest.approx(found["iou"], rel=1e-9)
    with rasterio.open(folder / "classes.tif") as source:
        assert source.descriptions == ("class [1]", "h_max_A [m]", "h_max_B [m]", "h_max_A_minus_B [m]")
        assert source.crs.to_epsg() == 32632
        classes, gap = source.read(1), source.read(4, masked=True)
    areas = [np.count_nonzero(classes == number) * 4.0 for number in (1, 2, 3)]
    assert areas == [found["only_a_m2"], found["only_b_m2"], found["both_m2"]]
    assert gap[classes == 3].mean() == pytest.approx(found["bands"][0]["mean_difference"], abs=1e-6)


def coloured(image, colour, near=0.12):
    """Share of the picture's pixels of about one colour."""
    return np.mean(np.abs(image[..., :3] - np.array(colour) / 255).max(axis=-1) < near)


def test_the_map_shows_three_classes_in_their_places(discs, capsys, tmp_path):
    compared(capsys, *discs, "-o", tmp_path / "map.png")
    image = matplotlib.image.imread(tmp_path / "map.png")
    both, first, second = (152, 123, 183), (225, 127, 52), (73, 140, 206)  # over white ground, a fifth of it shows
    shares = [coloured(image, colour) for colour in (both, first, second)]
    assert min(shares) > 0.02
    columns = np.arange(image.shape[1])
    places = []
    for colour in (first, both, second):
        hits = np.abs(image[..., :3] - np.array(colour) / 255).max(axis=-1) < 0.1
        places.append((hits[:, : int(0.6 * len(columns))].sum(axis=0) * columns[: int(0.6 * len(columns))]).sum())
        places[-1] /= hits[:, : int(0.6 * len(columns))].sum()
    assert places[0] < places[1] < places[2]


def test_nothing_is_replaced_unasked(discs, capsys, tmp_path):
    for name in ("table.csv", "map.png", "who.tif", "folder"):
        target = tmp_path / name
        compared(capsys, *discs, "-o", target)
        assert main(["compare", *map(str, discs), "-o", str(target)]) == 2
        assert "exists already" in capsys.readouterr().err
        compared(capsys, *discs, "-o", target, "--overwrite")
    assert not [path for path in tmp_path.rglob(".*") if path.name != ".mpmgis"]
    folder = tmp_path / "folder"  # carries the mark of what mpmgis may replace
    arguments = ["compare", str(folder / "classes.tif"), str(discs[0]), "--overwrite", "-o"]
    assert main([*arguments, str(folder)]) == 2 and (folder / "classes.tif").is_file()
    assert "and would be replaced; give another" in capsys.readouterr().err
    (folder / "way.csv").write_text("a line of the user's, kept beside the comparison")
    assert main(["compare", *map(str, discs), "--line", str(folder / "way.csv"), "--overwrite", "-o", str(folder)]) == 2
    assert "way.csv and would be replaced" in capsys.readouterr().err and (folder / "way.csv").is_file()
    assert {band.name for band in folder.iterdir()} >= {"map.png", "table.csv", "classes.tif"}
    with rasterio.open(tmp_path / "who.tif") as one, rasterio.open(folder / "classes.tif") as other:
        assert np.array_equal(one.read(), other.read(), equal_nan=True)


# ------------------------------------------------------------------------------------------------------------ refusals


def bad_cases(tmp_path, first, second):
    """Name -> (arguments, words of the refusal)."""
    grid = grid_of()
    dry = write_peak(tmp_path / "dry.tif", np.zeros(grid.shape), grid)
    other_crs = write_peak(
        tmp_path / "zone33.tif", disc(grid, 200, 200), Grid(pyproj.CRS.from_epsg(32633), grid.transform, grid.shape)
    )
    degrees = write_peak(
        tmp_path / "degrees.tif", np.ones((9, 9)), Grid.north_up(pyproj.CRS.from_epsg(4326), 10, 46, 1e-4, (9, 9))
    )
    far = grid_of(west=WEST + 5000, crs=None)
    away = write_peak(tmp_path / "away.tif", np.ones(far.shape), far)
    feet = write_peak(tmp_path / "feet.tif", disc(grid, 200, 200), grid, "h_max", "ft")
    nameless = tmp_path / "nameless.tif"
    place = {"crs": grid.crs.to_wkt(), "transform": grid.transform, "width": 9, "height": 9}
    with rasterio.open(nameless, "w", driver="GTiff", count=2, dtype="float32", **place) as target:
        target.write(np.ones((2, 9, 9), "float32"))
    cut = tmp_path / "cut.tif"
    cut.write_bytes(first.read_bytes()[:3000])
    (tmp_path / "empty").mkdir()
    (tmp_path / "frame.h5").write_bytes(b"x")
    path = write_shapes(tmp_path / "line.gpkg", shapely.LineString([(0, 0), (400, 0)]))
    two = write_shapes(
        tmp_path / "two.gpkg", shapely.LineString([(0, 0), (9, 0)]), shapely.LineString([(0, 9), (9, 9)])
    )
    area = write_shapes(tmp_path / "area.gpkg", shapely.box(100, 100, 200, 200))
    sliver = write_shapes(tmp_path / "sliver.gpkg", shapely.box(100.1, 100.1, 100.4, 100.4))
    return {
        "no such file": ((first, tmp_path / "none.tif"), "no such file"),
        "an empty folder": ((first, tmp_path / "empty"), "contains no result: expected an export"),
        "two outlines": ((area, area), "both outlines"),
        "lines as outline": ((first, path), "expected polygons"),
        "an outline as line": ((first, second, "--line", area), "expected lines"),
        "a line elsewhere": ((first, second, "--line", path), "is 141 m away from the flow"),
        "two lines": ((first, second, "--line", two), "2 lines that do not join"),
        "an outline smaller than a cell": ((first, sliver), "contains no cell centre at a cell size of 2 m"),
        "another CRS": ((first, other_crs), "is in EPSG:32633, the other rasters in EPSG:32632; reproject"),
        "degrees": ((degrees, first), "mpmgis needs metres"),
        "another place": ((first, away), "do not overlap, and not both have a CRS"),
        "another unit": ((first, feet), "h_max is in m in first, h_max in ft in feet"),
        "bands without names": ((first, nameless), "2 bands without names"),
        "a raster cut short": ((cut, first), "truncated"),
        "no flow at all": ((dry, dry), "no cell of either is above --threshold 0.1"),
        "a band that is not there": ((first, second, "--band", "pft"), "use --band with one of h_max"),
        "one frame": ((first, tmp_path / "frame.h5"), "is one frame; give the folder of the run"),
        "a DTM in another CRS": ((first, second, "--dem", other_crs), "--to-crs auto"),
        "a DTM that is not there": ((first, second, "--dem", tmp_path / "no.tif"), "no such file"),
        "an output of unknown kind": ((first, second, "-o", tmp_path / "out.xlsx"), "expected .png"),
        "a negative threshold": ((first, second, "--threshold", "-1"), "a number of at least 0"),
        "a threshold that is no number": ((first, second, "--threshold", "thick"), "expected a number"),
    }


def test_bad_inputs_cost_one_line_and_leave_nothing(discs, capsys, tmp_path):
    for case, (arguments, words) in bad_cases(tmp_path, *discs).items():
        before = sorted(tmp_path.rglob("*"))
        output = () if "-o" in arguments else ("-o", tmp_path / "out")
        try:
            code = main(["compare", *map(str, (*arguments, *output))])
        except SystemExit as stop:  # as the parser of the command line leaves
            code = stop.code
        out, said = capsys.readouterr()
        assert code == 2 and out == "", case
        assert said.count("\n") == 1 and words in said, (case, said)
        assert sorted(tmp_path.rglob("*")) == before, case


# ------------------------------------------------------------------------------------------------------ against others


@pytest.mark.thorough
@needs_iseesnow
def test_runout_and_area_of_twelve_codes_are_those_published(capsys):
    """ISeeSnow's ensemble.csv: runout where it is faster than 1 m/s along its path, area above 0.1 m, peaks."""
    with open(ISEESNOW / "ensemble.csv", newline="", encoding="utf-8") as file:
        published = list(csv.DictReader(file))
    assert len(published) == 12
    median, path = ISEESNOW / "ensemble_median", ISEESNOW / "LINES/path_aimec.shp"
    for row in published:
        code = ISEESNOW / "reference" / row["model"]
        fast, _ = compared(capsys, code, median, "--band", "pfv", "--threshold", 1, "--line", path)
        thick, _ = compared(capsys, code, median)
        farthest = fast["a"]["farthest_along_line_m"]
        assert farthest == pytest.approx(float(row["runout_s_pfv_gt_1_m"]), abs=0.1), row["model"]
        assert thick["a"]["area_m2"] / 1e4 == pytest.approx(float(row["area_pft_gt_0p1_ha"]), abs=0.011)
        peaks = {band["a"]: band["peak_a"] for band in thick["bands"]}
        assert peaks["pft"] == pytest.approx(float(row["max_pft_m"]), abs=0.006)
        assert peaks["pfv"] == pytest.approx(float(row["max_pfv_ms"]), abs=0.006)


SCENE = """
[terrain]
dem = "{data}/dem.tif"
crs = "local"
[release]
source = "{data}/release.shp"
thickness = 1.5
density = 200
[friction]
law = "Voellmy"
mu = 0.4
xi = 2000
[numerics]
cell_size = 5.0
[output]
end_time = 400
frame_interval = 5
maxima = true
"""


@pytest.mark.slow
@needs_iseesnow
def test_our_own_export_lies_within_the_ensemble(capsys, tmp_path):
    """Run, export under ISeeSnow's names, compare: the whole workflow as a user would type it."""
    (tmp_path / "scene.toml").write_text(SCENE.format(data=ISEESNOW.resolve()))
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run"), "--yes", "-q"]) == 0
    frames = sorted(map(str, (tmp_path / "run").glob("frame_*.h5")))
    assert main(["export-raster", *frames, "--naming", "iseesnow", "--no-qgis", "-q"]) == 0
    capsys.readouterr()
    ours, median = tmp_path / "run_gis", ISEESNOW / "ensemble_median"
    thick, _ = compared(capsys, ours, median, "-o", tmp_path / "map.png")
    assert thick["a"]["band"] == thick["b"]["band"] == "pft" and (tmp_path / "map.png").is_file()
    assert thick["iou"] >= 0.95
    assert 18e4 <= thick["a"]["area_m2"] <= 27e4
    path = ISEESNOW / "LINES/path_aimec.shp"
    fast, _ = compared(capsys, ours, median, "--band", "pfv", "--threshold", 1, "--line", path)
    assert 2290 <= fast["a"]["farthest_along_line_m"] <= 2425
    assert 34 <= next(band["peak_a"] for band in fast["bands"] if band["a"] == "pfv") <= 42


@pytest.mark.parametrize("swap", [False, True])
def test_an_observed_outline_reports_what_is_over_and_underestimated_and_how_far_apart(tmp_path, capsys, swap):
    grid = grid_of()
    result = write_peak(tmp_path / "deposit.tif", disc(grid, 150, 200), grid)
    circles = [shapely.Point(x, 200).buffer(60, 256) for x in (150, 190)]
    outline = write_shapes(tmp_path / "mapped.gpkg", circles[1], crs="EPSG:4326")
    line = write_shapes(tmp_path / "line.gpkg", shapely.LineString([(50, 200), (390, 200)]))
    sides = (outline, result) if swap else (result, outline)
    facts, said = compared(capsys, *sides, "--line", line)
    lens = circles[0].intersection(circles[1]).area
    only_result, only_outline = ("b", "a") if swap else ("a", "b")
    assert "reprojected" in said and facts["observed"] == only_outline
    assert facts["both_m2"] == pytest.approx(lens, rel=0.01)
    assert facts[f"only_{only_result}_m2"] == pytest.approx(circles[0].area - lens, rel=0.02)
    assert facts[f"only_{only_outline}_m2"] == pytest.approx(circles[1].area - lens, rel=0.02)
    assert facts["iou"] == pytest.approx(lens / (2 * circles[0].area - lens), rel=0.01)
    assert facts["observed_reached"] == pytest.approx(lens / circles[1].area, rel=0.01)
    ahead = facts[only_outline]["farthest_along_line_m"] - facts[only_result]["farthest_along_line_m"]
    assert ahead == pytest.approx(40, abs=2)
    distances = facts["outline_distance_m"]
    assert distances["largest"] == pytest.approx(40, abs=2)
    angle = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    apart = abs(np.sqrt(60**2 + 40**2 - 2 * 60 * 40 * np.cos(angle)) - 60)  # from one circle to the other
    assert distances["mean"] == pytest.approx(apart.mean(), abs=1) and distances["mean"] < distances["high"] <= 40 + 2
    assert main(["compare", *map(str, sides), "--line", str(line)]) == 0
    shown = capsys.readouterr().out
    assert f"overestimated, only {only_result.upper()} [ha]" in shown and "of the outline reached" in shown
    assert f"underestimated, only {only_outline.upper()} [ha]" in shown and "largest (Hausdorff) [m]" in shown


def test_two_results_are_neither_over_nor_underestimated(discs, capsys):
    facts, _ = compared(capsys, *discs)
    assert facts["observed"] is None and facts["observed_reached"] is None
    assert facts["outline_distance_m"]["largest"] == pytest.approx(50, abs=2)
