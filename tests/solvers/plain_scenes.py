"""Scenes of both solvers whose kernels run compiled and as plain Python; `test_plain_kernels.py` compares the results.

`python plain_scenes.py FILE` writes the results of this process to an npz file.
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).parent / "gpu"))
from column_slots import SCENES, drawn
from point_scenes import block_of, plane, points_on

from mpmgis.laws.friction import friction_law
from mpmgis.laws.material import drucker_prager, fluid
from mpmgis.solvers.features.walls import Wall

SAND, COULOMB = drucker_prager(6.7e6, 4e6, 35.0, 500.0), friction_law("Coulomb", 0.3)
WALL = Wall("dam", shapely.box(14.2, -50.0, 18.2, 80.0), height=20.0, mu=0.3)


def points(material=SAND, contact=COULOMB, degrees=20.0, **more):
    """A small block that strains and hits the ground, with `more` as of `points_on`."""
    frame = block_of((2.0, 1.5, 1.5), 0.5, (12.0, 12.2, 0.0), velocity=(6.0, 0.5, -3.0))
    place = frame.particles.position
    frame.particles.velocity[:] += (place - place.mean(axis=0)) @ np.array([[-3, 1, 0], [0.5, -1, 0.5], [2, 0, -8]])
    place[:, 2] += 120.0 - np.tan(np.radians(degrees)) * place[:, 0]
    return points_on(plane(degrees), frame, 1.0, material, contact, **more)


MADE = {  # name -> (what makes a solver, steps)
    "points": (points, 3),
    "points at a wall": (partial(points, walls=(WALL,)), 3),
    "layers of a fluid": (partial(points, fluid(1e6, 1.0, 0.0), friction_law("Voellmy", 0.1, 400.0)), 3),
    "layers of mud": (partial(points, fluid(1e6, 0.0, 0.0), friction_law("OBrien", 300.0, 20.0, 500.0, 0.05)), 3),
    "points in single precision": (partial(points, precision="float32"), 3),
    "columns": SCENES["slide"],
    "columns with all effects": (drawn(0), 3),
    "columns with all effects and nodata": (drawn(4), 3),
}
NAMES = "rows", "ids", "keys", "counts", "ledger", "peaks", "barrier_sums"


def results(name):
    """Arrays of the scene `name` after its steps, by name."""
    make, steps = MADE[name]
    solver = make()
    solver.advance(1e9, max_steps=steps)
    here = {part: getattr(solver.arrays, part) for part in NAMES}
    return here | {"time": np.array([solver.time]), "energy": np.array(solver.energy())}


if __name__ == "__main__":
    found = {f"{name}/{part}": array for name in MADE for part, array in results(name).items()}
    np.savez(sys.argv[1], **found)
