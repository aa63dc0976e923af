"""Time integration of a solver: frames at their times, progress, smaller steps after a failure, the reason for the end.

The last valid state is that of the last frame, which contains the state for a restart: keeping it costs no time. After
a failure the run continues from it with smaller steps, and with full steps again from the next frame on. A run that is
resumed at any frame fails and continues in the same way, bitwise identical.

End conditions of a stage: a time, a distance to a feature, or a calm flow.
"""

import math
import time as wall_clock
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..system.errors import UnphysicalError
from ..terrain.flow_reach import takes_off
from .events import Events
from .stepping import end_reason, stepper_of

if TYPE_CHECKING:
    import shapely

LOOK_SECONDS = 0.25  # simulated time between two checks of the flow, also after a restart
DEPTHS, SECONDS = 3.0, 2.0  # near: within 3 flow depths, or the distance of 2 s
MOST_LOOKED_AT = 2000  # columns or points whose path to a cliff is computed
FLYING_SHARE = 0.01  # share of the mass that takes off, at which the flow has reached a cliff
CALM_SHARE = 0.01  # share of the mass that can be near a feature or off the bed in a calm flow
CALM_NORMAL = 0.1  # largest speed across the slope in a calm flow, over the speed along it
_TIME = 1e-9  # [s], and in intervals of checks, rounding of a time


class Near(NamedTuple):
    """Feature that the flow is near to if it is within two seconds or three flow depths.

    `words` is its name, `shape` (shapely) is on the map; only flow deeper than `least` [m] counts.
    """

    words: str
    shape: "shapely.Geometry"
    least: float = 0.0

    def share(self, flow):
        """Share of the mass of a Flow that is near [1]."""
        import shapely  # only stages that end at a feature need it

        flow = flow.take(flow.depth > self.least)
        if not len(flow):
            return 0.0
        reach = np.maximum(DEPTHS * flow.depth, SECONDS * flow.speed)
        west, south, east, north = self.shape.bounds
        beside = np.maximum(west - flow.x, flow.x - east), np.maximum(south - flow.y, flow.y - north)
        maybe = np.flatnonzero(np.maximum(*beside) < reach)
        apart = shapely.distance(self.shape, shapely.points(flow.x[maybe], flow.y[maybe]))
        return float(flow.mass[maybe[apart < reach[maybe]]].sum() / flow.mass.sum())


class Cliff(NamedTuple):
    """Ground of `terrain` from which the flow takes off within two seconds (see `terrain.reach`)."""

    terrain: object
    words: str = "a cliff"

    def share(self, flow):
        """Share of the mass of a Flow that takes off [1], from a sample."""
        some = flow.take(slice(None, None, max(1, len(flow) // MOST_LOOKED_AT)))
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
        Time [s] since which the flow is calm; -1: it is not. Part of the state of a restart.
    """

    def __init__(self, time=None, reached=None, calm=None, disturbing=(), unsettled=None):
        self.time = math.inf if time is None else float(time)
        self.reached, self.calm, self.disturbing, self.unsettled = reached, calm, tuple(disturbing), unsettled
        self.calm_since = -1.0

    def next_time(self, time):
        """The next time [s] after `time` to check the flow; infinite without conditions."""
        due = [self.time] if self.time > time + _TIME else []
        if self.reached is not None or self.calm is not None:
            due.append((math.floor(time / LOOK_SECONDS + _TIME) + 1) * LOOK_SECONDS)
        return min(due, default=math.inf)

    def over(self, solver):
        """Why the stage is over now, in words; '' while it is not."""
        if solver.time >= self.time - _TIME:
            return f"t = {self.time:g} s"
        if not self._is_look(solver.time):
            return ""
        flow = solver.flow()
        if not len(flow):
            return ""
        if self.reached is not None and self.reached.share(flow) > _least_share(self.reached):
            return f"the flow is within reach of {self.reached.words}"
        return self._calm(solver, flow) if self.calm is not None else ""

    def _is_look(self, time):
        looks = self.reached is not None or self.calm is not None
        return looks and abs(time / LOOK_SECONDS - round(time / LOOK_SECONDS)) < _TIME

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


HALVINGS = 5  # of the time step, before a run is stopped


class Guard:
    """Keeps the last valid state of a time integration.

    Attributes
    ----------
    resolved : list of str
        Failures that were resolved with smaller steps, one line each.
    """

    def __init__(self, solver, side, events, stage_end):
        self._solver, self._side, self._events, self._stage_end = solver, side, events, stage_end
        self._kept, self._calm_since, self._halvings, self._first = None, -1.0, 0, ""
        self._look = None  # energies of the last valid state
        self.resolved = []

    def keep(self, frame):
        """Keep `frame`, with the state of solver and events, as the last valid one; continue with full steps."""
        if self._halvings:
            self._solver.share_step(1.0)
            self.resolved.append(
                f"{self._first}: continued from t = {self._kept.time:.3f} s on with steps of 1/{2**self._halvings}"
            )
        ids = SimpleNamespace(id=frame.particles.id)
        self._kept = SimpleNamespace(time=frame.time, state=frame.state, particles=ids)
        self._look = self._side.look()
        self._calm_since, self._halvings, self._first = self._stage_end.calm_since, 0, ""

    def trouble(self, code, at_frame):
        """Message with E and N for a present error; '' for none. Energy is checked at the times of frames."""
        trouble = self._side.trouble(code)
        if trouble or not at_frame or self._look is None or not self._side.particles:
            return trouble
        return self._side.energy_trouble(self._look)

    def go_back(self, trouble):
        """Return to the last valid state, with half the step.

        Raises
        ------
        UnphysicalError
            Steps of 1/32 failed too, or there is no valid state.
        """
        solver = self._solver
        self._first = self._first or f"step {solver.step}, t = {solver.time:.3f} s, {trouble}"
        if self._kept is None:
            raise UnphysicalError(
                f"the run became unphysical at {self._first}, before the first frame that it could restart from"
            )
        if self._halvings == HALVINGS:
            raise UnphysicalError(
                f"the run became unphysical at {self._first}; steps of down to 1/{2**HALVINGS} from "
                f"t = {self._kept.time:.3f} s on did not help"
            )
        self._halvings += 1
        solver.restore(self._kept, known=True)
        self._events.restore(self._kept)
        self._events.arm(solver)
        self._stage_end.calm_since = self._calm_since
        solver.share_step(0.5**self._halvings)


SLICE_SECONDS = 0.25  # wall time between two checks of progress and Ctrl+C


class TimeIntegration:
    """Iterator of frames at 0, interval, 2 interval, ... end, and at the end itself if the flow stops before.

    `solver` is a ColumnSolver or a PointSolver.

    Steps end exactly at the times of `events`, which act between steps; a frame of the same time includes the inflow.
    There are no frames while the terrain is empty. A run that is `resumed` continues after the frame that solver and
    events were restored from. After the last frame `reason` is the reason for the end.
    `observe(solver)` is called a few times a second. With `stage_end`, a StageEnd, it can end earlier: then `switch`
    is the reason, there is no frame of that time, and the next stage of the run continues. If the flow reaches a
    feature that the solver watches (`watched_features`), its effect is switched on and `tell_taken_in(TakenIn)` called.

    Attributes
    ----------
    reason, switch : str
    steps : int
    particle_steps : int
        Number of particles, summed over the steps.
    step_seconds : float [s]
        Wall time of the steps.
    troubles : list of str
        Failures that were resolved with shorter steps.

    Raises
    ------
    UnphysicalError
        A state that is not finite; columns with 5 % of the mass over twice the speed that energy allows; points that
        leak through the ground or gain energy; if shorter steps from the last frame fail too
        (`time_integration`). Earlier frames are complete.
    """

    def __init__(self, solver, end_time, frame_interval, observe=None, resumed=False, events=None, stage_end=None,
                 tell_taken_in=None):  # fmt: skip
        self.solver, self.end_time, self.interval = solver, float(end_time), float(frame_interval)
        self.observe = observe or (lambda solver: None)
        self.resumed, self.events = resumed, events or Events()
        self.stage_end = stage_end or StageEnd()
        self.reason, self.switch, self.steps, self.particle_steps, self.step_seconds = "", "", 0, 0, 0.0
        self.tell_taken_in = tell_taken_in or (lambda taken: None)
        self._side, self._observed = stepper_of(solver), 0.0
        self._guard = Guard(solver, self._side, self.events, self.stage_end)

    @property
    def troubles(self):
        return self._guard.resolved

    def __iter__(self):
        solver, events, side = self.solver, self.events, self._side
        events.arm(solver)
        if self.resumed:
            if events.ended == side.REACHED_TIME and solver.time < self.end_time:
                events.ended = 0  # the run ended at an earlier end_time and is now continued
            self.reason = end_reason(side, events.ended) if events.ended in side.END_REASONS else ""
            self._guard.keep(self._frame())
        else:
            events.let_in(solver)
            yield from self._frames()
        number = math.floor(solver.time / self.interval + 1e-9)
        while not self.reason:
            number += 1
            until = self._frame_time(number)
            code = self._advance(until, self._time_after(number))
            if self.switch:
                return
            if code == side.REACHED_TIME:
                code = side.at_frame(code)
            if code != side.REACHED_TIME or until >= self.end_time:
                self.reason, events.ended = end_reason(side, code), code
            yield from self._frames()

    def _frame_time(self, number):
        """Time [s] of a frame; the last frame is the end, not a hair before it."""
        time = number * self.interval
        return self.end_time if time > self.end_time - 1e-9 * self.interval else time

    def _time_after(self, number):
        """Time [s] of the frame after `number`. After the last frame it is that of a run with a later end, so that
        the state at the end is the same in both.
        """
        last = self._frame_time(number) >= self.end_time
        return (number + 1) * self.interval if last else self._frame_time(number + 1)

    def _frames(self):
        """The frame now, with the state of the events; none if there is no particle."""
        if self._side.particles:
            frame = self._frame()
            self._guard.keep(frame)
            yield frame

    def _frame(self):
        frame = self.solver.frame()
        return replace(frame, state=frame.state | self.events.state())

    def _advance(self, until, after):
        """Advance to `until`, from event to event, in slices of a quarter second of wall time.

        `after` is the time of the next frame.
        """
        solver, events, side, steps = self.solver, self.events, self._side, 10
        after = after if after > until else math.inf
        while True:
            over = events.over(solver.time)
            target = self._target(until, solver.time)
            then = self._target(after if target == until else until, target)
            began, step, particles = wall_clock.perf_counter(), solver.step, side.particles
            code = side.advance(target, then, steps, over)
            spent, taken = wall_clock.perf_counter() - began, solver.step - step
            self.steps += taken
            self.particle_steps += taken * particles
            self.step_seconds += spent
            if code == side.RUNNING:
                steps = int(min(max(taken * min(SLICE_SECONDS / max(spent, 1e-4), 4.0), 1), 1e6))
            taken_in = side.take_in(code)
            if taken_in:
                for taken in taken_in:
                    self.tell_taken_in(taken)
                continue
            trouble = self._guard.trouble(code, code == side.REACHED_TIME and target == until)
            if trouble:
                self._guard.go_back(trouble)
                continue
            if code == side.ALL_LEFT and not over:
                solver.wait(target)
                code = side.REACHED_TIME
            if code == side.TRIGGER_REACHED:
                events.release(solver)
            if code == side.REACHED_TIME:
                events.let_in(solver)
                if solver.time < self.end_time and side.particles:
                    self.switch = self.stage_end.over(solver)
            done = bool(self.switch) or (code == side.REACHED_TIME and target == until)
            self._look(done)
            if done or code not in (side.RUNNING, side.TRIGGER_REACHED, side.REACHED_TIME):
                return code

    def _target(self, until, time):
        """The next time [s] after `time`: an event, a check of the end of the stage, or `until`."""
        due = min(self.events.next_time(time), self.stage_end.next_time(time))
        return due if due < until - 1e-9 * self.interval else until

    def _look(self, always):
        """Call `observe`, a few times a second at most unless `always`."""
        now = wall_clock.perf_counter()
        if always or now - self._observed > 0.2 * SLICE_SECONDS:
            self._observed = now
            self.observe(self.solver)
