"""Scenes with exact answers for the depth-averaged solver, and the norms that they are judged by."""

import itertools
from dataclasses import replace

import numpy as np
from affine import Affine
from exact_solutions import G, mangeney, stoker  # noqa: F401  (G for the tests that import scenes)

from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.laws.friction import FRICTIONLESS, friction_law
from mpmgis.laws.ground_metric import SLOPE
from mpmgis.solvers.columns.column_solver import ColumnNumerics, ColumnSolver
from mpmgis.solvers.columns.column_time_step import CLOCK  # noqa: F401  (compiles nothing; fails early where kernels are broken)
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid


def terrain_of(height, length, width, pixel, west=0.0, south=0.0):
    """A terrain of `height(x, y)` on [west, west + length] x [south, south + width]."""
    rows, columns = round(width / pixel), round(length / pixel)
    grid = Grid(None, Affine(pixel, 0, west, 0, -pixel, south + width), (rows, columns))
    x, y = grid.xy(*np.mgrid[0:rows, 0:columns])
    return Terrain(grid, np.asarray(height(x, y), float) + 0 * x)


def columns_of(thickness, west, east, south, north, spacing, density=1000.0, velocity=(0.0, 0.0), staggered=0):
    """A lattice of columns of `thickness(x, y)` (or a number) [m] with one column a square of side `spacing` [m].

    With `staggered` = k columns along a cell's side no two columns of a cell share their x or y: each moves within its
    square by what its place across tells (Chiu, Shirley & Wang 1994), so that a stretched flow stays even.
    """
    j, i = np.mgrid[0 : round((north - south) / spacing), 0 : round((east - west) / spacing)]
    k = staggered or 1
    x = (west + spacing * (i + (j % k + 0.5) / k)).ravel()
    y = (south + spacing * (j + (k - 1 - i % k + 0.5) / k)).ravel()
    h = np.broadcast_to(thickness(x, y) if callable(thickness) else thickness, x.shape).astype(float)
    keep = h > 0
    x, y, h = x[keep], y[keep], h[keep]
    area = np.full(len(x), spacing**2)
    speed = np.column_stack([np.full(len(x), velocity[0]), np.full(len(x), velocity[1]), np.zeros(len(x))])
    particles = Particles(
        np.column_stack([x, y, 0 * x]), speed, density * area * h, area * h, h, area, np.arange(len(x), dtype=np.uint64)
    )
    return Frame(particles, dimension=2)


def seeded(thickness, west, east, south, north, dx, per_side=4, staggered=True, **more):
    """Columns staggered as `run` seeds them, `per_side` along the side of a cell of `dx` [m]."""
    spacing, stagger = dx / per_side, per_side if staggered else 0
    return columns_of(thickness, west, east, south, north, spacing, staggered=stagger, **more)


def solver_on(
    terrain,
    frame,
    cell_size,
    friction=None,
    metric=None,
    curvature=None,
    still_water=None,
    places=None,
    laws=None,
    **numerics,
):
    """A solver with the named laws (`laws`: those of the other slots, by name), no stop rule unless asked."""
    slots = {"friction": friction, "metric": metric, "curvature": curvature, "still_water": still_water, **(laws or {})}
    effects = ColumnEffects(**{name: law for name, law in slots.items() if law is not None})
    numerics = ColumnNumerics(cell_size, **{"stop_at_rest": False, **numerics})
    return ColumnSolver(frame, terrain, effects, numerics, places)


def joined(*frames):
    """One frame of the columns or points of all `frames`, numbered again."""
    parts = [frame.particles.arrays() for frame in frames]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    arrays["id"] = np.arange(len(arrays["mass"]), dtype=np.uint64)
    return replace(frames[0], particles=Particles(**arrays))


def spline(distance):
    """The quadratic B-spline at `distance` [cells] from its node, a number or an array."""
    away = np.abs(distance)
    return np.where(away < 0.5, 0.75 - away**2, 0.5 * np.maximum(1.5 - away, 0.0) ** 2)


def node_thickness(solver, walls=True):
    """(x, y, thickness) at the nodes from the columns' splines, walls mirrored as the solver does."""
    p = solver.frame().particles
    grid = solver.grid
    dx = grid.cell_size
    ny, nx = grid.bed.shape
    mass = np.zeros((ny, nx))
    bases, weights = [], []
    for position, start in ((p.position[:, 0], grid.x0), (p.position[:, 1], grid.y0)):
        s = (position - start) / dx + 1.0
        base = (s - 0.5).astype(int)
        f = s - base
        bases.append(base)
        weights.append((0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2))
    for j in range(3):
        for i in range(3):
            np.add.at(mass, (bases[1] + j, bases[0] + i), weights[0][i] * weights[1][j] * p.mass)
    if walls:
        for axis in (0, 1):
            m = np.moveaxis(mass, axis, 0)
            m[2] += m[0]
            m[-3] += m[-1]
            m[1] *= 2
            m[-2] *= 2
    x = grid.x0 + np.arange(nx - 2) * dx
    y = grid.y0 + np.arange(ny - 2) * dx
    return x, y, mass[1:-1, 1:-1] / (solver.numerics.density * dx * dx)


def dam_break(
    dx,
    time=2.5,
    degrees=0.0,
    friction_degrees=0.0,
    metric=None,
    depth=5.0,
    reservoir=50.0,
    length=100.0,
    tail=0.0,
    per_side=4,
    staggered=True,
    **numerics,
):
    """A dam of slope-normal `depth` [m] at rest on a plane; answers (distance from the dam along the slope, computed
    and exact vertical thickness) at `time` [s] on the nodes (Ritter 1892; Mangeney et al. 2000).

    `tail` is what `depth` becomes ahead of the dam (Stoker: the wet bed).
    """
    slope, delta = np.radians(degrees), np.radians(friction_degrees)
    cos = np.cos(slope)
    total, behind = round(length * cos / dx) * dx, round(reservoir * cos / dx) * dx
    width = 4 * dx
    terrain = terrain_of(lambda x, y: -np.tan(slope) * x, total, width, dx)
    thickness = depth / cos if tail == 0 else lambda x, y: np.where(x < behind, depth, tail)
    east = behind if tail == 0 else total
    frame = seeded(thickness, 0, east, 0, width, dx, per_side, staggered)
    law = friction_law("Coulomb", float(np.tan(delta))) if delta else FRICTIONLESS
    solver = solver_on(terrain, frame, dx, law, metric or SLOPE, edges="wall", **numerics)
    solver.advance(time)
    x, _, h = node_thickness(solver)
    along = (x - behind) / cos
    if tail:
        return along, h.mean(axis=0), stoker(along, time, depth, tail)[0], solver
    return along, h.mean(axis=0), mangeney(along, time, depth, slope, delta)[0] / cos, solver


def relative_l1(computed, exact, where=slice(None)):
    """Sum of |computed - exact| over the sum of exact."""
    return float(np.abs(computed - exact)[where].sum() / exact[where].sum())


def orders(errors):
    """Observed orders between successive halvings."""
    return [float(np.log2(a / b)) for a, b in itertools.pairwise(errors)]
