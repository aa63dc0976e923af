"""The methods that kernels call on laws, by slot. Kernels know these names, never a law."""

from ..effects import hencky, layers, softening
from .jit import law_function, law_method

METHODS = (
    "dry_stress",  # friction
    "viscous_coefficient",
    "drag_coefficient",
    "placed",
    "basal_stress",
    "plug_ratio",  # friction and viscosity
    "local",  # zones
    "cohesive_stress",  # cohesion
    "metric_gradient",  # metric
    "curvature_active",  # curvature
    "turned_velocity",
    "centrifugal_acceleration",
    "effective_gravity",
    "still_water_active",  # still water
    "reference_depth",
    "earth_pressure_active",  # earth pressure
    "pressure_factor",
    "largest_factor",
    "viscosity_active",  # viscosity in the plane
    "apparent_viscosity",
    "entrainment_active",  # entrainment
    "erosion_rate",
    "bed_lowering",
    "barrier_active",  # barriers
    "weir_discharge",
    "opening_discharge",
    "deflected",
    "let_through",
    "stress_step_far",  # material
    "stored_energy",
    "volume_ratio",
    "kept_slip",  # contact of points with the ground
    "sticks",
    "drag_active",
    "kept_by_drag",
    "layer_friction",
    "layer_roughness",
    "kept_along",  # barriers of points
    "only_turns",  # transfer of points
)

# of every point in every step, and so written into the kernels' loops
INLINED_METHODS = (
    "stress_step",  # material
    "returned_strain",
    "pressure",
    "softened_cone",  # softening
)

INLINED_FUNCTIONS = (
    hencky.determinant_of_step,
    hencky.pushed_forward,
    hencky.squared,
    hencky.determinant,
    hencky.squared_norm,
    hencky.cayley,
    hencky.hencky_strain,
    hencky.times_square,
    hencky.exponential_less_unit,
    softening.decay,
    softening.sine_cosine,
    softening.faded,
    softening.matched_cone,
)
FUNCTIONS = (hencky.rotation, hencky.turned, hencky.principal, hencky.assembled, hencky.principal_strain)
FUNCTIONS += (layers.relative_roughness, layers.chezy_number, layers.turbulent_link)

for _name in METHODS:
    law_method(_name)
for _name in INLINED_METHODS:
    law_method(_name, inlined=True)
for _function in INLINED_FUNCTIONS:
    law_function(_function)
for _function in FUNCTIONS:
    law_function(_function, inlined=False)
