"""Mass of columns that stops behind trees."""

import numpy as np

from ..effects.metric import cosine_squared
from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import GONE, REORDER_STEPS
from .column_clock import ALIVE, SINCE_REORDER, WORK_TOTAL
from .column_forest import DETRAINED, KINETIC, POTENTIAL, STOPPED, STOPPED_COLUMNS
from .column_rows import AREA, GX, GY, MASS, U, V, X, Y, bed_at, weights
from .jit import jit, jit_inline

MOST_SHARE = 0.999  # of a column's mass: where more would stop in a step, all of it does
LEAST_THICKNESS = 1e-3  # of the least thickness of friction: thinner columns in forest stop as a whole

_cosine_squared = jit_inline(cosine_squared)


@jit
def detrain(rows, keys, order, alive, fields, clock, counts, ahead, settings, metric):
    """Take from each column the share of its mass that stops, and give it to the nodes that stop it.

    Velocities are those of `ahead` [s] before the end of the step: the weight's work on the mass that stops is
    completed to its end. Shares of the nodes beyond a wall are those of their mirror images. The last column of all
    keeps its mass: frames need one.
    """
    share, state, sums, bed = fields.forest_share, fields.forest_state, fields.forest_sums, fields.bed
    dx, density, gravity = settings.dx, settings.density, settings.gravity
    least = LEAST_THICKNESS * settings.thickness_floor
    height, width = share.shape
    detrained, kinetic, potential = 0.0, 0.0, 0.0  # sums of this step first, which keeps their digits
    weight_x, weight_y, place_x, place_y = np.empty(3), np.empty(3), np.empty(3, np.int64), np.empty(3, np.int64)
    for q in range(alive):
        p = order[q]
        if keys[p] == GONE or counts[ALIVE] == 1:
            continue
        i0, _, weight_x[0], weight_x[1], weight_x[2] = weights(rows[p, X], 1.0 / dx)
        j0, _, weight_y[0], weight_y[1], weight_y[2] = weights(rows[p, Y], 1.0 / dx)
        for k in range(3):
            place_x[k] = _mirrored(i0 + k, width) if settings.wall else i0 + k
            place_y[k] = _mirrored(j0 + k, height) if settings.wall else j0 + k
        stops = 0.0
        for j in range(3):
            for i in range(3):
                stops += weight_y[j] * weight_x[i] * share[place_y[j], place_x[i]]
        if stops <= 0.0:
            continue
        mass, area = rows[p, MASS], rows[p, AREA]
        kept = mass * (1.0 - stops)
        if stops > MOST_SHARE or kept < least * density * area:
            kept = 0.0
            keys[p] = GONE
            counts[ALIVE] -= 1
            counts[SINCE_REORDER] = REORDER_STEPS  # drop it from memory at the next step
            sums[STOPPED_COLUMNS] += 1.0
        else:
            rows[p, MASS] = kept
        lost = mass - kept
        for j in range(3):
            for i in range(3):
                part = weight_y[j] * weight_x[i] * share[place_y[j], place_x[i]] / stops
                state[place_y[j], place_x[i], STOPPED] += lost * part
        u, v = rows[p, U], rows[p, V]
        mx, my = metric.metric_gradient(rows[p, GX], rows[p, GY])
        w = u * mx + v * my
        thinner = 0.5 * gravity * _cosine_squared(mx, my) * (mass * mass - kept * kept) / (density * area)
        detrained += lost
        kinetic += 0.5 * lost * (u * u + v * v + w * w)
        potential += lost * gravity * bed_at(bed, rows[p, X], rows[p, Y], 1.0 / dx)[0] + thinner
        clock[WORK_TOTAL] -= lost * gravity * ahead * (u * rows[p, GX] + v * rows[p, GY])
    sums[DETRAINED] += detrained
    sums[KINETIC] += kinetic
    sums[POTENTIAL] += potential


@jit_inline
def _mirrored(index, size):
    """Index of the node that a ghost beyond a wall is the image of; other nodes are their own."""
    return 2 if index == 0 else size - 3 if index == size - 1 else index
