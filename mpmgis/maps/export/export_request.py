"""Requests of the workflows in parts: frames, declarations about them, averaging of cells.

The option tables in `mpmgis.commands` describe their fields.
"""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ...exchange.declarations import Declarations


@dataclass(frozen=True, kw_only=True)
class DeclaredByUser:
    """User declarations about another code's files."""

    reader: str | None = None
    origin: tuple | None = None  # (E, N, H) [m]
    axes: tuple | None = None
    times: tuple | None = None  # [s]
    frame_step: float | None = None  # [s]
    frames_per_second: float | None = None  # [s-1]
    columns: tuple = ()
    particle_volume: float | None = None  # [m3]
    sidecar: Path | None = None


@dataclass(frozen=True, kw_only=True)
class FrameSource:
    """Frames, their DTM, and declarations about them."""

    frames: tuple = ()
    dem: Path | None = None
    dem_band: int | None = None
    crs: str | None = None
    to_crs: str | None = None
    density: float | None = None  # [kg m-3]
    declarations: DeclaredByUser = field(default_factory=DeclaredByUser)

    def terms(self) -> Declarations:
        """The declarations as Declarations."""
        declared = vars(self.declarations)
        return Declarations.named(declared | {"time_step": declared["frame_step"], "density": self.density}, self.crs)


@dataclass(frozen=True, kw_only=True)
class CellAveraging:
    """Averaging of the particles of a cell."""

    percentile: float = 100.0
    bed: str = "bilinear"
    min_depth: float = 0.05  # [m]
    standoff: float | str = 0.0  # [m]
    paper: bool = False


@dataclass(frozen=True, kw_only=True)
class CellSampling:
    """Cells and time steps."""

    cell_size: float | str | None = None  # [m]
    time_step: float | str | None = None  # [s]
    north_up: bool = False
    extent: str | None = None


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
        """Names of the given options that apply only to frames."""
        parts = (self.source, self.source.declarations, self.averaging, self.sampling)
        without = ("frames", "dem", "dem_band", "to_crs", "declarations")
        return [
            one.name for part in parts for one in fields(part)
            if one.name not in without and getattr(part, one.name) != one.default
        ]  # fmt: skip


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
        """Input paths other than the results: lines, points, guidelines, DTM, ..."""
        own = [getattr(self, one.name) for one in fields(self) if one.name != "output"]
        source = self.results.source
        return [path for path in (*own, source.dem, source.declarations.sidecar) if isinstance(path, Path)]
