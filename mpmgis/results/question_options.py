"""Options of every question about results."""

from typing import Annotated

from ..exchange.frame_source import THIRD_PARTY, DeclarationOptions, ThirdPartyOptions
from ..frames.frame_options import TerrainOptions
from ..maps.averaging.averaging_options import CellOptions, SizedCellOptions
from ..system.option import PathLike, options_of
from ..system.work_options import OverwriteOptions

AVERAGED = "cells, averaged as export-raster does"


class FrameQuestionOptions(OverwriteOptions, TerrainOptions, CellOptions, DeclarationOptions, total=False):
    """Options of questions about frames whose cell size is fixed."""


class QuestionOptions(OverwriteOptions, TerrainOptions, SizedCellOptions, DeclarationOptions, total=False):
    """Options of every question about results."""


class FrameQuestion(FrameQuestionOptions, total=False):
    """A question about frames whose cell size is fixed: results, options and the path to write."""

    frames: tuple[PathLike, ...]
    output: PathLike


class Question(QuestionOptions, total=False):
    """A question: results, options and the path to write."""

    frames: tuple[PathLike, ...]
    output: PathLike


class ReadingOptions(ThirdPartyOptions, total=False):
    """Reading of another code's files."""

    standoff: Annotated[float, options_of(CellOptions)["standoff"]]


# titles of groups of options in the help
FRAME_GROUPS = (("terrain", TerrainOptions), (AVERAGED, CellOptions), (THIRD_PARTY, DeclarationOptions))
GROUPS = (("terrain", TerrainOptions), (AVERAGED, SizedCellOptions), (THIRD_PARTY, DeclarationOptions))
