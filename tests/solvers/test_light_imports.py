"""Kernels, effects and solvers run with numba, numpy, scipy and h5py alone, as on a machine for computing."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PRESENT = {"numba", "numpy", "scipy", "h5py"}
UNITS = ("kernels", "effects", "solvers")

WITHOUT = """
import sys
absent = set({absent!r})

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in absent:
            raise ModuleNotFoundError(f"no library {{name}} on this machine", name=name)

sys.meta_path.insert(0, Absent())
"""
IMPORTS = """
import importlib, pkgutil
for unit in {units!r}:
    package = importlib.import_module("mpmgis." + unit)
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(package.__name__ + "." + module.name)
assert not absent & {{name.split(".")[0] for name in sys.modules}}
"""
STEPS = """
from typing import NamedTuple
import numpy as np
from mpmgis.effects.contact import CoulombContact
from mpmgis.effects.material import drucker_prager
from mpmgis.effects.slots import PointEffects
from mpmgis.particles import Frame, Particles
from mpmgis.solvers.point_numerics import PointNumerics
from mpmgis.solvers.points import PointSolver
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

class Cells(NamedTuple):
    a: float = 1.0
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0
    e: float = -1.0
    f: float = 20.0

terrain = Terrain(Grid(None, Cells(), (20, 40)), np.tile(20.0 - 0.5 * (np.arange(40) + 0.5), (20, 1)))
x, y, z = (part.ravel() for part in np.meshgrid(*3 * [0.25 + 0.5 * np.arange(8)], indexing="ij"))
volume = np.full(len(x), 0.125)
place = np.column_stack([x + 8.0, y + 8.0, z + 17.0 - 0.5 * x])
particles = Particles(place, np.zeros((len(x), 3)), 2000.0 * volume, volume, id=np.arange(len(x), dtype=np.uint64))
material = drucker_prager(1e6, 6e5, 35.0, 0.0)
solver = PointSolver(Frame(particles, dimension=3), terrain, PointEffects(material, contact=CoulombContact(0.4)),
                     PointNumerics(1.0, density=2000.0))
solver.advance(0.5)
assert solver.time == 0.5 and solver.frame().particles.velocity[:, 0].mean() > 0.1
"""


def absent_libraries():
    """Import names of all dependencies but those of PRESENT, and of pandas, which geopandas brings."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    names = {requirement.split(">")[0].strip() for requirement in listed}
    assert names >= PRESENT
    return sorted(names - PRESENT | {"pandas"})


def run_without_libraries(code):
    whole = WITHOUT.format(absent=absent_libraries()) + code
    done = subprocess.run([sys.executable, "-c", whole], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_kernels_effects_and_solvers_import_without_geographic_libraries():
    run_without_libraries(IMPORTS.format(units=UNITS))


@pytest.mark.thorough
def test_points_slide_without_geographic_libraries():
    run_without_libraries(STEPS)
