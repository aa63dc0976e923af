"""Parts of the benchmarks for a GPU in the CUDA simulator, with few particles; prints what they found as JSON.

Run as `python simulated_bench.py OUT` with NUMBA_ENABLE_CUDASIM=1 (`test_gpu_benchmarks.py` does). The simulator has no
times of events and no memory: they are replaced by the clock of the host and by a number that decreases.
"""

import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace

from numba import cuda

sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
import gpu
import gpu_columns

POINTS, COLUMNS = 64, 64
TAKEN = 6400  # bytes between two questions for the free memory


class Event:
    """A CUDA event with the time of the host [ms]."""

    def record(self, stream=0):
        self.at = 1e3 * time.perf_counter()

    def synchronize(self):
        pass

    def elapsed_time(self, later):
        return later.at - self.at


class Memory:
    """A context whose free memory [bytes] decreases."""

    free = 1e12

    def get_memory_info(self):
        Memory.free -= TAKEN
        return Memory.free, 1e12


def prepare():
    """Replace events and memory, and let the benchmarks take few steps."""
    cuda.event, cuda.current_context = Event, Memory
    gpu.STEPS, gpu.REPEATS, gpu.WARM_UP, gpu.STEPS_ON_PROCESSOR, gpu.REPEATS_ON_PROCESSOR = 1, 2, 1, 1, 2
    gpu.SCENE_SECONDS, gpu.SCENE_FRAMES = 0.02, 2


def points(folder):
    """All parts of gpu.py but the comparison, whose rows are here none, as `measure` calls them."""
    found = {"machine": gpu.machine(), "agreement": [], "sanitizer": gpu.sanitized(gpu.__file__, POINTS)}
    found["copy_bandwidth"] = gpu.copy_bandwidth(1 << 10, 2)
    found["on_device"] = [gpu.timed_on_device(POINTS, "float32")]
    found["on_device"].append(without_memory(gpu.timed_on_device, "float32"))
    found["on_processor"] = [gpu.timed_on_processor(POINTS, "float32"), gpu.timed_on_processor(10**9, "float32")]
    found["scenes"] = list(gpu.whole_scenes(POINTS, ["float32"]))
    found["kernels"] = gpu.kernels_of([POINTS], "float32")
    found["on_threads"] = gpu.on_threads(lambda: gpu.solver_of(gpu.PointSolver, POINTS), "points")
    gpu.write(found, folder)
    return found


def columns(folder):
    """All parts of gpu_columns.py but the comparison."""
    found = {"machine": gpu.machine(), "agreement": []}
    found["sanitizer"] = gpu_columns.sanitized(gpu_columns.__file__, COLUMNS)
    found["on_device"] = [gpu_columns.timed_on_device(COLUMNS, "Voellmy")]
    found["on_device"].append(without_memory(gpu_columns.timed_on_device, "Voellmy"))
    found["on_processor"] = [gpu_columns.timed_on_processor(n, "Voellmy") for n in (COLUMNS, 10**9)]
    found["kernels"] = gpu_columns.kernels_of([COLUMNS], "Voellmy")
    gpu_columns.write(found, folder)
    return found


def without_memory(timed, *arguments):
    """The row of a hundred million particles on a device that has no room for them, on a host that has."""
    context, available = cuda.current_context, gpu.available_memory
    cuda.current_context = lambda: SimpleNamespace(get_memory_info=lambda: (1e9, 1e12))
    gpu.available_memory = lambda: 1e12
    try:
        return timed(100_000_000, *arguments)
    finally:
        cuda.current_context, gpu.available_memory = context, available


if __name__ == "__main__":
    prepare()
    print(json.dumps({"points": points(Path(sys.argv[1])), "columns": columns(Path(sys.argv[1]))}))
