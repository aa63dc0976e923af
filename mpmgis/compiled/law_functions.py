"""Functions of laws that kernels call, and the check that a compiled user law gives the same results."""

import math

import numba
import numpy as np

from ..laws import (
    barrier,
    contact_friction,
    curvature,
    entrainment,
    flow_layers,
    fluid_material,
    forest,
    friction,
    ground_metric,
    hencky,
    internal_stress,
    material_choice,
    own_law,
    series,
    softening,
    solid_material,
    still_water,
)
from ..laws.own_law import OwnLaws, tried_inputs
from ..system.errors import SceneError, one_line
from .jit import FASTMATH, include_own_laws, law_function, own_law_method, own_or_built_in

# methods of user-defined laws that their `stress_parts` may call
OWN_METHODS = (own_law.WHOLE, *own_law.SPLIT)
# functions of a law that is a record, or a user-defined one with a method of the name -> (record, what the record gets)
OWN_OR_BUILT_IN = {
    friction.stress_parts: (friction.Friction, friction.built_in_parts),
    friction.at_node: (friction.Friction, friction.built_in_at_node),
}

# called for every node or point in every step, and therefore inlined into the loops of kernels
INLINED_FUNCTIONS = (
    ground_metric.metric_gradient,
    ground_metric.slope_gradient,
    ground_metric.water_gradient,
    ground_metric.cosine_squared,
    curvature.turned_velocity,
    curvature.centrifugal_acceleration,
    curvature.effective_gravity,
    friction.slowed_speed,
    still_water.reference_depth,
    internal_stress.is_hydrostatic,
    internal_stress.pressure_factor,
    internal_stress.largest_factor,
    internal_stress.is_viscous,
    hencky.determinant_of_step,
    hencky.pushed_forward,
    hencky.squared,
    hencky.determinant,
    hencky.squared_norm,
    hencky.cayley,
    hencky.hencky_strain,
    hencky.times_square,
    hencky.exponential_less_unit,
    series.decay,
    series.sine_cosine,
    softening.faded,
    softening.matched_cone,
    *softening.SOFTENED.values(),
    *solid_material.RETURNED.values(),
    solid_material.trial_strain,
    solid_material.state_of_strain,
    solid_material.stress_of_strain,
    fluid_material.fluid_pressure,
    fluid_material.fluid_step,
    friction.built_in_at_node,
    contact_friction.contact_at,
    contact_friction.dry_slip,
    contact_friction.has_traction,
    contact_friction.impulse_friction,
    contact_friction.kept_slip,
    contact_friction.kept_by_traction,
)
FUNCTIONS = (
    *(law for law, _ in friction.LAWS.values()),
    friction.built_in_parts,
    friction.plug_ratio,
    friction.excess_stress,
    friction.basal_stress,
    internal_stress.apparent_viscosity,
    *(law for law, _ in entrainment.LAWS.values()),
    entrainment.erosion_rate,
    barrier.weir_discharge,
    barrier.opening_discharge,
    barrier.deflected,
    barrier.let_through,
    forest.forest_breaks,
    forest.forest_only_detrains,
    forest.forest_detrained,
    hencky.rotation,
    hencky.turned,
    hencky.principal,
    hencky.assembled,
    hencky.principal_strain,
    flow_layers.relative_roughness,
    flow_layers.turbulent_link,
    contact_friction.traction_parts,
    contact_friction.drag_roughness,
    contact_friction.equal_roughness,
    softening.softened_cone,
    solid_material.returned_strain,
    solid_material.cone_of,
    solid_material.solid_step,
    solid_material.solid_step_far,
    solid_material.solid_energy,
    solid_material.solid_volume,
    fluid_material.gap_at_density,
    fluid_material.fluid_energy,
    material_choice.stress_step,
    material_choice.stress_step_far,
    material_choice.stored_energy,
    material_choice.volume_ratio,
)

for _name in OWN_METHODS:
    own_law_method(_name)
for _function in INLINED_FUNCTIONS:
    law_function(_function)
for _function in FUNCTIONS:
    law_function(_function, inlined=False)
for _function, (_record, _built_in) in OWN_OR_BUILT_IN.items():
    own_or_built_in(_function, _record, _built_in)


TOLERANCE = 1e-9  # of compiled against plain: the compiler may take another root or power


def use_own_laws(own_laws: OwnLaws) -> None:
    """Prepare the compilation of kernels with user-defined laws, in a separate cache.

    Parameters
    ----------
    own_laws : own_law.OwnLaws
    """
    if own_laws.laws:
        include_own_laws(own_laws.sha256)


def require_compiled(law: tuple, name: str) -> None:
    """Refuse a law that does not compile, or whose compiled results differ.

    Parameters
    ----------
    law : law
        User-defined friction law.
    name : str
        Name of the law in a scene, for messages.

    Raises
    ------
    SceneError
        With the most informative line of the message of the compiler.
    """
    clash = sorted(set(law._fields) & {*OWN_METHODS, *(function.__name__ for function in OWN_OR_BUILT_IN)})
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
        fix = "use arithmetic, math and if only, and no other functions"
        raise SceneError(f"{name} does not compile: {_informative_line(error)}; {fix}") from error


def _stresses(law, node, density, gravity, normal_stress, thickness_normal, speed):
    """All results of a law that the solver uses, directly and with the parameters of a node."""
    law_here = friction.at_node(law, node, 0, 0)
    dry, viscous, drag = friction.stress_parts(law, density, gravity, normal_stress, thickness_normal, speed)
    here, _, _ = friction.stress_parts(law_here, density, gravity, normal_stress, thickness_normal, speed)
    return dry, viscous, drag, here


def _require_same(plain, compiled, inputs, name):
    for a, b in zip(plain, compiled, strict=True):
        if not math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=1e-300):
            where = ", ".join(f"{value:.4g}" for value in inputs)
            raise SceneError(
                f"{name} is {a:.6g} in Python and {b:.6g} compiled at density, gravity, normal_stress, "
                f"thickness_normal, speed = {where}; does it depend on something that changes?"
            )


def _informative_line(error):
    """The line of the message of the compiler that names the unsupported construct."""
    lines = [one_line(line) for line in str(error).splitlines() if line.strip()]
    words = ("Untyped", "Unknown attribute", "No implementation", "not defined", "nsupported", "Cannot", "Invalid use")
    informative = [line for line in lines if any(word in line for word in words)]
    return (informative or lines)[-1][:200]
