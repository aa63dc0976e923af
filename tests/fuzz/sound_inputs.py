"""Sound files of every kind that mpmgis reads, small, as the fuzzer damages them."""

import os
import sys
from pathlib import Path

import geopandas
import numpy as np
import rasterio
import shapely
from affine import Affine

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "exchange"))

import third_party_writers as writers

from mpmgis.commands.shell.main import main

WEST, SOUTH, PIXEL, ROWS, COLUMNS = 400_000.0, 5_100_000.0, 10.0, 24, 40
CRS = "EPSG:32632"
TIFFS = {  # name -> how GDAL lays it out: strips and tiles, plain and packed, every kind of number
    "dtm.tif": {"dtype": "float64"},
    "tiled.tif": {"dtype": "float32", "tiled": True, "blockxsize": 16, "blockysize": 16, "compress": "deflate"},
    "packed.tif": {"dtype": "float32", "compress": "lzw", "predictor": 3},
    "whole.tif": {"dtype": "int16", "compress": "packbits"},
    "big.tif": {"dtype": "float64", "BIGTIFF": "YES", "compress": "zstd"},
}
VECTORS = {"release.shp": "ESRI Shapefile", "release.gpkg": "GPKG", "release.geojson": "GeoJSON"}
HYDROGRAPH = "time,discharge,speed\n0,0,5\n2,40,5\n6,10,5\n9,0,5\n"
SCENE = """\
solver = "columns"
[terrain]
dem = "dtm.tif"
window = [400000, 5100000, 400400, 5100240]
[release]
source = "release.shp"
thickness = "d0"
density = 1000
velocity = [0.0, 0.0]
points = "staggered"
seed = 1
[friction]
law = "Voellmy"
mu = 0.2
xi = 1000
[cohesion]
yield_stress = 200
[[zones]]
source = "release.gpkg"
mu = 0.3
[[barrier]]
source = "wall.gpkg"
height = 4.0
width = 12.0
name = "wall"
[numerics]
cell_size = 10.0
particles_per_cell = 4
cfl = 0.3
edges = "open"
[output]
end_time = 2.0
frame_interval = 0.5
maxima = true
"""
INFLOW = (
    SCENE[: SCENE.index("[release]")]
    + """\
[hydrograph]
source = "release.gpkg"
file = "inflow.csv"
density = 1000
[numerics]
cell_size = 10.0
[output]
end_time = 10
frame_interval = 5
"""
)
POINTS = """\
solver = "points"
[terrain]
dem = "dtm.tif"
[release]
source = "release.gpkg"
thickness = 6.0
density = 1500
[material]
law = "DruckerPrager"
bulk_modulus = 4e6
shear_modulus = 2e6
friction_angle = 35
[friction]
law = "Coulomb"
mu = 0.3
[softening]
residual_friction_angle = 20
[numerics]
cell_size = 5.0
[output]
end_time = 0.2
frame_interval = 0.1
"""
OF_FRAME = (
    SCENE[: SCENE.index("[release]")]
    + """\
[release]
particles = "seed.h5"
[numerics]
cell_size = 10.0
[output]
end_time = 2
frame_interval = 1
"""
)
PLAIN = (
    SCENE[: SCENE.index("[cohesion]")].replace("xi = 1000", 'xi = 1000\nuse = "on"')
    + """\
[curvature]
use = "off"
[numerics]
cell_size = 10.0
[output]
end_time = 2
frame_interval = 0.5
"""
)
STAGES = (
    POINTS[POINTS.index("[terrain]") :].replace("end_time = 0.2", "end_time = 3")
    + """\
[[stage]]
solver = "columns"
until = {time = 1}
[[stage]]
solver = "points"
cell_size = 5.0
until = {time = 1.5, calm = 1.0}
[[stage]]
solver = "columns"
"""
)
SCENES = {
    "scene.toml": SCENE,
    "inflow.toml": INFLOW,
    "points.toml": POINTS,
    "frame.toml": OF_FRAME,
    "plain.toml": PLAIN,
    "stages.toml": STAGES.replace("[softening]\nresidual_friction_angle = 20\n", ""),
}


FOREIGN = {  # other codes' files: folder -> (its writer, the files in it that are damaged)
    "cbgeo": (writers.write_cbgeo_pieces, ["particles-0_2-0500.h5", "mpm.json"]),
    "kratos": (writers.write_kratos_times, ["MPM_Material_0_0.5000000.vtk", "ProjectParameters.json"]),
    "gid": (writers.write_kratos_gid, ["slide.post.res", "slide.post.msh"]),
    "geotaichi": (writers.write_geotaichi, ["MPMParticle000001.npz"]),
    "anura3d": (writers.write_anura3d, ["slide_MPVector_001.vtk", "slide_MPScalar_001.vtk", "slide.CPS_001"]),
    "geomechanics": (writers.write_mpm_geomechanics, ["particles_2.vtu", "particleTimeSerie.pvd"]),
    "lammps": (writers.write_lammps, ["slide.lammpstrj"]),
    "zlib": (writers.vtk_writer(".vtu", "binary", packed=True), ["slide_1.vtu"]),
    "raw": (writers.vtk_writer(".vtp", "raw", header="UInt64"), ["slide_1.vtp"]),
    "legacy": (writers.write_legacy, ["slide_1.vtk"]),
    "ply": (writers.write_ply, ["slide_50.ply"]),
    "npz": (writers.write_npz, ["step1.npz"]),
    "hdf5": (writers.write_hdf5, ["step1.h5"]),
    "csv": (writers.csv_writer(), ["slide.csv"]),
    "parquet": (writers.write_parquet, ["slide.parquet"]),
}
GUIDELINES = """\
[swiss-flood]
title = "of our own"
source = "our office"
note = "none"
[[swiss-flood.class]]
name = "low"
colour = "#fff0a0"
when = [{}]
[[swiss-flood.class]]
name = "high"
colour = "#c1272d"
when = [{ h = 0.5, v = 1 }, { vh = 2, p = 3 }]
"""
SIDECAR = (
    '{"format": "mpmgis-georeference", "format_version": 1, "crs": "EPSG:32632", "origin": [400100, 5100100, 0], '
    '"axes": ["e", "n", "u"], "density": 1500, "dt": 0.01, "particle_volume": 0.5}'
)


def write_sound_inputs(folder):
    """Fill `folder`: terrains, releases, a wall, a hydrograph, scenes, a seed, points made of it, a run, and files of
    other codes."""
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) * PIXEL, (ROWS - np.arange(ROWS) - 0.5) * PIXEL)
    elevation = np.maximum(0.5 * (250.0 - x), 0.0) + 100.0 + 0.002 * (y - 120.0) ** 2
    for name, layout in TIFFS.items():
        _write_raster(folder / name, elevation, **layout)
    mask = np.zeros((ROWS, COLUMNS))
    mask[8:16, 4:12] = 1.5
    _write_raster(folder / "mask.tif", mask, dtype="float32")
    areas = [shapely.box(40, 80, 80, 160), shapely.Point(100, 120).buffer(18, 4)]
    for name, driver in VECTORS.items():
        _write_shapes(folder / name, areas, driver, d0=[1.0, 2.0], name=["upper", "lower"], number=[7, 8])
    _write_shapes(folder / "wall.gpkg", [shapely.LineString([(200, 60), (210, 180)])], "GPKG")
    _write_shapes(folder / "path.gpkg", [shapely.LineString([(30, 120), (380, 120)])], "GPKG")
    _write_shapes(
        folder / "places.geojson", [shapely.Point(60, 120), shapely.Point(100, 110)], "GeoJSON", name=["a", "b"]
    )
    (folder / "inflow.csv").write_text(HYDROGRAPH)
    (folder / "guidelines.toml").write_text(GUIDELINES)
    for name, text in SCENES.items():
        (folder / name).write_text(text)
    for name, (write, _) in FOREIGN.items():
        (folder / name).mkdir()
        write(folder / name)
        (folder / name / "georef.json").write_text(SIDECAR)
    before = os.getcwd()
    os.chdir(folder)
    try:
        _command("seed", "--dem", "dtm.tif", "--release", "release.shp", "--per-cell", "4", "-o", "seed.h5")
        _command("convert", "seed.h5", "--to", "points", "--spacing", "1", "-o", "points.h5")
        _command("run", "plain.toml", "-o", "results")
    finally:
        os.chdir(before)


def _command(*words):
    if main([*words, "-q"]) != 0:
        raise RuntimeError(f"mpmgis {' '.join(words)} failed on sound inputs")


def _write_raster(path, values, **layout):
    profile = {
        "driver": "GTiff",
        "height": ROWS,
        "width": COLUMNS,
        "count": 1,
        "crs": CRS,
        "nodata": -9999,
        "transform": Affine(PIXEL, 0, WEST, 0, -PIXEL, SOUTH + ROWS * PIXEL),
        **layout,
    }
    with rasterio.open(path, "w", **profile) as target:
        target.write(values.astype(profile["dtype"]), 1)
        target.update_tags(1, note="elevation")
        target.set_band_unit(1, "m")


def _write_shapes(path, shapes, driver, **columns):
    moved = [shapely.transform(shape, lambda p: p + np.array([WEST, SOUTH])) for shape in shapes]
    geopandas.GeoDataFrame(columns, geometry=moved, crs=CRS).to_file(path, driver=driver)
