"""The same files in cells of 4 mm and of 1 m, at coordinates of a UTM zone, run and export alike."""

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine

from mpmgis.commands.shell.main import main
from mpmgis.simulation.preparation import prepare

EAST, NORTH, ROWS, COLUMNS = 500_000.0, 5_100_000.0, 4, 40
MATERIAL = '[material]\nlaw = "DruckerPrager"\nbulk_modulus = {bulk}\nshear_modulus = {shear}\nfriction_angle = 35\n'
SCENE = """solver = "{solver}"
[terrain]
dem = "dtm.tif"
[release]
source = "block.gpkg"
thickness = {thickness}
density = 1500
{material}[friction]
law = "Coulomb"
mu = 0.3
[numerics]
cell_size = {cell}
[output]
end_time = {end}
frame_interval = {end}
"""


def laboratory(folder, cell, solver):
    """A slab on a strip of terrain as wide as itself, in cells of `cell` [m], as files; the scene's path."""
    folder.mkdir(exist_ok=True)
    height = (3.0 + 0.5 * np.tile(COLUMNS - 0.5 - np.arange(COLUMNS), (ROWS, 1))) * cell
    profile = {
        "driver": "GTiff",
        "height": ROWS,
        "width": COLUMNS,
        "count": 1,
        "dtype": "float64",
        "crs": "EPSG:32632",
        "transform": Affine(cell, 0, EAST, 0, -cell, NORTH + ROWS * cell),
    }
    with rasterio.open(folder / "dtm.tif", "w", **profile) as target:
        target.write(height, 1)
    slab = shapely.box(EAST + 4 * cell, NORTH, EAST + 14 * cell, NORTH + ROWS * cell)
    geopandas.GeoDataFrame({"a": [1]}, geometry=[slab], crs="EPSG:32632").to_file(folder / "block.gpkg")
    bulk = 900 * 1500 * 9.81 * cell
    scene = SCENE.format(
        solver=solver,
        thickness=4 * cell,
        cell=cell,
        end=0.4 * cell**0.5,
        material=MATERIAL.format(bulk=bulk, shear=0.6 * bulk) if solver == "points" else "",
    )
    path = folder / f"{solver}.toml"
    path.write_text(scene)
    return path


def exported(folder, cell, solver):
    """(particles at the start, depth in every cell at the end, in cells)."""
    scene = laboratory(folder, cell, solver)
    frames, maps = folder / f"out_{solver}", folder / f"maps_{solver}"
    assert main(["run", str(scene), "-o", str(frames)]) == 0
    files = sorted(map(str, frames.glob("frame_*.h5")))
    assert main(["export-raster", *files, "--min-depth", str(0.05 * cell), "-o", str(maps)]) == 0
    with rasterio.open(maps / "rasters" / f"out_{solver}_0001.tif") as source:
        depth = source.read(1, masked=True).filled(0.0)
    return len(prepare(scene).frame.particles), depth / cell


@pytest.mark.thorough
@pytest.mark.parametrize("solver", ["columns", "points"])
def test_files_of_four_millimetres_run_and_export_as_those_of_a_metre(tmp_path, solver):
    (small, depth), (count, expected) = (exported(tmp_path / f"{cell:g}", cell, solver) for cell in (0.004, 1.0))
    assert small == count == {"columns": 360, "points": 1440}[solver]
    assert expected.max() > 2.0
    np.testing.assert_allclose(depth, expected, atol=5e-3)  # rounding grows in a collapse of points
