"""Rigid barriers in the 3D solver: what moves into one is held and slowed, what it takes up is booked (note 4.8)."""

from math import sqrt

from . import laws as _laws  # noqa: F401  (registers the methods of laws)
from .block_order import CHUNKS
from .jit import jit, jit_inline

# of a node column with a barrier: outward unit normal of its nearest side, elevation of the crest above the domain's
# lowest level [m], depth behind that side [m], friction [1], weight with which what passes above is counted [m-1],
# place of the barrier's foot from here [m], 1 + number of the barrier (0: none)
WALL_X, WALL_Y, CREST, DEPTH, WALL_MU, WEIGHT, ARM_X, ARM_Y, FOOT, BARRIER, POINT_BARRIER_ENTRIES = range(11)
# what is booked for each barrier [N s], [N m s], [kg]; the last is the largest normal force of a single step [N]
(
    NORMAL, IMPULSE_X, IMPULSE_Y, IMPULSE_Z, MOMENT_X, MOMENT_Y, MOMENT_Z, OVER, POINT_BARRIER_SUMS,
) = range(9)  # fmt: skip


@jit_inline
def at_barrier(u, v, w, mass, z, dt, place, booked, barrier):
    """Velocity of a node at height `z` [m] in the node column `place` of a barrier, and its share of what is booked.

    The nearest face holds: a side, or the top if that is nearer. What moves into it loses that speed, and mu times as
    much of the speed along it; what moves away is free.
    """
    book = booked[int(place[BARRIER]) - 1]
    beneath = place[CREST] - z
    if beneath < 0.0:
        book[OVER] += mass * dt * place[WEIGHT] * abs(u * place[WALL_X] + v * place[WALL_Y])
        return u, v, w
    sideways = place[DEPTH] <= beneath
    nx, ny, nz = (place[WALL_X], place[WALL_Y], 0.0) if sideways else (0.0, 0.0, 1.0)
    into = u * nx + v * ny + w * nz
    if into >= 0.0:
        return u, v, w
    u1, v1, w1 = u - into * nx, v - into * ny, w - into * nz
    slip = sqrt(u1 * u1 + v1 * v1 + w1 * w1)
    kept = barrier.kept_along(place[WALL_MU], slip, -into) if slip > 0.0 else 0.0
    u1, v1, w1 = kept * u1, kept * v1, kept * w1
    jx, jy, jz = mass * (u - u1), mass * (v - v1), mass * (w - w1)
    book[NORMAL] -= mass * into
    book[IMPULSE_X] += jx
    book[IMPULSE_Y] += jy
    book[IMPULSE_Z] += jz
    up = z - place[FOOT]
    book[MOMENT_X] += place[ARM_Y] * jz - up * jy
    book[MOMENT_Y] += up * jx - place[ARM_X] * jz
    book[MOMENT_Z] += place[ARM_X] * jy - place[ARM_Y] * jx
    return u1, v1, w1


@jit
def collect_point_barriers(report, sums, dt):
    """Add a step's bookings of all chunks, in their order, to the run's, and keep the largest force."""
    for b in range(sums.shape[0]):
        normal = 0.0
        for c in range(CHUNKS):
            normal += report[c, b, NORMAL]
            for entry in range(POINT_BARRIER_SUMS):
                sums[b, entry] += report[c, b, entry]
        sums[b, POINT_BARRIER_SUMS] = max(sums[b, POINT_BARRIER_SUMS], normal / dt)
