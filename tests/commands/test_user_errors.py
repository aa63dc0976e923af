"""Wrong turns of a first hour with mpmgis, each answered with the fix of the place where it was taken."""

import json

import pytest
import shapely
from slope_site import COLUMNS, PIXEL, ROWS, SCENE, SOUTH, WEST, refused, run, write_raster, write_shapes, write_site

from mpmgis.commands.shell.main import main
from mpmgis.simulation.scene_run import run as run_scene
from mpmgis.system.messages import collected

EAST, NORTH = WEST + PIXEL * COLUMNS, SOUTH + PIXEL * ROWS
SHORT = SCENE.replace("end_time = 30", "end_time = 1").replace("frame_interval = 5", "frame_interval = 1")


@pytest.fixture
def site(tmp_path):
    return write_site(tmp_path)


def with_window(*window):
    return SHORT.replace('"dtm.tif"', f'"dtm.tif"\nwindow = {list(window)}')


def swap(old, new):
    return SCENE.replace(old, new)


SCENES = {  # scene, what the line says
    "no thickness": (swap("thickness = 2.0\n", ""), "or thickness in the table of the scene"),
    "words without quotes": (swap('"Voellmy"', "Voellmy"), 'put words in "quotes"'),
    "cells too large": (
        swap("cell_size = 10.0", "cell_size = 1e6"),
        "scene.toml: [numerics] cell_size = 1e+06 m leaves 0 x 0 cells",
    ),
    "cells too small": (
        swap("cell_size = 10.0", "cell_size = 1e-300"),
        "cell_size = 1e-300 m makes 8e+302 x 4e+302 cells",
    ),
    "window elsewhere": (with_window(1, 2, 3, 4), "scene.toml: [terrain] window = [1, 2, 3, 4] does not"),
    "CRS beside that of the DTM": (
        swap('"dtm.tif"', '"dtm.tif"\ncrs = "EPSG:32633"'),
        'crs = "EPSG:32633" is only for a DTM without a CRS; omit [terrain] crs, or correct',
    ),
    "CRS of no code": (swap('"dtm.tif"', '"dtm.tif"\ncrs = "utm"'), "[terrain] crs got 'utm'"),
    "key misspelt": (
        f'solvr = "columns"\n{SCENE}',
        "scene.toml: unknown key 'solvr' (did you mean 'solver'?); before the first table",
    ),
    "table misspelt": (SCENE + "[materal]\n", "unknown table [materal] (did you mean 'material'?)"),
}


@pytest.mark.parametrize("case", SCENES)
def test_a_wrong_scene_is_cured_in_the_scene(site, capsys, case):
    """The line names the file and its key, and is short."""
    scene, words = SCENES[case]
    said = refused(site, capsys, scene)
    assert words in said and len(said.replace(str(site), "")) < 400


def test_a_number_with_two_points_needs_no_quotes(site, capsys):
    assert "put words" not in refused(site, capsys, swap("mu = 0.2", "mu = 0.2.1"))


def test_a_mask_without_thickness_is_cured_in_the_scene(site, capsys):
    inside = [[float(10 < row < 20 and 8 < column < 16) for column in range(COLUMNS)] for row in range(ROWS)]
    write_raster(site / "mask.tif", inside)
    scene = SCENE.replace("release.geojson", "mask.tif").replace("thickness = 2.0\n", "")
    assert "or thickness in the table of the scene" in refused(site, capsys, scene)


def test_map_coordinates_in_a_geojson_without_a_crs(site, capsys):
    table = json.loads((site / "release.geojson").read_text())
    del table["crs"]
    (site / "release.geojson").write_text(json.dumps(table))
    assert "GeoJSON without a CRS is in degrees" in refused(site, capsys, SCENE)
    write_shapes(site / "release.geojson", [shapely.box(60, 150, 160, 250)], crs="EPSG:4326")
    assert run(site, SHORT) == 0


def test_a_window_in_the_order_of_qgis(site, capsys):
    """xmin, xmax, ymin, ymax takes the whole DTM in: nothing else would tell."""
    assert run(site, with_window(WEST, EAST, SOUTH, NORTH)) == 0
    assert "window = [west, south, east, north] extends beyond the DTM to the south, east" in capsys.readouterr().err
    assert run(site, with_window(WEST, SOUTH, EAST - 5 * PIXEL, NORTH)) == 0
    assert "beyond the DTM" not in capsys.readouterr().err


def test_the_error_of_a_wrong_file_names_the_right_one(site, capsys):
    assert main(["run", str(site)]) == 2
    assert "is a folder, expected a text file; name the file in it" in capsys.readouterr().err
    assert main(["runout", str(site / "dtm.tif")]) == 2
    assert "give the folder of a run, its frame_*.h5" in capsys.readouterr().err


def test_an_export_reports_what_to_open(site, capsys):
    assert run(site, SHORT) == 0
    assert main(["export-raster", str(site / "results")]) == 0
    out, err = capsys.readouterr()
    assert err.splitlines()[-1].startswith(f"open {site / 'results_gis' / 'results.qgz'} in QGIS")
    assert "open " not in out
    assert main(["export-raster", str(site / "results"), "--no-qgis", "--overwrite"]) == 0
    assert "in QGIS" not in capsys.readouterr().err


def test_the_fix_for_degrees_is_shown_whole(tmp_path, capsys):
    write_raster(tmp_path / "degrees.tif", [[0.0] * COLUMNS] * ROWS, crs="EPSG:4326")
    assert main(["info", str(tmp_path / "degrees.tif")]) == 0
    shown = next(line for line in capsys.readouterr().out.splitlines() if "as terrain" in line)
    assert not shown.endswith("...")


def test_a_scene_over_a_dtm_without_a_crs_is_cured_in_the_scene(site, capsys):
    write_raster(site / "bare.tif", [[100.0] * COLUMNS] * ROWS, crs=None)
    assert 'give [terrain] crs = "EPSG:n"' in refused(site, capsys, SCENE.replace("dtm.tif", "bare.tif"))


@pytest.mark.parametrize("suffix", ["geojson", "gpkg", "tif"])
def test_a_dtm_without_a_crs_is_refused_with_that_of_the_release_on_it(site, capsys, suffix):
    write_raster(site / "bare.tif", [[100.0] * COLUMNS] * ROWS, crs=None)
    if suffix == "tif":
        inside = [[float(10 < row < 20 and 8 < column < 16) for column in range(COLUMNS)] for row in range(ROWS)]
        write_raster(site / "on_it.tif", inside)
    else:
        write_shapes(site / f"on_it.{suffix}", [shapely.box(60, 150, 160, 250)], crs="EPSG:32632")
    words = ["seed", "--dem", str(site / "bare.tif"), "--release", str(site / f"on_it.{suffix}")]
    assert main([*words, "--thickness", "1"]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.endswith(f"on_it.{suffix} overlaps it and is in EPSG:32632: if the DTM is too, give --crs EPSG:32632")
    scene = SCENE.replace("dtm.tif", "bare.tif").replace("release.geojson", f"on_it.{suffix}")
    assert refused(site, capsys, scene).endswith('if the DTM is too, give [terrain] crs = "EPSG:32632"')
    assert main([*words, "--thickness", "1", "--crs", "EPSG:32632", "-o", str(site / "a.h5")]) == 0


@pytest.mark.parametrize(
    ("crs", "east"),
    [("EPSG:4326", 0.0), ("EPSG:32632", 5e4), ("missing", 0.0)],
    ids=["degrees", "elsewhere", "no file"],
)
def test_no_crs_is_proposed_that_cannot_be_the_dtms(site, capsys, crs, east):
    write_raster(site / "bare.tif", [[100.0] * COLUMNS] * ROWS, crs=None)
    path = site / "on_it.gpkg"
    if crs != "missing":
        write_shapes(path, [shapely.box(60 + east, 150, 160 + east, 250)], crs=crs)
    assert main(["seed", "--dem", str(site / "bare.tif"), "--release", str(path), "--thickness", "1"]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.endswith("--crs local for metres without a georeference")


def test_a_flow_that_leaves_the_terrain_reports_what_that_means(site, capsys):
    words = "use a larger DTM or [terrain] window"
    small = SCENE.replace('"dtm.tif"', f'"dtm.tif"\nwindow = [{WEST}, {SOUTH}, {WEST + 200}, {NORTH}]')
    assert run(site, small) == 0
    assert words in capsys.readouterr().err
    assert run(site, SHORT) == 0
    assert words not in capsys.readouterr().err


def test_an_unknown_option_names_the_verb_and_the_option_that_was_meant(capsys):
    for word, meant in (("--thicknes-mode=normal", "; did you mean --thickness-mode?"), ("--bogus", "")):
        with pytest.raises(SystemExit) as ended:
            main(["seed", "--dem", "d.tif", "--release", "r.shp", word])
        expected = f"mpmgis seed: unrecognized arguments: {word}{meant}; see mpmgis seed --help\n"
        assert ended.value.code == 2 and capsys.readouterr().err == expected


def test_a_template_takes_no_scene_and_no_output(tmp_path, capsys):
    """A file named by -o was never written, and nothing told."""
    for more in (["-o", str(tmp_path / "scene.toml")], [str(tmp_path / "scene.toml")]):
        assert main(["run", "--template", *more]) == 2
        out, err = capsys.readouterr()
        assert out == "" and "mpmgis run --template > scene.toml" in err


def test_a_missing_scene_is_reported_before_a_folder_that_is_there(site, capsys):
    (site / "results").mkdir()
    (site / "results" / "frame_000000.h5").write_bytes(b"")
    assert main(["run", str(site / "nosuch.toml")]) == 2
    assert "nosuch.toml: no such file" in capsys.readouterr().err


def test_metres_that_are_called_degrees_are_not_to_be_warped(site, capsys):
    write_raster(site / "bare.tif", [[100.0] * COLUMNS] * ROWS, crs=None)
    words = ["seed", "--dem", str(site / "bare.tif"), "--crs", "EPSG:4326", "--release", str(site / "release.geojson")]
    assert main([*words, "--thickness", "1", "-o", str(site / "a.h5")]) == 2
    err = capsys.readouterr().err
    assert "are not degrees; give the projection of the coordinates: --crs EPSG:n" in err and "warp" not in err


def test_georeferenced_frames_and_a_local_dtm(site, capsys):
    write_raster(site / "bare.tif", [[100.0] * COLUMNS] * ROWS, crs=None)
    assert run(site, SHORT) == 0
    capsys.readouterr()
    assert main(["export-raster", str(site / "results"), "--dem", str(site / "bare.tif"), "--crs", "local"]) == 2
    err = capsys.readouterr().err
    assert "or declare the CRS of this one: --crs EPSG:" in err and "warp" not in err


def test_an_interrupted_run_prints_the_command_to_continue(site):
    (site / "scene.toml").write_text(SHORT)

    def stop(now, end_time, left):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), collected() as told:
        run_scene(site / "scene.toml", watch=stop)
    assert (
        told[-1] == f"{site / 'results'} contains the results until now; "
        "`resume` continues after its last complete frame"
    )


def test_a_name_of_thousands_of_letters_is_shortened(site, capsys):
    assert main(["seed", "--dem", "x" * 5000, "--release", "area.shp"]) == 2
    said = capsys.readouterr().err
    assert "File name too long" in said and "xxx..." in said and len(said) < 200
