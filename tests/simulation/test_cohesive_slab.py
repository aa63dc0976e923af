"""A cohesive slab in 3D: it slides as a block, or its ends fail as cuts do."""

import numpy as np
import pytest
import shapely
from chain import write_polygons, write_raster

from mpmgis.frames.frame_files import read_frame
from mpmgis.simulation.scene_run import run

WEST, NORTH, LENGTH, WIDTH = 400_000.0, 5_000_000.0, 60, 3
SLOPE, FRICTION, TIME = np.radians(26.0), np.radians(25.0), 4.0


def paths_of(folder, match, cohesion):
    """(place along the slab [1], path along the slope [m]) of the points of a slab 12 m long and 2 m thick."""
    x = np.arange(LENGTH) + 0.5
    ground = np.tile(1000.0 - x * np.tan(SLOPE), (WIDTH, 1))
    write_raster(folder / "dtm.tif", ground, WEST, NORTH, 1.0, "EPSG:32632")
    block = shapely.box(WEST + 10.0, NORTH - WIDTH, WEST + 22.0, NORTH)
    write_polygons(folder / "slab.gpkg", [block], "EPSG:32632")
    scene = {
        "solver": "points",
        "terrain": {"dem": str(folder / "dtm.tif")},
        "release": {"source": str(folder / "slab.gpkg"), "thickness": 2.0, "density": 1600.0},
        "material": {
            "law": "DruckerPrager",
            "bulk_modulus": 6.7e6,
            "shear_modulus": 4e6,
            "friction_angle": 30.0,
            "cohesion": cohesion,
            "match": match,
        },
        "friction": {"law": "Coulomb", "mu": float(np.tan(FRICTION))},
        "numerics": {"cell_size": 0.5, "stiffness": "scaled", "edges": "wall"},
        "output": {"end_time": TIME, "frame_interval": TIME, "stop_at_rest": False},
    }
    run(scene, folder / "results", threads=1)
    first, last = (read_frame(path) for path in sorted((folder / "results").glob("frame_*.h5")))
    east = [frame.map_xy()[0][np.argsort(frame.particles.id)] for frame in (first, last)]
    return (east[0] - WEST - 10.0) / 12.0, (east[1] - east[0]) / np.cos(SLOPE)


@pytest.mark.thorough
@pytest.mark.parametrize(("match", "cohesion"), [("triaxial", 5e3), ("plane_strain", 15e3)])
def test_a_strong_slab_slides_as_a_block(tmp_path, match, cohesion):
    """g (sin - mu cos) t^2 / 2 within 3 % (1.53 and 1.52 m of 1.51 m), every part of it."""
    place, path = paths_of(tmp_path, match, cohesion)
    exact = 0.5 * 9.81 * (np.sin(SLOPE) - np.tan(FRICTION) * np.cos(SLOPE)) * TIME**2
    for least in (0.0, 0.25, 0.5, 0.75):
        assert path[(place >= least) & (place < least + 0.25)].mean() == pytest.approx(exact, rel=0.03)


@pytest.mark.thorough
def test_the_ends_of_a_weak_slab_yield_in_plane_strain(tmp_path):
    """5 kPa: its lowest quarter moves 2.1 m, its highest 1.3 m; the front is a cut of near the critical height."""
    place, path = paths_of(tmp_path, "plane_strain", 5e3)
    assert path[place > 0.75].mean() > 1.4 * path[place < 0.25].mean()
