"""Kratos MPM: two .mdpa, two .json and the script that runs them.

Kratos creates material points in the elements of a body mesh. Therefore each point becomes a cube element with the
volume of the point and one material point.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..solver_grid import CORNERS, solver_grid
from .start_files import SolverFiles, read_rows, write_json, write_rows

BODY, GRID, VELOCITIES = "start_Body.mdpa", "start_Grid.mdpa", "velocities.txt"
PARTS = ("bed", "side_x", "side_y")  # of the grid; fixed in all directions, x, y
HELD = {"bed": (True, True, True), "side_x": (True, False, False), "side_y": (False, True, False)}
_HEAD = b"Begin ModelPartData\nEnd ModelPartData\n\nBegin Properties 0\nEnd Properties\n\n"
_MAIN = '''"""Runs this folder's case with Kratos: python MainKratos.py."""

import KratosMultiphysics
from KratosMultiphysics import MPMApplication
from KratosMultiphysics.MPMApplication.mpm_analysis import MpmAnalysis


class Start(MpmAnalysis):
    """The material points with the velocities in velocities.txt, a row a point, in their order."""

    def ModifyAfterSolverInitialize(self):
        super().ModifyAfterSolverInitialize()  # before the first output, which shows them already
        part = self.model["MPM_Material"]
        with open("velocities.txt") as rows:
            for point, row in zip(part.Elements, rows, strict=True):
                velocity = KratosMultiphysics.Array3([float(word) for word in row.split()])
                point.SetValuesOnIntegrationPoints(MPMApplication.MP_VELOCITY, [velocity], part.ProcessInfo)


if __name__ == "__main__":
    with open("ProjectParameters.json") as file:
        parameters = KratosMultiphysics.Parameters(file.read())
    Start(KratosMultiphysics.Model(), parameters).Run()
'''


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
    _write_grid(folder / GRID, grid)
    _write_body(folder / BODY, start, len(grid.nodes), len(grid.cells))
    with open(folder / VELOCITIES, "wb") as sink:
        write_rows(sink, start.velocity)
    write_json(folder / "ParticleMaterials.json", _materials(start))
    write_json(folder / "ProjectParameters.json", _parameters(start))
    (folder / "MainKratos.py").write_text(_MAIN, encoding="utf-8", newline="\n")


def _write_grid(path, grid):
    with open(path, "wb") as sink:
        sink.write(_HEAD)
        _write_mesh(sink, b"Element3D8N", 1, grid.nodes, 1, grid.cells + 1)
        _write_part(sink, b"Parts_Grid", np.arange(len(grid.nodes)) + 1, np.arange(len(grid.cells)) + 1)
        for name in PARTS:
            _write_part(sink, name.encode(), getattr(grid, name) + 1)


def _write_body(path: Path, start: Any, node_count: int, cell_count: int) -> None:
    """Write the cubes, numbered after the nodes and elements of the grid."""
    half = 0.5 * np.cbrt(start.volume)
    nodes = (start.position[:, None] + half[:, None, None] * (2 * CORNERS - 1)).reshape(-1, 3)
    first, element = node_count + 1, cell_count + 1
    cubes = first + np.arange(len(nodes)).reshape(-1, len(CORNERS))
    with open(path, "wb") as sink:
        sink.write(_HEAD)
        _write_mesh(sink, b"MPMUpdatedLagrangian3D8N", first, nodes, element, cubes)
        _write_part(sink, b"Parts_Body", first + np.arange(len(nodes)), element + np.arange(len(cubes)))


def _write_mesh(sink: BinaryIO, kind: bytes, first: int, nodes: np.ndarray, element: int, cells: np.ndarray) -> None:
    sink.write(b"Begin Nodes\n")
    write_rows(sink, first + np.arange(len(nodes)), nodes)
    sink.write(b"End Nodes\n\nBegin Elements " + kind + b"\n")
    write_rows(sink, element + np.arange(len(cells)), np.zeros(len(cells), np.int64), cells)
    sink.write(b"End Elements\n\n")


def _write_part(sink: BinaryIO, name: bytes, nodes: np.ndarray, elements: Sequence[int] | np.ndarray = ()) -> None:
    sink.write(b"Begin SubModelPart " + name + b"\n Begin SubModelPartNodes\n")
    write_rows(sink, nodes)
    sink.write(b" End SubModelPartNodes\n Begin SubModelPartElements\n")
    write_rows(sink, np.asarray(elements, np.int64))
    sink.write(b" End SubModelPartElements\n Begin SubModelPartConditions\n End SubModelPartConditions\n")
    sink.write(b"End SubModelPart\n\n")


def _materials(start):
    young, poisson = start.elastic
    values = {
        "THICKNESS": 1.0,
        "MATERIAL_POINTS_PER_ELEMENT": 1,
        "DENSITY": start.density,
        "YOUNG_MODULUS": young,
        "POISSON_RATIO": poisson,
    }
    law = "LinearElasticIsotropic3DLaw"
    if start.material.law == "DruckerPrager":
        law, given = "HenckyMCPlastic3DLaw", start.material.parameters
        angle = math.radians(given["friction_angle"])
        values |= {"COHESION": given["cohesion"], "INTERNAL_FRICTION_ANGLE": angle, "INTERNAL_DILATANCY_ANGLE": 0.0}
    material = {"constitutive_law": {"name": law}, "Variables": values, "Tables": {}}
    part = {"model_part_name": "Initial_MPM_Material.Parts_Body", "properties_id": 1, "Material": material}
    return {"properties": [part]}


def _parameters(start):
    return {
        "problem_data": {
            "problem_name": "start",
            "parallel_type": "OpenMP",
            "echo_level": 0,
            "start_time": 0.0,
            "end_time": start.end_time,
        },
        "solver_settings": {
            "solver_type": "Dynamic",
            "model_part_name": "MPM_Material",
            "domain_size": 3,
            "echo_level": 0,
            "time_stepping": {"time_step": start.time_step},
            "grid_model_import_settings": {"input_type": "mdpa", "input_filename": "start_Grid"},
            "model_import_settings": {"input_type": "mdpa", "input_filename": "start_Body"},
            "material_import_settings": {"materials_filename": "ParticleMaterials.json"},
            "problem_domain_sub_model_part_list": ["Parts_Body", "Parts_Grid"],
            "processes_sub_model_part_list": list(PARTS),
            "pressure_dofs": False,
            "time_integration_method": "explicit",
            "scheme_type": "forward_euler",
            "stress_update": "usl",
            "analysis_type": "linear",
        },
        "processes": {
            "constraints_process_list": [_held(name, HELD[name]) for name in PARTS],
            "loads_process_list": [],
            "list_other_processes": [],
            "gravity": [_gravity(start.gravity)],
        },
        "output_processes": {"vtk": [_output(start)]},
    }


def _held(name, directions):
    return {
        "python_module": "assign_vector_variable_process",
        "kratos_module": "KratosMultiphysics",
        "Parameters": {
            "model_part_name": f"Background_Grid.{name}",
            "variable_name": "DISPLACEMENT",
            "constrained": list(directions),
            "value": [0.0, 0.0, 0.0],
            "interval": [0.0, "End"],
        },
    }


def _gravity(gravity):
    return {
        "python_module": "assign_gravity_to_material_point_process",
        "kratos_module": "KratosMultiphysics.MPMApplication",
        "process_name": "AssignGravityToMaterialPointProcess",
        "Parameters": {
            "model_part_name": "MPM_Material",
            "variable_name": "MP_VOLUME_ACCELERATION",
            "modulus": gravity,
            "direction": [0.0, 0.0, -1.0],
        },
    }


def _output(start):
    return {
        "python_module": "mpm_vtk_output_process",
        "kratos_module": "KratosMultiphysics.MPMApplication",
        "process_name": "MPMVTKOutputProcess",
        "Parameters": {
            "model_part_name": "MPM_Material",
            "file_format": "binary",
            "output_path": "vtk_output",
            "output_control_type": "time",
            "output_interval": start.end_time / 20,
            "write_ids": True,
            "gauss_point_variables_in_elements": [
                "MP_VELOCITY",
                "MP_DISPLACEMENT",
                "MP_MASS",
                "MP_VOLUME",
                "MP_DENSITY",
                "MP_CAUCHY_STRESS_VECTOR",
            ],
        },
    }


def read_back(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read positions and volumes from the cubes in the body mesh.

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
    text = (folder / BODY).read_bytes()
    nodes = read_rows(text.partition(b"Begin Nodes\n")[2].partition(b"End Nodes")[0], 4)
    cells = text.partition(b"Begin Elements MPMUpdatedLagrangian3D8N\n")[2].partition(b"End Elements")[0]
    corner = read_rows(cells, 10)[:, 2:].astype(np.int64) - int(nodes[0, 0])
    cubes = nodes[corner, 1:]
    edges = cubes.max(axis=1) - cubes.min(axis=1)
    return cubes.mean(axis=1), edges.prod(axis=1)


FILES = SolverFiles(
    name="kratos",
    title="Kratos MPM",
    write=write,
    read_back=read_back,
    files=(
        f"{BODY} (a cube a point, one material point in each), {GRID} (nodes under the DTM hold, sides slide), "
        "ParticleMaterials.json, ProjectParameters.json, velocities.txt"
    ),
    start="pip install KratosMultiphysics KratosMPMApplication; python MainKratos.py",
    keeps="volume, velocity",
    loses="friction on the bed (it holds what touches it)",
    laws=("DruckerPrager", "Elastic"),
    needs_grid=True,
    results="vtk_output/MPM_Material*.vtk",
)
