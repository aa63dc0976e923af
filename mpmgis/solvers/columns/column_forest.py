"""Forest on the grid: where it is reached, where it breaks, its resistance, and the mass that stops behind trees.

A pass over the nodes before their update finds the trees that are reached and broken, one after it the share of the
mass at each node that stops. The columns give that share to the nodes at the end of the step (`column_detrainment`).
"""

from math import sqrt

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the functions of laws)
from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from ...laws.entrainment import NO_EROSION, Entrainment
from ...laws.forest import (
    DETRAINMENT,
    DRAG,
    FRICTION,
    SHARE,
    SLOW,
    STRENGTH,
    THIN,
    TOO_THICK,
    forest_breaks,
    forest_detrained,
    forest_only_detrains,
)
from ...laws.ground_metric import cosine_squared, metric_gradient
from .column_blocks import BLOCK, TouchedBlocks, first_node
from .column_records import NodeFields, Settings
from .column_rows import NODE_GAIN, NODE_KINETIC, NODE_MASS, NODE_X, NODE_Y

# state of a node
(
    STOPPED,  # [kg] mass that stopped there
    TREES,  # state of its trees, one of the following; 0: the flow has not reached them
    FOREST_STATE,
) = range(3)
STANDING = 1.0  # in the flow
BROKEN = 2.0  # without effect on the flow
TAKING = 3.0  # they only take mass: the flow is within the limits of speed and thickness
BRAKING = 4.0  # they only brake: the flow is beyond these limits
# sums over a run
(
    DETRAINED,  # [kg] mass that stopped
    KINETIC,  # [J] its kinetic energy
    POTENTIAL,  # [J] its potential energy, from elevation 0
    RESISTED,  # [J] energy lost to the added resistance
    BROKEN_CELLS,  # [cells] area of broken forest
    STOPPED_COLUMNS,  # number of columns that stopped as a whole
    FOREST_SUMS,
) = range(7)
LEAST = 1e-300  # [m s-2] keeps a divisor off 0


@jit_parallel
def break_forest(
    nodes: np.ndarray, fields: NodeFields, touched: TouchedBlocks, report: np.ndarray, settings: Settings, metric: int
) -> None:
    """Mark trees that the flow reaches, and break those whose strength its pressure reaches.

    Flow is what is thicker than `settings.wet_thickness`: a film before the front neither breaks trees nor is slowed by
    them. Its speed is that of the columns before the forces of this step, or with them where that is less. The nodes
    have momentum.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    fields : NodeFields
    touched : TouchedBlocks
    report : float64[CHUNKS]
        Becomes the area of forest that broke [cells].
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    values, state, node_gradient = fields.forest, fields.forest_state, fields.gradient
    rows, columns = nodes.shape[0], nodes.shape[1]
    for c in prange(CHUNKS):
        report[c] = 0.0
        for k in range(c * touched.count // CHUNKS, (c + 1) * touched.count // CHUNKS):
            j_first, i_first = first_node(touched, k)
            for j in range(j_first, min(j_first + BLOCK, rows)):
                for i in range(i_first, min(i_first + BLOCK, columns)):
                    report[c] += break_trees(nodes, values, state, node_gradient, j, i, settings, metric)


@jit_inline
def break_trees(
    nodes: np.ndarray,
    values: np.ndarray,
    state: np.ndarray,
    node_gradient: np.ndarray,
    j: int,
    i: int,
    settings: Settings,
    metric: int,
) -> float:
    """Mark and break the trees at node [j, i] (see `break_forest`); return their area [cells] if they broke, else 0.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    values : float64[ny + 3, nx + 3, FOREST_ENTRIES]
        Of the trees (`laws.forest`).
    state : float64[ny + 3, nx + 3, FOREST_STATE]
    node_gradient : float64[ny + 3, nx + 3, 2] [1]
        Of the bed.
    j, i : int
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    density = settings.density
    mass, least = nodes[j, i, NODE_MASS], density * settings.dx * settings.dx * settings.wet_thickness
    if mass <= least or values[j, i, STRENGTH] == 0.0 or state[j, i, TREES] == BROKEN:
        return 0.0
    u, v = nodes[j, i, NODE_X] / mass, nodes[j, i, NODE_Y] / mass
    mx, my = metric_gradient(metric, node_gradient[j, i, 0], node_gradient[j, i, 1])
    w = u * mx + v * my
    before = sqrt(2.0 * nodes[j, i, NODE_KINETIC] / mass)
    speed = min(sqrt(u * u + v * v + w * w), before)
    thickness = mass / (density * settings.dx * settings.dx) * sqrt(cosine_squared(mx, my))
    slow, thin = values[j, i, SLOW], values[j, i, THIN]
    state[j, i, TREES] = STANDING
    if slow > 0.0 or thin > 0.0:
        only_detrains = forest_only_detrains(slow, thin, thickness, speed)
        state[j, i, TREES] = TAKING if only_detrains else BRAKING
    if forest_breaks(values[j, i, STRENGTH], values[j, i, TOO_THICK], density, thickness, speed):
        state[j, i, TREES] = BROKEN
        return values[j, i, SHARE]
    return 0.0


@jit_inline
def added_resistance(
    values: np.ndarray, state: np.ndarray, j: int, i: int, normal_gravity: float
) -> tuple[float, float]:
    """Return the deceleration by added friction [m s-2] and the added drag [m-1] at node [j, i].

    Parameters
    ----------
    values : float64[ny + 3, nx + 3, FOREST_ENTRIES]
    state : float64[ny + 3, nx + 3, FOREST_STATE]
    j, i : int
    normal_gravity : float [m s-2]
        Gravity normal to the ground.
    """
    if state[j, i, TREES] != STANDING and state[j, i, TREES] != BRAKING:
        return 0.0, 0.0
    return values[j, i, FRICTION] * normal_gravity, values[j, i, DRAG]


@jit_inline
def share_of_resistance(
    dry: float, drag: float, all_dry: float, viscous: float, all_drag: float, speed: float
) -> float:
    """Compute the share [1] of a part of the resistance in the deceleration by all of it.

    Parameters
    ----------
    dry : float [m s-2]
        Friction of the part.
    drag : float [m-1]
        Drag of the part.
    all_dry : float [m s-2]
    viscous : float [s-1]
        Linear coefficient of all resistance.
    all_drag : float [m-1]
    speed : float [m s-1]
    """
    square = speed * speed
    return (dry + drag * square) / max(all_dry + viscous * speed + all_drag * square, LEAST)


@jit_parallel
def find_shares(
    nodes: np.ndarray,
    fields: NodeFields,
    touched: TouchedBlocks,
    dt: float,
    settings: Settings,
    metric: int,
    entrainment: Entrainment,
) -> None:
    """Compute `fields.forest_share` at the touched nodes: the share of their mass that stops in this step.

    The nodes have the velocity in the middle of the step.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    fields : NodeFields
    touched : TouchedBlocks
    dt : float [s]
    settings : Settings
    metric, entrainment
        Slots of these names (`ColumnEffects`).
    """
    values, state, share, node_gradient = fields.forest, fields.forest_state, fields.forest_share, fields.gradient
    rows, columns = nodes.shape[0], nodes.shape[1]
    for k in prange(touched.count):
        j_first, i_first = first_node(touched, k)
        for j in range(j_first, min(j_first + BLOCK, rows)):
            for i in range(i_first, min(i_first + BLOCK, columns)):
                find_share(nodes, values, state, share, node_gradient, j, i, dt, settings, metric, entrainment)


@jit_inline
def find_share(
    nodes: np.ndarray,
    values: np.ndarray,
    state: np.ndarray,
    share: np.ndarray,
    node_gradient: np.ndarray,
    j: int,
    i: int,
    dt: float,
    settings: Settings,
    metric: int,
    entrainment: Entrainment,
) -> None:
    """Compute the share of the mass at node [j, i] that stops (see `find_shares`); 0 without trees.

    Parameters
    ----------
    nodes : float64[ny + 3, nx + 3, 4]
    values : float64[ny + 3, nx + 3, FOREST_ENTRIES]
    state : float64[ny + 3, nx + 3, FOREST_STATE]
    share : float64[ny + 3, nx + 3] [1]
    node_gradient : float64[ny + 3, nx + 3, 2] [1]
        Of the bed.
    j, i : int
    dt : float [s]
    settings : Settings
    metric, entrainment
        Slots of these names (`ColumnEffects`).
    """
    mass = nodes[j, i, NODE_MASS]
    if mass <= 0.0 or (state[j, i, TREES] != STANDING and state[j, i, TREES] != TAKING):
        return
    u, v = nodes[j, i, NODE_X], nodes[j, i, NODE_Y]
    if entrainment.kind != NO_EROSION:  # the mass taken up is at rest
        u, v = u / (1.0 + nodes[j, i, NODE_GAIN]), v / (1.0 + nodes[j, i, NODE_GAIN])
    mx, my = metric_gradient(metric, node_gradient[j, i, 0], node_gradient[j, i, 1])
    w = u * mx + v * my
    speed = sqrt(u * u + v * v + w * w)
    stopping = forest_detrained(values[j, i, DETRAINMENT], speed, dt)  # per area of the ground
    share[j, i] = min(stopping * settings.dx * settings.dx / (sqrt(cosine_squared(mx, my)) * mass), 1.0)


@jit_parallel
def clear_shares(share: np.ndarray, touched: TouchedBlocks) -> None:
    """Zero the shares of the touched blocks, so that none of this step is left in a block that the next one misses.

    Parameters
    ----------
    share : float64[ny + 3, nx + 3] [1]
    touched : TouchedBlocks
    """
    for k in prange(touched.count):
        j_first, i_first = first_node(touched, k)
        share[j_first : j_first + BLOCK, i_first : i_first + BLOCK] = 0.0


@jit
def collect_forest(broken: np.ndarray, node_report: np.ndarray, loss: int, sums: np.ndarray) -> None:
    """Add the chunks' areas of broken forest, and the energy lost to trees, in their order.

    Parameters
    ----------
    broken : float64[CHUNKS]
    node_report : float64[CHUNKS, NODE_REPORT]
    loss : int
        Entry of the reports that has the energy lost to trees.
    sums : float64[FOREST_SUMS]
    """
    for c in range(CHUNKS):
        sums[RESISTED] += node_report[c, loss]
        sums[BROKEN_CELLS] += broken[c]
