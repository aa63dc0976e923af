"""Conditions that end a stage: flow near a feature, free flight, calm flow, a time."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..terrain.flow_reach import takes_off

if TYPE_CHECKING:
    import shapely

    from ..frames.particle_store import Flow
    from ..terrain.elevation import Terrain
    from .stepping import FlowSolver

CHECK_SECONDS = 0.25  # [s] simulated time between two checks of the flow, also after a restart
NEAR_DEPTHS = 3.0  # [flow depths] distance within which the flow is near a feature
NEAR_SECONDS = 2.0  # [s] or the distance that it moves in this time
MOST_CHECKED = 2000  # columns or points whose path to a cliff is computed
FLYING_SHARE = 0.01  # share of the mass that takes off, at which the flow has reached a cliff
CALM_SHARE = 0.01  # share of the mass that can be near a feature or off the bed in a calm flow
CALM_NORMAL = 0.1  # largest speed across the slope in a calm flow, over the speed along it
_TIME = 1e-9  # [s] and [intervals of checks] rounding error of a time


class Near(NamedTuple):
    """Feature that the flow is near to if it is within two seconds or three flow depths.

    Parameters
    ----------
    words : str
        Name of the feature.
    shape : shapely.Geometry
        On the map.
    least : float [m]
        Only deeper flow counts.
    """

    words: str
    shape: "shapely.Geometry"
    least: float = 0.0

    def share(self, flow: "Flow") -> float:
        """Return the share of the mass that is near [1].

        Parameters
        ----------
        flow : Flow
        """
        import shapely  # only stages that end at a feature need it

        flow = flow.take(flow.depth > self.least)
        if not len(flow):
            return 0.0
        reach = np.maximum(NEAR_DEPTHS * flow.depth, NEAR_SECONDS * flow.speed)
        west, south, east, north = self.shape.bounds
        beside = np.maximum(west - flow.x, flow.x - east), np.maximum(south - flow.y, flow.y - north)
        maybe = np.flatnonzero(np.maximum(*beside) < reach)
        apart = shapely.distance(self.shape, shapely.points(flow.x[maybe], flow.y[maybe]))
        return float(flow.mass[maybe[apart < reach[maybe]]].sum() / flow.mass.sum())


class Cliff(NamedTuple):
    """Ground from which the flow takes off within two seconds (see `terrain.flow_reach.takes_off`).

    Parameters
    ----------
    terrain : Terrain
    words : str
        Name of the feature.
    """

    terrain: "Terrain"
    words: str = "a cliff"

    def share(self, flow: "Flow") -> float:
        """Return the share of the mass that takes off [1], from a sample.

        Parameters
        ----------
        flow : Flow
        """
        some = flow.take(slice(None, None, max(1, len(flow) // MOST_CHECKED)))
        flying = takes_off(self.terrain, some.x, some.y, some.u, some.v, some.depth)
        return float(some.mass[flying].sum() / some.mass.sum())


class StageEnd:
    """The checks that decide whether a stage is over.

    Parameters
    ----------
    time : float, optional [s]
        At which it is over.
    reached : Near or Cliff, optional
        Features that the flow has to reach.
    calm : float, optional [s]
        For how long the flow has to be calm: none of it near to anything of `disturbing`, and all on the bed.
    disturbing : sequence of Near and Cliff
    unsettled : callable, optional
        frame -> share of the mass that is off the bed, or moves across it by more than CALM_NORMAL.

    Attributes
    ----------
    calm_since : float [s]
        Time since which the flow is calm; -1: it is not. Part of the state of a restart.
    """

    def __init__(
        self,
        time: float | None = None,
        reached: Near | Cliff | None = None,
        calm: float | None = None,
        disturbing: Sequence = (),
        unsettled: Callable | None = None,
    ) -> None:
        self.time = math.inf if time is None else float(time)
        self.reached, self.calm, self.disturbing, self.unsettled = reached, calm, tuple(disturbing), unsettled
        self.calm_since = -1.0

    def next_time(self, time: float) -> float:
        """Return the next time to check the flow; infinity without conditions.

        Parameters
        ----------
        time : float [s]
            Present time.

        Returns
        -------
        float [s]
        """
        due = [self.time] if self.time > time + _TIME else []
        if self.reached is not None or self.calm is not None:
            due.append((math.floor(time / CHECK_SECONDS + _TIME) + 1) * CHECK_SECONDS)
        return min(due, default=math.inf)

    def over(self, solver: "FlowSolver") -> str:
        """Return the reason why the stage is over now, in words; '' while it is not.

        Parameters
        ----------
        solver : FlowSolver
        """
        if solver.time >= self.time - _TIME:
            return f"t = {self.time:g} s"
        if not self._is_check(solver.time):
            return ""
        flow = solver.flow()
        if not len(flow):
            return ""
        if self.reached is not None and self.reached.share(flow) > _least_share(self.reached):
            return f"the flow is within reach of {self.reached.words}"
        return self._calm(solver, flow) if self.calm is not None else ""

    def _is_check(self, time):
        checks = self.reached is not None or self.calm is not None
        return checks and abs(time / CHECK_SECONDS - round(time / CHECK_SECONDS)) < _TIME

    def _calm(self, solver, flow):
        stirred = any(thing.share(flow) > CALM_SHARE for thing in self.disturbing)
        if stirred or self.unsettled(solver.frame()) > CALM_SHARE:
            self.calm_since = -1.0
            return ""
        if self.calm_since < 0.0:
            self.calm_since = solver.time
        return f"the flow was calm for {self.calm:g} s" if solver.time - self.calm_since >= self.calm else ""


def _least_share(thing):
    return FLYING_SHARE if isinstance(thing, Cliff) else 0.0
