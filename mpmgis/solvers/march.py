"""Marching a solver through time: frames at their times, progress between them, and why it ended."""

import time as wall_clock

from ..errors import UnphysicalError
from ..kernels import columns as kernel

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

    With `first` = k it goes on after frame k, which the solver was restored from. After the last frame `reason` says
    why it ended; a terrain that all mass has left gets no frame. `observe(solver)` is called a few times a second.

    Raises
    ------
    UnphysicalError
        A state that is not finite, or 5 % of the mass over twice the speed that energy allows; frames before are whole.
    """

    def __init__(self, solver, end_time, frame_interval, observe=None, first=None):
        self.solver, self.end_time, self.interval = solver, float(end_time), float(frame_interval)
        self.first = first
        self.observe = observe or (lambda solver: None)
        self.reason = ""

    def __iter__(self):
        solver = self.solver
        number = self.first or 0
        if self.first is None:
            yield solver.frame()
        while not self.reason:
            number += 1
            until = number * self.interval
            if until > self.end_time - 1e-9 * self.interval:  # the last frame is the end, not a hair before it
                until = self.end_time
            code = self._advance(until)
            if code != kernel.REACHED_TIME or until >= self.end_time:
                self.reason = END_REASONS[code]
            if code != kernel.ALL_LEFT:
                yield solver.frame()

    def _advance(self, until):
        """March to `until` in slices of a quarter second of wall time."""
        steps = 10
        while True:
            began = wall_clock.perf_counter()
            code = self.solver.advance(until, steps)
            spent = wall_clock.perf_counter() - began
            self.observe(self.solver)
            if code in (kernel.NOT_FINITE_STATE, kernel.TOO_FAST):
                raise self._unphysical(code)
            if code != kernel.RUNNING:
                return code
            steps = int(min(max(steps * min(SLICE_SECONDS / max(spent, 1e-4), 4.0), 1), 1e6))

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
