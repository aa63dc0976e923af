"""Solid materials of the 3D solver: stress from the deformation of a step.

All functions run as plain Python and, unchanged, inside the compiled solver, some of them for several points at once. A
point carries eight numbers, all 0 where it is free of stress: b - I (xx, yy, zz, xy, xz, yz) of the elastic left
Cauchy-Green tensor b = F F^T, the accumulated deviatoric plastic strain e_d = sum of sqrt(2/3) |de_p| [1], and the
volume v_c [1] by which it was pulled apart and must be compressed before it bears load.

A step's gradient g = dt grad v [1] makes b_trial = (I + g) b (I + g)^T with the Hencky strain e = log(b_trial) / 2;
Kirchhoff stress tau = J sigma = 2 G dev e + K tr(e) I [Pa], per volume free of stress. Invariants p = -K tr e (pressure
is positive) and q = sqrt(6) G |dev e|. The law of a material, `returned_drucker_prager` for example, reduces the trial
strain of a step to what is elastic: it gives the elastic trace and the share of the deviator. Because all materials
here flow without change of volume, the deviator keeps its direction: no principal values are needed.
"""

from math import exp, expm1, sqrt

from .hencky import (
    LARGEST_STRETCH,
    SERIES_REACH,
    SMALLEST_STRETCH,
    assembled,
    determinant_of_step,
    exponential_less_unit,
    hencky_strain,
    large_exponential_less_unit,
    principal,
    principal_strain,
    pushed_forward,
    squared_norm,
)
from .material import COHESIVE_MU_I, CONES, DRUCKER_PRAGER, ELASTIC, FAR, MU_I, NO_TENSION, ORDINARY, TINY, Material
from .softening import Softening, softened_cone


def returned_elastic(
    material: Material,
    cone: tuple[float, float],
    trace: float,
    norm: float,
    plastic_strain: float,
    opening: float,
    time_step: float,
) -> tuple[float, float, float, float, float, bool]:
    """Return the strain of an elastic body, all of which is kept: tau = 2 G dev e + K tr(e) I of the Hencky strain e.

    Exact for any rotation, realistic for stretches of 0.7 to 1.3 (Anand 1979). For solid blocks and exact solutions.
    Rock K 10 to 50 GPa, ice 9 GPa, laboratory gels from 10 kPa; both moduli are commonly scaled down, because the time
    step is inversely proportional to their root.

    Parameters
    ----------
    material, cone, trace, norm, plastic_strain, opening, time_step
        As of `returned_drucker_prager`.
    """
    return trace, 1.0, plastic_strain, opening, ORDINARY, False


def returned_drucker_prager(
    material: Material,
    cone: tuple[float, float],
    trace: float,
    norm: float,
    plastic_strain: float,
    opening: float,
    time_step: float,
) -> tuple[float, float, float, float, float, bool]:
    """Return the elastic strain of a frictional, cohesive material: q <= slope (p - K v_c) + strength.

    It reduces the trial strain of a step to what is elastic (return mapping). Beyond the tip of the cone the material
    separates. Flow keeps volumes (no dilatancy). Made from phi and c by `material.drucker_prager`. `volume_correction`
    1 stores the opening, so that free fall does not create volume (Tampubolon et al. 2017); 0 does not. Vicari et al.
    (2025), glacier ice: K 6.7 MPa, G 4 MPa, 40 degrees, 1 kPa. Sands: 25 to 45 degrees, cohesion 0 to 5 kPa, K and G
    often scaled down to 1 to 10 MPa for longer time steps.

    Parameters
    ----------
    material : Material
    cone : (float [1], float [Pa])
        Slope and strength of the material after softening.
    trace : float [1]
        Trace of the trial strain.
    norm : float [1]
        Norm of its deviator.
    plastic_strain : float [1]
        e_d.
    opening : float [1]
        v_c.
    time_step : float [s]

    Returns
    -------
    elastic, kept, plastic_strain, opening, code, yields : float, float, float, float, float, bool
        Elastic trace [1], share of the deviator that is elastic [1], new e_d [1], new v_c [1], code of the step,
        whether the material yields.
    """
    slope, strength = cone
    tension = min(strength / max(slope, TINY), material.tension_limit)
    pull = material.bulk_modulus * (trace + opening)  # -p, v_c included
    borne = max(strength - slope * pull, 0.0)
    q = sqrt(6.0) * material.shear_modulus * norm
    torn, sheared = pull >= tension, q > borne
    kept = 0.0 if torn else (borne / max(q, TINY) if sheared else 1.0)
    elastic = tension / material.bulk_modulus if torn else trace
    gained = material.volume_correction * (opening + trace - elastic) if torn else 0.0
    plastic_strain = plastic_strain + sqrt(2.0 / 3.0) * (1.0 - kept) * norm
    return elastic, kept, plastic_strain, gained, NO_TENSION if torn else ORDINARY, torn or sheared


def returned_mu_i(
    material: Material,
    cone: tuple[float, float],
    trace: float,
    norm: float,
    plastic_strain: float,
    opening: float,
    time_step: float,
) -> tuple[float, float, float, float, float, bool]:
    """Return the elastic strain of a dense granular flow: mu = mu1 + (mu2 - mu1) / (1 + I0 / I).

    |s| / sqrt(2) = mu(I) p, I = rate d sqrt(rho_s / p) (Jop et al. 2006), solved for the shear
    rate at the end of the step. Glass beads: mu1 = tan 20.9, mu2 = tan 32.8 degrees, I0 = 0.279; sands mu1 0.4 to 0.65.
    No tension. Softening does not act on it.

    Parameters
    ----------
    material, cone, trace, norm, plastic_strain, opening, time_step
        As of `returned_drucker_prager`.
    """
    pressure = max(-material.bulk_modulus * (trace + opening), 0.0)
    shear = sqrt(2.0) * material.shear_modulus * norm  # |s| / sqrt(2)
    excess = max(shear - material.mu1 * pressure, 0.0)
    crossover = material.inertial_number * sqrt(pressure / material.grain_density) / material.grain_diameter  # I0 [s-1]
    slowing = material.shear_modulus * time_step
    linear = slowing * crossover + (material.mu2 - material.mu1) * pressure - excess
    root = sqrt(linear * linear + 4.0 * slowing * excess * crossover)
    # positive root of slowing rate^2 + linear rate - excess crossover = 0, times slowing
    fast = 0.5 * (root - linear)
    slow = 2.0 * slowing * excess * crossover / max(root + linear, TINY)
    torn, sheared = pressure <= 0.0, excess > 0.0
    kept = 0.0 if torn else 1.0 - (slow if linear > 0.0 else fast) / max(shear, TINY)
    elastic = 0.0 if torn else trace
    gained = material.volume_correction * (opening + trace) if torn else 0.0
    plastic_strain = plastic_strain + sqrt(2.0 / 3.0) * (1.0 - kept) * norm
    return elastic, kept, plastic_strain, gained, NO_TENSION if torn else ORDINARY, torn or sheared


def returned_cohesive_mu_i(
    material: Material,
    cone: tuple[float, float],
    trace: float,
    norm: float,
    plastic_strain: float,
    opening: float,
    time_step: float,
) -> tuple[float, float, float, float, float, bool]:
    """Return the elastic strain of a cohesive flow with rate-dependent friction.

    Drucker-Prager with the rate term of mu(I), q <= cone(p') + sqrt(3) mu_r p' / (1 + I0 / I): p' = p - K v_c, mu_r =
    mu2 - mu1 of mu(I), I = rate d sqrt(rho_s / p') (Jop et al. 2006). Softening reduces the cone and the cohesion, but
    not the rate-dependent part. That is 0 in tension and for mu_r = 0, which is `returned_drucker_prager` to the last
    bit; without cohesion and softening it is `returned_mu_i` of mu1 = slope / sqrt(3), to rounding. Solved for the rate
    at the end of the step. Rate-dependent cohesive Drucker-Prager laws are in use for ice (Gaume et al., PARTICLES
    2025, an abstract); parameters measured on ice avalanches are not known.

    Parameters
    ----------
    material, cone, trace, norm, plastic_strain, opening, time_step
        As of `returned_drucker_prager`.
    """
    slope, strength = cone
    tension = min(strength / max(slope, TINY), material.tension_limit)
    pull = material.bulk_modulus * (trace + opening)  # -p, v_c included
    borne = max(strength - slope * pull, 0.0)
    q = sqrt(6.0) * material.shear_modulus * norm
    torn, sheared = pull >= tension, q > borne
    pressure = max(-pull, 0.0)
    growth, excess = material.rate_friction * pressure, sqrt(1.0 / 3.0) * max(q - borne, 0.0)  # as |s| / sqrt(2)
    crossover = material.inertial_number / (material.grain_diameter * sqrt(material.grain_density)) * sqrt(pressure)
    slowing = material.shear_modulus * time_step * crossover
    linear = slowing + growth - excess
    half = 0.5 * (sqrt(linear * linear + 4.0 * excess * slowing) + abs(linear))
    # x = G dt rate is the positive root of x^2 + linear x - excess slowing = 0; strength: growth x / (x + slowing)
    over = excess if linear > 0.0 else half
    share = over / max(over + (half if linear > 0.0 else slowing), TINY)
    borne = borne + sqrt(3.0) * growth * share
    kept = 0.0 if torn else (borne / max(q, TINY) if sheared else 1.0)
    elastic = tension / material.bulk_modulus if torn else trace
    gained = material.volume_correction * (opening + trace - elastic) if torn else 0.0
    plastic_strain = plastic_strain + sqrt(2.0 / 3.0) * (1.0 - kept) * norm
    return elastic, kept, plastic_strain, gained, NO_TENSION if torn else ORDINARY, torn or sheared


# kind -> its law; `returned_strain` has a line for each
RETURNED = {
    ELASTIC: returned_elastic,
    DRUCKER_PRAGER: returned_drucker_prager,
    MU_I: returned_mu_i,
    COHESIVE_MU_I: returned_cohesive_mu_i,
}


def returned_strain(
    material: Material,
    cone: tuple[float, float],
    trace: float,
    norm: float,
    plastic_strain: float,
    opening: float,
    time_step: float,
) -> tuple[float, float, float, float, float, bool]:
    """Reduce the trial strain of a step to what is elastic, by the law of the material.

    Parameters
    ----------
    material, cone, trace, norm, plastic_strain, opening, time_step
        As of `returned_drucker_prager`.
    """
    if material.kind == DRUCKER_PRAGER:
        return returned_drucker_prager(material, cone, trace, norm, plastic_strain, opening, time_step)
    if material.kind == MU_I:
        return returned_mu_i(material, cone, trace, norm, plastic_strain, opening, time_step)
    if material.kind == COHESIVE_MU_I:
        return returned_cohesive_mu_i(material, cone, trace, norm, plastic_strain, opening, time_step)
    return returned_elastic(material, cone, trace, norm, plastic_strain, opening, time_step)


def cone_of(material: Material, softening: Softening, plastic_strain: float) -> tuple[float, float]:
    """Return slope [1] and strength [Pa] of the cone of a material after a plastic strain.

    Parameters
    ----------
    material : Material
    softening : Softening
    plastic_strain : float [1]
        e_d.
    """
    if material.kind in CONES:
        return softened_cone(softening, material.slope, material.strength, plastic_strain)
    return material.slope, material.strength


def trial_strain(x: tuple, gradient: tuple) -> tuple[tuple, float, tuple, float, bool]:
    """Compute the strain after a step in which nothing yields, for strains within the reach of the series.

    Parameters
    ----------
    x : tuple of 6 floats [1]
        b - I before the step: xx, yy, zz, xy, xz, yz.
    gradient : tuple of 9 floats [1]
        Gradient of the step, dt grad v: xx, xy, xz, yx, yy, yz, zx, zy, zz.

    Returns
    -------
    x : tuple of 6 floats [1]
        b - I after the step.
    trace : float [1]
        Trace of the Hencky strain.
    deviator : tuple of 6 floats [1]
    norm : float [1]
        Of the deviator.
    near : bool
        Whether the strain is within the reach, and the step does not turn the point inside out.
    """
    xxx, xyy, xzz, xxy, xxz, xyz = pushed_forward(x, gradient)
    within = squared_norm(xxx, xyy, xzz, xxy, xxz, xyz) <= SERIES_REACH
    upright = determinant_of_step(gradient) > 0.0
    trace, dxx, dyy, dzz, dxy, dxz, dyz = hencky_strain(xxx, xyy, xzz, xxy, xxz, xyz)
    norm = sqrt(squared_norm(dxx, dyy, dzz, dxy, dxz, dyz))
    return (xxx, xyy, xzz, xxy, xxz, xyz), trace, (dxx, dyy, dzz, dxy, dxz, dyz), norm, within and upright


def state_of_strain(trace: float, deviator: tuple) -> tuple[float, float, float, float, float, float]:
    """Compute b - I [1] of an elastic Hencky strain within the reach of the series.

    Parameters
    ----------
    trace : float [1]
    deviator : tuple of 6 floats [1]
    """
    dxx, dyy, dzz, dxy, dxz, dyz = deviator
    return exponential_less_unit(2.0 * trace, 2.0 * dxx, 2.0 * dyy, 2.0 * dzz, 2.0 * dxy, 2.0 * dxz, 2.0 * dyz)


def stress_of_strain(
    material: Material, trace: float, deviator: tuple
) -> tuple[float, float, float, float, float, float]:
    """Compute the Kirchhoff stress tau = J sigma = 2 G dev e + K tr(e) I [Pa]: xx, yy, zz, xy, xz, yz.

    Parameters
    ----------
    material : Material
    trace : float [1]
        Trace of the elastic Hencky strain e.
    deviator : tuple of 6 floats [1]
        Its deviator.
    """
    dxx, dyy, dzz, dxy, dxz, dyz = deviator
    twice, pull = 2.0 * material.shear_modulus, material.bulk_modulus * trace
    return twice * dxx + pull, twice * dyy + pull, twice * dzz + pull, twice * dxy, twice * dxz, twice * dyz


def solid_step(
    material: Material, softening: Softening, state: tuple, gradient: tuple, time_step: float
) -> tuple[tuple, tuple, float]:
    """Compute state and stress of a point after a step, for strains within the reach of the series.

    The compiled solver does it for several points at once, part by part (`grid_to_points`).

    Parameters
    ----------
    material : Material
    softening : Softening
    state : tuple of 8 floats
        b - I (xx, yy, zz, xy, xz, yz) [1], e_d [1], v_c [1].
    gradient : tuple of 9 floats [1]
        Gradient of the step, dt grad v: xx, xy, xz, yx, yy, yz, zx, zy, zz.
    time_step : float [s]

    Returns
    -------
    state : tuple of 8 floats
    stress : tuple of 6 floats [Pa]
        Kirchhoff stress xx, yy, zz, xy, xz, yz.
    code : float
        ORDINARY, NO_TENSION or FAR.
    """
    s0, s1, s2, s3, s4, s5, s6, s7 = state
    cone = cone_of(material, softening, s6)
    x, trace, (dxx, dyy, dzz, dxy, dxz, dyz), norm, near = trial_strain((s0, s1, s2, s3, s4, s5), gradient)
    trace, kept, s6, s7, code, yields = returned_strain(material, cone, trace, norm, s6, s7, time_step)
    deviator = kept * dxx, kept * dyy, kept * dzz, kept * dxy, kept * dxz, kept * dyz
    x0, x1, x2, x3, x4, x5 = state_of_strain(trace, deviator) if yields else x
    return (x0, x1, x2, x3, x4, x5, s6, s7), stress_of_strain(material, trace, deviator), code if near else FAR


def solid_step_far(
    material: Material, softening: Softening, state: tuple, gradient: tuple, time_step: float
) -> tuple[tuple, tuple, float]:
    """Compute `solid_step` for strains of any size, by principal values.

    Parameters
    ----------
    material, softening, state, gradient, time_step
        As of `solid_step`.
    """
    s0, s1, s2, s3, s4, s5, s6, s7 = state
    xxx, xyy, xzz, xxy, xxz, xyz = pushed_forward((s0, s1, s2, s3, s4, s5), gradient)
    upright = determinant_of_step(gradient) > 0.0
    a, b, c, ax, ay, az, bx, by, bz, cx, cy, cz = principal(xxx, xyy, xzz, xxy, xxz, xyz)
    held = 1.0 + min(a, b, c) >= SMALLEST_STRETCH * SMALLEST_STRETCH
    held = held and 1.0 + max(a, b, c) <= LARGEST_STRETCH * LARGEST_STRETCH
    ea, eb, ec = principal_strain(a), principal_strain(b), principal_strain(c)
    trace, mean = ea + eb + ec, (ea + eb + ec) / 3.0
    da, db, dc = ea - mean, eb - mean, ec - mean
    norm = sqrt(da * da + db * db + dc * dc)
    cone = cone_of(material, softening, s6)
    trace, kept, s6, s7, code, yields = returned_strain(material, cone, trace, norm, s6, s7, time_step)
    da, db, dc, mean = kept * da, kept * db, kept * dc, trace / 3.0
    if yields or not held:
        fa, fb, fc = expm1(2.0 * (mean + da)), expm1(2.0 * (mean + db)), expm1(2.0 * (mean + dc))
        xxx, xyy, xzz, xxy, xxz, xyz = assembled(fa, fb, fc, ax, ay, az, bx, by, bz, cx, cy, cz)
    twice, pull = 2.0 * material.shear_modulus, material.bulk_modulus * trace
    stress = assembled(twice * da + pull, twice * db + pull, twice * dc + pull, ax, ay, az, bx, by, bz, cx, cy, cz)
    return (xxx, xyy, xzz, xxy, xxz, xyz, s6, s7), stress, code if upright and held else FAR


def solid_at_stress(material: Material, stress: tuple) -> tuple:
    """Compute the elastic state of a Kirchhoff stress, 8 numbers or arrays.

    The first step returns stress beyond the yield surface. Strains up to a norm of 2.

    Parameters
    ----------
    material : Material
    stress : tuple of 6 floats or of 6 float64[n] [Pa]
        xx, yy, zz, xy, xz, yz.
    """
    txx, tyy, tzz, txy, txz, tyz = stress
    trace, bearing = (txx + tyy + tzz) / (3.0 * material.bulk_modulus), 1.0 / material.shear_modulus
    mean = (txx + tyy + tzz) / 3.0
    x = large_exponential_less_unit(
        2.0 * trace,
        bearing * (txx - mean),
        bearing * (tyy - mean),
        bearing * (tzz - mean),
        bearing * txy,
        bearing * txz,
        bearing * tyz,
    )
    nothing = 0.0 * trace
    return x[0], x[1], x[2], x[3], x[4], x[5], nothing, nothing


def solid_energy(material: Material, state: tuple) -> float:
    """Compute the elastic energy [J m-3] per volume free of stress: K tr(e)^2 / 2 + G |dev e|^2.

    Parameters
    ----------
    material : Material
    state : tuple of 8 floats
        b - I (xx, yy, zz, xy, xz, yz) [1], e_d [1], v_c [1].
    """
    s0, s1, s2, s3, s4, s5 = state[0], state[1], state[2], state[3], state[4], state[5]
    if squared_norm(s0, s1, s2, s3, s4, s5) <= SERIES_REACH:
        trace, dxx, dyy, dzz, dxy, dxz, dyz = hencky_strain(s0, s1, s2, s3, s4, s5)
        norm2 = squared_norm(dxx, dyy, dzz, dxy, dxz, dyz)
    else:
        parts = principal(s0, s1, s2, s3, s4, s5)
        ea, eb, ec = principal_strain(parts[0]), principal_strain(parts[1]), principal_strain(parts[2])
        trace, mean = ea + eb + ec, (ea + eb + ec) / 3.0
        norm2 = (ea - mean) ** 2 + (eb - mean) ** 2 + (ec - mean) ** 2
    return 0.5 * material.bulk_modulus * trace * trace + material.shear_modulus * norm2


def solid_volume(state: tuple) -> float:
    """Compute the volume over the stress-free volume [1]: sqrt(det b), times the opening exp(v_c).

    Parameters
    ----------
    state : tuple of 8 floats
        b - I (xx, yy, zz, xy, xz, yz) [1], e_d [1], v_c [1].
    """
    xx, yy, zz, s3, s4, s5 = 1.0 + state[0], 1.0 + state[1], 1.0 + state[2], state[3], state[4], state[5]
    determinant = xx * (yy * zz - s5 * s5) - s3 * (s3 * zz - s5 * s4) + s4 * (s3 * s5 - yy * s4)
    return sqrt(max(determinant, 0.0)) * exp(state[7])
