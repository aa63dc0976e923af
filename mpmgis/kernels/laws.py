"""The methods that kernels call on laws, by slot. Kernels know these names, never a law."""

from .jit import law_method

METHODS = (
    "dry_stress",  # friction
    "drag_coefficient",
    "metric_gradient",  # metric
    "curvature_active",  # curvature
    "turned_velocity",
    "centrifugal_acceleration",
    "effective_gravity",
    "still_water_active",  # still water
    "reference_depth",
)

for _name in METHODS:
    law_method(_name)
