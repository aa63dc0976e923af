"""One point of a 3D material, with tensors as matrices: what the tests of materials walk along strain paths."""

import numpy as np

from mpmgis.laws.material_choice import state_at_stress, stress_step
from mpmgis.laws.softening import Softening

UNSOFTENED = Softening()
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
FRESH = (0.0,) * 8  # a solid free of stress


def matrix(six):
    """float[3, 3] of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six(tensor):
    """xx, yy, zz, xy, xz, yz of a symmetric float[3, 3]."""
    return tuple(float(tensor[place]) for place in PLACES)


def cauchy_green(state):
    """b float[3, 3] of a solid's state."""
    return np.eye(3) + matrix(state[:6])


def carried(b):
    """The first six numbers of the state of a solid with the left Cauchy-Green tensor b float[3, 3]."""
    return six(b - np.eye(3))


def sheared(amount):
    """Gradient of simple shear, which keeps volumes exactly."""
    gradient = np.zeros((3, 3))
    gradient[0, 1] = amount
    return gradient


def at_pressure(law, p):
    """State under pressure p [Pa] alone."""
    return tuple(float(s) for s in state_at_stress(law, (-p, -p, -p, 0.0, 0.0, 0.0)))


def step(law, state, gradient, time_step=1e-3, softening=UNSOFTENED, function=stress_step):
    """(state, Kirchhoff stress float[3, 3] [Pa], code) after one step of `gradient` float[3, 3] [1]."""
    state, stress, code = function(law, softening, state, tuple(float(g) for g in np.ravel(gradient)), time_step)
    return state, matrix(stress), code


def function_of(symmetric, function):
    """`function` of a symmetric tensor by its principal values."""
    values, directions = np.linalg.eigh(symmetric)
    return (directions * function(values)) @ directions.T


def kirchhoff(law, b):
    """Kirchhoff stress float[3, 3] [Pa] of an elastic left Cauchy-Green tensor, by principal values."""
    strain = function_of(b, lambda values: 0.5 * np.log(values))
    trace = np.trace(strain)
    return 2.0 * law.shear_modulus * (strain - np.eye(3) * trace / 3.0) + law.bulk_modulus * trace * np.eye(3)


def pressure(stress):
    """p [Pa], positive in compression."""
    return -np.trace(stress) / 3.0


def shear(stress):
    """q = sqrt(3/2 s : s) [Pa]."""
    deviator = stress + pressure(stress) * np.eye(3)
    return np.sqrt(1.5 * np.sum(deviator**2))


def random_states(rng, count, size):
    """Steps of random points: b - I of deformations `size` away from none, gradients a fifth of that."""
    for _ in range(count):
        deformation = np.eye(3) + size * rng.uniform(-1.0, 1.0, (3, 3))
        yield carried(deformation @ deformation.T), 0.2 * size * rng.uniform(-1.0, 1.0, (3, 3))
