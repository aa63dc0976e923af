"""ParaView: one .vtp per frame and a .pvd with their times."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ...frames.vtp_file import write_vtp
from ..readers.vtk_xml import POINTS, read_array, read_layout
from .start_files import SolverFiles

SERIES = "points.pvd"


def name_of(number: int) -> str:
    """Return the file name of a frame.

    Parameters
    ----------
    number : int
        Of the frame.
    """
    return f"points_{number:04d}.vtp"


def write(start: Any, folder: Path, number: int) -> None:
    """Write the points of a start.

    Parameters
    ----------
    start : SolverStart
    folder : Path
    number : int
        Of the frame.
    """
    data = {
        "id": start.ids,
        "mass": start.mass,
        "volume": start.current_volume,
        "velocity": start.velocity,
        "speed": np.sqrt((start.velocity**2).sum(axis=1)),
    }
    if start.vertical_stress is not None:
        data["vertical_stress"] = start.vertical_stress
    fields = {"TimeValue": [start.time], "origin": list(start.box.origin)}
    write_vtp(folder / name_of(number), start.position, data, fields, "written by mpmgis")


def finish(folder: Path, times: Sequence[float]) -> None:
    """Write the .pvd with the files and their times.

    Parameters
    ----------
    folder : Path
    times : sequence of float [s]
    """
    rows = "".join(
        f'<DataSet timestep={quoteattr(repr(float(time)))} part="0" file={quoteattr(name_of(number))}/>\n'
        for number, time in enumerate(times)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n<Collection>\n'
    (folder / SERIES).write_text(f"{head}{rows}</Collection>\n</VTKFile>\n", encoding="utf-8", newline="\n")


def read_back(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read positions and volumes from the points.

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
    layout = read_layout(path)
    (piece,) = layout.pieces
    return read_array(path, layout, piece[POINTS]), read_array(path, layout, piece["volume"])[:, 0]


FILES = SolverFiles(
    name="paraview",
    title="ParaView",
    write=write,
    read_back=read_back,
    files=f"{SERIES} with points_0000.vtp and on",
    start=f"paraview {SERIES}, then File > Open terrain.stl",
    keeps="volume, velocity, id",
    takes_stress=True,
    now=True,
    finish=finish,
    results=SERIES,
)
