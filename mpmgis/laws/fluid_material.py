"""Water and mud in the 3D solver: weakly compressible, without tension.

A point has J, its volume over the stress-free volume [1]; the correction of J [s-1] by the density at the nodes
(`point_density`); and the energy [J m-3, per volume free of stress] that the correction has supplied since it was set.
"""

from math import log

from .material import FAR, NO_TENSION, ORDINARY, TINY, Material

SMALLEST_VOLUME = 0.6  # [1] smallest J; below it the fluid is far too soft for its speed: limited and counted
LARGEST_GAP = 0.1  # [1] of J; a larger one is closed at the rate of this one
NEWTON_STEPS = 8  # for J at a given pressure by Tait's equation


def fluid_pressure(material: Material, volume: float) -> float:
    """Compute the pressure [Pa]: p = K (1 / J - 1), or Tait's p = (K / 7) (J^-7 - 1).

    Parameters
    ----------
    material : Material
    volume : float [1]
        J.
    """
    inverse = 1.0 / volume
    cube = inverse * inverse * inverse
    stiffened = (cube * cube * inverse - 1.0) * (1.0 / 7.0)
    return material.bulk_modulus * (stiffened if material.tait > 0.5 else inverse - 1.0)


def fluid_step(
    material: Material, volume: float, rate: float, supplied: float, gradient: tuple, time_step: float
) -> tuple[float, float, tuple, float]:
    """Compute J and stress of a fluid after a step: sigma = -p I + 2 eta dev D with p of `fluid_pressure`.

    J above 1 is reset to 1: a fluid has no tension and no memory of gaps. K = rho (10 U)^2 for flows up to U [m s-1]
    keeps densities within 1 % (Monaghan 1994, whose water is Tait's). Viscosity: water 1e-3, muds 0.1 to 100 Pa s.

    Parameters
    ----------
    material : Material
    volume : float [1]
        J.
    rate : float [s-1]
        Correction of J.
    supplied : float [J m-3]
        Energy that it has supplied.
    gradient : tuple of 9 floats [1]
        Gradient of the step, dt grad v: xx, xy, xz, yx, yy, yz, zx, zy, zz.
    time_step : float [s]

    Returns
    -------
    volume : float [1]
    supplied : float [J m-3]
    stress : tuple of 6 floats [Pa]
        Kirchhoff stress xx, yy, zz, xy, xz, yz.
    code : float
        ORDINARY, NO_TENSION or, where J was limited, FAR.
    """
    gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz = gradient
    growth = gxx + gyy + gzz
    corrected = min(max(volume + time_step * rate, SMALLEST_VOLUME), 1.0)
    supplied = supplied - fluid_pressure(material, 0.5 * (volume + corrected)) * (corrected - volume)
    trial = corrected * (1.0 + growth)
    volume = min(max(trial, SMALLEST_VOLUME), 1.0)
    pull = -volume * fluid_pressure(material, volume)
    thick = volume * material.dynamic_viscosity / max(time_step, TINY)
    mean = growth * (2.0 / 3.0)
    expanded = NO_TENSION if trial > 1.0 else ORDINARY
    stress = (
        pull + thick * (2.0 * gxx - mean),
        pull + thick * (2.0 * gyy - mean),
        pull + thick * (2.0 * gzz - mean),
        thick * (gxy + gyx),
        thick * (gxz + gzx),
        thick * (gyz + gzy),
    )
    return volume, supplied, stress, expanded if trial >= SMALLEST_VOLUME else FAR


def fluid_at_stress(material: Material, stress: tuple) -> tuple:
    """Compute the state with the mean of a Kirchhoff stress, without shear: 8 numbers or arrays, J the first.

    Parameters
    ----------
    material : Material
    stress : tuple of 6 floats or of 6 float64[n] [Pa]
        xx, yy, zz, xy, xz, yz.
    """
    txx, tyy, tzz = stress[:3]
    pull = (txx + tyy + tzz) / (3.0 * material.bulk_modulus)
    volume = _held(1.0 + pull)
    if material.tait > 0.5:
        for _ in range(NEWTON_STEPS):  # Newton on the convex (J^-6 - J) / 7 + pull = 0, from the left
            sixth = 1.0 / (volume * volume * volume * volume * volume * volume)
            volume = volume + (sixth - volume + 7.0 * pull) / (6.0 * sixth / volume + 1.0)
        volume = _held(volume)
    nothing = 0.0 * pull
    return volume, nothing, nothing, nothing, nothing, nothing, nothing, nothing


def gap_at_density(volume: float, density: float, inside: bool, band: float) -> float:
    """Compute what J lacks at the density of the nodes [1].

    It is 0 where the product of J and the density is within 1 - `band` and 1 + `band`, otherwise the way of J to this
    band, at most LARGEST_GAP. It is positive only inside the flow, where no free surface is near.

    Parameters
    ----------
    volume : float [1]
        J.
    density : float [1]
        Density at the nodes over that of the fluid free of stress.
    inside : bool
        Whether the point is inside the flow.
    band : float [1]
    """
    product = volume * density
    within = min(max(product, 1.0 - band), 1.0 + band)
    if within == product or (product < within and not inside):
        return 0.0 * volume
    gap = volume * within / max(product, TINY) - volume
    return min(max(gap, -LARGEST_GAP), LARGEST_GAP)


def fluid_energy(material: Material, volume: float) -> float:
    """Compute the energy of compression [J m-3], the integral of -p over J from 1.

    Parameters
    ----------
    material : Material
    volume : float [1]
        J.
    """
    if material.tait > 0.5:
        return material.bulk_modulus / 7.0 * (1.0 / (6.0 * volume**6) + volume - 7.0 / 6.0)
    return material.bulk_modulus * (volume - 1.0 - log(volume))


def _held(volume):
    """J limited to SMALLEST_VOLUME..1, for a number or an array."""
    small, large = volume < SMALLEST_VOLUME, volume > 1.0
    return small * SMALLEST_VOLUME + large * 1.0 + (1.0 - small - large) * volume
