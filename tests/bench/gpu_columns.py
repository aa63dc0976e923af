"""The depth-averaged solver on a CUDA device against the processor: `python tests/bench/gpu_columns.py OUT`.

It runs from a checkout with numba, numba-cuda, numpy, scipy and h5py. In this order: agreement with the kernels of
the processor for several sets of effects, and equal bits of two runs, of which one is stopped and continued;
compute-sanitizer where it is installed; then the time of a step on the device, with memory, and on the processor for
each number of columns, of each kernel, and on 1, 2, 4, ... threads of the processor. gpu_columns.json and
gpu_columns.txt in OUT are updated after each part. The exit status is 1 if there is no device or no agreement. `gpu.py`
does the same for the 3D solver.
"""

import argparse
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import numba  # noqa: E402
import numpy as np  # noqa: E402
from gpu import (  # noqa: E402
    KERNELS_OF,
    LARGEST_ON_PROCESSOR,
    ON_THREADS,
    Cells,
    in_processes,
    kernel_times,
    lack_of_memory,
    machine,
    measured_on_device,
    measured_on_processor,
    on_threads,
    sanitized,
    text_of_kernels,
    words_of,
)

from mpmgis.frames.particles import Frame, Particles  # noqa: E402
from mpmgis.laws.curvature import CURVATURE  # noqa: E402
from mpmgis.laws.effect_slots import ColumnEffects  # noqa: E402
from mpmgis.laws.entrainment import entrainment_law  # noqa: E402
from mpmgis.laws.forest import FOREST_ENTRIES, SHARE  # noqa: E402
from mpmgis.laws.friction import friction_law  # noqa: E402
from mpmgis.laws.ground_metric import WATER  # noqa: E402
from mpmgis.laws.internal_stress import InPlaneViscosity, earth_pressure  # noqa: E402
from mpmgis.solvers.columns import column_barriers as wall  # noqa: E402
from mpmgis.solvers.columns.column_solver import ColumnNumerics, ColumnSolver  # noqa: E402
from mpmgis.solvers.columns.feature_arrays import NO_LAKE, Places  # noqa: E402
from mpmgis.solvers.columns.node_grid import ColumnGrid  # noqa: E402
from mpmgis.solvers.gpu.available import found_device  # noqa: E402
from mpmgis.solvers.gpu.device_column_solver import DeviceColumnSolver, device_memory_of_columns  # noqa: E402
from mpmgis.terrain.elevation import Terrain  # noqa: E402
from mpmgis.terrain.grid import Grid  # noqa: E402

CELL, DENSITY, DEPTH, MARGIN = 5.0, 1000.0, 2.0, 10  # [m], [kg m-3], [m], cells around the sheet
VOELLMY = friction_law("Voellmy", 0.15, 1500.0)
SETS = {  # effects, and the edges of the domain
    "Voellmy": (ColumnEffects(VOELLMY), "open"),
    "curvature": (ColumnEffects(VOELLMY, curvature=CURVATURE), "open"),
    "erosion, forest, barrier": (
        ColumnEffects(
            VOELLMY,
            True,
            50.0,
            curvature=CURVATURE,
            entrainment=entrainment_law("ErosionEnergy", 2000.0, 1e-3),
            barrier=True,
            forest=True,
        ),
        "wall",
    ),
    "earth pressure, viscosity": (
        ColumnEffects(
            friction_law("Bingham", 200.0, 20.0),
            earth_pressure=earth_pressure(35.0, 20.0),
            viscosity=InPlaneViscosity(50.0, 500.0),
        ),
        "open",
    ),
    "water": (ColumnEffects(VOELLMY, metric=WATER, still_water=True), "wall"),
}
AGREES = 1e-9  # largest difference of places [cells] and of speeds over the largest
CHECKED_COLUMNS, CHECKED_STEPS = 6400, 60
HOST_BYTES_PER_COLUMN = 500  # of the host while a run of the bench is made
BYTES_PER_NODE = 300  # of the arrays of the solver at its nodes


def sheet(columns):
    """(Terrain, Frame) of a sheet of about `columns`, 16 per cell, on a wavy slope to the east."""
    side = max(2, round(columns**0.5 / 4))
    n = side + 2 * MARGIN
    i = (np.arange(n) + 0.5) * CELL
    height = 0.4 * (n * CELL - i) + 3.0 * np.sin(i / 30.0) * np.cos(i[:, None] / 35.0)
    terrain = Terrain(Grid(None, Cells(CELL, 0.0, 0.0, 0.0, -CELL, n * CELL), (n, n)), height)
    k, across = np.arange(16 * side * side), 4 * side
    place = np.zeros((len(k), 3))
    place[:, 0], place[:, 1] = (MARGIN * CELL + (m + 0.5) * CELL / 4 for m in (k % across, k // across))
    area = np.full(len(k), CELL * CELL / 16)
    velocity = np.tile([4.0, 1.0, 0.0], (len(k), 1))
    thickness = DEPTH * (1.0 + 0.3 * np.sin(place[:, 0] / 11.0))
    volume = thickness * area
    return terrain, Frame(Particles(place, velocity, DENSITY * volume, volume, thickness, area, k.astype(np.uint64)))


def places_on(grid):
    """Zones, erodible ground, forest, lakes and a barrier across the sheet."""
    shape = grid.bed.shape
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] * CELL
    forest = np.zeros((*shape, FOREST_ENTRIES))
    forest[4:-4, 4:-4, :4], forest[4:-4, 4:-4, SHARE] = (30.0, 0.02, 0.02, 3e4), 1.0
    barriers = np.zeros((*shape, wall.BARRIER_ENTRIES))
    middle, rows = shape[1] // 2, slice(shape[0] // 3, shape[0] // 2)
    for k, side in ((0, -1.0), (1, 1.0)):
        held = barriers[rows, middle + k]
        held[:, wall.WALL_X], held[:, wall.BARRIER], held[:, wall.WEIGHT] = side, 1.0, 0.5 / CELL
        held[:, wall.CREST] = grid.bed[rows, middle + k] + 1.0
    lake = np.where(np.arange(grid.inside.shape[1]) > 0.6 * grid.inside.shape[1], grid.bed.min() + 10.0, NO_LAKE)
    return Places(
        zone_values=np.stack([0.1 + 1e-4 * x, 1000.0 + y], axis=-1),
        erodible=np.full(shape, 300.0),
        barriers=barriers,
        barrier_names=("wall",),
        lake_level=lake + np.zeros(grid.inside.shape),
        forest=forest,
    )


def solver_of(kind, columns, name="curvature"):
    """A solver of `kind` with the sheet of about `columns` and the set of effects `name`."""
    terrain, frame = sheet(columns)
    effects, edges = SETS[name]
    grid = ColumnGrid.on(terrain, CELL)
    numerics = ColumnNumerics(CELL, edges=edges, density=DENSITY, stop_at_rest=False, maxima=True)
    return kind(frame, terrain, effects, numerics, places_on(grid), grid)


def state_after(kind, columns, steps, name, parts=1):
    """(places, velocities, masses) of all columns after `steps`, in the order of their ids; in `parts` with a frame."""
    solver = solver_of(kind, columns, name)
    for _ in range(parts):
        solver.advance(1e9, max_steps=steps // parts)
        particles = solver.frame().particles
    order = np.argsort(particles.id)
    return particles.position[order], particles.velocity[order], particles.mass[order]


def agreement(columns, steps, names, jobs=1):
    """Rows of the comparison with the processor, for each set of effects; `jobs` at the same time."""
    yield from in_processes(compared, [(columns, steps, name) for name in names], jobs)


def compared(columns, steps, name):
    """Row of the comparison with the processor for a set of effects."""
    known = state_after(ColumnSolver, columns, steps, name)
    found = state_after(DeviceColumnSolver, columns, steps, name)
    again = state_after(DeviceColumnSolver, columns, steps, name, parts=2)
    row = {"effects": name, "columns": len(known[0]), "steps": steps, "allowed": AGREES}
    row["same_bits"] = all(np.array_equal(one, other) for one, other in zip(found, again, strict=True))
    if len(found[0]) != len(known[0]):
        return row | {"agrees": False, "columns_on_device": len(found[0])}
    row["place_cells"] = float(np.abs(found[0] - known[0]).max() / CELL)
    for k, number in ((1, "speed_relative"), (2, "mass_relative")):
        row[number] = float(np.abs(found[k] - known[k]).max() / max(np.abs(known[k]).max(), 1e-300))
    worst = max(row["place_cells"], row["speed_relative"], row["mass_relative"])
    return row | {"agrees": bool(worst <= AGREES and row["same_bits"])}


def no_room(columns, name):
    """Why a run does not fit into the memory of the host or of the device; "" if it does."""
    nodes = (columns**0.5 / 4 + 2 * MARGIN) ** 2
    on_device = device_memory_of_columns(columns, nodes, BYTES_PER_NODE * nodes, SETS[name][0])
    return lack_of_memory(HOST_BYTES_PER_COLUMN * columns, on_device)


def timed_on_device(columns, name):
    """Row of a run on the device."""
    row = {"columns": columns, "effects": name}
    if lack := no_room(columns, name):
        return row | {"not_run": lack}
    return row | measured_on_device(lambda: solver_of(DeviceColumnSolver, columns, name), "columns")


def timed_on_processor(columns, name):
    """Row of a run on all cores of the processor."""
    row = {"columns": columns, "effects": name}
    if columns > LARGEST_ON_PROCESSOR or lack_of_memory(HOST_BYTES_PER_COLUMN * columns):
        return row | {"not_run": "too large for the processor"}
    return row | measured_on_processor(lambda: solver_of(ColumnSolver, columns, name), "columns")


def kernels_of(sizes, name):
    """`kernel_times` of the largest of the `sizes` that is at most KERNELS_OF [columns] and fits into the memory."""
    columns = max((size for size in sizes if size <= KERNELS_OF), default=min(sizes))
    if lack := no_room(columns, name):
        return {"not_run": lack}
    return kernel_times(lambda: solver_of(DeviceColumnSolver, columns, name))


def text_of(found):
    """The results as lines of text."""
    yield from (f"{name}: {value}" for name, value in found["machine"].items())
    for row in found["agreement"]:
        yield ("agrees: " if row["agrees"] else "DIFFERS: ") + ", ".join(f"{k} {v}" for k, v in row.items())
    if "sanitizer" in found:
        yield f"compute-sanitizer: {found['sanitizer']}"
    for where in ("device", "processor"):
        for row in found.get(f"on_{where}", ()):
            yield f"{where}: {row['columns']} columns, {row['effects']}: {words_of(row)}"
    yield from text_of_kernels(found)


def write(found, folder):
    """Write what is known so far to `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "gpu_columns.json").write_text(json.dumps(found, indent=1) + "\n")
    (folder / "gpu_columns.txt").write_text("".join(f"{line}\n" for line in text_of(found)))


def measure(folder, sizes, checked, steps, names, jobs):
    """Write all parts to `folder`, for `sizes` [columns]; returns whether device and processor agree."""
    found = {"machine": machine(), "agreement": []}
    for row in agreement(checked, steps, names, jobs):
        found["agreement"].append(row)
        write(found, folder)
    if not numba.config.ENABLE_CUDASIM:
        found["sanitizer"] = sanitized(__file__, CHECKED_COLUMNS)
        write(found, folder)
        for where, timed in (("device", timed_on_device), ("processor", timed_on_processor)):
            rows = found[f"on_{where}"] = []
            for columns in sizes:
                rows.append(timed(columns, names[0]))
                write(found, folder)
        found["kernels"] = kernels_of(sizes, names[0])
        found["on_threads"] = on_threads(lambda: solver_of(ColumnSolver, ON_THREADS, names[0]), "columns")
        write(found, folder)
    print((folder / "gpu_columns.txt").read_text(), end="")
    return all(row["agrees"] for row in found["agreement"])


def main():
    """The command; returns its exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", nargs="?", type=Path, default=Path("gpu_bench"), help="folder for the results")
    parser.add_argument("--millions", nargs="+", type=float, default=[0.1, 1, 10, 100], help="millions of columns")
    parser.add_argument("--checked", type=int, default=CHECKED_COLUMNS, help="columns of the comparison")
    parser.add_argument("--steps", type=int, default=CHECKED_STEPS, help="steps of the comparison")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), help="effects; the first set is timed")
    parser.add_argument("--jobs", type=int, default=1, help="comparisons at the same time")
    parser.add_argument("--only-steps", action="store_true", help="only some steps, for compute-sanitizer; no results")
    given = parser.parse_args()
    found = found_device()
    if found.device is None:
        print(f"nothing is measured: {found.lack}", file=sys.stderr)
        return 1
    if given.only_steps:
        solver_of(DeviceColumnSolver, given.checked).advance(1e9, max_steps=given.steps)
        return 0
    sizes = [round(1e6 * size) for size in given.millions]
    return 0 if measure(given.out, sizes, given.checked, given.steps, given.sets, given.jobs) else 1


if __name__ == "__main__":
    sys.exit(main())
