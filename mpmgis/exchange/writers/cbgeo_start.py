"""CB-Geo MPM: mesh, particles, entity sets and settings as text, and the full state as HDF5 for a restart.

The solver reads the HDF5 by the order of the fields, not by name. A build with more than these 53 fields reports that
it cannot resume, and starts from the text files, at rest.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...system.hdf5_reading import opened_whole
from ...system.hdf5_writing import written
from ..solver_grid import solver_grid
from .start_files import SolverFiles, read_rows, write_json, write_rows

UUID = "start"
PARTICLES, VOLUMES, MESH, SETS = "particles.txt", "particles-volumes.txt", "mesh.txt", "entity_sets.json"
STATE_VARIABLES = 20  # of a record
_NUMBERS = (
    *("mass", "volume", "pressure", "coord_x", "coord_y", "coord_z"),
    *("displacement_x", "displacement_y", "displacement_z", "nsize_x", "nsize_y", "nsize_z"),
    *("velocity_x", "velocity_y", "velocity_z", "stress_xx", "stress_yy", "stress_zz", "tau_xy", "tau_yz", "tau_xz"),
    *("strain_xx", "strain_yy", "strain_zz", "gamma_xy", "gamma_yz", "gamma_xz", "epsilon_v"),
)
STRESS = {"stress_xx": 0, "stress_yy": 1, "stress_zz": 2, "tau_xy": 3, "tau_yz": 5, "tau_xz": 4}  # columns of mpmgis
# record layout of the code: aligned, status after the cell
ROW = np.dtype(
    {
        "names": [
            "id",
            *_NUMBERS,
            "status",
            "cell_id",
            "material_id",
            "nstate_vars",
            *(f"svars_{number}" for number in range(STATE_VARIABLES)),
        ],
        "formats": ["<i8"] + ["<f8"] * len(_NUMBERS) + ["u1", "<i8", "<u4", "<u4"] + ["<f8"] * STATE_VARIABLES,
        "offsets": [*range(0, 232, 8), 240, 232, 244, 248, *range(256, 416, 8)],
        "itemsize": 416,
    }
)
ROWS_AT_ONCE = 10_000  # chunk of the file


def write(start: Any, folder: Path, number: int) -> None:
    """Write the case of a start.

    Parameters
    ----------
    start : SolverStart
    folder : Path
    number : int
        Of the frame.

    Raises
    ------
    InputError
        The grid has too many cells, or the DTM has holes under points.
    """
    grid = solver_grid(start)
    with open(folder / MESH, "wb") as sink:
        sink.write(f"{len(grid.nodes)} {len(grid.cells)}\n".encode())
        write_rows(sink, grid.nodes)
        write_rows(sink, grid.cells)
    with open(folder / PARTICLES, "wb") as sink:
        sink.write(f"{len(start.position)}\n".encode())
        write_rows(sink, start.position)
    with open(folder / VOLUMES, "wb") as sink:
        write_rows(sink, np.arange(len(start.volume)), start.volume)
    sets = {"bed": 0, "side_x": 1, "side_y": 2}
    write_json(
        folder / SETS,
        {
            "particle_sets": [{"id": 0, "set": list(range(len(start.position)))}],
            "node_sets": [{"id": number, "set": getattr(grid, name).tolist()} for name, number in sets.items()],
            "cell_sets": [{"id": 0, "set": list(range(len(grid.cells)))}],
        },
    )
    steps = max(round(start.end_time / start.time_step), 1) + 1
    write_json(folder / "mpm.json", _settings(start, steps))
    state = folder / "results" / UUID
    state.mkdir(parents=True)
    _write_state(state / state_name(steps), start, grid.cell_of)


def state_name(steps: int) -> str:
    """Return the name of the file of step 0 in a run: it has as many zeros as `steps` has digits.

    Parameters
    ----------
    steps : int
        Number of steps of the run.
    """
    return f"particles{'0' * (int(math.log10(steps)) + 1)}.h5"


def _write_state(path: Path, start: Any, cell_of: np.ndarray) -> None:
    count, stress, variables = len(start.mass), start.stress, state_variables(start.material)
    with written(path) as file:
        table = file.create_dataset("table", (count,), ROW, maxshape=(None,), chunks=(ROWS_AT_ONCE,))
        for first in range(0, count, ROWS_AT_ONCE):
            part = slice(first, min(first + ROWS_AT_ONCE, count))
            rows = np.zeros(part.stop - part.start, ROW)
            rows["id"], rows["cell_id"] = np.arange(part.start, part.stop), cell_of[part]
            rows["mass"], rows["volume"], rows["status"] = start.mass[part], start.current_volume[part], 1
            for axis, letter in enumerate("xyz"):
                rows[f"coord_{letter}"] = start.position[part, axis]
                rows[f"velocity_{letter}"] = start.velocity[part, axis]
                rows[f"nsize_{letter}"] = 1.0
            for name, column in STRESS.items() if stress is not None else ():
                rows[name] = stress[part, column]
            rows["nstate_vars"] = len(variables)
            for number, value in enumerate(variables):
                rows[f"svars_{number}"] = value
            table[part] = rows


def state_variables(material: Any) -> tuple[float, ...]:
    """Return the initial state variables of a material in CB-Geo.

    Parameters
    ----------
    material : MaterialTable

    Returns
    -------
    tuple of float
        For MohrCoulomb3D friction, dilation [rad], cohesion [Pa], three stress invariants, plastic strain; for
        Newtonian3D the pressure.
    """
    if material.law == "DruckerPrager":
        angle = math.radians(material.parameters["friction_angle"])
        return (angle, 0.0, material.parameters["cohesion"], 0.0, 0.0, 0.0, 0.0)
    return (0.0,) if material.law == "Fluid" else ()


def _settings(start, steps):
    generator = {
        "type": "file",
        "location": PARTICLES,
        "io_type": "Ascii3D",
        "particle_type": "P3D",
        "material_id": 0,
        "pset_id": 0,
        "check_duplicates": False,
    }
    held = [(0, 0), (0, 1), (0, 2), (1, 0), (2, 1)]
    constraints = [{"nset_id": nodes, "dir": direction, "velocity": 0.0} for nodes, direction in held]
    return {
        "title": "written by mpmgis",
        "mesh": {
            "mesh": MESH,
            "entity_sets": SETS,
            "cell_type": "ED3H8",
            "isoparametric": False,
            "check_duplicates": False,
            "io_type": "Ascii3D",
            "node_type": "N3D",
            "particles_volumes": VOLUMES,
            "boundary_conditions": {"velocity_constraints": constraints},
        },
        "particles": [{"generator": generator}],
        "materials": [_material(start)],
        "external_loading_conditions": {"gravity": [0.0, 0.0, -start.gravity]},
        "analysis": {
            "type": "MPMExplicit3D",
            "mpm_scheme": "usf",
            "dt": start.time_step,
            "uuid": UUID,
            "nsteps": steps,
            "velocity_update": False,
            "locate_particles": True,
            "resume": {"resume": True, "uuid": UUID, "step": 0},
        },
        "post_processing": {"path": "results/", "output_steps": max(steps // 20, 1)},
    }


def _material(start):
    values, common = start.material.parameters, {"id": 0, "density": start.density}
    if start.material.law == "Fluid":
        return common | {
            "type": "Newtonian3D",
            "bulk_modulus": values["bulk_modulus"],
            "dynamic_viscosity": values["viscosity"],
        }
    young, poisson = start.elastic
    common |= {"youngs_modulus": young, "poisson_ratio": poisson}
    if start.material.law == "Elastic":
        return common | {"type": "LinearElastic3D"}
    angle, cohesion = values["friction_angle"], values["cohesion"]
    return common | {
        "type": "MohrCoulomb3D",
        "softening": False,
        "friction": angle,
        "dilation": 0.0,
        "cohesion": cohesion,
        "residual_friction": angle,
        "residual_dilation": 0.0,
        "residual_cohesion": cohesion,
        "peak_pdstrain": 0.0,
        "residual_pdstrain": 0.0,
        "tension_cutoff": start.tension_limit,
    }


def read_back(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read positions and volumes from the text files.

    The volume is mass over density; the HDF5 has the current volume.

    Parameters
    ----------
    folder : Path
    number : int
        Of the frame.

    Returns
    -------
    position : float64[n, 3] [m]
        NaN where positions in the HDF5 differ.
    volume : float64[n] [m3]
    """
    _, _, text = (folder / PARTICLES).read_bytes().partition(b"\n")
    place = read_rows(text, 3)
    with opened_whole(next((folder / "results" / UUID).glob("particles*.h5"))) as file:
        rows = file["table"][:]
    state = np.column_stack([rows[f"coord_{letter}"] for letter in "xyz"])
    return np.where(state == place, place, np.nan), read_rows((folder / VOLUMES).read_bytes(), 2)[:, 1]


FILES = SolverFiles(
    name="cbgeo",
    title="CB-Geo MPM",
    write=write,
    read_back=read_back,
    files=(
        f"mpm.json, {MESH} (nodes under the DTM hold, sides slide), {PARTICLES}, {VOLUMES}, {SETS}, and "
        f"results/{UUID}/particles0...h5 with the full state, from which it resumes"
    ),
    start='mpm -i mpm.json -f "$PWD/" (to start from the text files, at rest and without stress: "resume": false)',
    keeps="volume, velocity",
    takes_stress=True,
    loses="friction on the bed (it holds what touches it)",
    laws=("DruckerPrager", "Elastic", "Fluid"),
    needs_grid=True,
    results=f"results/{UUID}/particles*.h5",
)
