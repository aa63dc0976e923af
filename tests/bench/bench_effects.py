"""What the absence of each effect of the depth-averaged solver costs: a step against that of a program without it.

One compiled program has all effects; a scene without an effect takes the branches around it. Here the same scene, with
Coulomb friction alone, runs in two processes: the package as it is, and a copy of it in which the conditions of one
effect are replaced by False before it is compiled. Both time the same steps in turns, with the processor time of one
thread, so that other work on the machine acts on both; the ratio is the median over the pairs.
"""

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from os import environ
from pathlib import Path

ROOT = Path(__file__).parents[2]
COLUMNS, NODES = "solvers/columns/", "solvers/columns/column_nodes.py"
LOOP, FOREST = "solvers/columns/column_loop.py", "solvers/columns/column_forest.py"
TO_GRID, MOTION = "solvers/columns/columns_to_grid.py", "solvers/columns/column_motion.py"
# effect -> (file, condition, what is compiled in its place)
CONDITIONS = {
    "nothing": (),
    "other laws of friction": (("laws/friction.py", "    if law.kind == COULOMB:\n", "    if True:\n"),),
    "zones": ((NODES, "if laws.zones else laws.friction", "if False else laws.friction"),),
    "cohesion": ((NODES, "        dry += laws.cohesion\n", ""),),
    "form swe": (
        ("laws/ground_metric.py", "if metric == WATER:", "if False:"),
        (TO_GRID, "if laws.metric == WATER:", "if False:"),
        (MOTION, "if laws.metric == WATER:", "if False:"),
    ),
    "curvature": (
        (NODES, "if laws.curvature & LOAD:", "if False:"),
        (MOTION, "elif laws.curvature & TURN:", "elif False:"),
    ),
    "still water": ((TO_GRID, "if laws.still_water:", "if False:"),),
    "earth pressure": ((TO_GRID, "if not is_hydrostatic(laws.earth_pressure):", "if False:"),),
    "viscosity": ((TO_GRID, "if is_viscous(laws.viscosity):", "if False:"),),
    "entrainment": tuple(
        (file, f"if {slot}.{condition}:", "if False:")
        for file, slot, condition in (
            (NODES, "entrainment", "kind != NO_EROSION"),
            (NODES, "entrainment", "lowering > 0.0"),
            (MOTION, "entrainment", "kind != NO_EROSION"),
            (MOTION, "laws.entrainment", "kind != NO_EROSION"),
            (LOOP, "entrainment", "lowering > 0.0"),
        )
    ),
    "barriers": ((LOOP, "if effects.barrier:", "if False:"),),
    "forest": ((LOOP, "if effects.forest:", "if False:"), (NODES, "if forest:", "if False:")),
}
PER_SIDE, DX = 300, 5.0  # columns along a side, 16 per cell
STEPS, ROUNDS = 40, 25
WORKER = "--steps"  # argument with which this file times steps when it is asked to


def rows():
    """Rows of the table."""
    with tempfile.TemporaryDirectory() as folder:
        for effect, conditions in CONDITIONS.items():
            copied = without(conditions, Path(folder) / effect.replace(" ", "_"))
            whole, without_it = compared(ROOT, copied)
            ratio = statistics.median(a / b for a, b in zip(whole, without_it, strict=True))
            yield f"a step without {effect}", min(whole), "ns/column/step", "a program without its code", ratio
            shutil.rmtree(copied)


def without(conditions, folder):
    """Copy the package into `folder` with other `conditions`; the path to import it from."""
    shutil.copytree(ROOT / "mpmgis", folder / "mpmgis", ignore=shutil.ignore_patterns("__pycache__", "docs"))
    for file, condition, instead in conditions:
        path = folder / "mpmgis" / file
        text = path.read_text()
        if condition not in text:
            raise ValueError(f"{file} has no {condition!r}; change CONDITIONS")
        path.write_text(text.replace(condition, instead))
    return folder


def compared(one, other):
    """Times [ns] of a column and step of the packages in two folders, measured in turns, ROUNDS of each."""
    times = [], []
    with ExitStack() as stack:
        workers = [stack.enter_context(worker(folder)) for folder in (one, other)]
        for number in range(ROUNDS):
            for k in (0, 1) if number % 2 else (1, 0):
                times[k].append(asked(workers[k]))
    return times


@contextmanager
def worker(folder):
    """A process that times steps of the package in `folder`, ready and compiled."""
    command = [sys.executable, __file__, WORKER]
    path = {**environ, "PYTHONPATH": str(folder), "MPMGIS_CACHE_DIR": tempfile.mkdtemp(dir=folder.parent)}
    path = path if folder != ROOT else {**environ, "PYTHONPATH": str(folder)}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=path) as process:
        asked(process)
        yield process
        process.stdin.close()


def asked(process):
    """Ask a worker for the time of a column and step [ns]."""
    process.stdin.write("\n")
    process.stdin.flush()
    return float(process.stdout.readline())


def time_steps():
    """Print the processor time [ns] of a column and step for each line of the standard input, from the same state."""
    sys.path.insert(0, str(ROOT / "tests" / "solvers"))
    import numpy as np
    from column_scenes import columns_of, solver_on, terrain_of

    from mpmgis.compiled.jit import set_threads
    from mpmgis.laws.friction import friction_law

    set_threads(1)
    size = PER_SIDE * DX / 4 + 400
    terrain = terrain_of(lambda x, y: 0.5 * (size - x) + 5 * np.sin(x / 50) * np.cos(y / 60), size, size, DX)
    frame = columns_of(2.0, 100, 100 + PER_SIDE * DX / 4, 100, 100 + PER_SIDE * DX / 4, DX / 4)
    solver = solver_on(terrain, frame, DX, friction_law("Coulomb", 0.2))
    solver.advance(1e9, max_steps=5)
    start = solver.frame()
    for _ in sys.stdin:
        solver.restore(start, known=True)
        solver.advance(1e9, max_steps=2)
        began = time.process_time()
        solver.advance(1e9, max_steps=STEPS)
        print((time.process_time() - began) / STEPS / len(frame.particles) * 1e9, flush=True)


if __name__ == "__main__" and WORKER in sys.argv:
    time_steps()
