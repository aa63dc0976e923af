"""Options of an ensemble: what varies, its maps."""

from typing import Annotated, Any, Literal, TypedDict, Unpack, cast

from ..maps.qgis.page_options import PageOptions
from ..system.option import Option, PathLike
from ..system.option_values import defaults_of
from .many_runs_options import TOLERATE, MachineOptions


class PlanOptions(TypedDict, total=False):
    """Varied parameters."""

    vary: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "a key TABLE.KEY of the scene and its values; repeatable",
            "KEY=VALUES",
            default=(),
            repeat=True,
            folded=False,
            label="What varies: KEY=VALUES, one a line",
        ),
    ]
    plan: Annotated[
        PathLike,
        Option(
            "TOML file with [vary] and the options of this group; options override it",
            "FILE",
            folded=False,
            label="or: plan in a file",
            files="Plans (*.toml)",
        ),
    ]
    samples: Annotated[
        int,
        Option(
            "number of runs; with grid: number of values per range",
            "N",
            above=0,
            usual="32, with grid 5",
            folded=False,
            label="Runs",
        ),
    ]
    sampling: Annotated[
        Literal["lhs", "sobol", "random", "grid"],
        Option(
            "lhs (Latin hypercube), sobol, random, or grid: all combinations of values, of each range --samples "
            "values, each in the middle of an equally likely interval",
            usual="grid if all are lists, else lhs",
            label="How values are drawn",
        ),
    ]
    seed: Annotated[
        int,
        Option(
            "seed of the sampling; the same seed gives the same runs",
            "N",
            least=0,
            usual="0",
            label="Seed of the random numbers",
        ),
    ]


class MapOptions(PageOptions, total=False):
    """Maps of an ensemble."""

    exceed: Annotated[
        tuple[str, ...] | dict[str, Any],
        Option(
            "map of the probability that the peak of h [m], Ut [m/s] or p [Pa] is at least this",
            "NAME=A,B",
            repeat=True,
            usual="h=0.5,1,2",
            folded=False,
            label="Thresholds: NAME=A,B, one a line",
        ),
    ]
    percentiles: Annotated[
        tuple[float, ...],
        Option(
            "percentiles of the members' peaks and arrivals",
            "P,..",
            unit="%%",
            usual="5,50,95",
            folded=False,
            label="Percentiles, with commas",
        ),
    ]
    cell_size: Annotated[
        float,
        Option(
            "cell size of the maps",
            "M",
            unit="m",
            flag="--cs-e",
            above=0,
            usual="the DTM's",
            folded=False,
            field="CELL",
            label="Cell size of the maps",
        ),
    ]
    min_depth: Annotated[
        float,
        Option(
            "depth from which flow counts as arrived and has a velocity",
            "D",
            default=0.05,
            unit="m",
            above=0,
            label="Depth from which flow counts as arrived",
        ),
    ]
    keep: Annotated[
        Literal["maxima", "deposit", "frames"],
        Option(
            "keep of each run: its maxima, also its deposit, or all frames", default="maxima", label="Keep of each run"
        ),
    ]
    tolerate: Annotated[float, TOLERATE]


class EnsembleOptions(PlanOptions, MapOptions, MachineOptions, total=False):
    """Options of `mpmgis.ensemble`."""

    overwrite: Annotated[
        bool,
        Option(
            "replace the ensemble of another plan; members of both are kept",
            default=False,
            folded=False,
            label="Replace the ensemble of another plan in the folder",
        ),
    ]


class AskedEnsemble(EnsembleOptions, total=False):
    """An ensemble: options, the scene and the folder to write."""

    scene: PathLike
    output: PathLike


def ensemble_with(**given: Unpack[AskedEnsemble]) -> AskedEnsemble:
    """Return an ensemble with some options, and the defaults of the others.

    Parameters
    ----------
    **given : options by name
    """
    return cast("AskedEnsemble", {"output": None, **defaults_of(EnsembleOptions), **given})
