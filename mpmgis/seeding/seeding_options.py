"""Options of the seeding, checked once."""

import math
from dataclasses import dataclass

import numpy as np

from ..system.errors import InputError
from ..terrain.grid import Grid
from .lattice import Lattice
from .lattice_columns import KINDS

POINTS = (*KINDS, "halton")
MASSES = ("thickness", "equal", "paper")
REFINEMENT_LIMIT = 3.0  # [1] largest beta, which keeps particle masses alike
_MOST = 4_000_000_000  # columns that may be requested


@dataclass(frozen=True)
class SeedOptions:
    """Options of Algorithm 1.

    Parameters
    ----------
    cell_size : float, optional [m]
        Side of the square cells; default the DTM's own cells, of any shape.
    anchor : (float, float), optional [m]
        x, y of a corner of the square cells.
    per_cell : int, optional
        Columns a whole cell; 16 where neither `count` nor `spacing` is given.
    count : int, optional
        Columns in all (met within 1 %), instead of `per_cell`.
    spacing : float, optional [m]
        Spacing of the lattice, instead of `per_cell`.
    points : {"lattice", "staggered", "jittered", "halton", "random"}
    mass : {"thickness", "equal", "paper"}
        Mass from thickness and area of each column; equal masses, dense where it is thick; or as the paper prints it.
    density : float [kg m-3]
    refine_slope : float
        beta in n0 (1 + beta min(tan slope, 1)), 0 to 3; mass "thickness" only.
    velocity : (float, float) [m s-1]
        Of all columns, to the east and north; the vertical part follows the bed.
    seed : int
        Of the random numbers, 0 or more.

    Raises
    ------
    InputError
        An option is out of its range, or two options exclude each other.
    """

    cell_size: float | None = None
    anchor: tuple | None = None
    per_cell: int | None = None
    count: int | None = None
    spacing: float | None = None
    points: str = "lattice"
    mass: str = "thickness"
    density: float = 1000.0
    refine_slope: float = 0.0
    velocity: tuple = (0.0, 0.0)
    seed: int = 0

    def __post_init__(self):
        self._require_one_resolution()
        _require_choice("points", self.points, POINTS)
        _require_choice("mass", self.mass, MASSES)
        for name in ("cell_size", "spacing", "density"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"{name.replace('_', ' ')} is {value:g}, expected a finite number above 0")
        self._require_refinement()
        if len(self.velocity) != 2 or not all(math.isfinite(v) for v in self.velocity):
            raise InputError(f"velocity is {self.velocity}, expected two finite numbers (east, north) in m s-1")
        if self.anchor is not None and not all(math.isfinite(v) for v in self.anchor):
            raise InputError(f"anchor is {self.anchor}, expected two finite numbers (x, y) in m")
        if not 0 <= self.seed < 2**63:
            raise InputError(f"seed is {self.seed}, expected a whole number from 0 to 2^63 - 1")

    def _require_one_resolution(self):
        asked = [name for name in ("per_cell", "count", "spacing") if getattr(self, name) is not None]
        if len(asked) > 1:
            raise InputError(f"{' and '.join(asked)} exclude each other; give one of per_cell, count, spacing")
        for name in ("per_cell", "count"):
            value = getattr(self, name)
            if value is not None and (value != int(value) or not 1 <= value <= _MOST):
                raise InputError(f"{name} is {value:g}, expected a whole number from 1 to {_MOST}")
        if not asked:
            object.__setattr__(self, "per_cell", 16)

    def _require_refinement(self):
        beta = self.refine_slope
        if not 0 <= beta <= REFINEMENT_LIMIT:
            raise InputError(
                f"refine slope is {beta:g}, expected 0 to {REFINEMENT_LIMIT:g} (keeps particle masses alike)"
            )
        if beta and self.mass != "thickness":
            raise InputError(
                f"refine slope with mass {self.mass!r} would change the thickness that the columns stand for; use mass "
                f"'thickness'"
            )
        if beta and self.points == "jittered":
            raise InputError("refine slope has no jittered points; use lattice, staggered, halton or random")

    def cells(self, grid: Grid) -> Lattice:
        """Return the lattice of cells: those requested, or the pixels of the DTM.

        Parameters
        ----------
        grid : Grid
            Grid of the DTM.
        """
        if self.cell_size is None and self.anchor is None:
            return Lattice.of_grid(grid)
        corner = self.anchor if self.anchor is not None else (grid.transform.c, grid.transform.f)
        return Lattice.squares(corner, self.cell_size or grid.cell_size)

    def squares(self, grid: Grid, side: float) -> Lattice:
        """Return a lattice of squares, anchored to the cells and along their rows.

        Parameters
        ----------
        grid : Grid
            Grid of the DTM.
        side : float [m]
        """
        cells = self.cells(grid)
        along = cells.matrix[:, 0] / np.hypot(*cells.matrix[:, 0])
        return Lattice.squares(cells.origin, side, tuple(along.tolist()))

    def expected(self, grid: Grid, area: float) -> float:
        """Return the requested number of columns (a real number), refinement apart.

        Parameters
        ----------
        grid : Grid
            Grid of the DTM.
        area : float [m2]
            Area of the release.

        Raises
        ------
        InputError
            Too many columns, or a spacing wider than the release.
        """
        if self.count is not None:
            return float(self.count)
        side = math.sqrt(area)
        if self.spacing is not None and self.spacing > side:
            raise InputError(
                f"spacing is {self.spacing:g} m, expected at most {side:.4g} m, the side of a square with the area of "
                "the release"
            )
        share = self.spacing**2 if self.spacing is not None else self.cells(grid).cell_area / self.per_cell
        number = area / share
        if number > _MOST:
            raise InputError(
                f"{number:.3g} columns requested, expected at most {_MOST}; use a wider spacing or fewer a cell"
            )
        return number


def _require_choice(name, value, choices):
    if value not in choices:
        raise InputError(f"{name} {value!r} is unknown, expected {', '.join(choices)}")
