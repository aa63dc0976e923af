"""Options of a calibration: its parameters, observations and rounds of runs."""

from typing import Annotated, Any, Literal, TypedDict, Unpack, cast

from ..system.option import Option, PathLike
from ..system.option_values import defaults_of
from .many_runs_options import TOLERATE, MachineOptions


class ParameterOptions(TypedDict, total=False):
    """Calibrated parameters."""

    vary: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "a key TABLE.KEY of the scene and its prior distribution, as for ensemble; KEY alone: the range of "
            "--material; repeatable",
            "KEY[=PRIOR]",
            default=(),
            repeat=True,
            folded=False,
            label="What is calibrated: KEY=PRIOR, one a line",
        ),
    ]
    material: Annotated[
        Literal["snow-avalanche", "debris-flow", "rock-avalanche"],
        Option(
            "ranges of friction.mu and friction.xi for keys without a prior",
            folded=False,
            label="Kind of event, for keys without a prior",
        ),
    ]


class ObservationOptions(TypedDict, total=False):
    """Observations of the event."""

    observed: Annotated[
        PathLike,
        Option(
            "mapped outline of the whole flow, in any vector format",
            "FILE",
            kind="polygon layer",
            folded=False,
            label="Mapped outline",
        ),
    ]
    points: Annotated[
        PathLike,
        Option(
            "points with the columns h_max [m], Ut_max [m/s], p_max [Pa] or t_arrival [s], and their standard "
            "deviations h_max_sd, ...",
            "FILE",
            kind="point layer",
            folded=False,
            label="Points with observed values",
        ),
    ]
    deposit: Annotated[
        PathLike,
        Option(
            "raster of the vertical thickness of the deposit; nodata where it is not known",
            "RASTER",
            unit="m",
            kind="raster layer",
            folded=False,
            label="Thickness of the deposit",
        ),
    ]
    volume: Annotated[
        str,
        Option(
            "volume of the deposit and its standard deviation",
            "V[:SD]",
            unit="m3",
            folded=False,
            label="Volume of the deposit: V or V:SD",
        ),
    ]
    line: Annotated[
        PathLike,
        Option(
            "path of the flow, from its top",
            "FILE",
            usual="the centre line of the outline",
            kind="line layer",
            label="Path of the flow, from its top",
        ),
    ]
    event: Annotated[
        tuple[str, ...],
        Option(
            "TOML file of another event with the same parameters: scene and its observed, points, deposit, volume, "
            "line; repeatable",
            "FILE",
            default=(),
            repeat=True,
            label="Files of other events",
            kind="files",
            files="Events (*.toml)",
        ),
    ]
    outline_error: Annotated[
        float,
        Option(
            "standard deviation of the position of the outline",
            "M",
            unit="m",
            above=0,
            usual="one cell of the maps",
            label="Error of the outline",
        ),
    ]
    value_error: Annotated[
        float,
        Option(
            "relative standard deviation of values without one",
            "SHARE",
            default=0.2,
            unit="1",
            above=0,
            label="Relative error of values without one",
        ),
    ]
    threshold: Annotated[
        float,
        Option(
            "depth from which a cell counts as covered",
            "M",
            default=0.1,
            unit="m",
            above=0,
            label="Depth from which a cell counts as covered",
        ),
    ]


class RoundOptions(TypedDict, total=False):
    """Numbers of runs, for each event."""

    samples: Annotated[
        int, Option("runs from the prior", "N", default=100, above=0, folded=False, label="Runs from the prior")
    ]
    refine: Annotated[
        int,
        Option("more runs near the posterior; 0 for none", "N", default=50, least=0, label="Runs near the posterior"),
    ]
    predictive: Annotated[
        int,
        Option(
            "runs from the posterior for the hazard maps; 0 for none",
            "N",
            default=50,
            least=0,
            label="Runs for the hazard maps",
        ),
    ]
    seed: Annotated[
        int, Option("seed of all random numbers", "N", default=0, least=0, label="Seed of the random numbers")
    ]
    exceed: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "thresholds of the probability maps, as for ensemble",
            "NAME=A,B",
            repeat=True,
            usual="h=0.5,1,2",
            label="Thresholds: NAME=A,B, one a line",
        ),
    ]
    cell_size: Annotated[
        float,
        Option(
            "cell size of maps and comparisons",
            "M",
            unit="m",
            flag="--cs-e",
            above=0,
            usual="the DTM's",
            field="CELL",
            label="Cell size of the maps",
        ),
    ]
    tolerate: Annotated[float, TOLERATE]


class CalibrateOptions(ParameterOptions, ObservationOptions, RoundOptions, MachineOptions, total=False):
    """Options of `mpmgis.calibrate`."""

    overwrite: Annotated[
        bool,
        Option(
            "replace the runs of another plan in the folder",
            default=False,
            folded=False,
            label="Replace the runs of another plan in the folder",
        ),
    ]


class AskedCalibration(CalibrateOptions, total=False):
    """A calibration: options, the scene and the folder to write."""

    scene: PathLike
    output: PathLike


def calibration_with(**given: Unpack[AskedCalibration]) -> AskedCalibration:
    """Return a calibration with some options, and the defaults of the others.

    Parameters
    ----------
    **given : options by name
    """
    return cast("AskedCalibration", {"output": None, **defaults_of(CalibrateOptions), **given})
