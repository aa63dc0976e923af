"""Solid materials of the 3D solver: stress from the deformation of a step.

A material is a NamedTuple of its parameters whose methods run as plain Python and, unchanged, inside the compiled
solver, for several points at once. A point carries eight numbers, all 0 where it is free of stress: b - I (xx, yy, zz,
xy, xz, yz) of the elastic left Cauchy-Green tensor b = F F^T, the accumulated deviatoric plastic strain e_d = sum of
sqrt(2/3) |de_p| [1], and the volume v_c [1] by which it was pulled apart and must be compressed before it bears
load.

A step's gradient g = dt grad v [1] makes b_trial = (I + g) b (I + g)^T with the Hencky strain e = log(b_trial) / 2;
Kirchhoff stress tau = J sigma = 2 G dev e + K tr(e) I [Pa], per volume free of stress. Invariants p = -K tr e (pressure
is positive) and q = sqrt(6) G |dev e|. `returned_strain` of a material gives the elastic trace and norm. Because all
materials here flow without change of volume, the deviator keeps its direction: no principal values are needed.

Codes of a step: ORDINARY, NO_TENSION (at the cone's tip), FAR (call `stress_step_far`; its own FAR: a stretch was
limited to 1e-4..1e4, or the determinant of the step is negative).
"""

from math import exp, expm1, inf, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

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
from .softening import cone

if TYPE_CHECKING:
    import numpy as np

ORDINARY = 0.0  # code of a step
NO_TENSION = 1.0  # code of a step: the stress is at the tip of the cone
FAR = 2.0  # code of a step: strains beyond the series; of `stress_step_far`: beyond the allowed stretches
TINY = 1e-30  # a divisor in place of 0: its inverse is finite in float32 too


def stress_step(
    material: tuple,
    s0: float,
    s1: float,
    s2: float,
    s3: float,
    s4: float,
    s5: float,
    s6: float,
    s7: float,
    gxx: float,
    gxy: float,
    gxz: float,
    gyx: float,
    gyy: float,
    gyz: float,
    gzx: float,
    gzy: float,
    gzz: float,
    time_step: float,
    softening: tuple,
) -> tuple[float, ...]:
    """Compute state and stress of a point after a step, for strains within the reach of the series.

    The Kirchhoff stress is tau = J sigma = 2 G dev e + K tr(e) I of the elastic Hencky strain e.

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    s0, s1, s2, s3, s4, s5, s6, s7 : float
        State: b - I (xx, yy, zz, xy, xz, yz) [1], e_d [1], v_c [1].
    gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz : float [1]
        Gradient of the step, dt grad v.
    time_step : float [s]
    softening : law
        Law of the slot `softening`.

    Returns
    -------
    s0..s7, txx, tyy, tzz, txy, txz, tyz, code : float
        New state, Kirchhoff stress [Pa], and the code ORDINARY, NO_TENSION or FAR.
    """
    xxx, xyy, xzz, xxy, xxz, xyz = pushed_forward(s0, s1, s2, s3, s4, s5, gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz)
    near = squared_norm(xxx, xyy, xzz, xxy, xxz, xyz) <= SERIES_REACH
    upright = determinant_of_step(gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz) > 0.0
    trace, dxx, dyy, dzz, dxy, dxz, dyz = hencky_strain(xxx, xyy, xzz, xxy, xxz, xyz)
    norm = sqrt(squared_norm(dxx, dyy, dzz, dxy, dxz, dyz))
    trace, kept, s6, s7, code, yields = material.returned_strain(trace, norm, s6, s7, time_step, softening)
    dxx, dyy, dzz, dxy, dxz, dyz = kept * dxx, kept * dyy, kept * dzz, kept * dxy, kept * dxz, kept * dyz
    fxx, fyy, fzz, fxy, fxz, fyz = exponential_less_unit(
        2.0 * trace, 2.0 * dxx, 2.0 * dyy, 2.0 * dzz, 2.0 * dxy, 2.0 * dxz, 2.0 * dyz
    )
    twice, pull = 2.0 * material.shear_modulus, material.bulk_modulus * trace
    return (
        fxx if yields else xxx,
        fyy if yields else xyy,
        fzz if yields else xzz,
        fxy if yields else xxy,
        fxz if yields else xxz,
        fyz if yields else xyz,
        s6,
        s7,
        twice * dxx + pull,
        twice * dyy + pull,
        twice * dzz + pull,
        twice * dxy,
        twice * dxz,
        twice * dyz,
        code if near and upright else FAR,
    )


def stress_step_far(
    material: tuple,
    s0: float,
    s1: float,
    s2: float,
    s3: float,
    s4: float,
    s5: float,
    s6: float,
    s7: float,
    gxx: float,
    gxy: float,
    gxz: float,
    gyx: float,
    gyy: float,
    gyz: float,
    gzx: float,
    gzy: float,
    gzz: float,
    time_step: float,
    softening: tuple,
) -> tuple[float, ...]:
    """Compute `stress_step` of one point for strains of any size, by principal values.

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    s0, s1, s2, s3, s4, s5, s6, s7 : float
        State: b - I (xx, yy, zz, xy, xz, yz) [1], e_d [1], v_c [1].
    gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz : float [1]
        Gradient of the step, dt grad v.
    time_step : float [s]
    softening : law
        Law of the slot `softening`.
    """
    xxx, xyy, xzz, xxy, xxz, xyz = pushed_forward(s0, s1, s2, s3, s4, s5, gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz)
    upright = determinant_of_step(gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz) > 0.0
    a, b, c, ax, ay, az, bx, by, bz, cx, cy, cz = principal(xxx, xyy, xzz, xxy, xxz, xyz)
    held = 1.0 + min(a, b, c) >= SMALLEST_STRETCH * SMALLEST_STRETCH
    held = held and 1.0 + max(a, b, c) <= LARGEST_STRETCH * LARGEST_STRETCH
    ea, eb, ec = principal_strain(a), principal_strain(b), principal_strain(c)
    trace, mean = ea + eb + ec, (ea + eb + ec) / 3.0
    da, db, dc = ea - mean, eb - mean, ec - mean
    norm = sqrt(da * da + db * db + dc * dc)
    trace, kept, s6, s7, code, yields = material.returned_strain(trace, norm, s6, s7, time_step, softening)
    da, db, dc, mean = kept * da, kept * db, kept * dc, trace / 3.0
    if yields or not held:
        fa, fb, fc = expm1(2.0 * (mean + da)), expm1(2.0 * (mean + db)), expm1(2.0 * (mean + dc))
        xxx, xyy, xzz, xxy, xxz, xyz = assembled(fa, fb, fc, ax, ay, az, bx, by, bz, cx, cy, cz)
    twice, pull = 2.0 * material.shear_modulus, material.bulk_modulus * trace
    txx, tyy, tzz, txy, txz, tyz = assembled(
        twice * da + pull, twice * db + pull, twice * dc + pull, ax, ay, az, bx, by, bz, cx, cy, cz
    )
    code = code if upright and held else FAR
    return xxx, xyy, xzz, xxy, xxz, xyz, s6, s7, txx, tyy, tzz, txy, txz, tyz, code


def state_at_stress(
    material: tuple,
    txx: "float | np.ndarray",
    tyy: "float | np.ndarray",
    tzz: "float | np.ndarray",
    txy: "float | np.ndarray",
    txz: "float | np.ndarray",
    tyz: "float | np.ndarray",
) -> tuple:
    """Compute the elastic state s0..s7 of a Kirchhoff stress; for numbers or arrays.

    The first step returns stress beyond the yield surface. Strains up to a norm of 2.

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    txx, tyy, tzz, txy, txz, tyz : float or float64[n] [Pa]
        Kirchhoff stress.
    """
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


def stored_energy(
    material: tuple, s0: float, s1: float, s2: float, s3: float, s4: float, s5: float, s6: float, s7: float
) -> float:
    """Compute the elastic energy [J m-3] per volume free of stress: K tr(e)^2 / 2 + G |dev e|^2.

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    s0, s1, s2, s3, s4, s5, s6, s7 : float
        State: b - I (xx, yy, zz, xy, xz, yz) [1], e_d [1], v_c [1].
    """
    if squared_norm(s0, s1, s2, s3, s4, s5) <= SERIES_REACH:
        trace, dxx, dyy, dzz, dxy, dxz, dyz = hencky_strain(s0, s1, s2, s3, s4, s5)
        norm2 = squared_norm(dxx, dyy, dzz, dxy, dxz, dyz)
    else:
        parts = principal(s0, s1, s2, s3, s4, s5)
        ea, eb, ec = principal_strain(parts[0]), principal_strain(parts[1]), principal_strain(parts[2])
        trace, mean = ea + eb + ec, (ea + eb + ec) / 3.0
        norm2 = (ea - mean) ** 2 + (eb - mean) ** 2 + (ec - mean) ** 2
    return 0.5 * material.bulk_modulus * trace * trace + material.shear_modulus * norm2


def volume_ratio(
    material: tuple, s0: float, s1: float, s2: float, s3: float, s4: float, s5: float, s6: float, s7: float
) -> float:
    """Compute the volume over the stress-free volume [1]: sqrt(det b), times the opening exp(v_c).

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    s0, s1, s2, s3, s4, s5, s6, s7 : float
        State: b - I (xx, yy, zz, xy, xz, yz) [1], e_d [1], v_c [1].
    """
    xx, yy, zz = 1.0 + s0, 1.0 + s1, 1.0 + s2
    determinant = xx * (yy * zz - s5 * s5) - s3 * (s3 * zz - s5 * s4) + s4 * (s3 * s5 - yy * s4)
    return sqrt(max(determinant, 0.0)) * exp(s7)


def wave_speed(material: tuple, density: float) -> float:
    """Compute the speed of pressure waves [m s-1], sqrt((K + 4 G / 3) / rho), for the time step.

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    density : float [kg m-3]
    """
    return sqrt((material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus) / density)


def no_viscosity(material: tuple) -> float:
    """Return 0 [Pa s]: no viscous limit of the time step.

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    """
    return 0.0


def no_density(material: tuple) -> bool:
    """Return False: the density at the nodes is not used (`point_density`).

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    """
    return False


def eight_variables(material: tuple) -> int:
    """Return the number of state variables of a point, 8.

    Parameters
    ----------
    material : law
        Material with the fields `bulk_modulus` and `shear_modulus` [Pa].
    """
    return 8


class Elastic(NamedTuple):
    """Hencky elasticity: exact for any rotation, realistic for stretches of 0.7 to 1.3 (Anand 1979).

    For solid blocks and exact solutions. Rock K 10 to 50 GPa, ice 9 GPa, laboratory gels from 10 kPa; both moduli are
    commonly scaled down, because the time step is inversely proportional to their root.
    """

    bulk_modulus: float  # K [Pa]
    shear_modulus: float  # G [Pa]

    def strength_at_rest(self) -> tuple[float, float]:
        """Return m [1] and k [Pa]: |s| / sqrt(2) is at most m p + k at rest; here it is not limited."""
        return inf, 0.0

    def returned_strain(
        self, trace: float, norm: float, plastic_strain: float, opening: float, time_step: float, softening: tuple
    ) -> tuple[float, float, float, float, float, bool]:
        """Return the trial strain, all of which is elastic, as `DruckerPrager.returned_strain`.

        Parameters
        ----------
        trace : float [1]
            Trace of the trial strain.
        norm : float [1]
            Norm of its deviator.
        plastic_strain : float [1]
            e_d.
        opening : float [1]
            v_c.
        time_step : float [s]
        softening : law
            Law of the slot `softening`.
        """
        return trace, 1.0, plastic_strain, opening, ORDINARY, False

    stress_step = stress_step
    stress_step_far = stress_step_far
    state_at_stress = state_at_stress
    stored_energy = stored_energy
    volume_ratio = volume_ratio
    wave_speed = wave_speed
    viscosity = no_viscosity
    state_count = eight_variables
    follows_density = no_density


class DruckerPrager(NamedTuple):
    """Frictional, cohesive: q <= slope (p - K v_c) + strength; beyond the tip of the cone the material separates.

    Flow keeps volumes (no dilatancy). Made from phi and c by `drucker_prager`. `volume_correction` 1 stores the
    opening, so that free fall does not create volume (Tampubolon et al. 2017); 0 does not. Vicari et al.
    (2025), glacier ice: K 6.7 MPa, G 4 MPa, 40 degrees, 1 kPa. Sands: 25 to 45 degrees, cohesion 0 to 5 kPa,
    K and G often scaled down to 1 to 10 MPa for longer time steps.
    """

    bulk_modulus: float  # K [Pa]
    shear_modulus: float  # G [Pa]
    slope: float  # gamma [1]
    strength: float  # q_c [Pa], strength without pressure
    tension_limit: float  # largest tension -p [Pa], below that of the tip of the cone (always if slope is 0)
    volume_correction: float  # 1 or 0

    def strength_at_rest(self) -> tuple[float, float]:
        """Return m [1] and k [Pa]: at rest |s| / sqrt(2) is at most m p + k."""
        return self.slope / sqrt(3.0), self.strength / sqrt(3.0)

    def returned_strain(
        self, trace: float, norm: float, plastic_strain: float, opening: float, time_step: float, softening: tuple
    ) -> tuple[float, float, float, float, float, bool]:
        """Reduce the trial strain of a step to what is elastic (return mapping).

        Parameters
        ----------
        trace : float [1]
            Trace of the trial strain.
        norm : float [1]
            Norm of its deviator.
        plastic_strain : float [1]
            e_d.
        opening : float [1]
            v_c.
        time_step : float [s]
        softening : law
            Law of the slot `softening`.

        Returns
        -------
        elastic, kept, plastic_strain, opening, code, yields : float, float, float, float, float, bool
            Elastic trace [1], share of the deviator that is elastic [1], new e_d [1], new v_c [1], code of the step,
            whether the material yields.
        """
        slope, strength = softening.softened_cone(self.slope, self.strength, plastic_strain)
        tension = min(strength / max(slope, TINY), self.tension_limit)
        pull = self.bulk_modulus * (trace + opening)  # -p, v_c included
        borne = max(strength - slope * pull, 0.0)
        q = sqrt(6.0) * self.shear_modulus * norm
        torn, sheared = pull >= tension, q > borne
        kept = 0.0 if torn else (borne / max(q, TINY) if sheared else 1.0)
        elastic = tension / self.bulk_modulus if torn else trace
        gained = self.volume_correction * (opening + trace - elastic) if torn else 0.0
        plastic_strain = plastic_strain + sqrt(2.0 / 3.0) * (1.0 - kept) * norm
        return elastic, kept, plastic_strain, gained, NO_TENSION if torn else ORDINARY, torn or sheared

    stress_step = stress_step
    stress_step_far = stress_step_far
    state_at_stress = state_at_stress
    stored_energy = stored_energy
    volume_ratio = volume_ratio
    wave_speed = wave_speed
    viscosity = no_viscosity
    state_count = eight_variables
    follows_density = no_density


class MuI(NamedTuple):
    """Dense granular flow: |s| / sqrt(2) = mu(I) p, mu = mu1 + (mu2 - mu1) / (1 + I0 / I), I = rate d sqrt(rho_s / p).

    Jop et al. (2006), solved for the shear rate at the end of the step. Glass beads: mu1 = tan 20.9,
    mu2 = tan 32.8 degrees, I0 = 0.279; sands mu1 0.4 to 0.65. No tension. Softening does not act on it.
    """

    bulk_modulus: float  # K [Pa]
    shear_modulus: float  # G [Pa]
    mu1: float  # [1] at rest
    mu2: float  # [1] fast, above mu1
    inertial_number: float  # I0 [1]
    grain_diameter: float  # d [m]
    grain_density: float  # rho_s [kg m-3]
    volume_correction: float  # 1 or 0

    def strength_at_rest(self) -> tuple[float, float]:
        """Return m [1] and k [Pa]: at rest |s| / sqrt(2) is at most m p + k."""
        return self.mu1, 0.0

    def returned_strain(
        self, trace: float, norm: float, plastic_strain: float, opening: float, time_step: float, softening: tuple
    ) -> tuple[float, float, float, float, float, bool]:
        """Reduce the trial strain of a step to what is elastic, as `DruckerPrager.returned_strain`.

        Parameters
        ----------
        trace : float [1]
            Trace of the trial strain.
        norm : float [1]
            Norm of its deviator.
        plastic_strain : float [1]
            e_d.
        opening : float [1]
            v_c.
        time_step : float [s]
        softening : law
            Law of the slot `softening`.
        """
        pressure = max(-self.bulk_modulus * (trace + opening), 0.0)
        shear = sqrt(2.0) * self.shear_modulus * norm  # |s| / sqrt(2)
        excess = max(shear - self.mu1 * pressure, 0.0)
        crossover = self.inertial_number * sqrt(pressure / self.grain_density) / self.grain_diameter  # rate [s-1] of I0
        slowing = self.shear_modulus * time_step
        linear = slowing * crossover + (self.mu2 - self.mu1) * pressure - excess
        root = sqrt(linear * linear + 4.0 * slowing * excess * crossover)
        # positive root of slowing rate^2 + linear rate - excess crossover = 0, times slowing
        fast = 0.5 * (root - linear)
        slow = 2.0 * slowing * excess * crossover / max(root + linear, TINY)
        torn, sheared = pressure <= 0.0, excess > 0.0
        kept = 0.0 if torn else 1.0 - (slow if linear > 0.0 else fast) / max(shear, TINY)
        elastic = 0.0 if torn else trace
        gained = self.volume_correction * (opening + trace) if torn else 0.0
        plastic_strain = plastic_strain + sqrt(2.0 / 3.0) * (1.0 - kept) * norm
        return elastic, kept, plastic_strain, gained, NO_TENSION if torn else ORDINARY, torn or sheared

    stress_step = stress_step
    stress_step_far = stress_step_far
    state_at_stress = state_at_stress
    stored_energy = stored_energy
    volume_ratio = volume_ratio
    wave_speed = wave_speed
    viscosity = no_viscosity
    state_count = eight_variables
    follows_density = no_density


class CohesiveMuI(NamedTuple):
    """`DruckerPrager` with rate-dependent friction: q <= cone(p') + sqrt(3) mu_r p' / (1 + I0 / I).

    p' = p - K v_c, mu_r = mu2 - mu1 of `MuI`, I = rate d sqrt(rho_s / p') (Jop et al. 2006). `softening` reduces the
    cone and the cohesion, but not the rate-dependent part. That is 0 in tension and for mu_r = 0, which is
    `DruckerPrager` to the last bit; without cohesion and softening it is `MuI` of mu1 = slope / sqrt(3), to rounding.
    Solved for the rate at the end of the step, as `MuI`. Rate-dependent cohesive Drucker-Prager laws are in use for
    ice (Gaume et al., PARTICLES 2025, an abstract); parameters measured on ice avalanches are not known.
    """

    bulk_modulus: float  # K [Pa]
    shear_modulus: float  # G [Pa]
    slope: float  # gamma [1]
    strength: float  # q_c [Pa]
    tension_limit: float  # [Pa], as that of `DruckerPrager`
    rate_friction: float  # mu_r [1]
    inertial_number: float  # I0 [1]
    grain_diameter: float  # d [m]
    grain_density: float  # rho_s [kg m-3]
    volume_correction: float  # 1 or 0

    def strength_at_rest(self) -> tuple[float, float]:
        """Return m [1] and k [Pa]: at rest |s| / sqrt(2) is at most m p + k."""
        return self.slope / sqrt(3.0), self.strength / sqrt(3.0)

    def returned_strain(
        self, trace: float, norm: float, plastic_strain: float, opening: float, time_step: float, softening: tuple
    ) -> tuple[float, float, float, float, float, bool]:
        """Reduce the trial strain of a step to what is elastic, as `DruckerPrager.returned_strain`.

        Parameters
        ----------
        trace : float [1]
            Trace of the trial strain.
        norm : float [1]
            Norm of its deviator.
        plastic_strain : float [1]
            e_d.
        opening : float [1]
            v_c.
        time_step : float [s]
        softening : law
            Law of the slot `softening`.
        """
        slope, strength = softening.softened_cone(self.slope, self.strength, plastic_strain)
        tension = min(strength / max(slope, TINY), self.tension_limit)
        pull = self.bulk_modulus * (trace + opening)  # -p, v_c included
        borne = max(strength - slope * pull, 0.0)
        q = sqrt(6.0) * self.shear_modulus * norm
        torn, sheared = pull >= tension, q > borne
        pressure = max(-pull, 0.0)
        growth, excess = self.rate_friction * pressure, sqrt(1.0 / 3.0) * max(q - borne, 0.0)  # as |s| / sqrt(2)
        crossover = self.inertial_number / (self.grain_diameter * sqrt(self.grain_density)) * sqrt(pressure)  # [s-1]
        slowing = self.shear_modulus * time_step * crossover
        linear = slowing + growth - excess
        half = 0.5 * (sqrt(linear * linear + 4.0 * excess * slowing) + abs(linear))
        # x = G dt rate is the positive root of x^2 + linear x - excess slowing = 0; strength: growth x / (x + slowing)
        over = excess if linear > 0.0 else half
        share = over / max(over + (half if linear > 0.0 else slowing), TINY)
        borne = borne + sqrt(3.0) * growth * share
        kept = 0.0 if torn else (borne / max(q, TINY) if sheared else 1.0)
        elastic = tension / self.bulk_modulus if torn else trace
        gained = self.volume_correction * (opening + trace - elastic) if torn else 0.0
        plastic_strain = plastic_strain + sqrt(2.0 / 3.0) * (1.0 - kept) * norm
        return elastic, kept, plastic_strain, gained, NO_TENSION if torn else ORDINARY, torn or sheared

    stress_step = stress_step
    stress_step_far = stress_step_far
    state_at_stress = state_at_stress
    stored_energy = stored_energy
    volume_ratio = volume_ratio
    wave_speed = wave_speed
    viscosity = no_viscosity
    state_count = eight_variables
    follows_density = no_density


def drucker_prager(
    bulk_modulus: float,
    shear_modulus: float,
    friction_angle: float,
    cohesion: float,
    match: str = "triaxial",
    tension_limit: float | None = None,
    volume_correction: bool = True,
) -> DruckerPrager:
    """Make a `DruckerPrager` from a friction angle phi and a cohesion c.

    A cone matched at triaxial compression is too strong in plane strain (30 degrees: slope 1.2 in place of 0.866).

    Parameters
    ----------
    bulk_modulus, shear_modulus : float [Pa]
        K and G.
    friction_angle : float [deg]
        phi.
    cohesion : float [Pa]
        c.
    match : str
        `triaxial` (compression) or `plane_strain`: where the cone meets Mohr-Coulomb.
    tension_limit : float [Pa], optional
        Tension is borne up to the cone's tip c / tan(phi), and nowhere above this limit. Default 10 c, which cuts no
        cone steeper than 5.7 degrees.
    volume_correction : bool
        Whether the opening v_c is stored.

    Raises
    ------
    InputError
        No such match.
    """
    slope, strength = cone(friction_angle, cohesion, match)
    limit = 10.0 * cohesion if tension_limit is None else tension_limit
    return DruckerPrager(bulk_modulus, shear_modulus, slope, strength, limit, 1.0 if volume_correction else 0.0)


def cohesive_mu_i(
    friction_angle: float,
    cohesion: float,
    rate_friction: float,
    inertial_number: float,
    grain_diameter: float,
    grain_density: float,
    **cone: Any,
) -> CohesiveMuI:
    """Make a `CohesiveMuI` with the cone of `drucker_prager`.

    Parameters
    ----------
    friction_angle : float [deg]
        phi.
    cohesion : float [Pa]
        c.
    rate_friction : float [1]
        mu_r.
    inertial_number : float [1]
        I0.
    grain_diameter : float [m]
    grain_density : float [kg m-3]
    cone : dict
        Further parameters of `drucker_prager`: the moduli, and options.
    """
    at_rest = drucker_prager(friction_angle=friction_angle, cohesion=cohesion, **cone)
    grows = {
        "rate_friction": rate_friction,
        "inertial_number": inertial_number,
        "grain_diameter": grain_diameter,
        "grain_density": grain_density,
    }
    return CohesiveMuI(**at_rest._asdict(), **grows)
