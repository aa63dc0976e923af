"""Options of maps for print: classes of the colours, and the author of the page."""

import math
from itertools import pairwise
from typing import Annotated, TypedDict

from ...system.option import Option


def _fault(texts: tuple[str, ...]) -> str:
    """What is expected of limits of classes; '' for valid ones."""
    for text in texts:
        name, _, numbers = str(text).partition("=")
        try:
            limits = [float(part) for part in numbers.split(",")]
        except ValueError:
            limits = []
        if not name.strip() or not limits or not all(low < high for low, high in pairwise([0.0, *limits, math.inf])):
            return "NAME=A,B,.. with ascending numbers above 0, for example h=0.5,1,2,4"
    return ""


class PageOptions(TypedDict, total=False):
    """Classes and author of maps."""

    classes: Annotated[
        tuple[str, ...],
        Option(
            "limits of the classes of a quantity (h, t, Ut, p, ...) and of its maxima on all maps, in the unit of the "
            "legend, so that maps of several runs can be compared; repeatable",
            "NAME=A,B,..",
            default=(),
            repeat=True,
            check=_fault,
            label="Limits of classes: NAME=A,B, one a line, for example h=0.5,1,2,4",
        ),
    ]
    author: Annotated[
        str,
        Option(
            "author of the maps, on the page for print", "NAME", usual="a line to fill in", label="Author of the maps"
        ),
    ]
