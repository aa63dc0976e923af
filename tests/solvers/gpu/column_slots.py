"""Small scenes of the depth-averaged solver, one for each slot and branch, for a solver of any kind."""

import sys
from pathlib import Path

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).parents[1]))
from column_scenes import columns_of, terrain_of

from mpmgis.laws import friction as laws
from mpmgis.laws.curvature import CURVATURE
from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.laws.entrainment import entrainment_law
from mpmgis.laws.forest import FOREST_ENTRIES, SHARE
from mpmgis.laws.ground_metric import WATER
from mpmgis.laws.internal_stress import InPlaneViscosity, earth_pressure
from mpmgis.solvers.columns.column_rows import CXX
from mpmgis.solvers.columns.column_solver import ColumnNumerics, ColumnSolver
from mpmgis.solvers.columns.feature_arrays import NO_LAKE, Places, barrier_entries
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.solvers.features.walls import Wall, wall_nodes

DX = 5.0
LENGTH, WIDTH = 130.0, 90.0
VOELLMY = laws.friction_law("Voellmy", 0.15, 800.0)
HOLE = (65.0, 75.0, 30.0, 50.0)  # west, east, south, north of cells without elevation
POOL = 16.0  # [m] still level of the lake


def rough(x, y):
    """A rough slope of some 20 degrees, to the east."""
    return 0.36 * (400 - x) + 1.5 * np.sin(x / 9) * np.cos(y / 8)


def with_hole(x, y):
    """The same with cells without elevation."""
    west, east, south, north = HOLE
    return np.where((x > west) & (x < east) & (y > south) & (y < north), np.nan, rough(x, y))


def beach(x, y):
    """A beach, to the east under water."""
    return 0.2 * (LENGTH - x) + 0.3 * np.cos(y / 9)


def cap(x, y):
    """Thickness [m] of a pile without symmetry, across the borders of blocks."""
    return np.maximum(2.0 - ((x - 42) ** 2 + (y - 41) ** 2) / 60, 0.0) + 0.05 * np.sin(x + 2 * y)


def thin(x, y):
    """A pile with a film around it."""
    return np.where(cap(x, y) > 0.1, cap(x, y), 1e-5)


def pile(thickness=cap, velocity=(3.0, -2.0), west=30.0, east=55.0, south=30.0, north=55.0, spacing=2.5):
    """The columns of a pile; their velocities differ."""
    frame = columns_of(thickness, west, east, south, north, spacing, velocity=velocity)
    p = frame.particles
    p.velocity[:, 0] += 0.04 * (p.position[:, 0] - 42) + 0.03 * (p.position[:, 1] - 41)
    p.velocity[:, 1] += 0.05 * (p.position[:, 0] - 42) - 0.02 * (p.position[:, 1] - 41)
    return frame


def made(kind=ColumnSolver, bed=rough, frame=None, places=None, cell_size=DX, gradient=True, **more):
    """A solver of `kind`; `more` are effects by the name of their slot, and numerics."""
    frame = pile() if frame is None else frame
    slots = {"friction": VOELLMY} | {name: law for name, law in more.items() if name in ColumnEffects._fields}
    numerics = {"stop_at_rest": False, "maxima": True} | {n: v for n, v in more.items() if n not in slots}
    terrain = terrain_of(bed, LENGTH, WIDTH, DX)
    places = places(ColumnGrid.on(terrain, cell_size)) if callable(places) else places
    solver = kind(frame, terrain, ColumnEffects(**slots), ColumnNumerics(cell_size, **numerics), places)
    if gradient:
        solver.arrays.rows[:, CXX : CXX + 4] = 0.1 * np.sin(np.arange(4 * len(solver.arrays.rows))).reshape(-1, 4)
    return solver


def zones(grid):
    """Voellmy parameters from a map."""
    x, y = grid.node_points()
    return Places(zone_values=np.stack([0.1 + 0.002 * x, 500.0 + 5 * y], axis=-1))


def erodible(grid):
    """A bed of which less can be taken up in the south."""
    x, y = grid.node_points()
    return Places(erodible=np.where(y > 40, 500.0, 0.5) + 0 * x)


def lake(grid):
    """A lake in the east."""
    ny, nx = grid.inside.shape
    x = (np.arange(nx) + 0.5) * grid.cell_size
    return Places(lake_level=np.where(x > LENGTH - POOL / 0.2, POOL, NO_LAKE) + np.zeros((ny, 1)))


def walls(grid):
    """A wall across the flow and one with a narrow opening along it."""
    rows, columns = grid.bed.shape
    x, y = grid.x0 + (np.arange(columns) - 1) * DX, grid.y0 + (np.arange(rows) - 1) * DX
    across = shapely.box(56.0, 20.0, 57.0, 44.0)
    opened = shapely.union_all([shapely.box(30, 26, 44, 27), shapely.box(46, 26, 60, 27)])
    made_of = [Wall("low", across, 0.6, mu=0.1), Wall("opened", opened, 50.0)]
    nodes = wall_nodes(made_of, x, y, grid.bed, grid.cell_size)
    return Places(barriers=barrier_entries(nodes), barrier_names=("low", "opened"))


def wall_outside(grid):
    """A wall without nodes on the grid."""
    nodes = wall_nodes([Wall("far", shapely.box(-500, -500, -499, -400), 2.0)], *grid.node_axes(), grid.bed, DX)
    return Places(barriers=barrier_entries(nodes), barrier_names=("far",))


def trees(*values, also_erodible=False, clearing=35.0):
    """Forest of `values`, a clearing in the south up to `clearing` [m]."""

    def places(grid):
        x, y = grid.node_points()
        forest = np.zeros((*x.shape, FOREST_ENTRIES))
        forest[..., : len(values)], forest[..., SHARE] = values, 1.0
        forest[(y < clearing) | ~grid.domain_nodes()] = 0.0
        return Places(forest=forest, erodible=np.full(x.shape, 50.0) if also_erodible else None)

    return places


def armed(kind=ColumnSolver):
    """An area that the flow releases when it arrives."""
    solver = made(kind)
    solver.arm(1, (np.array([9, 10]), np.array([13, 13])), 0.05)
    solver.arm(2, (np.array([12]), np.array([20])), None)
    return solver


def fast(kind=ColumnSolver, which=slice(None, None, 3), speed=45.0):
    """Some columns are faster than their drop allows."""
    solver = made(kind)
    solver.arrays.rows[which, 2] = speed
    return solver


def spread(kind=ColumnSolver):
    """Columns with areas that the thickness clamp resets."""
    solver = made(kind, clamp=1.5)
    solver.arrays.rows[::4, 9] *= 6.0
    solver.arrays.rows[1::4, 9] *= 0.1
    return solver


def leaving(velocity, **box):
    """Columns that leave over an edge."""
    return lambda kind=ColumnSolver: made(kind, frame=pile(1.0, velocity, **box), time_step=0.3)


def drawn(seed):
    """A scene with all effects at once, and with cells, columns, edges, nodata and walls drawn at random."""

    def make(kind=ColumnSolver):
        rng = np.random.default_rng(seed)
        size, hole = rng.uniform(3.0, 9.0), rng.integers(2)
        west, south = rng.uniform(0.0, 90.0), rng.uniform(0.0, 50.0)
        frame = columns_of(
            rng.uniform(0.2, 2.0),
            west,
            west + 3 * size,
            south,
            south + 3 * size,
            size / rng.integers(1, 3),
            velocity=rng.uniform(-15.0, 15.0, 2),
        )
        p = frame.particles
        p.velocity[:, :2] += rng.normal(0.0, 0.5, (len(p), 2))
        p.thickness[:] *= rng.uniform(0.5, 1.5, len(p))
        p.volume[:] = p.thickness * p.area
        p.mass[:] = 1000.0 * p.volume
        holes = shapely.box(*HOLE[:1], HOLE[2], HOLE[1], HOLE[3]).buffer(size)
        bed = with_hole if hole and not shapely.contains_xy(holes, *p.position[:, :2].T).any() else rough

        def places(grid):
            x, y = grid.node_points()
            forest = np.zeros((*x.shape, FOREST_ENTRIES))
            forest[..., :8] = 30.0, 0.02, 0.05, 3e4, 2.0, 0.1, 1.5, 1.0
            forest[(np.sin(x) > 0.5) | ~grid.domain_nodes()] = 0.0
            held = wall_nodes(
                [Wall("w", shapely.LineString([(20, 20), (70, 70)]).buffer(0.6), 0.8, mu=0.2)],
                *grid.node_axes(),
                grid.bed,
                grid.cell_size,
            )
            parameters = np.stack([0.1 + 0.002 * x, 500.0 + 5 * y], axis=-1)
            return Places(
                zone_values=parameters,
                erodible=200.0 * rng.random(x.shape),
                barriers=barrier_entries(held),
                barrier_names=("w",),
                forest=forest,
            )

        return made(
            kind,
            bed,
            frame,
            places,
            size,
            zones=True,
            cohesion=100.0,
            curvature=CURVATURE,
            earth_pressure=earth_pressure(35.0, 20.0),
            viscosity=InPlaneViscosity(50.0, 500.0),
            entrainment=entrainment_law("ErosionEnergy", 800.0, 1e-3),
            barrier=True,
            forest=True,
            edges=("open", "wall")[rng.integers(2)],
            clamp=(0.0, 1.5)[rng.integers(2)],
            time_step=(None, 0.1)[rng.integers(2)],
        )

    return make


IN_WATER = {"metric": WATER, "bed": beach}
WEST, EAST = {"west": 0, "east": 15, "south": 0, "north": 15}, {"west": 115, "east": 130, "south": 75, "north": 90}
# name -> (what makes a solver of a kind, steps)
SCENES = {
    "slide": (made, 3),
    "fixed step": (lambda kind=ColumnSolver: made(kind, time_step=0.11), 3),
    "reordered": (lambda kind=ColumnSolver: made(kind, frame=pile(spacing=5.0)), 23),
    "thin": (lambda kind=ColumnSolver: made(kind, frame=pile(thin)), 2),
    "outflow west and south": (leaving((-14.0, -12.0), **WEST), 3),
    "outflow east and north": (leaving((14.0, 12.0), **EAST), 3),
    "nodata": (lambda kind=ColumnSolver: made(kind, with_hole, pile(1.0, (14.0, 0.0)), time_step=0.4), 3),
    "walls at edges": (
        lambda kind=ColumnSolver: made(kind, frame=pile(1.0, (-40.0, -35.0), **WEST), edges="wall", time_step=0.3),
        3,
    ),
    "Coulomb": (lambda kind=ColumnSolver: made(kind, friction=laws.friction_law("Coulomb", 0.4)), 2),
    "Frictionless": (lambda kind=ColumnSolver: made(kind, friction=laws.FRICTIONLESS), 2),
    "ModifiedVoellmy": (
        lambda kind=ColumnSolver: made(kind, friction=laws.friction_law("ModifiedVoellmy", 0.15, 800.0, 200.0)),
        2,
    ),
    "Bingham": (lambda kind=ColumnSolver: made(kind, friction=laws.friction_law("Bingham", 500.0, 50.0)), 2),
    "Pouliquen": (
        lambda kind=ColumnSolver: made(kind, friction=laws.friction_law("Pouliquen", 0.38, 0.6, 0.136, 0.05)),
        2,
    ),
    "SamosAT": (lambda kind=ColumnSolver: made(kind, friction=laws.friction_law("SamosAT", 0.155)), 2),
    "HerschelBulkley": (
        lambda kind=ColumnSolver: made(kind, friction=laws.friction_law("HerschelBulkley", 200.0, 200.0, 0.5)),
        2,
    ),
    "zones": (lambda kind=ColumnSolver: made(kind, places=zones, zones=True), 2),
    "cohesion": (lambda kind=ColumnSolver: made(kind, cohesion=800.0), 2),
    "curvature": (lambda kind=ColumnSolver: made(kind, curvature=CURVATURE), 3),
    "earth pressure": (lambda kind=ColumnSolver: made(kind, earth_pressure=earth_pressure(35.0, 20.0)), 3),
    "viscosity": (lambda kind=ColumnSolver: made(kind, viscosity=InPlaneViscosity(5e4, 4000.0)), 3),
    "swe": (lambda kind=ColumnSolver: made(kind, metric=WATER), 2),
    "still water": (
        lambda kind=ColumnSolver: made(
            kind, frame=pile(1.5, west=70.0, east=95.0), places=lake, still_water=True, **IN_WATER
        ),
        3,
    ),
    "erosion": (
        lambda kind=ColumnSolver: made(kind, places=erodible, entrainment=entrainment_law("ErosionSpeed", 0.02)),
        3,
    ),
    "greedy erosion": (
        lambda kind=ColumnSolver: made(kind, places=erodible, entrainment=entrainment_law("ErosionSpeed", 3.0)),
        2,
    ),
    "lowered bed": (
        lambda kind=ColumnSolver: made(
            kind, places=erodible, entrainment=entrainment_law("ErosionEnergy", 500.0, 1e-3)
        ),
        3,
    ),
    "lowered bed with curvature": (
        lambda kind=ColumnSolver: made(
            kind, places=erodible, entrainment=entrainment_law("ErosionEnergy", 500.0, 1e-3), curvature=CURVATURE
        ),
        3,
    ),
    "clamp": (spread, 2),
    "speed bound": (fast, 2),
    "too fast": (lambda kind=ColumnSolver: fast(kind, slice(None), 90.0), 2),
    "weightless": (lambda kind=ColumnSolver: made(kind, time_step=1.5, curvature=CURVATURE), 3),
    "triggers": (armed, 9),
    "barriers": (lambda kind=ColumnSolver: made(kind, places=walls, barrier=True), 6),
    "barrier outside": (
        lambda kind=ColumnSolver: made(
            kind, frame=pile(1.0, (-14.0, -12.0), **WEST), places=wall_outside, barrier=True, time_step=0.3
        ),
        2,
    ),
    "barriers and walls": (
        lambda kind=ColumnSolver: made(kind, places=walls, barrier=True, edges="wall", curvature=CURVATURE),
        6,
    ),
    "forest": (lambda kind=ColumnSolver: made(kind, places=trees(100.0, 0.03, 0.05, 1e12), forest=True), 4),
    "forest breaks": (
        lambda kind=ColumnSolver: made(kind, places=trees(20.0, 0.03, 0.0, 2e4, 0.0, 0.0, 1.5), forest=True),
        4,
    ),
    "forest takes all": (
        lambda kind=ColumnSolver: made(
            kind, frame=pile(0.02, spacing=5.0), places=trees(2e4, 0.0, 0.0, 1e12, clearing=0.0), forest=True
        ),
        4,
    ),
    "forest with limits": (
        lambda kind=ColumnSolver: made(kind, places=trees(50.0, 0.03, 0.0, 1e12, 3.0, 0.5), forest=True),
        4,
    ),
    "forest, erosion and walls": (
        lambda kind=ColumnSolver: made(
            kind,
            frame=pile(0.5, (-6.0, -5.0), west=0, east=20, south=30, north=50),
            places=trees(50.0, 0.03, 0.05, 1e12, also_erodible=True),
            forest=True,
            entrainment=entrainment_law("ErosionSpeed", 0.01),
            edges="wall",
        ),
        4,
    ),
} | {f"drawn {seed}": (drawn(seed), 4) for seed in range(8)}
