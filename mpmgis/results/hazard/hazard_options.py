"""Options of a hazard map."""

from typing import Annotated, Literal, TypedDict

from ...system.option import Option, PathLike, options_of
from ..question_options import Question


class HazardOptions(TypedDict, total=False):
    """Options of a hazard map."""

    map: Annotated[
        str,
        Option(
            "a hazard map of the scenarios instead of a report: a matrix of return period and intensity of the list "
            "above, or of --matrices",
            "MATRIX",
            kind="choice",
            folded=False,
            label="Matrix",
            also=(
                {
                    "name": "OWN",
                    "kind": "text",
                    "label": "or: name of one of your own",
                    "advanced": True,
                    "help": "As its file has it.",
                },
            ),
        ),
    ]
    scenario: Annotated[
        tuple[str, ...],
        Option(
            "return period in years and results: frames, an export, the beginning of the names of rasters, or an "
            "ensemble; repeatable",
            "T=RESULTS",
            default=(),
            repeat=True,
            folded=False,
            label="Scenarios: return period in years = results, one a line",
        ),
    ]
    scale: Annotated[
        str,
        Option(
            "scale of the printed map, to which outlines are simplified",
            "1:N",
            usual="the largest usual one that fits on the paper",
            folded=False,
            label="Scale of the map, 1:N",
        ),
    ]
    min_area: Annotated[
        float,
        Option(
            "smallest area of the zones; smaller gaps are filled, smaller parts enlarged",
            "A",
            unit="m2",
            least=0,
            usual="that of 2 mm x 2 mm on the map",
            label="Smallest area of the zones",
        ),
    ]
    sheet: Annotated[
        Literal["A4", "A3"], Option("paper of the printed map", flag="--paper", default="A4", label="Paper")
    ]
    matrices: Annotated[
        PathLike,
        Option(
            "your own matrices, as TOML (docs/guide/hazard-map)",
            "FILE",
            label="Your own matrices",
            files="Matrices (*.toml)",
        ),
    ]
    guidelines: Annotated[
        PathLike,
        Option(
            "your own intensity classes for them, as TOML (docs/guide/hazard-map)",
            "FILE",
            label="Your own intensity classes",
            files="Guidelines (*.toml)",
        ),
    ]


class HazardQuestion(HazardOptions, Question, total=False):
    """A question about scenarios."""

    title: str
    author: str


def given_hazard_options(asked: HazardOptions) -> list[str]:
    """Return the names of the options of a hazard map that have other values than their defaults.

    Parameters
    ----------
    asked : HazardOptions
    """
    return [name for name, option in options_of(HazardOptions).items() if asked.get(name) != option.default]
