"""Compare the observations of an event with its runs: the same summaries of both on the grid of the runs."""

from dataclasses import dataclass
from itertools import chain

import numpy as np
import shapely

from ..frames.ensemble_members import Members, read_band
from ..frames.particles import Frame
from ..results.comparison import nearest
from ..results.flow_line import centre_line
from ..results.path_bands import BANDS, PathBands
from ..system.errors import InputError
from ..system.messages import log
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from ..terrain.observations import cells_within, read_line, read_outline, read_values
from ..terrain.raster_input import read_raster
from ..terrain.undeclared_nodata import THICKNESS
from .calibration_events import Event
from .calibration_options import AskedCalibration
from .ensemble_member import DEPOSITED

DEPOSIT_ERROR = 0.1  # [m] standard deviation of the thickness of an observed deposit
RELEASE_MISSED = 0.2  # [1] share of the release outside an outline, above which a message is printed
OUTSIDE_DTM = 0.05  # [1] share of an outline without ground, above which a message is printed


@dataclass(frozen=True)
class Compared:
    """Summaries of one event, the same for observations and runs.

    Parameters
    ----------
    names : list of str
    observed, variances : float64[k]
        Summaries of the observations, and the variances of their errors.
    simulated : float64[n, k]
        Summaries of the runs.
    """

    names: list
    observed: np.ndarray
    variances: np.ndarray
    simulated: np.ndarray


class EventOnGrid:
    """The observations of an Event on the grid of its runs.

    Parameters
    ----------
    event : Event
    grid : Grid
    terrain : Terrain
    asked : AskedCalibration
    """

    def __init__(self, event: Event, grid: Grid, terrain: Terrain, asked: AskedCalibration) -> None:
        self.event, self.grid, self.terrain, self.asked = event, grid, terrain, asked
        self.error = grid.cell_size if asked["outline_error"] is None else asked["outline_error"]
        self.outline = None if event.observed is None else read_outline(event.observed, grid)
        self.mask = None if self.outline is None else self._within(self.outline)
        self.values = [] if event.points is None else read_values(event.points, grid, asked["value_error"])
        self.deposit = None if event.deposit is None else self._deposit(event.deposit)
        self.line = self._line()

    def _within(self, shape):
        return np.zeros(self.grid.shape, bool) if shape.is_empty else cells_within(shape, self.grid)

    def _deposit(self, path):
        """Return the vertical thickness [m] on the grid; NaN where it is not known, 0 for erosion."""
        values, own = read_raster(path, THICKNESS)
        return np.maximum(nearest(values, own, self.grid), 0.0)

    def _line(self):
        if self.event.line is not None:
            return read_line(self.event.line, self.grid)
        if self.mask is None:
            return None
        if not self.mask.any():
            cells = shapely.box(*self.grid.bounds)
            fix = "use smaller cells" if self.outline.intersects(cells) else "it is outside the DTM; check its CRS"
            raise InputError(f"{self.event.observed}: no cell of the runs lies in the outline; {fix}")
        elevation = np.full(self.grid.shape, np.nan)
        elevation[self.mask] = self.terrain.sample(*self.grid.xy(*np.nonzero(self.mask)))
        line = centre_line([self.mask], [np.ones(self.grid.shape)], elevation, self.grid)
        if line is None:
            raise InputError(f"{self.event.observed}: no path is found in the outline; give `line`")
        return line

    def report_outline(self, release: Frame) -> None:
        """Report an outline without the release of the scene, or with ground that the DTM does not have.

        Parameters
        ----------
        release : Frame
            Columns of all mass that may move.
        """
        if self.outline is None:
            return
        path, near = self.event.observed, shapely.buffer(self.outline, self.error)
        missing = 1.0 - shapely.contains_xy(near, *release.map_xy()).mean()
        if missing > RELEASE_MISSED:
            log.info(
                f"warning: {path} does not contain {missing:.0%} of the release of {self.event.scene.name}; expected "
                "the outline of the whole flow from its top. If it is of the deposit only, give `deposit` or `volume`"
            )
        height = self.terrain.sample(*self.grid.xy(*np.nonzero(self.mask)))
        beyond = 1.0 - np.isfinite(height).sum() * self.grid.cell_area / self.outline.area
        if beyond > OUTSIDE_DTM:
            log.info(f"warning: {beyond:.0%} of the area in {path} has no ground in the DTM and is not compared")

    def compared(self, runs: list[tuple[Members, int]]) -> Compared:
        """Return the summaries of the observations and of the runs.

        Parameters
        ----------
        runs : list of (Members, int)
            Each a member of an ensemble by its index.
        """
        parts = [self._outline_part(runs), self._point_part(runs), self._deposit_part(runs)]
        parts = [part for part in parts if part is not None]
        return Compared(
            [name for part in parts for name in part.names],
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ("observed", "variances")),
            np.hstack([part.simulated for part in parts]),
        )

    def covered(self, run: tuple[Members, int]) -> np.ndarray:
        """Return which cells a run covers.

        Parameters
        ----------
        run : (Members, int)

        Returns
        -------
        bool[rows, columns]
        """
        members, k = run
        return np.nan_to_num(members.band(k, "h_max")) >= self.asked["threshold"]

    def _outline_part(self, runs):
        if self.outline is None:
            return None
        union = self.mask.copy()
        for run in runs:
            union |= self.covered(run)
        smaller, larger = (self._within(shapely.buffer(self.outline, by)) for by in (-self.error, self.error))
        bands = PathBands.of(self.line, self.grid, union | larger)
        simulated = np.array([bands.of_mask(self.covered(run)) for run in runs])
        names = [f"{self.event.name}: {name}" for name in bands.names]
        return Compared(names, bands.of_mask(self.mask), bands.deviations(smaller, larger, self.error) ** 2, simulated)

    def _point_part(self, runs):
        if not self.values:
            return None
        columns = []
        for quantity in dict.fromkeys(value.quantity for value in self.values):
            own = [value for value in self.values if value.quantity == quantity]
            rows, cols = ([getattr(value, name) for value in own] for name in ("row", "column"))
            dry = [members.figure("end_time_s")[k] if quantity == "t_arrival" else 0.0 for members, k in runs]
            read = np.array([members.band(k, quantity)[rows, cols] for members, k in runs])
            columns.append(np.where(np.isfinite(read), read, np.array(dry)[:, None]))
        order = [
            value
            for q in dict.fromkeys(v.quantity for v in self.values)
            for value in self.values
            if value.quantity == q
        ]
        return Compared(
            [f"{self.event.name}: {value.quantity} at {value.point}" for value in order],
            np.array([value.value for value in order]),
            np.array([value.deviation**2 for value in order]),
            np.hstack(columns),
        )

    def _deposit_part(self, runs):
        if not self.event.needs_deposit:
            return None
        thickness = [read_band(members.deposit(k), DEPOSITED.name) for members, k in runs]
        parts = []
        if self.deposit is not None:
            known = np.isfinite(self.deposit)
            bands = PathBands.of(self.line, self.grid, known)
            observed = bands.of_volume(self.deposit)
            area = bands.of_volume((self.deposit > 0).astype(float)) + self.error * self.grid.cell_size
            variance = (self.asked["value_error"] * observed) ** 2 + (DEPOSIT_ERROR * area) ** 2
            names = [f"{self.event.name}: deposit_{k + 1}" for k in range(BANDS)]
            parts.append((names, observed, variance, np.array([bands.of_volume(one) for one in thickness])))
        if self.event.volume is not None:
            value, deviation = self.event.volume
            totals = np.array([[np.nansum(one) * self.grid.cell_area] for one in thickness])
            parts.append(([f"{self.event.name}: volume"], np.array([value]), np.array([deviation**2]), totals))
        names, observed, variances, simulated = zip(*parts, strict=True)
        return Compared([*chain(*names)], np.concatenate(observed), np.concatenate(variances), np.hstack(simulated))
