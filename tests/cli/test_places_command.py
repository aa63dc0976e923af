"""What a scene knows by place, from files to results: friction zones, barriers, erodible ground, lakes, cliffs."""

import csv
import json

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine

from mpmgis.cli.main import main
from mpmgis.io.frames import read_frame

WEST, SOUTH, PIXEL, COLUMNS, ROWS = 400_000.0, 5_100_000.0, 10.0, 80, 40
FOOT = 400.0  # [m] where the slope ends

SCENE = """
[terrain]
dem = "dtm.tif"
[release]
source = "release.geojson"
thickness = 2.0
density = 1000
[friction]
law = "Voellmy"
mu = 0.2
xi = 1000
[numerics]
cell_size = 10.0
particles_per_cell = 4
[output]
end_time = 30
frame_interval = 5
"""


def write_raster(path, values, crs="EPSG:32632", nodata=-9999.0):
    """A raster on the site's pixels."""
    profile = {"driver": "GTiff", "height": ROWS, "width": COLUMNS, "count": 1, "dtype": "float64", "crs": crs,
               "transform": Affine(PIXEL, 0, WEST, 0, -PIXEL, SOUTH + ROWS * PIXEL), "nodata": nodata}  # fmt: skip
    with rasterio.open(path, "w", **profile) as target:
        target.write(np.where(np.isfinite(values), values, nodata), 1)


def write_shapes(path, shapes, crs="EPSG:32632", **columns):
    """Features given from the site's corner, in map coordinates."""
    moved = [shapely.transform(shape, lambda p: p + [WEST, SOUTH]) for shape in shapes]
    table = geopandas.GeoDataFrame(columns, geometry=moved, crs="EPSG:32632")
    table.to_crs(crs).to_file(path)


def distances():
    """(x, y) of pixel centres from the site's corner [m]."""
    x, y = (np.arange(COLUMNS) + 0.5) * PIXEL, (ROWS - np.arange(ROWS) - 0.5) * PIXEL
    return np.meshgrid(x, y)


@pytest.fixture
def site(tmp_path):
    """A slope of 27 degrees that runs out on level ground."""
    x, _ = distances()
    write_raster(tmp_path / "dtm.tif", np.maximum(0.5 * (FOOT - x), 0.0) + 100.0)
    write_shapes(tmp_path / "release.geojson", [shapely.box(60, 150, 160, 250)])
    return tmp_path


def run(site, scene, *options):
    """Exit code of `mpmgis run` on `scene`."""
    (site / "scene.toml").write_text(scene)
    return main(["run", str(site / "scene.toml"), "--overwrite", *options])


def refused(site, capsys, scene):
    """The line with which `scene` is refused, before anything is written."""
    assert run(site, scene) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mpmgis")]
    assert not (site / "results").exists()
    assert len(lines) == 1
    return lines[0]


def record(site):
    return json.loads((site / "results" / "run.json").read_text())


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
    assert state_of(site, "zones")[:2] == ("on", "auto")
    assert centre(site) < plain - 5.0
    assert run(site, SCENE + '[[zones]]\nsource = "zones.gpkg"\nmu = 0.2\n') == 0
    assert state_of(site, "zones") == ("off", "auto", 0.0)
    assert centre(site) == plain
