"""Mass of columns that stops behind trees."""

from ...compiled import law_methods as _laws  # noqa: F401  (registers the methods of laws)
from ...compiled.block_order import GONE
from ...compiled.jit import jit, jit_inline
from ...laws.ground_metric import cosine_squared
from .column_clock import ALIVE, WORK_TOTAL
from .column_forest import DETRAINED, KINETIC, POTENTIAL, STOPPED, STOPPED_COLUMNS
from .column_rows import AREA, GX, GY, MASS, U, V, X, Y
from .spline_bed import bed_at, weights

MOST_SHARE = 0.999  # [1] of a column's mass: where more would stop in a step, all of it does
LEAST_THICKNESS = 1e-3  # [1] of the least thickness for friction: thinner columns in forest stop as a whole

_cosine_squared = jit_inline(cosine_squared)


@jit
def detrain(rows, keys, order, alive, fields, clock, counts, ahead, settings, metric):
    """Take from each column the share of its mass that stops, and give it to the nodes that stop it.

    Velocities are those of `ahead` [s] before the end of the step: the weight's work on the mass that stops is
    completed to its end. Shares of the nodes beyond a wall are those of their mirror images. The last column of all
    keeps its mass: frames need one.
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
def nodes_around(x, y, shape, settings):
    """(weights along x, along y, columns of nodes, rows of nodes), three of each, of a column at (x, y) [m]."""
    i0, _, wx0, wx1, wx2 = weights(x, 1.0 / settings.dx)
    j0, _, wy0, wy1, wy2 = weights(y, 1.0 / settings.dx)
    places_x, places_y = (i0, i0 + 1, i0 + 2), (j0, j0 + 1, j0 + 2)
    if settings.wall:
        height, width = shape
        places_x = (_mirrored(i0, width), _mirrored(i0 + 1, width), _mirrored(i0 + 2, width))
        places_y = (_mirrored(j0, height), _mirrored(j0 + 1, height), _mirrored(j0 + 2, height))
    return (wx0, wx1, wx2), (wy0, wy1, wy2), places_x, places_y


@jit_inline
def stopping_share(share, around):
    """Share [1] of the mass of a column that stops, from the `share` of the nodes `around` it."""
    weight_x, weight_y, place_x, place_y = around
    stops = 0.0
    for j in range(3):
        for i in range(3):
            stops += weight_y[j] * weight_x[i] * share[place_y[j], place_x[i]]
    return stops


@jit_inline
def kept_mass(mass, area, stops, settings):
    """What a column keeps of its `mass` [kg] if the share `stops` of it stops; 0 where all of it does."""
    kept, least = mass * (1.0 - stops), LEAST_THICKNESS * settings.thickness_floor
    return 0.0 if stops > MOST_SHARE or kept < least * settings.density * area else kept


@jit_inline
def taken_energy(row, mass, kept, bed, ahead, settings, metric):
    """((kinetic, potential) energy [J] of the mass that stops, work of the weight on it in the time `ahead` [J])."""
    gravity, lost = settings.gravity, mass - kept
    u, v = row[U], row[V]
    mx, my = metric.metric_gradient(row[GX], row[GY])
    w = u * mx + v * my
    thinner = 0.5 * gravity * _cosine_squared(mx, my) * (mass * mass - kept * kept) / (settings.density * row[AREA])
    kinetic = 0.5 * lost * (u * u + v * v + w * w)
    potential = lost * gravity * bed_at(bed, row[X], row[Y], 1.0 / settings.dx)[0] + thinner
    return (kinetic, potential), lost * gravity * ahead * (u * row[GX] + v * row[GY])


@jit_inline
def _mirrored(index, size):
    """Index of the node that a ghost beyond a wall is the image of; other nodes are their own."""
    return 2 if index == 0 else size - 3 if index == size - 1 else index
