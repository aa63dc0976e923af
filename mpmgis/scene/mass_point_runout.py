"""Runout of a mass point down the terrain, which shows what an effect changes.

An estimate to judge effects by, never a result: no pressure, no spreading, the thickness of the release all the way.
"""

import itertools
from collections.abc import Iterator
from math import exp, sqrt
from typing import Any

from ..laws.friction import FRICTIONLESS, stress_parts
from ..laws.quantities import GRAVITY
from .decision_rules import TerrainFacts

MOST_SPANS = 4.0  # [lengths of the profile] that a point is followed on flat ground beyond its end
PIECES = 400  # of the profile at the least


def runout(facts: TerrainFacts, friction: Any = None, cohesion: float = 0.0) -> float | None:
    """Compute the horizontal distance at which a point comes to rest.

    dU^2 / 2 ds = g sin - tau / (rho h_n) along `facts.profile`, with the stress of `friction` and of `cohesion`.
    For Coulomb friction this is D / mu (Heim 1932).

    Parameters
    ----------
    facts : TerrainFacts
    friction : law of basal resistance, optional
        Without it the point slides freely.
    cohesion : float [Pa]
        Yield stress at the bed.

    Returns
    -------
    float or None [m]
        None if the point never comes to rest or never starts.
    """
    if len(facts.profile) < 2 or facts.release_thickness <= 0.0:
        return None
    friction = FRICTIONLESS if friction is None else friction
    energy, distance = facts.start_speed**2, 0.0  # U^2 [m2 s-2]
    for length, fall in _pieces(facts.profile):
        slope = fall / length
        cosine = 1.0 / sqrt(1.0 + slope * slope)
        after = _after(energy, length / cosine, slope * cosine, cosine, facts, friction, cohesion)
        if after <= 0.0 and energy > 0.0:
            return distance + length * energy / max(energy - after, 1e-300)
        energy = max(after, 0.0)
        distance += length
    return None


def _pieces(profile: tuple) -> Iterator[tuple[float, float]]:
    """Yield (horizontal length, fall) [m] of short pieces of the profile, then of flat ground."""
    whole = profile[-1][0] - profile[0][0]
    longest = whole / PIECES
    for (start, high), (end, low) in itertools.pairwise(profile):
        count = max(1, int((end - start) / longest))
        yield from [((end - start) / count, (high - low) / count)] * count
    yield from [(longest, 0.0)] * int(MOST_SPANS * PIECES)


def _after(
    energy: float, length: float, sine: float, cosine: float, facts: TerrainFacts, friction: Any, cohesion: float
) -> float:
    """Return U^2 after `length` [m] along the ground; exact for quadratic drag; negative: at rest before its end."""
    speed, depth = sqrt(energy), facts.release_thickness * cosine
    load = facts.density * depth * GRAVITY * cosine
    per_mass = 1.0 / (facts.density * depth)
    dry, viscous, drag = stress_parts(friction, facts.density, GRAVITY, load, depth, speed)
    drive = GRAVITY * sine - (dry + cohesion + viscous * speed) * per_mass
    drag = drag / depth
    if drag == 0.0:
        return energy + 2.0 * length * drive
    return drive / drag + (energy - drive / drag) * exp(-2.0 * drag * length)


def change(reference: float | None, other: float | None) -> float | None:
    """Compute the relative change of the runout.

    Parameters
    ----------
    reference, other : float or None [m]
        Runout before and after the change; None where unknown.

    Returns
    -------
    float or None [1]
        None where one of them is not known or `reference` is 0.
    """
    return None if not reference or other is None else other / reference - 1.0
