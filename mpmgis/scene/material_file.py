"""Material parameters from a scene, or from a file with little more than a material."""

from pathlib import Path
from typing import NamedTuple

from ..system.errors import SceneError
from .scene_reading import read_toml, scene_from_tables
from .tables import MaterialTable

MATERIAL_TABLES = ("material", "softening", "friction", "output")
# required in a scene but not in a material file; not used
_REST = {
    "terrain": {"dem": "dtm.tif"},
    "release": {"source": "release.shp", "thickness": 1.0, "density": 1000.0},
    "numerics": {"cell_size": 1.0},
    "output": {},
}
EXAMPLE = 'law = "DruckerPrager", bulk_modulus, shear_modulus [Pa], friction_angle [degrees], cohesion [Pa]'


class GivenMaterial(NamedTuple):
    """Material of a file, with the values for other solvers that the same file has.

    Attributes
    ----------
    table : MaterialTable
    bed_friction : float or None [1]
        Coefficient mu of [friction], tan of the friction angle on the bed; None without it.
    bed_law : str
        Law of [friction]; empty without the table.
    end_time : float or None [s]
        End of the run, where the file has it.
    lost : tuple of str
        Tables of the file that other solvers do not get.
    """

    table: MaterialTable
    bed_friction: float | None
    bed_law: str
    end_time: float | None
    lost: tuple


def read_material(path: str | Path) -> GivenMaterial:
    """Read the material of a scene, or of a TOML file with [material] and maybe [softening], [friction] and [output].

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    SceneError
        No such file, no material in it, impossible values.
    """
    path = Path(path)
    tables = read_toml(path)
    if "material" not in tables:
        raise SceneError(f"{path} has no table [material]; write one: {EXAMPLE}")
    whole = "terrain" in tables
    alien = [name for name in tables if name not in (*MATERIAL_TABLES, "solver")]
    if not whole and alien:
        raise SceneError(
            f"{path}: [{alien[0]}] is in a file without [terrain], which is not a scene; "
            f"expected one of {', '.join(MATERIAL_TABLES)}"
        )
    filled = tables if whole else _filled(tables)
    scene = scene_from_tables(filled, path.parent, path.name)
    friction = scene.friction.parameters.get("mu") if scene.friction is not None else None
    lost = tuple(name for name in ("softening", "zones", "barrier") if tables.get(name))
    law = scene.friction.law if scene.friction is not None else ""
    end = scene.output.end_time if "end_time" in tables.get("output", ()) else None
    return GivenMaterial(scene.material, friction, law, end, lost)


def _filled(tables: dict) -> dict:
    """Return the tables of a material file with the required tables of a scene; some keys of [output] are allowed."""
    filled = {"solver": "points"} | _REST | tables
    own = filled["output"]
    if isinstance(own, dict):  # a frame at the end: whatever the one is, the other is possible with it
        end, interval = own.get("frame_interval", 1.0), own.get("end_time", 1.0)
        filled["output"] = {"end_time": end, "frame_interval": interval} | own
    return filled
