"""Options of maps for print: classes of the colours, and the author of the page."""

from typing import Annotated, TypedDict

from ...system.option import Option


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
            label="Limits of classes: NAME=A,B, one a line, for example h=0.5,1,2,4",
        ),
    ]
    author: Annotated[
        str,
        Option(
            "author of the maps, on the page for print", "NAME", usual="a line to fill in", label="Author of the maps"
        ),
    ]
