"""A DTM in degrees through seed, run and export: `--to-crs`, and what the outputs say about it."""

import json

import numpy as np
import pytest
import rasterio
from affine import Affine

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame

SCENE = """
solver = "columns"
[terrain]
dem = "dtm.tif"
to_crs = "auto"
[release]
source = "release.json"
thickness = 1.0
[friction]
law = "Coulomb"
mu = 0.2
[output]
end_time = 0.4
frame_interval = 0.2
"""


@pytest.fixture
def site(tmp_path):
    """A slope of 0.3 in EPSG:4326 in feet of height, and a release in degrees."""
    step = 1e-4
    transform = Affine(step, 0, 9.0, 0, -step, 46.0)
    values = (1500.0 - 0.3 * 7.7 * np.arange(40.0) + np.zeros((40, 1))) / 0.3048
    profile = {"driver": "GTiff", "width": 40, "height": 40, "count": 1, "dtype": "float64", "crs": "EPSG:4326"}
    with rasterio.open(tmp_path / "dtm.tif", "w", transform=transform, **profile) as file:
        file.write(values, 1)
        file.units = ["ft"]
    ring = [[9.001, 45.999], [9.002, 45.999], [9.002, 45.998], [9.001, 45.998], [9.001, 45.999]]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {}, "geometry": geometry}
    collection = {"type": "FeatureCollection", "features": [feature]}
    (tmp_path / "release.json").write_text(json.dumps(collection))
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def test_a_run_writes_its_terrain_in_metres_and_reports_the_factor(site, capsys):
    assert main(["run", str(site / "scene.toml"), "-o", str(site / "results")]) == 0
    said = capsys.readouterr().err
    assert "reprojected from EPSG:4326 to EPSG:32632" in said and "converted from ft to metres" in said
    record = json.loads((site / "results" / "run.json").read_text())
    facts = record["terrain"]["reprojection"]
    assert facts["to_crs"] == "EPSG:32632" and facts["height_factor"] == 0.3048 and facts["resampled"]
    with rasterio.open(site / "results" / "terrain.tif") as file:
        assert file.crs.to_epsg() == 32632 and file.tags()["from_crs"] == "EPSG:4326"
        assert 1300 < np.nanmax(file.read(1)) < 1501
    assert main(["export-raster", str(site / "results"), "--no-qgis"]) == 0  # names the terrain in metres


def test_a_seed_remembers_how_its_dtm_came_to_metres(site, capsys):
    seed, export = site / "frames" / "seed.h5", site / "maps"
    seed.parent.mkdir()
    release = ["--release", str(site / "release.json"), "--thickness", "1", "-o", str(seed)]
    assert main(["seed", "--dem", str(site / "dtm.tif"), *release]) == 2
    assert "--to-crs auto" in capsys.readouterr().err
    assert main(["seed", "--dem", str(site / "dtm.tif"), "--to-crs", "auto", *release]) == 0
    assert read_frame(seed).header["to_crs"] == "EPSG:32632"
    assert main(["export-raster", str(seed), "--no-qgis", "-o", str(export)]) == 0
    with rasterio.open(next((export / "rasters").glob("*_max.tif"))) as file:
        assert file.crs.to_epsg() == 32632 and file.tags(ns="mpmgis")["dem_from_crs"] == "EPSG:4326"
    capsys.readouterr()
    again = ["export-raster", str(seed), "--no-qgis", "-o", str(site / "other"), "--dem", str(site / "dtm.tif")]
    assert main(again) == 2
    assert "--to-crs auto" in capsys.readouterr().err
    assert main([*again, "--to-crs", "EPSG:32633"]) == 2
    said = capsys.readouterr().err
    assert "is reprojected to EPSG:32633; leave --to-crs out, or give --to-crs auto" in said
    assert main([*again, "--to-crs", "auto"]) == 0


def test_a_wrong_target_is_one_line(site, capsys):
    with pytest.raises(SystemExit) as end:
        main(["seed", "--dem", "d.tif", "--release", "r.shp", "--to-crs", "utm"])
    assert end.value.code == 2
    assert "expected auto or EPSG:n" in capsys.readouterr().err


def test_a_scene_without_to_crs_names_its_key(site, capsys):
    scene = site / "scene.toml"
    scene.write_text(scene.read_text().replace('to_crs = "auto"\n', ""))
    assert main(["run", str(scene)]) == 2
    assert '[terrain] to_crs = "auto"' in capsys.readouterr().err
