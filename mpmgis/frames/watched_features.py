"""Inactive features on the map: an effect is switched on before the flow reaches its feature.

The kernels stop before a step in which a particle would add mass to a block of nodes with such a feature.
An effect acts only on its own nodes, so switching it on at that moment gives the same result as from
the start: no step is repeated, and no flow is ever on a feature whose effect is off.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

STATE = "taken_in"  # name in the restart state of a frame: float64[features, ENTRIES]
# entries of the state of a feature
TAKEN = 0  # [1] 1 where the effect is on
TIME = 1  # [s] when the flow reached it
EAST = 2  # [m] map position of the particle that reached it
NORTH = 3  # [m]
ENTRIES = 4
MOST_FEATURES = 8  # bits of the mark of a block of nodes


class WatchedFeature(NamedTuple):
    """A spatial effect of a scene that is off.

    Parameters
    ----------
    effect : str
        Name, as in a Decision.
    words : str
        Description, and the reason for which it is off.
    nodes : bool[ny + 3, nx + 3]
        Nodes on which it would act.
    """

    effect: str  # as in a Decision
    words: str  # description, and reason for which it is off
    nodes: np.ndarray


class TakenIn(NamedTuple):
    """Time and place where the flow reached a feature and switched its effect on.

    Parameters
    ----------
    effect, words : str
        Name of the effect, as in a WatchedFeature.
    time : float [s]
    east, north : float [m]
        Map position of a particle that reached it.
    """

    effect: str
    words: str
    time: float
    east: float
    north: float

    def line(self) -> str:
        """Return a message about it."""
        return (
            f"t = {self.time:.2f} s, E {self.east:.1f} N {self.north:.1f}: the flow comes to {self.words}; the effect "
            f"'{self.effect}' is on from here"
        )


class Watch:
    """Features that a solver watches.

    Parameters
    ----------
    features : sequence of WatchedFeature
    with_effects : callable
        (names of additional effects) -> (effects, Places, walls) for the solver.

    Raises
    ------
    ValueError
        More features than MOST_FEATURES.
    """

    def __init__(self, features: Sequence[WatchedFeature], with_effects: Callable[[tuple[str, ...]], tuple]):
        self.features, self.with_effects = tuple(features), with_effects
        if len(self.features) > MOST_FEATURES:
            raise ValueError(f"{len(self.features)} features are watched, at most {MOST_FEATURES} can be")
        self.state = np.zeros((len(self.features), ENTRIES))

    @property
    def taken_in(self) -> tuple[TakenIn, ...]:
        """Features that the flow has reached so far."""
        pairs = zip(self.features, self.state.tolist(), strict=True)
        return tuple(TakenIn(f.effect, f.words, *row[TIME:]) for f, row in pairs if row[TAKEN])

    def marks(self) -> np.ndarray | None:
        """Return bit k at the nodes of each feature k that is still off.

        Returns
        -------
        uint8[ny + 3, nx + 3] or None
            None where all features are on.
        """
        if self.state[:, TAKEN].all():
            return None
        marks = np.zeros(self.features[0].nodes.shape, np.uint8)
        for k, feature in enumerate(self.features):
            if not self.state[k, TAKEN]:
                marks |= feature.nodes.astype(np.uint8) << k
        return marks


def block_marks(marks: np.ndarray, block: int) -> np.ndarray:
    """Combine the marks of nodes over blocks of nodes.

    Parameters
    ----------
    marks : uint8[rows, columns]
    block : int
        Nodes along a side of a block.

    Returns
    -------
    uint8[block rows, block columns]
    """
    rows, columns = (-(-n // block) for n in marks.shape)
    padded = np.pad(marks, ((0, rows * block - marks.shape[0]), (0, columns * block - marks.shape[1])))
    return np.bitwise_or.reduce(padded.reshape(rows, block, columns, block), axis=(1, 3))


def marks_reached(blocks: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return the marks of the blocks that particles reach: their own block and the next ones.

    Parameters
    ----------
    blocks : uint8[block rows, block columns]
        Marks from `block_marks`.
    row, column : int[n]
        Block of each particle.

    Returns
    -------
    uint8[n]
    """
    beyond = np.pad(blocks, ((0, 2), (0, 2)))
    return beyond[row, column] | beyond[row + 1, column] | beyond[row, column + 1] | beyond[row + 1, column + 1]
