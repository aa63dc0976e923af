"""Runs a case of `mpmgis seed --for kratos` with GiD output beside its VTK: python kratos_slide.py FOLDER.

Made with Kratos 10.4.4 (pip install KratosMultiphysics KratosMPMApplication), from a folder that came of

    mpmgis seed --dem dtm.tif --release release.gpkg --thickness 1 --density 1800 --velocity 3,0 --for kratos --cell 1 \
        --material slide.toml -o case

with a plane of 40 x 30 m that falls 0.3 towards the east and a square of 2 x 2 m; slide.toml is Drucker-Prager of bulk
and shear modulus 2e6 and 1.2e6 Pa, 35 degrees, 100 Pa. Prints what Kratos' own points say.
"""

import json
import os
import sys

os.chdir(sys.argv[1])
sys.path.insert(0, ".")

import KratosMultiphysics  # noqa: E402
from KratosMultiphysics import MPMApplication  # noqa: E402
from MainKratos import Start  # noqa: E402

END = 0.2


class Told(Start):
    """The case; at each output it prints time, number, mass [kg] and centre [m] of its points."""

    def OutputSolutionStep(self):
        super().OutputSolutionStep()
        part = self.model["MPM_Material"]
        points = [
            tuple(point.CalculateOnIntegrationPoints(what, part.ProcessInfo)[0] for point in part.Elements)
            for what in (MPMApplication.MP_MASS, MPMApplication.MP_COORD, MPMApplication.MP_VELOCITY)
        ]
        mass = sum(points[0])
        means = [
            [sum(m * v[k] for m, v in zip(points[0], values, strict=True)) / mass for k in range(3)]
            for values in points[1:]
        ]
        print("TOLD", round(part.ProcessInfo[KratosMultiphysics.TIME], 7), len(points[0]), repr(mass), *means)


with open("ProjectParameters.json") as file:
    parameters = json.load(file)
parameters["problem_data"]["end_time"] = END
parameters["output_processes"]["vtk"][0]["Parameters"]["output_interval"] = END / 2
configuration = {"file_label": "time", "output_control_type": "time", "output_interval": END}
configuration |= {"gauss_point_results": ["MP_DISPLACEMENT", "MP_VELOCITY", "MP_MASS"]}
parameters["output_processes"]["gid"] = [
    {
        "python_module": "mpm_gid_output_process",
        "kratos_module": "KratosMultiphysics.MPMApplication",
        "Parameters": {
            "model_part_name": "MPM_Material",
            "output_name": "slide",
            "postprocess_parameters": {"result_file_configuration": configuration},
        },
    }
]
Told(KratosMultiphysics.Model(), KratosMultiphysics.Parameters(json.dumps(parameters))).Run()
