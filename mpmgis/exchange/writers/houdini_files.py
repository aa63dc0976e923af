"""Houdini: one .ply per frame, y up, for its File node."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..readers.ply import read_ply_columns, read_ply_header
from .start_files import Y_UP, SolverFiles

ROW = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "vx", "vy", "vz", "mass", "volume", "density")] + [("id", "<i4")]
)
TYPES = {"f4": "float", "i4": "int"}


def name_of(number: int) -> str:
    """Return the file name of a frame.

    Parameters
    ----------
    number : int
        Of the frame.
    """
    return f"points_{number:04d}.ply"


def write(start: Any, folder: Path, number: int) -> None:
    """Write the points of a start: x east, y up, z south, float32 as in Houdini.

    Parameters
    ----------
    start : SolverStart
    folder : Path
    number : int
        Of the frame.
    """
    rows = np.zeros(len(start.mass), ROW)
    for letter, prefix in (("position", ""), ("velocity", "v")):
        east, north, up = getattr(start, letter).T
        rows[f"{prefix}x"], rows[f"{prefix}y"], rows[f"{prefix}z"] = east, up, -north
    rows["mass"], rows["volume"], rows["density"] = start.mass, start.current_volume, start.mass / start.current_volume
    rows["id"] = start.ids
    properties = "".join(f"property {TYPES[ROW[name].str[1:]]} {name}\n" for name in ROW.names)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{properties}end_header\n"
    with open(folder / name_of(number), "wb") as sink:
        sink.write(head.encode("ascii"))
        rows.tofile(sink)


def read_back(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read positions and volumes from the vertices.

    Parameters
    ----------
    folder : Path
    number : int
        Of the frame.

    Returns
    -------
    position : float64[n, 3] [m]
    volume : float64[n] [m3]
    """
    path = folder / name_of(number)
    found = read_ply_columns(path, read_ply_header(path), ("x", "y", "z", "volume"))
    return np.column_stack([found["x"], -found["z"], found["y"]]), found["volume"]


def finish(folder: Path, times: Sequence[float]) -> None:
    """Do nothing: Houdini finds the sequence by its numbers.

    Parameters
    ----------
    folder : Path
    times : sequence of float [s]
    """


FILES = SolverFiles(
    name="houdini",
    title="Houdini",
    write=write,
    read_back=read_back,
    files="points_0000.ply and on, y up",
    start="a File node with points_$F4.ply, a second one with terrain.stl",
    keeps="volume, density, velocity (vx, vy, vz), id",
    axes=Y_UP,
    tolerance=3e-7,
    now=True,
    finish=finish,
    results="points_*.ply",
)
