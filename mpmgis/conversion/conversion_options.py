"""Options of a conversion between columns and points, with their checks."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..laws.quantities import GRAVITY
from ..system.errors import InputError
from .column_pieces import pieces_along

if TYPE_CHECKING:
    from ..frames.particles import Particles

VERTICAL_VELOCITIES = ("tangent", "paper", "linear")
PLACEMENTS = ("centred", "paper")
COUNTS = ("round", "paper")
GROUPINGS = ("parent", "cell")
REFUSE, KEEP, LAY = "refuse", "keep", "lay"  # treatment of mass that has left the bed
MOST = 2_000_000_000  # [points] of a conversion
_ROUNDING = 1e-6  # [1] share by which thickness over spacing may miss a whole number or a half


@dataclass(frozen=True)
class PointOptions:
    """Options of the conversion of columns to points.

    Parameters
    ----------
    spacing : float, optional [m]
        Vertical distance r of a column's points; default half the `cell`, or without one the median column's side.
    vertical_velocity : {"tangent", "paper", "linear"}
        w = u . grad b; 0 as printed (Eq 3); or u . grad b - (z - b) div u, which requires div u.
    placement : {"centred", "paper"}
        Points in the middle of equal slices, or from bed to surface as printed (Eq 2), which deletes columns
        of a single point: 0/0 is "eliminated".
    counting : {"round", "paper"}
        Points in a column: round(h / r) or floor(h / r), at least 1 (Eq 1). Halves are rounded upwards; a quotient
        that misses a whole number or a half by a millionth counts as that, so that equal columns have equally many.
    cell : float, optional [m]
        Grid spacing of the 3D solver to be filled: wider columns are split sideways.
    relevel : bool
        Raise overlapping columns to the height of their mass; requires `cell`.
    gravity : float [m s-2]
        Of the geostatic stress.
    stretched : bool
        Footprints of columns that have moved are stretched according to their neighbours; False: squares, for columns
        whose neighbours are not in the frame.

    Raises
    ------
    InputError
    """

    spacing: float | None = None
    vertical_velocity: str = "tangent"
    placement: str = "centred"
    counting: str = "round"
    cell: float | None = None
    relevel: bool = False
    gravity: float = GRAVITY
    stretched: bool = True

    def __post_init__(self):
        for name, choices in (
            ("vertical_velocity", VERTICAL_VELOCITIES),
            ("placement", PLACEMENTS),
            ("counting", COUNTS),
        ):
            _require_choice(name, getattr(self, name), choices)
        for name in ("spacing", "cell", "gravity"):
            _require_positive(name, getattr(self, name))
        if self.relevel and self.cell is None:
            raise InputError("relevel requires the grid spacing of the 3D solver; give it with cell (--cell)")

    @classmethod
    def as_printed(cls, spacing: float | None = None) -> "PointOptions":
        """Return all options as printed in MOX report 15/2025.

        Parameters
        ----------
        spacing : float, optional [m]
        """
        return cls(spacing=spacing, vertical_velocity="paper", placement="paper", counting="paper")

    @property
    def deletes_single_points(self) -> bool:
        """Whether columns of one point are deleted: Eq (2) is 0/0 for them in the printed algorithm."""
        return self.placement == "paper"

    def spacing_for(self, particles: "Particles") -> float:
        """Return the vertical spacing [m]: as given, else half a cell, else the median column's side.

        Parameters
        ----------
        particles : Particles
            Columns.
        """
        if self.spacing is not None:
            return self.spacing
        return 0.5 * self.cell if self.cell is not None else float(np.median(np.sqrt(particles.area)))

    @property
    def piece_size(self) -> float | None:
        """Longest piece [m] into which columns are cut: half a cell; None: columns are not cut."""
        return None if self.cell is None else 0.5 * self.cell

    def points_in(self, thickness: np.ndarray, spacing: float) -> np.ndarray:
        """Compute the whole number of points in columns (Eq 1), at least 1.

        Parameters
        ----------
        thickness : float64[n] [m]
        spacing : float [m]

        Returns
        -------
        float64[n]
        """
        ratio = thickness / spacing * (1.0 + _ROUNDING)
        whole = np.floor(ratio) if self.counting == "paper" else np.floor(ratio + 0.5)
        return np.maximum(whole, 1.0)

    def predicted_points(self, particles: "Particles") -> float:
        """Predict the number of points of columns.

        Parameters
        ----------
        particles : Particles
            Columns.
        """
        whole = np.sqrt(particles.area)
        along = pieces_along(whole, self.piece_size).astype(float)
        return float((along**2 * self.points_in(particles.thickness, self.spacing_for(particles))).sum())


@dataclass(frozen=True)
class ColumnOptions:
    """Options of the conversion of points to columns.

    Parameters
    ----------
    by : {"parent", "cell"}, optional
        Points of one parent make a column, or those of one cell. Default: by parent where points have parents and
        are still together, else by cell.
    cell : float, optional [m]
        Side of the cells, from the upper left corner of the terrain; default its pixels.
    point_cell : float, optional [m]
        Grid spacing of the 3D code; default from the frame, else twice the mean point's side.
    detached : {"refuse", "keep", "lay"}
        Mass that leaves the bed or is above it is refused, or stays points, or is moved onto the bed
        below it with its mass and horizontal momentum, as in a run that continues with columns.

    Raises
    ------
    InputError
    """

    by: str | None = None
    cell: float | None = None
    point_cell: float | None = None
    detached: str = REFUSE

    def __post_init__(self):
        if self.by is not None:
            _require_choice("by", self.by, GROUPINGS)
        _require_choice("detached", self.detached, (REFUSE, KEEP, LAY))
        for name in ("cell", "point_cell"):
            _require_positive(name, getattr(self, name))


def _require_choice(name, value, choices):
    if value not in choices:
        raise InputError(f"{name.replace('_', ' ')} {value!r} is unknown, expected {', '.join(choices)}")


def _require_positive(name, value):
    if value is not None and not (math.isfinite(value) and value > 0):
        raise InputError(f"{name.replace('_', ' ')} is {value:g}, expected a finite number above 0")
