"""What a march does when its state breaks: back to the last frame, with half the time step, before it gives up.

The last good state is that of the last frame, which holds all that a restart needs: keeping it costs no time. Going
back is what a restart does, and the step is whole again from the next frame on. So a run that is resumed at any frame
meets the same trouble, and gets over it in the same way to the same bits, with nothing of this in its frames.
"""

from types import SimpleNamespace

from ..errors import UnphysicalError

HALVINGS = 5  # of the time step, before a run gives up (design notes H32)


class Guard:
    """Keeps the last good state of a march.

    Attributes
    ----------
    told : list of str
        What went wrong and was got over, one line each time.
    """

    def __init__(self, solver, side, events, stage_end):
        self._solver, self._side, self._events, self._stage_end = solver, side, events, stage_end
        self._kept, self._calm_since, self._halvings, self._first = None, -1.0, 0, ""
        self._look = None  # energies at the last good state
        self.told = []

    def keep(self, frame):
        """`frame`, with the state of solver and events, is good: from here on steps are whole again."""
        if self._halvings:
            self._solver.share_step(1.0)
            self.told.append(
                f"{self._first}: got over from t = {self._kept.time:.3f} s on with steps of 1/{2**self._halvings}"
            )
        ids = SimpleNamespace(id=frame.particles.id)
        self._kept = SimpleNamespace(time=frame.time, state=frame.state, particles=ids)
        self._look = self._side.look()
        self._calm_since, self._halvings, self._first = self._stage_end.calm_since, 0, ""

    def trouble(self, code, at_frame):
        """What is wrong now, in words with E and N; '' where nothing. Energy is looked at where frames are."""
        trouble = self._side.trouble(code)
        if trouble or not at_frame or self._look is None or not self._side.particles:
            return trouble
        return self._side.energy_trouble(self._look)

    def go_back(self, trouble):
        """Back to the last good state, with half the step.

        Raises
        ------
        UnphysicalError
            Steps of 1/32 have not helped, or there is no good state.
        """
        solver = self._solver
        self._first = self._first or f"step {solver.step}, t = {solver.time:.3f} s, {trouble}"
        if self._kept is None:
            raise UnphysicalError(f"the run became unphysical at {self._first}, before there was a frame to go back to")
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
