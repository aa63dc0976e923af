"""Cost of a step of the depth-averaged solver from 1e4 to 1e7 columns, and the plot of performance.md.

Writes `sample_data/solver_cost.png`. Every scene is the sliding sheet of the benchmark `solver` in another size. The
reference is the memory floor: the time to copy the bytes that a step must read and write, at the rate of a large copy
on this machine.
"""

import os
import tempfile
import time
from pathlib import Path

import numpy as np
from bench_solver import BYTES, copy_rate, scene

from mpmgis.compiled.jit import set_threads

PICTURE = Path(__file__).parents[2] / "sample_data" / "solver_cost.png"
SIDES = (100, 316, 1000, 3162)  # columns along a side of the sheet: 1e4 to 1e7
STEPS = 40  # timed in each repeat: as many as two rounds of putting rows into order
LARGE = 2_000_000  # columns from which on a sheet is started only once
MEMORY_OF_THE_LARGEST = 8e9  # [bytes]


def nanoseconds(side, threads):
    """Least ns per column and step over the repeats, for each of `threads`, after a warm-up that compiles.

    A small sheet is started again for each repeat, before it slides off its terrain.
    """
    columns, best, solver = side * side, {}, None
    steps, repeats = (STEPS, 8) if columns < LARGE else (STEPS // 2, 2)
    for used in threads:
        for _ in range(repeats):
            if solver is None or columns < LARGE:
                solver = scene(side)
                solver.advance(1e9, max_steps=5)
            set_threads(used)
            began = time.perf_counter()
            solver.advance(1e9, max_steps=steps)
            best[used] = min(best.get(used, np.inf), (time.perf_counter() - began) / (steps * columns) * 1e9)
    if solver.particles != columns:
        raise RuntimeError(f"{columns - solver.particles} columns left the terrain; the figure is too low")
    return best


def free_memory():
    """Free memory of this machine [bytes], or infinite if it is unknown."""
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return np.inf


def draw(measured, floor, path):
    """Plot the time per column and step [ns] against the number of columns, for each number of threads."""
    os.environ.setdefault("MPLCONFIGDIR", tempfile.gettempdir())
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 3.2), layout="constrained")
    for (threads, points), marker in zip(measured.items(), "os", strict=True):
        axes.plot(*zip(*points, strict=True), marker=marker, label=f"{threads} thread{'s' * (threads > 1)}")
    axes.axhline(floor, color="0.5", linestyle=":", label="bytes of a step through memory")
    axes.set(xscale="log", xlabel="columns", ylabel="ns per column and step")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    pyplot.close(figure)


def rows():
    """Rows of the table: time per column and step for each size, and its ratio to that of 1e4 columns."""
    floor = BYTES / copy_rate() * 1e9
    measured = {1: [], 2: []}
    for side in SIDES:
        columns = side * side
        if columns == max(SIDES) ** 2 and free_memory() < MEMORY_OF_THE_LARGEST:
            yield f"{columns:,} columns", None, "ns/column/step", f"skipped: wants {MEMORY_OF_THE_LARGEST:.0e} B", None
            continue
        for threads, cost in nanoseconds(side, [t for t in measured if set_threads(t) == t]).items():
            points = measured[threads]
            points.append((columns, cost))
            case = f"{columns:,} columns, {threads} thread{'s' * (threads > 1)}"
            yield case, cost, "ns/column/step", f"{points[0][0]:,} columns, {points[0][1]:.1f} ns", cost / points[0][1]
    yield "memory floor of a step", floor, "ns/column/step", f"{BYTES} bytes at this machine's copy rate", None
    draw({threads: points for threads, points in measured.items() if points}, floor, PICTURE)
    yield "picture written", None, "", str(PICTURE.name), None
