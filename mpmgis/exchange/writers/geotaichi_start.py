"""GeoTaichi: particles as text, and a script that loads them.

Its Newtonian fluid uses the bulk modulus; early versions used Cole's law with an exponent of 7 and the same stiffness.
"""

from pathlib import Path
from typing import Any

import numpy as np

from .start_files import SolverFiles, read_rows, write_rows

PARTICLES, SCRIPT = "particles.txt", "start.py"
_SCRIPT = '''"""Brings the particles of this folder into GeoTaichi: python {script}.

MPM alone knows no DTM: put your boundary conditions where it says so below. In a coupled run {heights} is a wall:
dem.add_wall with WallType DigitalElevation.
"""

from geotaichi import *

init()
mpm = MPM()
mpm.set_configuration(
    domain=ti.Vector({domain}),
    gravity=ti.Vector([0.0, 0.0, {gravity}]),
    background_damping=0.0,
    alphaPIC=0.002,
    mapping="USL",
    shape_function="QuadBSpline",{kind}
)
mpm.set_solver(solver={{"Timestep": {time_step}, "SimulationTime": {end_time}, "SaveInterval": {interval}}})
mpm.memory_allocate(memory={{
    "max_material_number": 1,
    "max_particle_number": {count},
    "max_constraint_number": {{"max_velocity_constraint": {nodes}, "max_reflection_constraint": {nodes}}},
}})
mpm.add_material(model="{model}", material={material})
mpm.add_element(element={{"ElementType": "R8N3D", "ElementSize": ti.Vector([{cell}, {cell}, {cell}])}})
mpm.add_body_from_file(body={{
    "FileType": "TXT",
    "Template": {{
        "ParticleFile": "{particles}",
        "BodyID": 0,
        "MaterialID": 1,
        "InitialVelocity": ti.Vector({velocity}),
        "FixVelocity": ["Free", "Free", "Free"],
    }},
}})
# your boundary conditions: a list of dictionaries (BoundaryType, StartPoint, EndPoint, ..)
mpm.add_boundary_condition()
mpm.select_save_data()
mpm.run()
'''


def write(start: Any, folder: Path, number: int) -> None:
    """Write the particles of a start (x y z volume and half sizes) and the script.

    Parameters
    ----------
    start : SolverStart
    folder : Path
    number : int
        Of the frame.
    """
    half = 0.5 * np.cbrt(start.volume)
    with open(folder / PARTICLES, "wb") as sink:
        write_rows(sink, start.position, start.volume, half, half, half)
    model, material = _material(start)
    nodes = int(np.prod(np.array(start.cells) + 1))
    text = _SCRIPT.format(
        script=SCRIPT,
        heights="terrain.asc",
        domain=[float(length) for length in start.box.size],
        gravity=-start.gravity,
        kind='\n    material_type="Fluid",' if start.material.law == "Fluid" else "",
        time_step=start.time_step,
        end_time=start.end_time,
        interval=start.end_time / 20,
        count=len(start.position),
        nodes=nodes,
        model=model,
        material=material,
        cell=start.cell,
        particles=PARTICLES,
        velocity=mean_velocity(start),
    )
    (folder / SCRIPT).write_text(text, encoding="utf-8", newline="\n")


def mean_velocity(start: Any) -> list[float]:
    """Return the mean velocity of the whole body: GeoTaichi uses one velocity per file.

    Parameters
    ----------
    start : SolverStart

    Returns
    -------
    list of 3 floats [m s-1]
    """
    return [float(value) for value in start.mass @ start.velocity / start.mass.sum()]


def _material(start):
    values, common = start.material.parameters, {"MaterialID": 1, "Density": start.density}
    if start.material.law == "Fluid":
        return "Newtonian", common | {"Modulus": values["bulk_modulus"], "Viscosity": values["viscosity"]}
    young, poisson = start.elastic
    common |= {"YoungModulus": young, "PossionRatio": poisson}  # its own spelling
    if start.material.law == "Elastic":
        return "LinearElastic", common
    return "DruckerPrager", common | {
        "Cohesion": values["cohesion"],
        "Friction": values["friction_angle"],
        "Dilation": 0.0,
        "Tensile": start.tension_limit,
    }


def read_back(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read positions and volumes from the rows.

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
    rows = read_rows((folder / PARTICLES).read_bytes(), 7)
    return rows[:, :3], rows[:, 3]


FILES = SolverFiles(
    name="geotaichi",
    title="GeoTaichi",
    write=write,
    read_back=read_back,
    files=f"{PARTICLES} (x y z volume and half sizes), {SCRIPT}; boundary conditions are still yours to write there",
    start=f"python {SCRIPT}, in an environment with GeoTaichi",
    keeps="volume, the mean velocity of all",
    loses="velocities of the points (one for all), friction on the bed",
    laws=("DruckerPrager", "Elastic", "Fluid"),
    needs_grid=True,
    results="particles/*.npz",
)
