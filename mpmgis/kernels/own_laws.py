"""Whether a user's own law of friction compiles, and then says the same as it does in plain Python."""

import math

import numba
import numpy as np

from ..effects.own_law import tried_inputs
from ..errors import SceneError, one_line
from .jit import FASTMATH, include_own_laws
from .laws import METHODS

TOLERANCE = 1e-9  # of compiled against plain: the compiler may take another root or power


def use_own_laws(own_laws):
    """Let kernels be compiled with the laws of `own_laws` (`effects.own_law.OwnLaws`), in a cache of their own."""
    if own_laws.laws:
        include_own_laws(own_laws.sha256)


def require_compiled(law, name):
    """Refuse a law that does not compile, or that says something else when it is compiled.

    Raises
    ------
    SceneError
        With the line of the compiler that tells most.
    """
    clash = sorted(set(law._fields) & set(METHODS))
    if clash:
        raise SceneError(
            f"{name}: a parameter cannot be called {clash[0]!r}, which is a method of the solver; rename it"
        )
    node = np.array([[[*map(float, law)]]])
    try:
        compiled = numba.njit(fastmath=FASTMATH, error_model="numpy")(_stresses)
        for inputs in tried_inputs():
            _require_same(_stresses(law, node, *inputs), compiled(law, node, *inputs), inputs, name)
    except numba.core.errors.NumbaError as error:
        cure = "use arithmetic, math and if, no functions of your own"
        raise SceneError(f"{name} does not compile: {_telling_line(error)}; {cure}") from error


def _stresses(law, node, density, gravity, normal_stress, thickness_normal, speed):
    """All that the solver asks of a law, of itself and as made from a node's values."""
    placed = law.placed(node, 0, 0)
    return (
        law.dry_stress(density, gravity, normal_stress, thickness_normal, speed),
        law.viscous_coefficient(density, gravity, normal_stress, thickness_normal, speed),
        law.drag_coefficient(gravity, thickness_normal, speed),
        placed.dry_stress(density, gravity, normal_stress, thickness_normal, speed),
    )


def _require_same(plain, compiled, inputs, name):
    for a, b in zip(plain, compiled, strict=True):
        if not math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=1e-300):
            where = ", ".join(f"{value:.4g}" for value in inputs)
            raise SceneError(
                f"{name} is {a:.6g} in Python and {b:.6g} compiled at density, gravity, normal_stress, "
                f"thickness_normal, speed = {where}; does it depend on something that changes?"
            )


def _telling_line(error):
    """Of the compiler's many lines the one that names what it does not know."""
    lines = [one_line(line) for line in str(error).splitlines() if line.strip()]
    words = ("Untyped", "Unknown attribute", "No implementation", "not defined", "nsupported", "Cannot", "Invalid use")
    telling = [line for line in lines if any(word in line for word in words)]
    return (telling or lines)[-1][:200]
