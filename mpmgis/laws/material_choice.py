"""What the 3D solver asks of a material of any kind; each function chooses by the kind."""

from math import inf, sqrt

from .fluid_material import fluid_at_stress, fluid_energy, fluid_step
from .material import CONES, FLUID, MU_I, Material
from .softening import Softening
from .solid_material import solid_at_stress, solid_energy, solid_step, solid_step_far, solid_volume

SHORT_STATE = 4  # numbers of state of a point of a fluid
LONG_STATE = 8  # of a solid


def stress_step(
    material: Material, softening: Softening, state: tuple, gradient: tuple, time_step: float
) -> tuple[tuple, tuple, float]:
    """Compute state and stress of a point after a step.

    Parameters
    ----------
    material : Material
    softening : Softening
    state : tuple of 8 floats
        That of `solid_material`, or of `fluid_material` with five more numbers.
    gradient : tuple of 9 floats [1]
        Gradient of the step, dt grad v: xx, xy, xz, yx, yy, yz, zx, zy, zz.
    time_step : float [s]

    Returns
    -------
    state : tuple of 8 floats
    stress : tuple of 6 floats [Pa]
        Kirchhoff stress xx, yy, zz, xy, xz, yz.
    code : float
        ORDINARY, NO_TENSION, or FAR: call `stress_step_far`.
    """
    if material.kind == FLUID:
        volume, supplied, stress, code = fluid_step(material, state[0], state[1], state[2], gradient, time_step)
        return (volume, state[1], supplied, state[3], state[4], state[5], state[6], state[7]), stress, code
    return solid_step(material, softening, state, gradient, time_step)


def stress_step_far(
    material: Material, softening: Softening, state: tuple, gradient: tuple, time_step: float
) -> tuple[tuple, tuple, float]:
    """Compute `stress_step` for strains of any size; the code FAR says that they were limited.

    Parameters
    ----------
    material, softening, state, gradient, time_step
        As of `stress_step`.
    """
    if material.kind == FLUID:
        return stress_step(material, softening, state, gradient, time_step)
    return solid_step_far(material, softening, state, gradient, time_step)


def state_at_stress(material: Material, stress: tuple) -> tuple:
    """Compute the state of a Kirchhoff stress, 8 numbers or arrays.

    Parameters
    ----------
    material : Material
    stress : tuple of 6 floats or of 6 float64[n] [Pa]
        xx, yy, zz, xy, xz, yz.
    """
    return fluid_at_stress(material, stress) if material.kind == FLUID else solid_at_stress(material, stress)


def stored_energy(material: Material, state: tuple) -> float:
    """Compute the elastic energy [J m-3] of a point per volume free of stress.

    Parameters
    ----------
    material : Material
    state : tuple of 8 floats
    """
    if material.kind == FLUID:
        return fluid_energy(material, state[0])
    return solid_energy(material, state)


def volume_ratio(material: Material, state: tuple) -> float:
    """Compute the volume of a point over the stress-free volume [1].

    Parameters
    ----------
    material : Material
    state : tuple of 8 floats
    """
    return state[0] if material.kind == FLUID else solid_volume(state)


def wave_speed(material: Material, density: float) -> float:
    """Compute the speed of pressure waves [m s-1], sqrt((K + 4 G / 3) / rho), for the time step.

    Parameters
    ----------
    material : Material
    density : float [kg m-3]
    """
    return sqrt((material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus) / density)


def strength_at_rest(material: Material) -> tuple[float, float]:
    """Return m [1] and k [Pa]: at rest |s| / sqrt(2) is at most m p + k.

    A fluid bears no shear stress; the strength of an elastic material is not limited.

    Parameters
    ----------
    material : Material
    """
    if material.kind in CONES:
        return material.slope / sqrt(3.0), material.strength / sqrt(3.0)
    if material.kind == MU_I:
        return material.mu1, 0.0
    return (0.0, 0.0) if material.kind == FLUID else (inf, 0.0)


def state_count(material: Material) -> int:
    """Return the number of state variables that a point has, SHORT_STATE or LONG_STATE.

    Parameters
    ----------
    material : Material
    """
    return SHORT_STATE if material.kind == FLUID else LONG_STATE


def follows_density(material: Material) -> bool:
    """Return whether J is corrected where it differs from the density at the nodes (`point_density`).

    Parameters
    ----------
    material : Material
    """
    return material.kind == FLUID
