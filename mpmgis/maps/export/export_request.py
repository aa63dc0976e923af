"""Requests for exports and answers: results, cells, time steps and files.

The option tables in `mpmgis.commands` describe their fields.
"""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ...exchange.frame_source import FrameSource
from ..averaging.averaging_settings import CellAveraging


@dataclass(frozen=True, kw_only=True)
class CellSampling:
    """Cells and time steps."""

    cell_size: float | str | None = None  # [m] or "auto"; None: the finer of DTM and run
    time_step: float | str | None = None  # [s] or "auto"; None: every frame
    north_up: bool = False
    extent: str | None = None  # "dtm" or "flow"


@dataclass(frozen=True, kw_only=True)
class ExportFiles:
    """Files of an export."""

    products: tuple = ()
    layout: str = "steps"
    naming: str = "mpmgis"
    cog: bool = False
    qgis: bool = True
    qgis_min: str = "3.38"
    animation: Path | None = None
    kml: bool = False
    stac: bool = False
    layers: tuple = ()  # [m] heights over the bed


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results: frames with the averaging of their cells, an export, or rasters."""

    source: FrameSource = field(default_factory=FrameSource)
    averaging: CellAveraging = field(default_factory=CellAveraging)
    sampling: CellSampling = field(default_factory=CellSampling)

    @property
    def frames(self) -> tuple:
        """Paths of the results."""
        return self.source.frames

    def options_of_frames(self) -> list[str]:
        """Return the names of the given options that apply only to frames."""
        parts = (self.source, self.source.declarations, self.averaging, self.sampling)
        without = ("frames", "dem", "dem_band", "to_crs", "declarations")
        return [
            one.name
            for part in parts
            for one in fields(part)
            if one.name not in without and getattr(part, one.name) != one.default
        ]


@dataclass(frozen=True, kw_only=True)
class ExportRequest(Results):
    """An export for GIS."""

    files: ExportFiles = field(default_factory=ExportFiles)
    output: Path | None = None
    overwrite: bool = False
    workers: int | None = None
    dask: str | None = None


@dataclass(frozen=True, kw_only=True)
class AnswerRequest:
    """A question about `results`, with the output of the answer."""

    results: Results
    output: Path | None = None
    overwrite: bool = False

    def paths(self) -> list[Any]:
        """Return the input paths other than the results: lines, points, guidelines, DTM, ..."""
        own = [getattr(self, one.name) for one in fields(self) if one.name != "output"]
        source = self.results.source
        return [path for path in (*own, source.dem, source.declarations.sidecar) if isinstance(path, Path)]
