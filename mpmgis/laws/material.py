"""Materials of the 3D solver: one record for all, the kinds that its field `kind` names, and how each is made.

What a material does is in `solid_material` and `fluid_material`; `material_choice` selects it by the kind.
"""

from typing import Any, NamedTuple

from .softening import cone

# kinds of materials
ELASTIC = 1
DRUCKER_PRAGER = 2
MU_I = 3
COHESIVE_MU_I = 4
FLUID = 5
CONES = (DRUCKER_PRAGER, COHESIVE_MU_I)  # kinds with a cone, which softening changes

ORDINARY = 0.0  # code of a step
NO_TENSION = 1.0  # code of a step: the stress is at the tip of the cone
FAR = 2.0  # code of a step: strains beyond the series; of `stress_step_far`: beyond the allowed stretches
TINY = 1e-30  # a divisor in place of 0: its inverse is finite in float32 too


class Material(NamedTuple):
    """A material of any kind; parameters that its kind does not have are 0.

    Made by `elastic`, `drucker_prager`, `mu_i`, `cohesive_mu_i` or `fluid`.
    """

    kind: int
    bulk_modulus: float  # K [Pa]
    shear_modulus: float = 0.0  # G [Pa]
    slope: float = 0.0  # gamma [1] of the cone q <= slope p + strength
    strength: float = 0.0  # q_c [Pa] of the cone, strength without pressure
    tension_limit: float = 0.0  # largest tension -p [Pa], below that of the tip of the cone (always if slope is 0)
    volume_correction: float = 0.0  # 1: the volume of gaps is stored, 0: it is not
    mu1: float = 0.0  # [1] friction at rest
    mu2: float = 0.0  # [1] friction of fast flow, above mu1
    rate_friction: float = 0.0  # mu_r [1], mu2 - mu1 of a cone
    inertial_number: float = 0.0  # I0 [1]
    grain_diameter: float = 0.0  # d [m]
    grain_density: float = 0.0  # rho_s [kg m-3]
    dynamic_viscosity: float = 0.0  # eta [Pa s]
    tait: float = 0.0  # 1: pressure by Tait's equation, 0: linear


def elastic(bulk_modulus: float, shear_modulus: float) -> Material:
    """Make a material of `solid_material.returned_elastic`.

    Parameters
    ----------
    bulk_modulus, shear_modulus : float [Pa]
        K and G.
    """
    return Material(ELASTIC, float(bulk_modulus), float(shear_modulus))


def drucker_prager(
    bulk_modulus: float,
    shear_modulus: float,
    friction_angle: float,
    cohesion: float,
    match: str = "triaxial",
    tension_limit: float | None = None,
    volume_correction: bool = True,
) -> Material:
    """Make a material of `solid_material.returned_drucker_prager` from a friction angle phi and a cohesion c.

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
    return Material(
        DRUCKER_PRAGER,
        float(bulk_modulus),
        float(shear_modulus),
        slope=float(slope),
        strength=float(strength),
        tension_limit=float(10.0 * cohesion if tension_limit is None else tension_limit),
        volume_correction=1.0 if volume_correction else 0.0,
    )


def mu_i(
    bulk_modulus: float,
    shear_modulus: float,
    mu1: float,
    mu2: float,
    inertial_number: float,
    grain_diameter: float,
    grain_density: float,
    volume_correction: bool = True,
) -> Material:
    """Make a material of `solid_material.returned_mu_i`.

    Parameters
    ----------
    bulk_modulus, shear_modulus : float [Pa]
        K and G.
    mu1, mu2 : float [1]
        Friction at rest, and of fast flow, above mu1.
    inertial_number : float [1]
        I0.
    grain_diameter : float [m]
    grain_density : float [kg m-3]
    volume_correction : bool
        Whether the opening v_c is stored.
    """
    return Material(
        MU_I,
        float(bulk_modulus),
        float(shear_modulus),
        mu1=float(mu1),
        mu2=float(mu2),
        inertial_number=float(inertial_number),
        grain_diameter=float(grain_diameter),
        grain_density=float(grain_density),
        volume_correction=1.0 if volume_correction else 0.0,
    )


def cohesive_mu_i(
    friction_angle: float,
    cohesion: float,
    rate_friction: float,
    inertial_number: float,
    grain_diameter: float,
    grain_density: float,
    **cone: Any,
) -> Material:
    """Make a material of `solid_material.returned_cohesive_mu_i` with the cone of `drucker_prager`.

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
    return at_rest._replace(
        kind=COHESIVE_MU_I,
        rate_friction=float(rate_friction),
        inertial_number=float(inertial_number),
        grain_diameter=float(grain_diameter),
        grain_density=float(grain_density),
    )


def fluid(bulk_modulus: float, viscosity: float = 0.0, tait: bool = False) -> Material:
    """Make a material of `fluid_material.fluid_step`.

    Parameters
    ----------
    bulk_modulus : float [Pa]
        K.
    viscosity : float [Pa s]
        Dynamic viscosity eta.
    tait : bool
        Whether the pressure is that of Tait's equation.
    """
    return Material(FLUID, float(bulk_modulus), dynamic_viscosity=float(viscosity), tait=1.0 if tait else 0.0)
