"""Facts about how a DTM is brought to a metric CRS and to metres of height, in words and for records."""

from dataclasses import dataclass
from typing import Any

from .georeference import name_of
from .grid import Grid

RESAMPLING = "bilinear"


@dataclass(frozen=True)
class Reprojection:
    """How a DTM comes to the CRS that `to_crs` asked for.

    Parameters
    ----------
    asked : str
        ``auto`` or ``EPSG:n``.
    source, target : pyproj.CRS
        Horizontal CRS of the file and of the terrain.
    grid : Grid
        Of the terrain; that of the file where `resampled` is False.
    resampled : bool
        The pixels of `grid` are not those of the file.
    height_unit : str
        Of the file; "" where it names none.
    height_factor : float [1]
        Metres in a unit of the file's heights.
    shift : str
        Text on the operation between the datums, where it is less accurate than 1 m.
    """

    asked: str
    source: Any
    target: Any
    grid: Grid
    resampled: bool
    height_unit: str = ""
    height_factor: float = 1.0
    shift: str = ""

    @property
    def word(self) -> str:
        """Target as `to_crs` takes it: ``EPSG:n``, or what was asked for."""
        code = self.target.to_epsg()
        return f"EPSG:{code}" if code else self.asked

    def line(self, path: str) -> str:
        """Return a message on what was done to the DTM; "" where nothing was.

        Parameters
        ----------
        path : str
            Of the DTM.
        """
        parts = []
        if self.resampled:
            rows, columns = self.grid.shape
            parts.append(
                f"reprojected from {name_of(self.source)} to {name_of(self.target)}{self.shift}: {rows} x {columns} "
                f"cells of {self.grid.cell_size:.6g} m, {RESAMPLING}"
            )
        if self.height_factor != 1.0:
            parts.append(f"heights converted from {self.height_unit} to metres (times {self.height_factor:.10g})")
        return f"{path}: {'; '.join(parts)}" if parts else ""

    def facts(self) -> dict[str, Any]:
        """Return numbers and text for records and tags."""
        return {
            "from_crs": name_of(self.source),
            "to_crs": name_of(self.target),
            "asked": self.asked,
            "resampled": self.resampled,
            "resampling": RESAMPLING if self.resampled else "",
            "cell_size": self.grid.cell_size,
            "height_unit": self.height_unit or "not named, metres assumed",
            "height_factor": self.height_factor,
        }
