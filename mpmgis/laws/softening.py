"""Permanent loss of strength with plastic shear strain: the slot `softening` of Drucker-Prager.

`softened_cone` gives the yield cone q <= slope p + strength (slope [1], strength [Pa])
after the accumulated deviatoric plastic strain e_d [1] = sum of sqrt(2/3) |de_p|. In a code that sums |de_p|
(Matter) e_d is larger by sqrt(3/2): multiply its coefficient by that for a comparison.

Evidence for the exponential is indirect: Vicari et al. (2025) give a coefficient and no formula; Matter and GeoTaichi
use this form. Strength is lost over the width of one cell: a coefficient is valid for a cell size.
"""

from math import cos, radians, sin, sqrt, tan
from typing import NamedTuple

from ..system.errors import InputError
from .series import decay, sine_cosine

# kinds of softening
NONE = 0
EXPONENTIAL = 1
TANGENT = 2
LINEAR = 3
FORMS = {"exponential": EXPONENTIAL, "tangent": TANGENT, "linear": LINEAR}  # name in a scene -> kind
# Of a cone through Mohr-Coulomb's hexagon: slope = factor sin / (1 - share sin), strength = factor c cos / (same).
MATCHES = {
    "triaxial": (2.0, 1.0 / 3.0),  # at its corners of triaxial compression: 6 sin / (3 - sin)
    "plane_strain": (sqrt(3.0), 0.0),  # plane strain at constant volume: sqrt(3) sin
}


def faded(initial: float, residual: float, left: float) -> float:
    """Compute the strength between the initial and the residual one.

    Parameters
    ----------
    initial, residual : float
    left : float [1]
        Share that is left: 1 is `initial`, 0 is `residual`.
    """
    return residual + (initial - residual) * left


def matched_cone(sine: float, cosine: float, cohesion: float, factor: float, share: float) -> tuple[float, float]:
    """Compute the cone q <= slope p + strength of a friction angle and a cohesion.

    Parameters
    ----------
    sine, cosine : float [1]
        Of the friction angle.
    cohesion : float [Pa]
    factor, share : float [1]
        Values of MATCHES.

    Returns
    -------
    slope, strength : float [1], [Pa]
    """
    scale = factor / (1.0 - share * sine)
    return scale * sine, scale * cosine * cohesion


class Softening(NamedTuple):
    """Loss of strength of any kind; constant strength by default. Made by `softening`."""

    kind: int = NONE
    friction: float = 0.0  # friction angle [rad]; of TANGENT its tangent [1]
    cohesion: float = 0.0  # [Pa]
    residual_friction: float = 0.0  # as `friction`
    residual_cohesion: float = 0.0  # [Pa]
    coefficient: float = 0.0  # xi_s [1]
    peak_strain: float = 0.0  # e_d [1] up to which there is no loss, of LINEAR
    residual_strain: float = 0.0  # e_d [1], above peak_strain, from which on the strength is residual, of LINEAR
    factor: float = 0.0  # of MATCHES
    share: float = 0.0


def exponential_cone(softening: Softening, plastic_strain: float) -> tuple[float, float]:
    """Compute the cone after a plastic strain: X = X_r + (X_i - X_r) exp(-xi_s e_d).

    X is the friction angle and the cohesion. xi_s = 10 loses 90 % by e_d = 0.23. Vicari et al. (2025), ice avalanche on
    cells of 1 m: 40 to 20 degrees, 1 kPa to 0, xi_s = 10.

    Parameters
    ----------
    softening : Softening
    plastic_strain : float [1]
        Accumulated deviatoric plastic strain e_d.

    Returns
    -------
    slope, strength : float [1], [Pa]
    """
    left = decay(softening.coefficient * plastic_strain)
    sine, cosine = sine_cosine(faded(softening.friction, softening.residual_friction, left))
    cohesion = faded(softening.cohesion, softening.residual_cohesion, left)
    return matched_cone(sine, cosine, cohesion, softening.factor, softening.share)


def tangent_cone(softening: Softening, plastic_strain: float) -> tuple[float, float]:
    """Compute `exponential_cone` with tan(phi) instead of phi.

    The difference is below 1.5 degrees from 40 to 20 degrees.

    Parameters
    ----------
    softening : Softening
    plastic_strain : float [1]
        Accumulated deviatoric plastic strain e_d.
    """
    left = decay(softening.coefficient * plastic_strain)
    tangent = faded(softening.friction, softening.residual_friction, left)
    cosine = 1.0 / sqrt(1.0 + tangent * tangent)
    cohesion = faded(softening.cohesion, softening.residual_cohesion, left)
    return matched_cone(tangent * cosine, cosine, cohesion, softening.factor, softening.share)


def linear_cone(softening: Softening, plastic_strain: float) -> tuple[float, float]:
    """Compute the cone after a plastic strain: friction angle and cohesion decrease linearly between two of them.

    As in CB-Geo's Mohr-Coulomb.

    Parameters
    ----------
    softening : Softening
    plastic_strain : float [1]
        Accumulated deviatoric plastic strain e_d.
    """
    way = (softening.residual_strain - plastic_strain) / (softening.residual_strain - softening.peak_strain)
    left = min(max(way, 0.0), 1.0)
    sine, cosine = sine_cosine(faded(softening.friction, softening.residual_friction, left))
    cohesion = faded(softening.cohesion, softening.residual_cohesion, left)
    return matched_cone(sine, cosine, cohesion, softening.factor, softening.share)


# kind -> its law; `softened_cone` has a line for each
SOFTENED = {EXPONENTIAL: exponential_cone, TANGENT: tangent_cone, LINEAR: linear_cone}


def softened_cone(softening: Softening, slope: float, strength: float, plastic_strain: float) -> tuple[float, float]:
    """Compute the cone after a plastic strain, by the law of the softening.

    Parameters
    ----------
    softening : Softening
    slope, strength : float [1], [Pa]
        The cone without softening.
    plastic_strain : float [1]
        Accumulated deviatoric plastic strain e_d.

    Returns
    -------
    slope, strength : float [1], [Pa]
    """
    if softening.kind == EXPONENTIAL:
        return exponential_cone(softening, plastic_strain)
    if softening.kind == TANGENT:
        return tangent_cone(softening, plastic_strain)
    if softening.kind == LINEAR:
        return linear_cone(softening, plastic_strain)
    return slope, strength


def cone(friction_angle: float, cohesion: float, match: str = "triaxial") -> tuple[float, float]:
    """Compute the cone q <= slope p + strength for a friction angle and a cohesion.

    Parameters
    ----------
    friction_angle : float [deg]
        phi.
    cohesion : float [Pa]
    match : str
        A key of MATCHES.

    Returns
    -------
    slope, strength : float [1], [Pa]

    Raises
    ------
    InputError
        No such match.
    """
    if match not in MATCHES:
        raise InputError(f"the cone's match is {match!r}, expected one of {', '.join(MATCHES)}")
    phi = radians(friction_angle)
    return matched_cone(sin(phi), cos(phi), cohesion, *MATCHES[match])


def softening(
    initial: tuple[float, float],
    residual: tuple[float, float],
    coefficient: float,
    form: str = "exponential",
    match: str = "triaxial",
    peak_strain: float = 0.0,
) -> Softening:
    """Make the law of softening from an initial to a residual strength.

    Parameters
    ----------
    initial : tuple of float
        Friction angle [deg] and cohesion [Pa].
    residual : tuple of float
        The same.
    coefficient : float [1]
        xi_s; of `linear`: 1 over the range of plastic strain in which strength is lost.
    form : str
        `exponential`, `tangent` (both with xi_s) or `linear`, with a loss of strength between the plastic strains
        `peak_strain` and `peak_strain + 1 / coefficient`.
    match : str
        A key of MATCHES.
    peak_strain : float [1]
        Of `linear`.

    Raises
    ------
    InputError
        No such form or match, or a linear form whose coefficient is not above 0.
    """
    if match not in MATCHES:
        raise InputError(f"the cone's match is {match!r}, expected one of {', '.join(MATCHES)}")
    (angle, cohesion), (residual_angle, residual_cohesion) = initial, residual
    start, end = radians(angle), radians(residual_angle)
    if form not in FORMS:
        raise InputError(f"softening has no form {form!r}, expected exponential, tangent or linear")
    kind, lost = FORMS[form], 0.0
    if kind == TANGENT:
        start, end = tan(start), tan(end)
    if kind == LINEAR:
        if not coefficient > 0.0:
            raise InputError(f"linear softening has coefficient {coefficient:g}, expected above 0; or remove softening")
        lost = peak_strain + 1.0 / coefficient
    numbers = start, cohesion, end, residual_cohesion, coefficient, peak_strain, lost, *MATCHES[match]
    return Softening(kind, *map(float, numbers))
