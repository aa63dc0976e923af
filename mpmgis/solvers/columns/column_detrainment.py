"""Mass of columns that stops behind trees."""

import numpy as np

from ...compiled import law_functions as _laws  # noqa: F401  (registers the functions of laws)
from ...compiled.block_order import GONE
from ...compiled.jit import jit, jit_inline
from ...laws.ground_metric import cosine_squared, metric_gradient
from .column_forest import DETRAINED, KINETIC, POTENTIAL, STOPPED, STOPPED_COLUMNS
from .column_records import NodeFields, Settings
from .column_rows import AREA, GX, GY, MASS, U, V, X, Y
from .column_time_step import ALIVE, WORK_TOTAL
from .spline_bed import bed_at
from .spline_weights import weights

MOST_SHARE = 0.999  # [1] of a column's mass: where more would stop in a step, all of it does
LEAST_THICKNESS = 1e-3  # [1] of the least thickness for friction: thinner columns in forest stop as a whole


@jit
def detrain(
    rows: np.ndarray,
    keys: np.ndarray,
    order: np.ndarray,
    alive: int,
    fields: NodeFields,
    clock: np.ndarray,
    counts: np.ndarray,
    ahead: float,
    settings: Settings,
    metric: int,
) -> None:
    """Take from each column the share of its mass that stops, and give it to the nodes that stop it.

    Shares of the nodes beyond a wall are those of their mirror images. The last column of all keeps its mass: frames
    need one.

    Parameters
    ----------
    rows : float64[columns, ROW]
    keys : int32[columns]
        Block of each column; GONE for one that has left.
    order : int32[columns]
        Indices of columns in the order of blocks.
    alive : int
        Number of columns in the order.
    fields : NodeFields
    clock : float64[CLOCK]
    counts : int64[COUNTS]
    ahead : float [s]
        Velocities are those of this time before the end of the step: the weight's work on the mass that stops is
        completed to its end.
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).
    """
    share, state, sums = fields.forest_share, fields.forest_state, fields.forest_sums
    detrained, kinetic, potential = 0.0, 0.0, 0.0  # sums of this step first, which keeps their digits
    for q in range(alive):
        p = order[q]
        if keys[p] == GONE or counts[ALIVE] == 1:
            continue
        around = nodes_around(rows[p, X], rows[p, Y], share.shape, settings)
        stops = stopping_share(share, around)
        if stops <= 0.0:
            continue
        mass = rows[p, MASS]
        kept = kept_mass(mass, rows[p, AREA], stops, settings)
        if kept == 0.0:
            keys[p] = GONE
            counts[ALIVE] -= 1
            sums[STOPPED_COLUMNS] += 1.0
        else:
            rows[p, MASS] = kept
        lost = mass - kept
        weight_x, weight_y, place_x, place_y = around
        for j in range(3):
            for i in range(3):
                part = weight_y[j] * weight_x[i] * share[place_y[j], place_x[i]] / stops
                state[place_y[j], place_x[i], STOPPED] += lost * part
        taken, work = taken_energy(rows[p], mass, kept, fields.bed, ahead, settings, metric)
        detrained += lost
        kinetic += taken[0]
        potential += taken[1]
        clock[WORK_TOTAL] -= work
    sums[DETRAINED] += detrained
    sums[KINETIC] += kinetic
    sums[POTENTIAL] += potential


@jit_inline
def nodes_around(x: float, y: float, shape: tuple, settings: Settings) -> tuple[tuple, tuple, tuple, tuple]:
    """Return the nodes around a column and its weights on them, three along each axis.

    Parameters
    ----------
    x, y : float [m]
    shape : (int, int)
        Of the nodes.
    settings : Settings

    Returns
    -------
    (float, float, float), (float, float, float)
        Weights along x and along y.
    (int, int, int), (int, int, int)
        Columns and rows of the nodes; with walls those of their mirror images.
    """
    i0, _, wx0, wx1, wx2 = weights(x, 1.0 / settings.dx)
    j0, _, wy0, wy1, wy2 = weights(y, 1.0 / settings.dx)
    places_x, places_y = (i0, i0 + 1, i0 + 2), (j0, j0 + 1, j0 + 2)
    if settings.wall:
        height, width = shape
        places_x = (_mirrored(i0, width), _mirrored(i0 + 1, width), _mirrored(i0 + 2, width))
        places_y = (_mirrored(j0, height), _mirrored(j0 + 1, height), _mirrored(j0 + 2, height))
    return (wx0, wx1, wx2), (wy0, wy1, wy2), places_x, places_y


@jit_inline
def stopping_share(share: np.ndarray, around: tuple) -> float:
    """Compute the share [1] of the mass of a column that stops.

    Parameters
    ----------
    share : float64[ny + 3, nx + 3] [1]
        Of the mass at each node that stops.
    around : tuple
        Result of `nodes_around`.
    """
    weight_x, weight_y, place_x, place_y = around
    stops = 0.0
    for j in range(3):
        for i in range(3):
            stops += weight_y[j] * weight_x[i] * share[place_y[j], place_x[i]]
    return stops


@jit_inline
def kept_mass(mass: float, area: float, stops: float, settings: Settings) -> float:
    """Compute the mass [kg] that a column keeps if a share of it stops; 0 where all of it does.

    Parameters
    ----------
    mass : float [kg]
    area : float [m2]
    stops : float [1]
    settings : Settings
    """
    kept, least = mass * (1.0 - stops), LEAST_THICKNESS * settings.thickness_floor
    return 0.0 if stops > MOST_SHARE or kept < least * settings.density * area else kept


@jit_inline
def taken_energy(
    row: np.ndarray, mass: float, kept: float, bed: np.ndarray, ahead: float, settings: Settings, metric: int
) -> tuple[tuple[float, float], float]:
    """Compute the energy of the mass that stops, and the work of the weight on it.

    Parameters
    ----------
    row : float64[ROW]
        Of the column.
    mass : float [kg]
        Before.
    kept : float [kg]
        After.
    bed : float64[ny + 3, nx + 3] [m]
    ahead : float [s]
        Time for which the work counts.
    settings : Settings
    metric : int
        Slot of this name (`ColumnEffects`).

    Returns
    -------
    (float, float) [J]
        Kinetic and potential energy; potential energy is relative to elevation 0.
    float [J]
        Work.
    """
    gravity, lost = settings.gravity, mass - kept
    u, v = row[U], row[V]
    mx, my = metric_gradient(metric, row[GX], row[GY])
    w = u * mx + v * my
    thinner = 0.5 * gravity * cosine_squared(mx, my) * (mass * mass - kept * kept) / (settings.density * row[AREA])
    kinetic = 0.5 * lost * (u * u + v * v + w * w)
    potential = lost * gravity * bed_at(bed, row[X], row[Y], 1.0 / settings.dx)[0] + thinner
    return (kinetic, potential), lost * gravity * ahead * (u * row[GX] + v * row[GY])


@jit_inline
def _mirrored(index, size):
    """Index of the node that a ghost beyond a wall is the image of; other nodes are their own."""
    return 2 if index == 0 else size - 3 if index == size - 1 else index
