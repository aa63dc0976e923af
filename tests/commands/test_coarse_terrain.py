"""Products of a run with finer cells than its DTM: by default on the cells of the run."""

import json

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from slope_site import FOOT, SCENE, SOUTH, WEST, run, write_shapes, write_site

from mpmgis.commands.shell.main import main

COARSE = 80.0


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The slope of the site in cells of 80 m; a run on cells of 10 m."""
    folder = write_site(tmp_path_factory.mktemp("coarse"))
    rows, columns = 5, 10
    x = (np.arange(columns) + 0.5) * COARSE
    heights = np.tile(np.maximum(0.5 * (FOOT - x), 0.0) + 100.0, (rows, 1))
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": "float64"}
    place = {"crs": "EPSG:32632", "transform": Affine(COARSE, 0, WEST, 0, -COARSE, SOUTH + rows * COARSE)}
    with rasterio.open(folder / "dtm.tif", "w", **profile, **place) as file:
        file.write(heights, 1)
    write_shapes(folder / "release.geojson", [shapely.box(60, 150, 160, 250)])
    assert run(folder, SCENE, "-q") == 0
    return folder


def facts(capsys, *arguments):
    capsys.readouterr()
    assert main([str(word) for word in arguments]) == 0
    return capsys.readouterr()


def test_runout_by_default_is_that_on_the_cells_of_the_run(site, capsys):
    out, said = facts(capsys, "runout", site / "results", "--json", "-o", site / "a")
    fine, _ = facts(capsys, "runout", site / "results", "--json", "--cs-e", 10, "-o", site / "b")
    assert json.loads(out) == json.loads(fine) | {"files": json.loads(out)["files"]}
    assert "cells of 10 m, as the run has; those of the DTM are 80 m" in said
    coarse, said = facts(capsys, "runout", site / "results", "--json", "--cs-e", COARSE, "-o", site / "c")
    assert "cells of 80 m are coarser than those of the run, 10 m" in said
    assert abs(json.loads(coarse)["runout_m"] - json.loads(out)["runout_m"]) > 5.0


@pytest.mark.parametrize("size", [None, 10, 20])
def test_an_export_has_the_cells_of_the_run(site, capsys, size):
    out = site / f"gis{size}"
    _, said = facts(
        capsys, "export-raster", site / "results", "--no-qgis", "-o", out, *([] if size is None else ["--cs-e", size])
    )
    (path,) = out.glob("rasters/*_max.tif")
    with rasterio.open(path) as file:
        assert file.res == (size or 10, size or 10)
    assert ("coarser than those of the run" in said) == (size == 20)


def test_hazard_map_and_intensity(site, capsys):
    guideline = ["--map", "swiss-debris-flow", "--scenario", f"100={site / 'results'}"]
    _, said = facts(capsys, "report", *guideline, "-o", site / "map")
    with rasterio.open(site / "map" / "hazard.tif") as file:
        assert file.res == (10, 10)
    assert "not assessed" not in said
    _, said = facts(capsys, "report", *guideline, "-o", site / "map80", "--cs-e", COARSE, "--scale", "1:5000")
    assert "coarser than those of the run" in said and "16 mm wide at 1:5000, more than 2 mm" in said
    facts(capsys, "intensity", site / "results", "--guideline", "swiss-debris-flow", "-o", site / "intensity")
    with rasterio.open(site / "intensity" / "intensity.tif") as file:
        assert file.res == (10, 10)


def test_rasters_written_by_the_run_have_its_cells(site, capsys):
    scene = SCENE.replace("end_time = 30", "end_time = 5\nrasters = true")
    (site / "rasters.toml").write_text(scene)
    facts(capsys, "run", site / "rasters.toml", "-o", site / "with_rasters", "-q")
    (path,) = (site / "with_rasters").glob("maps/rasters/*_max.tif")
    with rasterio.open(path) as file:
        assert file.res == (10, 10)


def test_a_release_of_few_cells_is_told(site, capsys):
    (site / "scene80.toml").write_text(
        SCENE.replace("cell_size = 10.0", "cell_size = 40.0").replace("_cell = 4", "_cell = 16")
    )
    _, said = facts(capsys, "effects", site / "scene80.toml", "-v")
    assert "only 2.5 cells are across the release" in said
