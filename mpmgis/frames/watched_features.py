"""Map places of outflow: over an edge of the DTM, into a nodata collar, into a hole.

Inactive features on the map: an effect is switched on before the flow reaches its feature.

The kernels stop before a step in which a particle would add mass to a block of nodes with such a feature.
An effect acts only on its own nodes, so switching it on at that moment gives the same result as from
the start: no step is repeated, and no flow is ever on a feature whose effect is off.
"""

from typing import NamedTuple

import numpy as np

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
