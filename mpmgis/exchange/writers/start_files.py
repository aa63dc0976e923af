"""Start files of other solvers: interface of a writer, rows of numbers, and the terrain."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from affine import Affine

from ...frames.text_rows import append_rows
from ...terrain.grid import Grid
from ...terrain.raster_output import write_ascii_grid

UPWARDS = ("e", "n", "u")
Y_UP = ("e", "u", "-n")
STL, HEIGHTS = "terrain.stl", "terrain.asc"
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_TRIANGLES_AT_ONCE = 100_000


def write_rows(sink: BinaryIO, *columns: np.ndarray) -> None:
    """Append rows of numbers with blanks between them to a file.

    Parameters
    ----------
    sink : binary file
    *columns : number[n] or number[n, k]
    """
    flat = []
    for values in columns:
        flat += [values] if values.ndim == 1 else list(values.T)
    append_rows(sink, flat, " ")


def read_rows(text: bytes, width: int) -> np.ndarray:
    """Read rows of numbers with blanks between them.

    Parameters
    ----------
    text : bytes
    width : int
        Numbers of a row.

    Returns
    -------
    float64[n, width]
    """
    return np.fromstring(text, dtype=float, sep=" ").reshape(-1, width)


class SolverFiles(NamedTuple):
    """Writer of the start files of a solver.

    Parameters
    ----------
    name, title : str
        Name on the command line; name in texts.
    write : callable
        `write(start, folder, number)` writes the files of a SolverStart to `folder`; `number` counts the frames.
    read_back : callable
        `read_back(folder, number)`: (float64[n, 3] [m] position E, N, up, float64[n] [m3] volume) read from the files.
    files : str
        Content of the folder, for its README.txt.
    start : str
        Command that starts the solver.
    keeps, loses : str
        Properties of a point that are written or lost, in addition to position, mass and stress.
    takes_stress : bool
    laws : tuple of str
        Supported laws of [material]; empty where no material is needed.
    needs_grid : bool
        A background grid is required.
    needs_bed_friction : bool
    axes : tuple of str
        Directions of x, y and z in the files.
    tolerance : float
        Largest error of a position in the files, as a fraction of the box.
    now : bool
        Volumes are the current ones; else mass over density, from which the solver computes the mass.
    finish : callable or None
        `finish(folder, times)` after all frames are written; solvers without it accept only one frame.
    terrain_on_grid : bool
        The ground has the nodes of the grid and is written as text (`write_terrain`).
    results : str
        Pattern of the results, for `mpmgis export-raster`.
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


def write_json(path: Path, content: Any) -> None:
    """Write JSON data.

    Parameters
    ----------
    path : Path
    content : Any
    """
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")


def write_terrain(folder: Path, box: Any, axes: np.ndarray, on_grid: bool = False) -> list[str]:
    """Write the ground of a box: triangles, and elevations where the pixels are square and north-up.

    There are two triangles between four neighbouring pixels. Solvers often search contact at triangle centres, and only
    inside the grid: `on_grid` uses the nodes of the grid for the triangles, as text, which all readers support.

    Parameters
    ----------
    folder : Path
    box : Box
    axes : float64[3, 3]
        Map vectors (E, N, up) of the file's x, y and z.
    on_grid : bool

    Returns
    -------
    list of str
        Names of the files.
    """
    corners = _triangles(box.bed_at_nodes() if on_grid else _pixels(box)) @ axes.T
    (_write_text if on_grid else _write_binary)(folder / STL, corners, _normals(corners))
    if not box.terrain.grid.is_north_up:
        return [STL]
    write_ascii_grid(folder / HEIGHTS, *_local_heights(box))
    return [STL, HEIGHTS]


def _pixels(box: Any) -> np.ndarray:
    """Return float64[rows, columns, 3] [m]: positions of the pixels in the Box."""
    terrain = box.terrain
    x, y = terrain.grid.xy(*np.indices(terrain.grid.shape))
    return np.stack([x, y, terrain.elevation], axis=-1) - np.asarray(box.origin)


def _triangles(place: np.ndarray) -> np.ndarray:
    """Return the corners of the triangles between neighbours of `place` [a, b, 3], counterclockwise seen from above.

    Triangles with NaN are omitted; the shape is float64[k, 3, 3] [m].
    """
    a, b, c, d = place[:-1, :-1], place[:-1, 1:], place[1:, :-1], place[1:, 1:]
    corners = np.stack([np.stack([a, c, b], axis=-2), np.stack([b, c, d], axis=-2)], axis=-3).reshape(-1, 3, 3)
    corners = corners[np.isfinite(corners).all(axis=(1, 2))]
    if len(corners) and _normals(corners)[:, 2].mean() < 0:  # opposite row order
        corners = corners[:, ::-1]
    return corners


def _normals(corners):
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normal / np.sqrt((normal**2).sum(axis=1, keepdims=True))


def _write_binary(path: Path, corners: np.ndarray, normals: np.ndarray) -> None:
    triangles = np.zeros(len(corners), _TRIANGLE)
    triangles["normal"], triangles["corners"] = normals, corners
    with open(path, "wb") as sink:
        sink.write(b"terrain in local coordinates, metres".ljust(80))
        sink.write(np.uint32(len(corners)).tobytes())
        triangles.tofile(sink)


def _write_text(path: Path, corners: np.ndarray, normals: np.ndarray) -> None:
    row = "facet normal %.6g %.6g %.6g\n outer loop\n" + "  vertex %.10g %.10g %.10g\n" * 3 + " endloop\nendfacet\n"
    with open(path, "w", encoding="ascii", newline="\n") as sink:
        sink.write("solid terrain\n")
        for start in range(0, len(corners), _TRIANGLES_AT_ONCE):
            part = slice(start, start + _TRIANGLES_AT_ONCE)
            numbers = np.concatenate([normals[part, None], corners[part]], axis=1).reshape(-1, 12)
            sink.write("".join(row % tuple(values) for values in numbers.tolist()))
        sink.write("endsolid terrain\n")


def _local_heights(box: Any) -> tuple[Grid, np.ndarray]:
    """Return (Grid in local coordinates, float64[rows, columns] [m] elevation above the origin of the Box)."""
    grid, (east, north, up) = box.terrain.grid, box.origin
    return Grid(None, Affine.translation(-east, -north) @ grid.transform, grid.shape), box.terrain.elevation - up
