"""Materials of the 3D solver by name: parameters in a scene with units and ranges, and their laws."""

from math import radians, tan
from typing import TYPE_CHECKING

from ..laws import solid_material as solid
from ..laws.contact_friction import sticking_contact
from ..laws.fluid_material import fluid_step
from ..laws.friction import LAWS as FRICTION_LAWS
from ..laws.friction import Parameter
from ..laws.material import Material, cohesive_mu_i, drucker_prager, elastic, fluid, mu_i
from ..laws.softening import Softening, softening

if TYPE_CHECKING:
    from .tables import MaterialTable, SofteningTable

_BULK = Parameter("Pa", "bulk modulus K", 1.0, 1e12)
_SHEAR = Parameter("Pa", "shear modulus G, at most 1.5 K", 1.0, 1e12)
_CONE = {
    "bulk_modulus": _BULK,
    "shear_modulus": _SHEAR,
    "friction_angle": Parameter("degrees", "internal friction angle phi", 0.0, 80.0),
    "cohesion": Parameter("Pa", "cohesion c", 0.0, 1e9, 0.0),
}
_GRAINS = {
    "inertial_number": Parameter("1", "I0, where friction is halfway between the two", 1e-6, 100.0, 0.279),
    "grain_diameter": Parameter("m", "diameter of a grain", 1e-6, 100.0),
    "grain_density": Parameter("kg m-3", "density of a grain", 1.0, 30000.0),
}

# name in a scene -> (law, {parameter: Parameter})
MATERIALS = {
    "DruckerPrager": (solid.returned_drucker_prager, _CONE),
    "MuI": (
        solid.returned_mu_i,
        {
            "bulk_modulus": _BULK,
            "shear_modulus": _SHEAR,
            "mu1": Parameter("1", "internal friction coefficient at rest", 0.0, 10.0),
            "mu2": Parameter("1", "internal friction coefficient of fast flow, above mu1", 0.0, 10.0),
            **_GRAINS,
        },
    ),
    "CohesiveMuI": (
        solid.returned_cohesive_mu_i,
        {
            **_CONE,
            "rate_friction": Parameter("1", "mu2 - mu1, added to internal friction in fast flow", 0.0, 10.0),
            **_GRAINS,
        },
    ),
    "Fluid": (fluid_step, {"bulk_modulus": _BULK, "viscosity": Parameter("Pa s", "dynamic viscosity", 0.0, 1e9, 0.0)}),
    "Elastic": (solid.returned_elastic, {"bulk_modulus": _BULK, "shear_modulus": _SHEAR}),
}
CONES = ("DruckerPrager", "CohesiveMuI")  # laws with friction angle, cohesion and softening
# keys of [material] that are not parameters -> (laws that have it, default)
OPTIONS = {
    "match": (CONES, "triaxial"),
    "tension_limit": (CONES, None),
    "volume_correction": ((*CONES, "MuI"), True),
    "pressure": (("Fluid",), "linear"),
}
STICKING_LAW = "Sticking"  # name of the contact of the 3D solver that is no law of friction
# laws on the bed of the 3D solver: name -> (law, {parameter: Parameter})
CONTACTS = {**FRICTION_LAWS, STICKING_LAW: (sticking_contact, {})}


def contradiction(name: str, parameters: dict[str, float]) -> str:
    """Return a message on parameters that are valid separately but not together.

    Parameters
    ----------
    name : str
        Of the material in MATERIALS.
    parameters : dict of str to float

    Returns
    -------
    str
        Empty where there is no contradiction.
    """
    bulk, shear = parameters["bulk_modulus"], parameters.get("shear_modulus", 0.0)
    if shear > 1.5 * bulk:
        return (
            f"shear_modulus = {shear:g} is above 1.5 bulk_modulus = {1.5 * bulk:g} Pa, a negative Poisson's ratio; "
            "correct one of them"
        )
    if name == "MuI" and parameters["mu2"] <= parameters["mu1"]:
        return f"mu2 = {parameters['mu2']:g} is not above mu1 = {parameters['mu1']:g}; friction grows with the rate"
    return ""


def made_material(table: "MaterialTable") -> Material:
    """Make the material of a scene.

    Parameters
    ----------
    table : MaterialTable
    """
    values = table.parameters
    chosen = {
        key: default if getattr(table, key) is None else getattr(table, key)
        for key, (laws, default) in OPTIONS.items()
        if table.law in laws
    }
    if table.law == "DruckerPrager":
        return drucker_prager(**values, **chosen)
    if table.law == "CohesiveMuI":
        return cohesive_mu_i(**values, **chosen)
    if table.law == "MuI":
        return mu_i(**values, **chosen)
    if table.law == "Fluid":
        return fluid(**values, tait=chosen["pressure"] == "tait")
    return elastic(**values)


def made_softening(table: "SofteningTable", material: "MaterialTable") -> Softening:
    """Make the softening of the cone of a material.

    Parameters
    ----------
    table : SofteningTable
    material : MaterialTable
        Of one of the laws in CONES.
    """
    initial = material.parameters["friction_angle"], material.parameters["cohesion"]
    residual = table.residual_friction_angle, table.residual_cohesion
    if initial == residual:
        return Softening()
    return softening(initial, residual, table.coefficient, table.form, material.match or "triaxial", table.peak_strain)


def stiffened(material: Material, bulk_modulus: float) -> Material:
    """Return a material with another bulk modulus, and its shear modulus in the same ratio to it.

    Parameters
    ----------
    material : Material
    bulk_modulus : float [Pa]
    """
    shear_modulus = material.shear_modulus * bulk_modulus / material.bulk_modulus
    return material._replace(bulk_modulus=bulk_modulus, shear_modulus=shear_modulus)


def least_internal_friction(table: "MaterialTable", softening_table: "SofteningTable | None") -> float | None:
    """Return tan of the smallest friction angle of a material.

    Parameters
    ----------
    table : MaterialTable
    softening_table : SofteningTable or None

    Returns
    -------
    float or None [1]
        None for a material that does not yield.
    """
    values = table.parameters
    if table.law in CONES:
        angles = [values["friction_angle"]]
        if softening_table is not None and softening_table.use != "off":
            angles.append(softening_table.residual_friction_angle)
        return tan(radians(min(angles)))
    return {"MuI": values.get("mu1"), "Fluid": 0.0}.get(table.law)
