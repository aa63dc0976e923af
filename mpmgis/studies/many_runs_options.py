"""Options of everything that runs a scene many times: processes, cluster, laws, failed runs."""

from typing import Annotated, TypedDict

from ..simulation.simulation_options import LAW
from ..system.option import Option, PathLike
from ..system.work_options import DASK

TOLERATE = Option(
    "share of the runs that may become unphysical or fail; a number from 0 to below 1",
    "SHARE",
    default=0.1,
    least=0,
    below=1,
    label="Share of the runs that may fail",
)


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
