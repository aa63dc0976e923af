"""What a frame of a run takes beside the steps: sums, guards, digests and the file, against writing as many bytes."""

import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
import bench_points
import bench_solver

from mpmgis.io.frame_contents import result_after
from mpmgis.io.frames import drop_state, write_frame
from mpmgis.kernels.jit import set_threads
from mpmgis.solvers.integrate import TimeIntegration

FRAMES, SECONDS = 6, 0.02  # after the first; simulated time [s] between them
WITH_STATE = 2  # the newest, as in the folder of a run


def integrated(solver, folder):
    """(wall time [s] beside the steps, bytes) of a frame of `solver`, written to `folder` as `mpmgis run` does."""
    began, paths, digest, size = time.perf_counter(), [], "", 0
    integration = TimeIntegration(solver, solver.time + FRAMES * SECONDS, SECONDS)
    for frame in integration:
        paths.append(Path(folder) / f"frame_{len(paths):04d}.h5")
        digest = result_after(digest, write_frame(paths[-1], frame, digest))
        size += paths[-1].stat().st_size
        if len(paths) > WITH_STATE:
            drop_state(paths[-1 - WITH_STATE])
    return (time.perf_counter() - began - integration.step_seconds) / len(paths), size / len(paths)


def written(size, folder):
    """Wall time [s] in which `size` bytes are written to `folder` and flushed to the disk."""
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
    """ns per particle and frame beside the steps, on 1 and 2 threads, over the time to write the bytes of the frame."""
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
                f"a frame, {name}, {threads} threads", seconds / particles * 1e9, "ns a particle",
                f"writing its {size / particles:.0f} bytes", seconds / reference,
            )  # fmt: skip
