"""Options of everything that runs a scene many times: processes, cluster, laws."""

from typing import Annotated, TypedDict

from ..simulation.simulation_options import LAW
from ..system.option import Option, PathLike
from ..system.work_options import DASK


class MachineOptions(TypedDict, total=False):
    """Processes of many runs."""

    workers: Annotated[
        int,
        Option(
            "number of processes; the results do not depend on it",
            "N",
            above=0,
            usual="one for each core",
            label="Runs at a time",
        ),
    ]
    dask: Annotated[str, DASK]
    law: Annotated[PathLike, LAW]
