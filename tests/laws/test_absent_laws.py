"""Kernels of a law that a scene does not have are not compiled for it."""

from typing import NamedTuple

import numba
import numpy as np
import pytest

from mpmgis.compiled.jit import for_law
from mpmgis.laws.contact_friction import coulomb_contact, sticking_contact, voellmy_contact
from mpmgis.solvers.points import point_loop


class Absent(NamedTuple):
    null: float = 0.0

    def is_there(self):
        return False


class Present(NamedTuple):
    null: float = 0.0

    def is_there(self):
        return True


class ByValue(NamedTuple):
    there: float

    def is_there(self):
        return self.there > 0.0


def kernel_and_caller():
    """(a kernel that counts into an array, a compiled function that calls it for a law)."""

    @numba.njit
    def kernel(counts, law):
        counts[0] += 1.0

    optional = for_law(kernel, -1, "is_there")

    @numba.njit
    def caller(counts, law):
        optional(counts, law)

    return kernel, caller


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_the_kernel_of_an_absent_law_is_neither_compiled_nor_called():
    kernel, caller = kernel_and_caller()
    counts = np.zeros(1)
    caller(counts, Absent())
    assert counts[0] == 0.0 and kernel.signatures == []
    caller(counts, Present())
    assert counts[0] == 1.0 and len(kernel.signatures) == 1
    caller(counts, ByValue(0.0))  # the caller asks such a law itself, at run time
    assert counts[0] == 2.0


@pytest.mark.parametrize("law", [True, False, coulomb_contact(0.3), sticking_contact(), voellmy_contact(0.2, 500.0)])
def test_whether_a_law_is_active_does_not_depend_on_its_values(law):
    """So that their kernels are left out where they are absent."""
    for name in ("barrier_active", "drag_active"):
        if hasattr(law, name):
            assert getattr(type(law), name)(None) is getattr(law, name)()


def test_the_step_of_points_leaves_out_barriers_and_drag():
    assert point_loop._press_on_faces is not point_loop.press_on_faces
    assert point_loop._couple_layers is not point_loop.couple_layers
