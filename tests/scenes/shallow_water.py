"""Shallow water along a line by finite volumes: an answer for scenes that owes nothing to particles.

First order in space and time: HLL fluxes (Harten, Lax & van Leer 1983) with hydrostatic reconstruction of the bed
(Audusse et al. 2004), so that water at rest stays at rest and depths stay positive. Both ends are walls.
"""

from typing import NamedTuple

import numpy as np

GRAVITY = 9.81
DRY = 1e-6  # [m], below which there is no speed


class Line(NamedTuple):
    """Water along a line at one time; arrays float64[n] by cell."""

    time: float  # [s]
    depth: np.ndarray  # [m]
    speed: np.ndarray  # [m s-1]


def march(depth, bed, cell, times, courant=0.45):
    """The Lines at `times` [s] of water that starts at rest, `depth` [m] on `bed` [m], in cells of `cell` [m]."""
    h, q, time, lines = depth.astype(float).copy(), np.zeros(len(depth)), 0.0, []
    for until in times:
        while time < until:
            u = _speed(h, q)
            step = courant * cell / max(np.max(np.abs(u) + np.sqrt(GRAVITY * h)), 1e-9)
            step = min(step, until - time)
            h, q = _stepped(h, q, u, bed, step / cell)
            time += step
        lines.append(Line(until, h.copy(), _speed(h, q)))
    return lines


def _speed(h, q):
    return np.where(h > DRY, q / np.maximum(h, DRY), 0.0)


def _stepped(h, q, u, bed, ratio):
    """Depth and discharge after a step; `ratio` is step over cell [s/m]."""
    h, u, bed = (np.concatenate([part[:1], part, part[-1:]]) for part in (h, u, bed))
    u[0], u[-1] = -u[0], -u[-1]  # the mirror beyond a wall
    higher = np.maximum(bed[:-1], bed[1:])
    left = np.maximum(h[:-1] + bed[:-1] - higher, 0.0)
    right = np.maximum(h[1:] + bed[1:] - higher, 0.0)
    mass, momentum = _hll(left, u[:-1], right, u[1:])
    push = 0.5 * GRAVITY
    from_left = momentum + push * (h[:-1] ** 2 - left**2)
    from_right = momentum + push * (h[1:] ** 2 - right**2)
    h_new = h[1:-1] - ratio * (mass[1:] - mass[:-1])
    q_new = q - ratio * (from_left[1:] - from_right[:-1])
    return np.maximum(h_new, 0.0), q_new


def _hll(hl, ul, hr, ur):
    """Fluxes of mass and momentum between two states."""
    cl, cr = np.sqrt(GRAVITY * hl), np.sqrt(GRAVITY * hr)
    slowest = np.where(hl > DRY, np.minimum(ul - cl, ur - cr), ur - 2.0 * cr)
    fastest = np.where(hr > DRY, np.maximum(ul + cl, ur + cr), ul + 2.0 * cl)
    slowest = np.where(hr > DRY, slowest, ul - cl)
    fastest = np.where(hl > DRY, fastest, ur + cr)
    lower, upper = np.minimum(slowest, 0.0), np.maximum(fastest, 0.0)
    width = np.maximum(upper - lower, 1e-12)
    fluxes = []
    for low, high, jump in (
        (hl * ul, hr * ur, hr - hl),
        (hl * ul**2 + 0.5 * GRAVITY * hl**2, hr * ur**2 + 0.5 * GRAVITY * hr**2, hr * ur - hl * ul),
    ):
        fluxes.append((upper * low - lower * high + upper * lower * jump) / width)
    return fluxes
