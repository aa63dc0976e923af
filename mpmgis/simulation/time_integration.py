"""Time integration of a solver: frames at their times, progress, smaller steps after a failure, the reason for the end.

The last valid state is that of the last frame, which contains the state for a restart: keeping it costs no time. After
a failure the run continues from it with smaller steps, and with full steps again from the next frame on. A run that is
resumed at any frame fails and continues in the same way, bitwise identical.

End conditions of a stage: a time, a distance to a feature, or a calm flow.
"""

import math
import time as wall_clock
from dataclasses import replace

from .events import Events
from .stage_end import StageEnd
from .step_guard import Guard
from .stepping import end_reason, stepper_of

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

    def __init__(
        self,
        solver,
        end_time,
        frame_interval,
        observe=None,
        resumed=False,
        events=None,
        stage_end=None,
        tell_taken_in=None,
    ):
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
