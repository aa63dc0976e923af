"""The methods that kernels call on laws, by slot. Kernels know these names, never a law."""

from .jit import law_method

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
    "deflected",
)

for _name in METHODS:
    law_method(_name)
