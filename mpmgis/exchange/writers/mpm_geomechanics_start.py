"""MPM-Geomechanics: case and particles as JSON, terrain as STL text."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from .start_files import STL, SolverFiles, write_json

CASE, PARTICLES = "case.json", "particles.json"
CONTACT = 2.0  # [cells] distance to the ground within which contact is searched
PLANES = tuple(f"plane_{axis}{end}" for axis in "XYZ" for end in "0n")


def write(start: Any, folder: Path, number: int) -> None:
    """Write the case of a start.

    Parameters
    ----------
    start : SolverStart
    folder : Path
    number : int
        Of the frame.
    """
    rows = (
        json.dumps({"id": number, "position": place, "volume": volume, "material_id": 1})
        for number, (place, volume) in enumerate(zip(start.position.tolist(), start.volume.tolist(), strict=True), 1)
    )
    with open(folder / PARTICLES, "w", encoding="utf-8", newline="\n") as sink:
        sink.write("[")
        for count, row in enumerate(rows):
            sink.write((",\n" if count else "\n") + row)
        sink.write("\n]\n")
    write_json(folder / CASE, _case(start))


def _case(start):
    return {
        "stress_scheme_update": "MUSL",
        "shape_function": "GIMP",
        "time": start.end_time,
        "time_step": start.time_step,
        "gravity": [0.0, 0.0, -start.gravity],
        "results": {
            "print": 20,
            "material_point_results": ["id", "material", "active", "velocity", "displacement", "plastic_strain"],
        },
        "mesh": {
            "cells_dimension": [start.cell] * 3,
            "cells_number": list(start.cells),
            "origin": [0.0, 0.0, 0.0],
            "boundary_conditions": dict.fromkeys(PLANES, "sliding"),
        },
        "material": {"flow": _material(start)},
        "body": {"flow": {"type": "particles_from_file", "id": 1, "material_id": 1, "file": PARTICLES}},
        "terrain_contact": {
            "active": True,
            "stl_mesh": STL,
            "friction": start.bed_friction,
            "distance_threshold": CONTACT,
        },
    }


def _material(start):
    values, common = start.material.parameters, {"id": 1, "density": start.density}
    if start.material.law == "Fluid":
        return common | {"type": "newtonian", "viscosity": values["viscosity"], "bulk": values["bulk_modulus"]}
    young, poisson = start.elastic
    common |= {"young": young, "poisson": poisson}
    if start.material.law == "Elastic":
        return common | {"type": "elastic"}
    return common | {
        "type": "mohr-coulomb",
        "friction": values["friction_angle"],
        "cohesion": values["cohesion"],
        "dilation": 0.0,
        "tensile": start.tension_limit,
    }


def read_back(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read positions and volumes from the list of particles.

    Parameters
    ----------
    folder : Path
    number : int
        Of the frame.

    Returns
    -------
    position : float64[n, 3] [m]
    volume : float64[n] [m3]
    """
    rows = json.loads((folder / PARTICLES).read_text(encoding="utf-8"))
    return np.array([row["position"] for row in rows]), np.array([row["volume"] for row in rows])


FILES = SolverFiles(
    name="mpm-geomechanics",
    title="MPM-Geomechanics",
    write=write,
    read_back=read_back,
    files=f"{CASE}, {PARTICLES}, and {STL}, on which it slides",
    start=f"MPM-Geomechanics {CASE}, in this folder",
    keeps="volume, friction on the bed",
    loses="velocity (all starts at rest)",
    laws=("DruckerPrager", "Elastic", "Fluid"),
    needs_grid=True,
    needs_bed_friction=True,
    terrain_on_grid=True,
    results="particles/*.vtu",
)
