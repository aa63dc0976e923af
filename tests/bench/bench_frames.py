"""Time of a frame of a run without the steps: sums, guards, digests and the file, against writing as many bytes."""

import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
import bench_points
import bench_solver
from written_run import write_run

from mpmgis.compiled.jit import set_threads

FRAMES, SECONDS = 6, 0.02  # after the first; simulated time [s] between them


def integrated(solver, folder):
    """(wall time [s] without the steps, bytes) of a frame of `solver`, written to `folder`."""
    run = write_run(solver, solver.time + FRAMES * SECONDS, SECONDS, folder)
    return run.beside_steps / run.frames, run.size / run.frames


def written(size, folder):
    """Wall time [s] to write `size` bytes to `folder` and flush them to the disk."""
    data = os.urandom(1 << 20) * (1 + int(size) // (1 << 20))
    began = time.perf_counter()
    with open(Path(folder) / "bytes", "wb") as file:
        file.write(memoryview(data)[: int(size)])
        file.flush()
        os.fsync(file.fileno())
    return time.perf_counter() - began


def solvers():
    """Name -> solver of half a million particles."""
    for precision in ("float32", "float64"):
        yield f"points, Drucker-Prager, {precision}", bench_points.scene(bench_points.SOIL, precision=precision)
    yield "columns", bench_solver.scene(708)


def rows():
    """ns per particle and frame without the steps, on 1 and 2 threads, over the time to write as many bytes."""
    for name, solver in solvers():
        particles = len(solver.frame().particles)
        solver.advance(solver.time + SECONDS)  # compiles
        for threads in (1, 2):
            set_threads(threads)
            with tempfile.TemporaryDirectory() as folder:
                integrated(solver, folder)  # compiles, and fills the cache of the disk
                seconds, size = min(integrated(solver, folder) for _ in range(2))
                reference = min(written(size, folder) for _ in range(3))
            set_threads(None)
            yield (
                f"a frame, {name}, {threads} threads",
                seconds / particles * 1e9,
                "ns a particle",
                f"writing its {size / particles:.0f} bytes",
                seconds / reference,
            )
