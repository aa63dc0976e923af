"""Changes of the bed by a flow, as frames store them: mass per area at the nodes, eroded and stopped in forest."""

from typing import Any

import numpy as np

# names in a frame of arrays at the nodes
MASS = "eroded_mass"  # [kg m-2]
DETRAINED = "detrained_mass"  # [kg m-2]
BROKEN = "broken_forest"  # [1]; share of the node's square with broken forest
# further names in a frame
TRANSFORM = "transform"  # affine transform of the squares that nodes stand for [m]
DENSITY = "bed_density"  # [kg m-3]


def bed_change_of(
    eroded: np.ndarray, forest: tuple[np.ndarray, np.ndarray] | None, west: float, south: float, spacing: float
) -> dict[str, np.ndarray]:
    """Return what a frame stores of the bed, cut to the nodes where anything changed.

    Parameters
    ----------
    eroded : float64[rows, columns] [kg m-2]
        Per plan area at the nodes, row 0 in the south; a node stands for the square of side `spacing` around it.
    forest : (float64[rows, columns], float64[rows, columns]) or None
        Mass that stopped in forest [kg m-2], and the share of the square with broken forest.
    west, south : float [m]
        Map position of the first node.
    spacing : float [m]

    Returns
    -------
    dict
        eroded_mass float64[rows, columns] [kg m-2] and the affine `transform` of the nodes' squares; with forest also
        detrained_mass [kg m-2] and broken_forest [1].
    """
    arrays = {MASS: eroded} if forest is None else {MASS: eroded, DETRAINED: forest[0], BROKEN: forest[1]}
    j, i = np.nonzero(np.any([values > 0 for values in arrays.values()], axis=0))
    window = (slice(j.min(), j.max() + 1), slice(i.min(), i.max() + 1)) if len(j) else (slice(0, 1), slice(0, 1))
    corner = west + (window[1].start - 0.5) * spacing, south + (window[0].start - 0.5) * spacing
    transform = np.array([spacing, 0.0, corner[0], 0.0, spacing, corner[1]])
    return {name: values[window].copy() for name, values in arrays.items()} | {TRANSFORM: transform}


def with_density(eroded: dict[str, Any], density: float) -> dict[str, Any]:
    """Add the density of the bed, with which masses become depths, to what a frame stores of the bed.

    Parameters
    ----------
    eroded : dict
        Result of `bed_change_of`; one that is empty stays so.
    density : float [kg m-3]
    """
    return eroded | {DENSITY: float(density)} if eroded else {}
