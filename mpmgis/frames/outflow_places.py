"""Map places of outflow: over an edge of the DTM, into a nodata collar, into a hole."""

from typing import Any

import numpy as np
from scipy import ndimage

from ..compiled.block_order import (
    EAST_EDGE,
    INTO_NODATA,
    LEFT_BLOCK,
    LEFT_MASS,
    LEFT_X,
    LEFT_Y,
    NORTH_EDGE,
    SOUTH_EDGE,
    WEST_EDGE,
)
from ..terrain.nodata_groups import nodata_groups

HOLE = "hole"  # nodata amid the DTM
COLLAR = "collar"  # nodata that reaches the edge of the DTM
SIDES = {WEST_EDGE: "west", SOUTH_EDGE: "south", EAST_EDGE: "east", NORTH_EDGE: "north"}
MOST_PLACES = 10  # entries in the list; the smallest places beyond are summed in one entry
_AROUND = np.ones((3, 3))  # blocks that touch at a corner belong together, too


def left_places(grid: Any, left: np.ndarray) -> list[dict]:
    """Return the places at which mass left the terrain, the largest first.

    Parameters
    ----------
    grid : ColumnGrid
    left : float64[ways, blocks, blocks, entries]
        Sums of the outflow that `block_order.book_left` fills.

    Returns
    -------
    list of dict
        `where`: the side of the DTM that was left, `collar` (nodata that reaches the edge of the DTM) or `hole`
        (nodata amid the DTM); `mass` [kg]; `east`, `north` [m], the mean place of that mass. Beyond MOST_PLACES the
        smallest are one entry with `where` = "elsewhere".
    """
    places = [_place(grid, sums, side) for edge, side in SIDES.items() for sums in _groups(left[edge])]
    if left[INTO_NODATA, ..., LEFT_MASS].any():
        places += _nodata_places(grid, left[INTO_NODATA])
    places.sort(key=lambda place: (-place["mass"], place["east"], place["north"]))
    kept, rest = places[:MOST_PLACES], places[MOST_PLACES:]
    if rest:
        mass = sum(place["mass"] for place in rest)
        mean = {axis: sum(place["mass"] * place[axis] for place in rest) / mass for axis in ("east", "north")}
        kept.append({"where": "elsewhere", "mass": mass, **mean})
    return kept


def _groups(blocks: np.ndarray) -> list[np.ndarray]:
    """Return the sums over each group of blocks that touch, float64[entries]."""
    labels, count = ndimage.label(blocks[..., LEFT_MASS] > 0.0, _AROUND)
    return [blocks[labels == k].sum(axis=0) for k in range(1, count + 1)]


def _place(grid, sums, where):
    x, y = sums[LEFT_X] / sums[LEFT_MASS], sums[LEFT_Y] / sums[LEFT_MASS]
    return {"where": where, "mass": float(sums[LEFT_MASS]), "east": float(grid.x0 + x), "north": float(grid.y0 + y)}


def _nodata_places(grid: Any, blocks: np.ndarray) -> list[dict]:
    """Return one place for each hole, and one for each stretch of the collar."""
    labels, edge_labels = nodata_groups(grid.inside == 0)
    holes, collar = {}, np.zeros_like(blocks)
    for row, column in np.argwhere(blocks[..., LEFT_MASS] > 0.0):
        sums = blocks[row, column]
        number = _nearest_label(labels, row, column, sums, grid.cell_size)
        if number and number not in edge_labels:
            holes[number] = holes.get(number, 0.0) + sums
        else:
            collar[row, column] = sums
    return [_place(grid, sums, HOLE) for sums in holes.values()] + [
        _place(grid, sums, COLLAR) for sums in _groups(collar)
    ]


def _nearest_label(labels: np.ndarray, row: int, column: int, sums: np.ndarray, dx: float) -> int:
    """Return the number of the group of nodata cells, in or next to a block, nearest to the outflow there; 0: none."""
    first = np.maximum(np.array((row, column)) * LEFT_BLOCK - 1, 0)
    window = labels[first[0] : first[0] + LEFT_BLOCK + 2, first[1] : first[1] + LEFT_BLOCK + 2]
    cells = np.argwhere(window > 0)
    if not len(cells):
        return 0
    y, x = sums[LEFT_Y] / sums[LEFT_MASS] / dx, sums[LEFT_X] / sums[LEFT_MASS] / dx
    apart = (cells[:, 0] + first[0] + 0.5 - y) ** 2 + (cells[:, 1] + first[1] + 0.5 - x) ** 2
    return int(window[tuple(cells[np.argmin(apart)])])
