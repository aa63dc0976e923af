"""Predicted over taken time of runs: as predicted after their first second, alone and while all cores are busy.

`python tests/bench/run.py prediction`, ten minutes. A run is longer than predicted where other programs start beside
it; the head of the table shows the load.
"""

import multiprocessing
import os
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "scenes"))
sys.path.insert(0, str(Path(__file__).parent))
import chain
import defaults

from mpmgis.simulation.scene_run import run
from mpmgis.system.messages import muted

LIMIT = {2: 1.3, 3: 1.5}  # dimension -> largest factor between predicted and taken time


def lecco(name, folder, **changed):
    """Mud of Lecco, a tenth of its columns."""
    chain.scene_module("lecco").write_inputs(folder)
    return chain.write_scene(name, folder, particles_per_cell=36, **changed)


def water(folder):
    """Water down a plane, between walls."""
    wall = chain.scene_module("wall")
    wall.scene_in(folder, "wall/free", wall.Size())


def matter(folder):
    """The slide of Matter, from its particles."""
    chain.scene_module("matter_terrain").write_inputs(folder)
    chain.write_scene("matter_terrain", folder)


def ice(folder):
    """The ice avalanche of Whymper, with cells of 5 m."""
    chain.scene_module("whymper").write_all(folder, 5.0, 150.0)


def stages(folder):
    """Columns, then points at the barrier."""
    path = lecco("lecco", folder)
    path.write_text(path.read_text().replace("cell_size = 0.625", "cell_size = 1.5"))


def sand(folder):
    """Sand down a flume three cells wide, onto a wall."""
    flume = chain.scene_module("sand_flume")
    size = flume.Size(45.0, 0.025)
    flume.write_inputs(folder, size)
    chain.write_scene("sand_flume", folder, cell_size=size.cell)


CASES = {  # words -> (dimension, function that writes the scene)
    "the sample site": (2, defaults.shipped.demo),
    "ISeeSnow IdealizedTopo": (2, defaults.ideal),
    "mud of Lecco, columns": (2, lambda folder: lecco("lecco/columns", folder)),
    "water down a plane": (2, water),
    "slide of Matter": (3, matter),
    "ice avalanche": (3, ice),
    "mud of Lecco, two stages": (3, stages),
    "sand in a flume": (3, sand),
}


def _spin():
    while True:
        pass


@contextmanager
def busy(processes):
    """Keep cores busy with other processes within this block."""
    others = [multiprocessing.get_context("spawn").Process(target=_spin, daemon=True) for _ in range(processes)]
    for other in others:
        other.start()
    try:
        yield
    finally:
        for other in others:
            other.terminate()
            other.join()


def rows():
    """Predicted over taken wall time of each case; shorter runs than a second are not predicted."""
    for words, (dimension, write) in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            write(folder)
            for load, others in (("alone", 0), ("cores busy", os.cpu_count())):
                with busy(others), muted():
                    found = run(folder / "scene.toml", folder / "results", overwrite=True)
                predicted, limit = found.predicted_seconds, LIMIT[dimension]
                taken = f"{found.wall_seconds:.3g} s taken; required {1 / limit:.2f} to {limit}"
                case = f"{dimension}D, {words}, {load}"
                yield case, predicted, "s predicted", taken, predicted and predicted / found.wall_seconds
