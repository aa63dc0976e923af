"""Integrate a solver in time: frames at their times, progress, smaller steps after a failure, reason for the end."""

import math
import time as wall_clock
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from .release_events import Events
from .stage_end import StageEnd
from .step_retry import Guard
from .stepping import end_of

if TYPE_CHECKING:
    from ..frames.flow_end import FlowEnd
    from ..frames.particles import Frame
    from .stepping import FlowSolver

SLICE_SECONDS = 0.25  # [s] wall time between two checks of progress and Ctrl+C


class TimeIntegration:
    """Iterator of frames at 0, interval, 2 interval, ... end, and at the end itself if the flow stops before.

    Steps end exactly at the times of `events`, which act between steps; a frame of the same time includes the inflow.
    There are no frames while the terrain is empty.

    Parameters
    ----------
    solver : FlowSolver
    end_time : float [s]
    frame_interval : float [s]
    observe : callable, optional
        Called with the solver a few times a second.
    resumed : bool
        Continue after the frame from which solver and events were restored.
    events : Events, optional
    stage_end : StageEnd, optional
        With it the integration can end earlier: then `switch` is the reason, there is no frame of that time, and the
        next stage of the run continues.

    Attributes
    ----------
    reason : str
        For the end, after the last frame.
    end : FlowEnd or None
        State at the end; None before it.
    switch : str
        Reason for the end of the stage; '' without `stage_end`.
    steps : int
    particle_steps : int
        Number of particles, summed over the steps.
    step_seconds : float [s]
        Wall time of the steps.

    Raises
    ------
    UnphysicalError
        A state that is not finite; columns with 5 % of the mass over twice the speed that energy allows; points that
        leak through the ground or gain energy; if shorter steps from the last frame fail too (`step_retry`). Earlier
        frames are complete.
    """

    def __init__(
        self,
        solver: "FlowSolver",
        end_time: float,
        frame_interval: float,
        observe: Callable | None = None,
        resumed: bool = False,
        events: Events | None = None,
        stage_end: StageEnd | None = None,
    ) -> None:
        self.solver, self.end_time, self.interval = solver, float(end_time), float(frame_interval)
        self.observe = observe or (lambda solver: None)
        self.resumed, self.events = resumed, events or Events()
        self.stage_end = stage_end or StageEnd()
        self.reason, self.switch, self.steps, self.particle_steps, self.step_seconds = "", "", 0, 0, 0.0
        self.end: FlowEnd | None = None
        self._observed = 0.0
        self._guard = Guard(solver, self.events, self.stage_end)

    @property
    def troubles(self) -> list[str]:
        """Failures that were resolved with shorter steps."""
        return self._guard.resolved

    def __iter__(self) -> "Iterator[Frame]":
        solver, events = self.solver, self.events
        events.arm(solver)
        if self.resumed:
            if events.ended == solver.REACHED_TIME and solver.time < self.end_time:
                events.ended = 0  # the run ended at an earlier end_time and is now continued
            if events.ended in solver.END_REASONS:
                self._finish(events.ended)
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
            if code == solver.REACHED_TIME:
                code = solver.at_frame(code)
            if code != solver.REACHED_TIME or until >= self.end_time:
                self._finish(code)
            yield from self._frames()

    def _finish(self, code):
        """Set reason and state of the end; `code` is the reason of the solver."""
        self.events.ended, self.reason = code, self.solver.END_REASONS[code]
        self.end = end_of(self.solver, code)

    def _frame_time(self, number):
        """Return the time [s] of a frame; the last frame is exactly at the end, in spite of rounding."""
        time = number * self.interval
        return self.end_time if time > self.end_time - 1e-9 * self.interval else time

    def _time_after(self, number):
        """Return the time [s] of the frame after `number`.

        After the last frame it is that of a run with a later end, so that the state at the end is the same in both.
        """
        last = self._frame_time(number) >= self.end_time
        return (number + 1) * self.interval if last else self._frame_time(number + 1)

    def _frames(self):
        """Yield the present frame, with the state of the events; none if there is no particle."""
        if self.solver.particles:
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
        solver, events, steps = self.solver, self.events, 10
        after = after if after > until else math.inf
        while True:
            over = events.over(solver.time)
            target = self._target(until, solver.time)
            then = self._target(after if target == until else until, target)
            began, step, particles = wall_clock.perf_counter(), solver.step, solver.particles
            code = solver.advance(target, then, steps, over)
            spent, taken = wall_clock.perf_counter() - began, solver.step - step
            self.steps += taken
            self.particle_steps += taken * particles
            self.step_seconds += spent
            if code == solver.RUNNING:
                steps = int(min(max(taken * min(SLICE_SECONDS / max(spent, 1e-4), 4.0), 1), 1e6))
            trouble = self._guard.trouble(code, code == solver.REACHED_TIME and target == until)
            if trouble:
                self._guard.go_back(trouble)
                continue
            if code == solver.ALL_LEFT and not over:
                solver.wait(target)
                code = solver.REACHED_TIME
            if code == solver.TRIGGER_REACHED:
                events.release(solver)
            if code == solver.REACHED_TIME:
                events.let_in(solver)
                if solver.time < self.end_time and solver.particles:
                    self.switch = self.stage_end.over(solver)
            done = bool(self.switch) or (code == solver.REACHED_TIME and target == until)
            self._look(done)
            if done or code not in (solver.RUNNING, solver.TRIGGER_REACHED, solver.REACHED_TIME):
                return code

    def _target(self, until, time):
        """Return the next time [s] after `time`: an event, a check of the end of the stage, or `until`."""
        due = min(self.events.next_time(time), self.stage_end.next_time(time))
        return due if due < until - 1e-9 * self.interval else until

    def _look(self, always):
        """Call `observe`, a few times a second at most unless `always`."""
        now = wall_clock.perf_counter()
        if always or now - self._observed > 0.2 * SLICE_SECONDS:
            self._observed = now
            self.observe(self.solver)
