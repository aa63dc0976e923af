"""Hydrographs: inflow over time, its exact volume between two times, and its division into batches."""

from dataclasses import dataclass

import numpy as np

from ..laws.quantities import GRAVITY

# columns that the table of a hydrograph may have -> unit
COLUMNS = {
    "time": "s",
    "discharge": "m3 s-1",
    "thickness": "m",
    "speed": "m s-1",
    "velocity_east": "m s-1",
    "velocity_north": "m s-1",
}
BATCH_SHARE = 0.125  # [1] share of the content of an inlet that enters at once


@dataclass(frozen=True, eq=False)
class Hydrograph:
    """Inflow over time: either a discharge or the thickness of slabs.

    Parameters
    ----------
    time : float64[n] [s]
        Rising.
    discharge : float64[n] [m3 s-1], optional
        Linear between the times, none before the first and after the last.
    thickness : float64[n] [m], optional
        Of a slab that is released at each time; 0 for none.
    speed : float64[n] [m s-1], optional
        Along the ground, down the steepest descent.
    velocity : float64[n, 2] [m s-1], optional
        East and north, instead of speed.
    """

    time: np.ndarray
    discharge: np.ndarray | None = None
    thickness: np.ndarray | None = None
    speed: np.ndarray | None = None
    velocity: np.ndarray | None = None

    def volume(self, start: float, end: float) -> float:
        """Return the volume [m3] that flows in between two times: the exact integral of the piecewise linear discharge.

        Parameters
        ----------
        start, end : float [s]
        """
        start, end = max(start, self.time[0]), min(end, self.time[-1])
        if end <= start:
            return 0.0
        times = np.concatenate([[start], self.time[(self.time > start) & (self.time < end)], [end]])
        discharge = np.interp(times, self.time, self.discharge)
        return float((0.5 * (discharge[1:] + discharge[:-1]) * np.diff(times)).sum())

    def speed_at(self, time: float) -> float:
        """Return the speed [m s-1] at a time, linear between the times of the table; 0 where it has no speed.

        Parameters
        ----------
        time : float [s]
        """
        return 0.0 if self.speed is None else float(np.interp(time, self.time, self.speed))

    def velocity_at(self, time: float) -> tuple[float, float]:
        """Return the velocity east and north [m s-1] at a time, linear between the times of the table; without one 0.

        Parameters
        ----------
        time : float [s]
        """
        if self.velocity is None:
            return (0.0, 0.0)
        return tuple(float(np.interp(time, self.time, part)) for part in self.velocity.T)


def clearing_time(
    discharge: float, length: float, width: float, slope: float, speed: float, gravity: float = GRAVITY
) -> float:
    """Return the time [s] in which the inflow leaves the inlet.

    Its speed there is that of critical flow, (g Q / W)^(1/3) (the free outflow of a pool), or that of material which
    enters with `speed` and slides down the inlet without friction, averaged over the way, whichever is faster.

    Parameters
    ----------
    discharge : float [m3 s-1]
    length, width : float [m]
        Of the inlet, along and across the flow.
    slope : float [1]
        Tangent of the inlet's slope.
    speed : float [m s-1]
    gravity : float [m s-2]
    """
    critical = (gravity * discharge / width) ** (1.0 / 3.0)
    leaving = np.sqrt(speed**2 + 2.0 * gravity * length * slope / (1.0 + slope**2))
    return length / max(critical, 0.5 * (speed + leaving))


def batch_times(hydrograph: Hydrograph, end_time: float, interval: float) -> np.ndarray:
    """Divide the time of a hydrograph into equal intervals; the inflow of each enters at its start.

    Only the intervals before `end_time` are returned, the last one cut there, so that a run with a later end begins
    with the same batches.

    Parameters
    ----------
    hydrograph : Hydrograph
    end_time : float [s]
    interval : float [s]
        Longest one.

    Returns
    -------
    float64[k, 2] [s]
        Start and end.
    """
    start, last = hydrograph.time[0], hydrograph.time[-1]
    if min(last, end_time) <= start:
        return np.empty((0, 2))
    edges = np.linspace(start, last, int(np.ceil((last - start) / interval)) + 1)
    edges = np.append(edges[edges < end_time], min(last, end_time)) if end_time < last else edges
    return np.column_stack([edges[:-1], edges[1:]])
