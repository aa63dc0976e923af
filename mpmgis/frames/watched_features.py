"""Map places of outflow: over an edge of the DTM, into a nodata collar, into a hole.

Inactive features on the map: an effect is switched on before the flow reaches its feature.

The kernels stop before a step in which a particle would add mass to a block of nodes with such a feature.
An effect acts only on its own nodes, so switching it on at that moment gives the same result as from
the start: no step is repeated, and no flow is ever on a feature whose effect is off.
"""

from typing import NamedTuple

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
from ..terrain.elevation import nodata_groups

HOLE, COLLAR = "hole", "collar"
SIDES = {WEST_EDGE: "west", SOUTH_EDGE: "south", EAST_EDGE: "east", NORTH_EDGE: "north"}
MOST_PLACES = 10  # number of places; the smallest ones are summed in one entry
_AROUND = np.ones((3, 3))


def left_places(grid, left):
    """The places at which mass left, the largest first.

    Parameters
    ----------
    grid : ColumnGrid
    left : float64[ways, blocks, blocks, entries]
        As `block_order.book_left` fills it.

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


def _groups(blocks):
    """Sums over each group of blocks that touch, float64[entries]."""
    labels, count = ndimage.label(blocks[..., LEFT_MASS] > 0.0, _AROUND)
    return [blocks[labels == k].sum(axis=0) for k in range(1, count + 1)]


def _place(grid, sums, where):
    x, y = sums[LEFT_X] / sums[LEFT_MASS], sums[LEFT_Y] / sums[LEFT_MASS]
    return {"where": where, "mass": float(sums[LEFT_MASS]), "east": float(grid.x0 + x), "north": float(grid.y0 + y)}


def _nodata_places(grid, blocks):
    """One place for each hole, and one for each stretch of the collar."""
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


def _nearest_label(labels, row, column, sums, dx):
    """Number of the group of nodata cells in or next to a block that is nearest to the outflow there; 0: none."""
    first = np.maximum(np.array((row, column)) * LEFT_BLOCK - 1, 0)
    window = labels[first[0] : first[0] + LEFT_BLOCK + 2, first[1] : first[1] + LEFT_BLOCK + 2]
    cells = np.argwhere(window > 0)
    if not len(cells):
        return 0
    y, x = sums[LEFT_Y] / sums[LEFT_MASS] / dx, sums[LEFT_X] / sums[LEFT_MASS] / dx
    apart = (cells[:, 0] + first[0] + 0.5 - y) ** 2 + (cells[:, 1] + first[1] + 0.5 - x) ** 2
    return int(window[tuple(cells[np.argmin(apart)])])


STATE = "taken_in"  # of a frame: float64[features, 4], TAKEN, TIME, EAST, NORTH of each
TAKEN, TIME, EAST, NORTH, ENTRIES = range(5)
MOST_FEATURES = 8  # bits of the mark of a block of nodes


class Feature(NamedTuple):
    """A spatial effect of a scene that is off; `nodes` bool[ny + 3, nx + 3] are the nodes on which it would act."""

    effect: str  # as in a Decision
    words: str  # description, and reason for which it is off
    nodes: np.ndarray


class TakenIn(NamedTuple):
    """Time [s] and place (map E, N [m] of a particle) where the flow reached a feature and switched its effect on."""

    effect: str
    words: str
    time: float
    east: float
    north: float

    def line(self):
        """As a message."""
        return (
            f"t = {self.time:.2f} s, E {self.east:.1f} N {self.north:.1f}: the flow comes to {self.words}; the effect "
            f"'{self.effect}' is on from here"
        )


class Watch:
    """Features that a solver watches.

    Parameters
    ----------
    features : sequence of Feature
    with_effects : callable
        (names of additional effects) -> (effects, Places, walls) for the solver.
    """

    def __init__(self, features, with_effects):
        self.features, self.with_effects = tuple(features), with_effects
        if len(self.features) > MOST_FEATURES:
            raise ValueError(f"{len(self.features)} features are watched, at most {MOST_FEATURES} can be")
        self.state = np.zeros((len(self.features), ENTRIES))

    @property
    def taken_in(self):
        """tuple of TakenIn so far."""
        pairs = zip(self.features, self.state.tolist(), strict=True)
        return tuple(TakenIn(f.effect, f.words, *row[TIME:]) for f, row in pairs if row[TAKEN])

    def marks(self):
        """uint8[ny + 3, nx + 3]: bit k at the nodes of feature k that is not taken in yet; None where all are."""
        if self.state[:, TAKEN].all():
            return None
        marks = np.zeros(self.features[0].nodes.shape, np.uint8)
        for k, feature in enumerate(self.features):
            if not self.state[k, TAKEN]:
                marks |= feature.nodes.astype(np.uint8) << k
        return marks


def block_marks(marks, block):
    """uint8[block rows, block columns]: `marks` [rows, columns] combined over each block of `block` x `block` nodes."""
    rows, columns = (-(-n // block) for n in marks.shape)
    padded = np.pad(marks, ((0, rows * block - marks.shape[0]), (0, columns * block - marks.shape[1])))
    return np.bitwise_or.reduce(padded.reshape(rows, block, columns, block), axis=(1, 3))


def marks_reached(blocks, row, column):
    """uint8[n]: marks of the blocks that particles in the blocks `row`, `column` reach: theirs and the next ones."""
    beyond = np.pad(blocks, ((0, 2), (0, 2)))
    return beyond[row, column] | beyond[row + 1, column] | beyond[row, column + 1] | beyond[row + 1, column + 1]
