"""The 3D solver on a CUDA device against the processor of the same machine: `python tests/bench/gpu.py OUT`.

It runs from a checkout with numba, numba-cuda, numpy, scipy and h5py; with shapely it checks a barrier too. In
this order: agreement with the kernels of the processor for every material in both precisions, and equal bits of two
runs; compute-sanitizer where it is installed; copy bandwidth of the device; time of a step by CUDA events for each
number of points, with memory, and of each kernel; time of a step on the processor, and on 1, 2, 4, ... of its threads;
time of a whole scene with frames on both. gpu.json and gpu.txt in OUT are updated after each part. The exit status is 1
if there is no device or no agreement. The kernels of the processor compile for half a minute per material and
precision: `--jobs` compares several at the same time, `--materials` and `--precisions` choose some of them.
"""

import argparse
import gc
import importlib.util
import json
import multiprocessing
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numba  # noqa: E402
import numpy as np  # noqa: E402
from written_run import write_run  # noqa: E402

from mpmgis.frames.particles import Frame, Particles  # noqa: E402
from mpmgis.laws.effect_slots import PointEffects  # noqa: E402
from mpmgis.laws.friction import friction_law  # noqa: E402
from mpmgis.laws.material import (  # noqa: E402
    cohesive_mu_i,
    drucker_prager,
    elastic,
    fluid,
    mu_i,
)
from mpmgis.laws.softening import Softening, softening  # noqa: E402
from mpmgis.solvers.gpu.available import found_device  # noqa: E402
from mpmgis.solvers.gpu.device_point_solver import DevicePointSolver, device_memory  # noqa: E402
from mpmgis.solvers.points.point_numerics import PointNumerics  # noqa: E402
from mpmgis.solvers.points.point_solver import PointSolver  # noqa: E402
from mpmgis.system.memory import available_memory  # noqa: E402
from mpmgis.terrain.elevation import Terrain  # noqa: E402
from mpmgis.terrain.grid import Grid  # noqa: E402

SLOPE, DEPTH = 0.5, 8  # of the plane; of the slab [cells], with 8 points in a cell of 1 m
DENSITY = 2000.0
SOIL = drucker_prager(6.7e6, 4e6, 35.0, 500.0)
MATERIALS = {
    "elastic": (elastic(6.7e6, 4e6), Softening(), friction_law("Coulomb", 0.4)),
    "Drucker-Prager": (SOIL, Softening(), friction_law("Coulomb", 0.4)),
    "Drucker-Prager with softening": (SOIL, softening((35.0, 500.0), (20.0, 0.0), 10.0), friction_law("Coulomb", 0.4)),
    "mu(I)": (mu_i(6.7e6, 4e6, 0.4, 0.6, 0.3, 1e-3, 2500.0, 1.0), Softening(), friction_law("Voellmy", 0.2, 900.0)),
    "cohesive mu(I)": (
        cohesive_mu_i(35.0, 500.0, 0.2, 0.3, 1e-3, 2500.0, bulk_modulus=6.7e6, shear_modulus=4e6),
        Softening(),
        friction_law("Coulomb", 0.4),
    ),
    "fluid": (fluid(7.1e6, 0.0, 0.0), Softening(), friction_law("Voellmy", 0.1, 900.0)),
}
AT_BARRIER = "Drucker-Prager at a barrier"
if importlib.util.find_spec("shapely") is not None:  # which places a barrier on the nodes
    MATERIALS[AT_BARRIER] = MATERIALS["Drucker-Prager"]
AGREES = {"float64": 1e-9, "float32": 2e-3}  # largest difference of places [cells] and of speeds over the largest
CHECKED_POINTS, CHECKED_STEPS = 4096, 60
STEPS, REPEATS, WARM_UP = 20, 5, 40
STEPS_ON_PROCESSOR, REPEATS_ON_PROCESSOR = 5, 3
LARGEST_ON_PROCESSOR = 10_000_000  # points or columns
KERNELS_OF = 10_000_000  # largest number of points or columns for which each kernel is timed
ON_THREADS = 2_000_000  # points or columns of which steps are timed on several numbers of threads
HOST_BYTES_PER_POINT = 600  # of the host while a run of the bench is made
SANITIZER_SECONDS = 900
SCENE_SECONDS, SCENE_FRAMES = 2.0, 4  # simulated time [s] of the whole scene, and its frames after the first
FLOOR_BYTES = {"float32": 320, "float64": 640}  # read and written for a point and step by a solver without any waste


class Cells(NamedTuple):
    """Cells of 1 m, with the attributes of the affine of a raster."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float


def slab(points):
    """(Terrain, Frame) of a slab of about `points` on a plane that falls to the east."""
    side = max(2, round((points / (8 * DEPTH)) ** 0.5))
    high = DEPTH if points >= 8 * DEPTH * 4 else 2
    rows, columns = side + 16, 2 * side + 32
    top = SLOPE * columns
    height = np.tile(top - SLOPE * (np.arange(columns) + 0.5), (rows, 1))
    terrain = Terrain(Grid(None, Cells(1.0, 0.0, 0.0, 0.0, -1.0, float(rows)), (rows, columns)), height)
    n = (2 * side) * (2 * side) * (2 * high)
    place = np.empty((n, 3))
    k = np.arange(n)
    place[:, 0] = 8.25 + 0.5 * (k % (2 * side))
    place[:, 1] = 8.25 + 0.5 * (k // (2 * side) % (2 * side))
    place[:, 2] = 0.25 + 0.5 * (k // (4 * side * side)) + top - SLOPE * place[:, 0]
    volume = np.full(n, 0.125)
    particles = Particles(place, np.zeros((n, 3)), DENSITY * volume, volume, id=k.astype(np.uint64))
    return terrain, Frame(particles, dimension=3)


def solver_of(kind, points, material="Drucker-Prager", precision="float32", maxima=False):
    """A solver of `kind` with the slab of about `points`."""
    law, soft, contact = MATERIALS[material]
    terrain, frame = slab(points)
    numerics = PointNumerics(1.0, density=DENSITY, precision=precision, maxima=maxima)
    effects, walls = PointEffects(law, soft, contact), ()
    if material == AT_BARRIER:
        effects, walls = effects._replace(barrier=True), barrier_before(frame)
    return kind(frame, terrain, effects, numerics, walls=walls)


def barrier_before(frame):
    """A wall with friction that the slab of `frame` touches when it begins to slide."""
    import shapely

    from mpmgis.solvers.features.walls import Wall

    west = float(frame.particles.position[:, 0].max()) + 0.5
    return (Wall("dam", shapely.box(west, -1e4, west + 4.0, 1e4), height=20.0, mu=0.4),)


def state_after(kind, points, steps, material, precision):
    """(places, velocities) of all points after `steps`, in the order of their ids."""
    solver = solver_of(kind, points, material, precision, maxima=True)
    solver.advance(1e9, max_steps=steps)
    particles = solver.frame().particles
    order = np.argsort(particles.id)
    return particles.position[order], particles.velocity[order]


def agreement(points, steps, materials, precisions, jobs=1):
    """Rows of the comparison with the processor, for each material and precision; `jobs` at the same time."""
    tasks = [(points, steps, material, precision) for material in materials for precision in precisions]
    yield from in_processes(compared, tasks, jobs)


def in_processes(work, tasks, jobs):
    """`work(*task)` of all `tasks`, in order, in `jobs` processes with one thread each; 1: in this process."""
    if jobs <= 1:
        yield from (work(*task) for task in tasks)
        return
    given = os.environ.get("NUMBA_NUM_THREADS")
    os.environ["NUMBA_NUM_THREADS"] = "1"
    try:
        with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
            yield from pool.map(work, *zip(*tasks, strict=True))
    finally:
        os.environ.pop("NUMBA_NUM_THREADS")
        os.environ.update({} if given is None else {"NUMBA_NUM_THREADS": given})


def compared(points, steps, material, precision):
    """Row of the comparison with the processor for a material and precision."""
    allowed, task = AGREES[precision], (points, steps, material, precision)
    known, found, again = (state_after(kind, *task) for kind in (PointSolver, *2 * [DevicePointSolver]))
    place = float(np.abs(found[0] - known[0]).max())
    speed = float(np.abs(found[1] - known[1]).max() / max(np.abs(known[1]).max(), 1e-300))
    repeated = all(np.array_equal(one, other) for one, other in zip(found, again, strict=True))
    return {
        "material": material,
        "precision": precision,
        "points": len(known[0]),
        "steps": steps,
        "place_cells": place,
        "speed_relative": speed,
        "allowed": allowed,
        "same_bits": repeated,
        "agrees": bool(max(place, speed) <= allowed and repeated),
    }


def sanitized(script, particles):
    """Result of compute-sanitizer for WARM_UP steps of `script`, or the reason why it was not run."""
    tool = shutil.which("compute-sanitizer")
    if tool is None:
        return {"ran": False, "reason": "compute-sanitizer is not installed"}
    command = [
        *(tool, "--tool", "memcheck", "--error-exitcode", "9", sys.executable, script, "--only-steps"),
        *("--checked", str(particles), "--steps", str(WARM_UP)),
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SANITIZER_SECONDS)
    except subprocess.TimeoutExpired:
        return {"ran": False, "reason": f"stopped after {SANITIZER_SECONDS} s"}
    lines = (done.stdout + done.stderr).splitlines()
    return {"ran": True, "clean": done.returncode == 0, "last_lines": lines[-5:]}


def event_seconds(work):
    """Time [s] of `work()` on the device, between two CUDA events."""
    from numba import cuda

    start, end = cuda.event(), cuda.event()
    start.record()
    work()
    end.record()
    end.synchronize()
    return 1e-3 * float(start.elapsed_time(end))


def copy_bandwidth(size=1 << 30, times=10):
    """Bandwidth [B s-1] of copies on the device, bytes read and written."""
    from numba import cuda

    one, other = cuda.device_array(size, np.uint8), cuda.device_array(size, np.uint8)

    def copies():
        for _ in range(times):
            other.copy_to_device(one)

    copies()
    return 2.0 * size * times / min(event_seconds(copies) for _ in range(3))


def free_memory():
    """Free memory [bytes] of the device, after the arrays that nothing refers to are released."""
    from numba import cuda

    gc.collect()
    context = cuda.current_context()
    if not numba.config.ENABLE_CUDASIM:
        context.memory_manager.deallocations.clear()  # numba-cuda releases several at a time
    return context.get_memory_info()[0]


def measured_on_device(make, particles):
    """Row of a run of the solver `make()` on the device, with the memory that it uses.

    `particles` is "points" or "columns"; ns per particle and step.
    """
    free = free_memory()
    solver = make()
    solver.advance(1e9, max_steps=WARM_UP)
    taken, count, before = free - free_memory(), solver.particles, solver.step
    seconds = [event_seconds(lambda: solver.advance(1e9, max_steps=STEPS)) for _ in range(REPEATS)]
    if solver.step - before != REPEATS * STEPS:
        return {"not_run": f"stopped after {solver.step - before} steps"}
    each = np.array(seconds) / (STEPS * count) * 1e9
    return {
        particles: count,
        "ns": float(np.median(each)),
        "ns_least": float(each.min()),
        "ns_most": float(each.max()),
        f"bytes_per_{particles[:-1]}": taken / count,
    }


def kernel_times(make):
    """Time of each kernel [ns per particle and step] in steps of the solver `make()`, launched one by one.

    With few particles these times are those of the launches.
    """
    from numba import cuda

    from mpmgis.solvers.gpu import device_functions, launch_graph

    solver, events = make(), []
    solver.advance(1e9, max_steps=WARM_UP)
    kernel_of, repeat = device_functions.Kernel.of, launch_graph.Repeated.__call__

    class Timed:
        def __init__(self, kernel, name):
            self.kernel, self.name = kernel, name

        def __getitem__(self, sizes):
            return partial(self.launch, sizes)

        def launch(self, sizes, *arguments):
            start, end = cuda.event(), cuda.event()
            start.record(sizes[2])
            self.kernel[sizes](*arguments)
            end.record(sizes[2])
            events.append((self.name, start, end))

    device_functions.Kernel.of = lambda self, real: Timed(kernel_of(self, real), self.function.__name__)
    launch_graph.Repeated.__call__ = lambda self, times: [self.launches() for _ in range(times)]
    try:
        solver.advance(1e9, max_steps=STEPS)
    finally:
        device_functions.Kernel.of, launch_graph.Repeated.__call__ = kernel_of, repeat
    found, scale = {}, 1e6 / (STEPS * solver.particles)
    for name, start, end in events:
        end.synchronize()
        found[name] = found.get(name, 0.0) + float(start.elapsed_time(end)) * scale
    return dict(sorted(found.items(), key=lambda one: -one[1]))


def on_threads(make, particles):
    """Rows of `measured_on_processor` on 1, 2, 4, ... threads, with the speed-up over one thread."""
    from mpmgis.compiled.jit import set_threads

    most, rows, threads, solver = numba.config.NUMBA_NUM_THREADS, [], 1, make()
    while threads <= most:
        set_threads(threads)
        rows.append({"threads": threads} | measured_on_processor(lambda: solver, particles))
        rows[-1]["times_faster"] = rows[0]["ns_least"] / rows[-1]["ns_least"]
        threads = most if threads < most < 2 * threads else 2 * threads
    set_threads(most)
    return rows


def measured_on_processor(make, particles):
    """As `measured_on_device` on all cores of the processor, without the memory."""
    solver = make()
    solver.advance(1e9, max_steps=STEPS_ON_PROCESSOR)
    count, each = solver.particles, []
    for _ in range(REPEATS_ON_PROCESSOR):
        began = time.perf_counter()
        solver.advance(1e9, max_steps=STEPS_ON_PROCESSOR)
        each.append((time.perf_counter() - began) / (STEPS_ON_PROCESSOR * count) * 1e9)
    return {particles: count, "ns": float(np.median(each)), "ns_least": float(min(each))}


def timed_on_device(points, precision):
    """Row of a run on the device."""
    row = {"points": points, "precision": precision}
    if lack := no_room(points, precision):
        return row | {"not_run": lack}
    return row | measured_on_device(lambda: solver_of(DevicePointSolver, points, precision=precision), "points")


def kernels_of(sizes, precision):
    """`kernel_times` of the largest of the `sizes` that is at most KERNELS_OF [points] and fits, or why none is."""
    points = max((size for size in sizes if size <= KERNELS_OF), default=min(sizes))
    if lack := no_room(points, precision):
        return {"not_run": lack}
    return kernel_times(lambda: solver_of(DevicePointSolver, points, precision=precision))


def timed_on_processor(points, precision):
    """Row of a run on all cores of the processor."""
    row = {"points": points, "precision": precision}
    if points > LARGEST_ON_PROCESSOR or lack_of_memory(HOST_BYTES_PER_POINT * points):
        return row | {"not_run": "too large for the processor"}
    return row | measured_on_processor(lambda: solver_of(PointSolver, points, precision=precision), "points")


def timed_scene(kind, points, precision):
    """Row of a whole run with frames: wall time [s] from the first frame to the last one on the disk."""
    lack = no_room(points, precision)
    if lack:
        return {"points": points, "precision": precision, "not_run": lack}
    solver = solver_of(kind, points, precision=precision, maxima=True)
    solver.advance(1e9, max_steps=2)  # compiles
    return run_scene(solver_of(kind, points, precision=precision, maxima=True), precision)


def run_scene(solver, precision):
    """Row of a whole run of `solver` with frames, as `mpmgis run` integrates and writes them."""
    with tempfile.TemporaryDirectory() as folder:
        run = write_run(solver, SCENE_SECONDS, SCENE_SECONDS / SCENE_FRAMES, folder)
    return {
        "points": solver.particles,
        "precision": precision,
        "steps": solver.step,
        "seconds": run.seconds,
        "frames": run.frames,
        "seconds_of_frames": run.beside_steps,
    }


def whole_scenes(points, precisions):
    """Rows of a whole run on the device and on the processor, and the speed-up by the device."""
    for precision in precisions:
        device, processor = (timed_scene(kind, points, precision) for kind in (DevicePointSolver, PointSolver))
        row = {"precision": precision, "device": device, "processor": processor}
        if "seconds" in device and "seconds" in processor:
            row["times_faster"] = processor["seconds"] / device["seconds"]
        yield row


def no_room(points, precision):
    """Why a run does not fit into the memory of the host or of the device; "" if it does."""
    return lack_of_memory(HOST_BYTES_PER_POINT * points, device_memory(points, precision, SOIL))


def lack_of_memory(on_host, on_device=0):
    """Why a memory [bytes] is not available; "" if it is."""
    if on_host > 0.8 * available_memory():
        return f"the host has {available_memory() / 1e9:.3g} GB free"
    free = free_memory() if on_device else 0
    return f"the device has {free / 1e9:.3g} GB free" if on_device > free else ""


def machine():
    """The machine of the measurement."""
    from importlib.metadata import version

    names = ("numba", "numba-cuda", "numpy", "scipy", "h5py")
    return {
        "device": found_device().line(),
        "processor": platform.processor() or platform.machine(),
        "threads": numba.config.NUMBA_NUM_THREADS,
        "python": platform.python_version(),
        **{name: version(name) for name in names},
    }


def text_of(found):
    """The results as lines of text."""
    yield from (f"{name}: {value}" for name, value in found["machine"].items())
    for row in found["agreement"]:
        verdict, repeated = "agrees" if row["agrees"] else "DIFFERS", "equal" if row["same_bits"] else "DIFFERENT"
        yield (
            f"{verdict}: {row['material']}, {row['precision']}, {row['points']} points, {row['steps']} steps: places "
            f"{row['place_cells']:.1e} cells, speeds {row['speed_relative']:.1e}, bits of two runs {repeated}"
        )
    if "sanitizer" in found:
        yield f"compute-sanitizer: {found['sanitizer']}"
    if "copy_bandwidth" in found:
        yield f"copy bandwidth: {found['copy_bandwidth'] / 1e12:.3g} TB/s"
    for where in ("device", "processor"):
        for row in found.get(f"on_{where}", ()):
            words = words_of(row)
            if where == "device" and "ns" in row:
                floor = 1e9 * FLOOR_BYTES[row["precision"]] / found["copy_bandwidth"]
                words += f", {row['ns'] / floor:.3g} times its floor of {floor:.3g} ns by the copy bandwidth"
            yield f"{where}: {row['points']} points, {row['precision']}: {words}"
    yield from text_of_kernels(found)
    for row in found.get("scenes", ()):
        for where in ("device", "processor"):
            one = row[where]
            words = one.get("not_run") or (
                f"{one['steps']} steps, {one['seconds']:.3g} s, {one['seconds_of_frames']:.3g} s of them for "
                f"{one['frames']} frames"
            )
            yield f"whole scene, {where}: {one['points']} points, {row['precision']}: {words}"
        if "times_faster" in row:
            yield f"whole scene, {row['precision']}: the device is {row['times_faster']:.3g} times faster"


def text_of_kernels(found):
    """Times of kernels and of numbers of threads as lines of text."""
    for name, value in found.get("kernels", {}).items():
        yield f"kernel {name}: {value if isinstance(value, str) else f'{value:.3g} ns'}"
    for row in found.get("on_threads", ()):
        yield f"processor, {row['threads']} threads: ns {row['ns_least']:.4g}, {row['times_faster']:.3g} times faster"


def words_of(row):
    """Result of a timed run, or why it was not run."""
    numbers = (f"{name} {value:.4g}" for name, value in row.items() if name.startswith(("ns", "bytes")))
    return row.get("not_run") or ", ".join(numbers)


def write(found, folder):
    """Write what is known so far to `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "gpu.json").write_text(json.dumps(found, indent=1) + "\n")
    (folder / "gpu.txt").write_text("".join(f"{line}\n" for line in text_of(found)))


def measure(folder, sizes, scene, checked, steps, materials, precisions, jobs):
    """Write all parts to `folder`, for `sizes` and a whole `scene` [points]; returns whether the results agree."""
    found = {"machine": machine(), "agreement": []}
    for row in agreement(checked, steps, materials, precisions, jobs):
        found["agreement"].append(row)
        write(found, folder)
    if not numba.config.ENABLE_CUDASIM:
        found["sanitizer"] = sanitized(__file__, CHECKED_POINTS)
        found["copy_bandwidth"] = copy_bandwidth()
        write(found, folder)
        for where, timed in (("device", timed_on_device), ("processor", timed_on_processor)):
            rows = found[f"on_{where}"] = []
            for points in sizes:
                for precision in precisions:
                    rows.append(timed(points, precision))
                    write(found, folder)
        found["kernels"] = kernels_of(sizes, precisions[0])
        found["on_threads"] = on_threads(lambda: solver_of(PointSolver, ON_THREADS, precision=precisions[0]), "points")
        write(found, folder)
    if scene:
        found["scenes"] = []
        for row in whole_scenes(scene, precisions):
            found["scenes"].append(row)
            write(found, folder)
    print((folder / "gpu.txt").read_text(), end="")
    return all(row["agrees"] for row in found["agreement"])


def main():
    """The command; returns its exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", nargs="?", type=Path, default=Path("gpu_bench"), help="folder for gpu.json and gpu.txt")
    parser.add_argument("--millions", nargs="+", type=float, default=[0.1, 1, 10, 100], help="millions of points")
    parser.add_argument("--scene-millions", type=float, default=10, help="millions of points of the scene; 0: no scene")
    parser.add_argument("--checked", type=int, default=CHECKED_POINTS, help="points of the comparison")
    parser.add_argument("--steps", type=int, default=CHECKED_STEPS, help="steps of the comparison")
    parser.add_argument("--materials", nargs="+", choices=MATERIALS, default=list(MATERIALS), help="to be compared")
    parser.add_argument("--precisions", nargs="+", choices=AGREES, default=["float32", "float64"], help="of all parts")
    parser.add_argument("--jobs", type=int, default=1, help="comparisons at the same time")
    parser.add_argument("--only-steps", action="store_true", help="only some steps, for compute-sanitizer; no results")
    given = parser.parse_args()
    found = found_device()
    if found.device is None:
        print(f"nothing is measured: {found.lack}", file=sys.stderr)
        return 1
    if given.only_steps:
        solver_of(DevicePointSolver, given.checked).advance(1e9, max_steps=given.steps)
        return 0
    sizes = [round(1e6 * size) for size in given.millions]
    scene = round(1e6 * given.scene_millions)
    agrees = measure(given.out, sizes, scene, given.checked, given.steps, given.materials, given.precisions, given.jobs)
    return 0 if agrees else 1


if __name__ == "__main__":
    sys.exit(main())
