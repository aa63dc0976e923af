"""What a module that writes a solver's files offers: a SolverFiles."""

import json
from collections.abc import Callable
from typing import NamedTuple

UPWARDS = ("e", "n", "u")
Y_UP = ("e", "u", "-n")


class SolverFiles(NamedTuple):
    """A solver that starts from files of ours.

    Parameters
    ----------
    name, title : str
        On the command line; to people.
    write : callable
        `write(start, folder, number)` puts a SolverStart's files into `folder`; `number` counts the frames.
    read_back : callable
        `read_back(folder, number)`: (float64[n, 3] [m] place along E, N, up, float64[n] [m3] volume) as the files say.
    files : str
        What lies in the folder, for its README.txt.
    start : str
        How to start the solver with it.
    keeps, loses : str
        Of a point, besides place, mass and stress.
    takes_stress : bool
    laws : tuple of str
        Laws of [material] that it has too; empty where it needs no material.
    needs_grid : bool
        It wants a background grid.
    needs_bed_friction : bool
    axes : tuple of str
        Where its files' x, y and z point.
    tolerance : float
        Largest error of a place, as a share of the box, with which its files tell it.
    now : bool
        Its volumes are the frame's own; else mass over density, from which it makes the mass.
    finish : callable or None
        `finish(folder, times)` once all frames are written; only solvers that have it take several.
    terrain_on_grid : bool
        Its ground is made of the grid's nodes, as text (`write_terrain`).
    results : str
        Its results as `mpmgis export-raster` takes them.
    """

    name: str
    title: str
    write: Callable
    read_back: Callable
    files: str
    start: str
    keeps: str
    loses: str = ""
    takes_stress: bool = False
    laws: tuple = ()
    needs_grid: bool = False
    needs_bed_friction: bool = False
    axes: tuple = UPWARDS
    tolerance: float = 1e-9
    now: bool = False
    finish: Callable | None = None
    terrain_on_grid: bool = False
    results: str = ""


def write_json(path, content):
    """Write plain data as JSON."""
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")
