"""End of a flow: whether it came to rest, the share of its mass that still moves, and the name of its last step."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

FLOWING_SPEED = 1.0  # [m s-1] slower is creep, which changes no deposit
FLOWING_SHARE = 0.05  # [1] of the mass on the terrain; a flow of which more is faster than FLOWING_SPEED is not at rest
REST_ENERGY = 0.01  # [1] of the largest kinetic energy so far; a flow with more is not at rest
# reasons for the end of a run
END_TIME, NOTHING_LEFT = "end_time reached", "all mass has left the terrain"
NEARLY_AT_REST = (
    "nearly at rest: kinetic energy below 1 % of its peak for 2 s, and under 5 % of the mass is faster than 1 m/s"
)
DEPOSIT, LAST = "deposit", "last"  # ends of the file names of a last step, of a flow at rest and of one that moves


@dataclass(frozen=True)
class FlowEnd:
    """State of a flow in its last step.

    Parameters
    ----------
    time : float [s]
    moving : float [1]
        Share of the mass that is faster than FLOWING_SPEED.
    came_to_rest : bool
        Only then the last step is a deposit.
    """

    time: float
    moving: float
    came_to_rest: bool

    @property
    def file(self) -> str:
        """End of the name of the raster of the last step, `deposit` or `last`; also of its bands in memory."""
        return DEPOSIT if self.came_to_rest else LAST

    def words(self) -> str:
        """Return the name of the last step on maps and pages."""
        return DEPOSIT if self.came_to_rest else f"last step, {self.moving_words()}"

    def moving_words(self) -> str:
        """Return the time of the last step and the share of the mass that still moves."""
        return f"t = {self.time:.4g} s, {_percent(self.moving)} % still moving"

    def tags(self) -> dict:
        """Return the tags of rasters that were made of the last step."""
        return {"came_to_rest": str(self.came_to_rest).lower(), "still_moving": f"{self.moving:.4g}"}


def _percent(share):
    """Return a share in percent: whole percents from 1 % on, one digit below."""
    return f"{100 * share:.0f}" if share >= 0.01 else f"{100 * share:.1g}"


def moving_share(mass: np.ndarray, speed: np.ndarray) -> float:
    """Return the share of the mass that is faster than FLOWING_SPEED [1]; 0 without particles.

    Parameters
    ----------
    mass : float[n] [kg]
    speed : float[n] [m s-1]
    """
    total = float(mass.sum())
    return float(mass[speed > FLOWING_SPEED].sum()) / total if total > 0.0 else 0.0


def rests(moving: float, kinetic: float, peak: float) -> bool:
    """Return whether a flow is at rest by both rules: little mass is fast, and the kinetic energy is low.

    Parameters
    ----------
    moving : float [1]
        Share of the mass that is faster than FLOWING_SPEED.
    kinetic, peak : float [J]
        Kinetic energy now, and the largest so far.
    """
    return moving < FLOWING_SHARE and kinetic <= REST_ENERGY * peak


def recorded_end(record: Mapping) -> FlowEnd | None:
    """Return the FlowEnd in the record of a run; None for a run that is not finished, or of another program.

    Parameters
    ----------
    record : Mapping
        Content of a `run.json`.
    """
    found = record.get("end")
    if record.get("state") != "finished" or not isinstance(found, Mapping):
        return None
    time, moving, at_rest = (found.get(name) for name in ("time", "moving", "came_to_rest"))
    if isinstance(time, int | float) and isinstance(moving, int | float) and isinstance(at_rest, bool):
        return FlowEnd(float(time), float(moving), at_rest)
    return None
