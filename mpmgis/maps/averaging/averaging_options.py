"""Options of the averaging of particles in cells."""

from typing import Annotated

from ...frames.frame_options import DensityOptions
from ...system.option import Option

USUAL_DEPTH = 0.05  # [m] shallower flow has no velocity


class AveragingOptions(DensityOptions, total=False):
    """How the cells of frames are averaged."""

    percentile: Annotated[
        float,
        Option(
            "percentile of the particles' distances from the bed, by mass, taken as depth; 100 is the highest",
            "P",
            default=100.0,
            unit="%",
            above=0,
            most=100,
            label="Percentile of the particles' heights taken as depth",
        ),
    ]


class CellOptions(AveragingOptions, total=False):
    """Averaging of cells for questions about results."""

    standoff: Annotated[
        float,
        Option(
            "height above the DTM, along its normal, at which particles of a 3D code rest",
            "M",
            default=0.0,
            unit="m",
            least=-100,
            most=100,
            label="Height above the terrain at which particles of a 3D code rest",
        ),
    ]


class SizedCellOptions(CellOptions, total=False):
    """Averaging and size of cells for questions about results."""

    cell_size: Annotated[
        float,
        Option(
            "cell size",
            "M",
            unit="m",
            flag="--cs-e",
            above=0,
            usual="the finer of the cells of DTM and run",
            field="CELL",
            label="Cell size",
        ),
    ]
    min_depth: Annotated[
        float,
        Option(
            "velocities of flow shallower than this are left out",
            "D",
            default=USUAL_DEPTH,
            unit="m",
            above=0,
            label="Velocities of flow shallower than this are left out",
        ),
    ]
