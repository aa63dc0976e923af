"""Marching a solver through time: frames at their times, progress between them, and why it ended."""

import time as wall_clock
from dataclasses import replace

from ..errors import UnphysicalError
from ..kernels import columns as kernel
from .events import Events

SLICE_SECONDS = 0.25  # wall time between two looks at progress and Ctrl+C

END_REASONS = {
    kernel.REACHED_TIME: "end_time reached",
    kernel.STOPPED_MOVING: "at rest: less than 1 % of the peak moving mass is faster than 0.05 m/s",
    kernel.STOPPED_ENERGY: "nearly at rest: kinetic energy below 1 % of its peak for 2 s",
    kernel.STOPPED_FOOTPRINT: (
        "nearly at rest: the footprint grew by less than 0.1 % in 10 s, and under 5 % of the mass is faster than 1 m/s"
    ),
    kernel.ALL_LEFT: "all mass has left the terrain",
}


class March:
    """An iterator of frames at 0, interval, 2 interval, ... end, and at the end itself if the flow stops before.

    Steps end exactly at the times of `events`, which happen between them; a frame of the same time shows what has come
    in. While nothing is on the terrain there is no frame. A run that is `resumed` goes on after the frame that solver
    and events were restored from. After the last frame `reason` says why it ended. `observe(solver)` is called a few
    times a second.

    Attributes
    ----------
    reason : str
    column_steps : int
        Sum over the steps of the columns there were.

    Raises
    ------
    UnphysicalError
        A state that is not finite, or 5 % of the mass over twice the speed that energy allows; frames before are whole.
    """

    def __init__(self, solver, end_time, frame_interval, observe=None, resumed=False, events=None):
        self.solver, self.end_time, self.interval = solver, float(end_time), float(frame_interval)
        self.observe = observe or (lambda solver: None)
        self.resumed, self.events = resumed, events or Events()
        self.reason, self.column_steps = "", 0
        self._observed = 0.0

    def __iter__(self):
        solver, events = self.solver, self.events
        events.arm(solver)
        if self.resumed:
            self.reason = END_REASONS.get(events.ended, "")
        else:
            events.let_in(solver)
            yield from self._frames()
        number = round(solver.time / self.interval)
        while not self.reason:
            number += 1
            until = number * self.interval
            if until > self.end_time - 1e-9 * self.interval:  # the last frame is the end, not a hair before it
                until = self.end_time
            code = self._advance(until)
            if code != kernel.REACHED_TIME or until >= self.end_time:
                self.reason, events.ended = END_REASONS[code], code
            yield from self._frames()

    def _frames(self):
        """The frame now, with the state of the events; none if there is no column."""
        if self.solver.columns:
            frame = self.solver.frame()
            yield replace(frame, state=frame.state | self.events.state())

    def _advance(self, until):
        """March to `until`, from event to event, in slices of a quarter second of wall time."""
        solver, events, steps = self.solver, self.events, 10
        while True:
            over = events.over(solver.time)
            target = min(until, events.next_time(solver.time))
            began, step, columns = wall_clock.perf_counter(), solver.step, solver.columns
            code = solver.advance(target, steps, may_stop=over)
            spent, taken = wall_clock.perf_counter() - began, solver.step - step
            self.column_steps += taken * columns
            if code == kernel.RUNNING:
                steps = int(min(max(taken * min(SLICE_SECONDS / max(spent, 1e-4), 4.0), 1), 1e6))
            if code in (kernel.NOT_FINITE_STATE, kernel.TOO_FAST):
                raise self._unphysical(code)
            if code == kernel.ALL_LEFT and not over:
                solver.wait(target)
                code = kernel.REACHED_TIME
            if code == kernel.TRIGGER_REACHED:
                events.release(solver)
            if code == kernel.REACHED_TIME:
                events.let_in(solver)
            done = code == kernel.REACHED_TIME and target == until
            self._look(done)
            if done or code not in (kernel.RUNNING, kernel.TRIGGER_REACHED, kernel.REACHED_TIME):
                return code

    def _look(self, always):
        """Call `observe`, not more often than anybody can look unless `always`."""
        now = wall_clock.perf_counter()
        if always or now - self._observed > 0.2 * SLICE_SECONDS:
            self._observed = now
            self.observe(self.solver)

    def _unphysical(self, code):
        solver = self.solver
        east, north, bad, ratio, share = solver.trouble()
        place = f"step {solver.step}, t = {solver.time:.3f} s, E {east:.1f} N {north:.1f}"
        if code == kernel.NOT_FINITE_STATE:
            what = f"{bad} columns have a position or area that is not finite; take a smaller cfl or larger cells"
        else:
            what = (
                f"{100 * share:.0f} % of the mass is over twice, at worst {ratio:.1f} times, as fast as its drop in "
                "height allows; a cliff there is beyond a depth-averaged model, elsewhere take a smaller cfl"
            )
        return UnphysicalError(f"the run became unphysical at {place}: {what}")
