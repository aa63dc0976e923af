"""Settings of the averaging of particles in cells."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class CellAveraging:
    """Averaging of the particles of a cell."""

    percentile: float = 100.0  # [%] of the distances from the bed, by mass, taken as depth; 100 is the highest
    bed: str = "bilinear"  # interpolation of the DTM
    min_depth: float = 0.05  # [m] thinner flow has no velocity
    standoff: float | str = 0.0  # [m] height above the DTM, along its normal, at which particles rest
    paper: bool = False  # Eqs 2 to 14 of NHESS 25-3897-2025 as printed
