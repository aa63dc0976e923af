"""The last valid state of a time integration, from which it repeats steps that fail with shorter ones."""

from types import SimpleNamespace

from ..system.errors import UnphysicalError

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
