"""Where frames come from: their files, their DTM, and what the user declares about them."""

from dataclasses import dataclass, field
from pathlib import Path

from .declarations import Declarations
from .map_coordinates import Ground


@dataclass(frozen=True, kw_only=True)
class DeclaredByUser:
    """User declarations about another code's files, as options give them."""

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
        """Return the declarations, checked."""
        declared = vars(self.declarations)
        return Declarations.named(declared | {"time_step": declared["frame_step"], "density": self.density}, self.crs)

    def ground(self) -> Ground:
        """Return the DTM of the frames, where it is given."""
        return Ground(dem=self.dem, crs=self.crs, band=self.dem_band, to_crs=self.to_crs)
