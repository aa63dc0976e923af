"""Keep the last valid state of a time integration, from which it repeats steps that fail with shorter ones.

The last valid state is that of the last frame, which contains the state for a restart: keeping it costs no time. After
a failure the run continues from it with smaller steps, and with full steps again from the next frame on. A run that is
resumed at any frame fails and continues in the same way, bitwise identical.
"""

from types import SimpleNamespace
from typing import TYPE_CHECKING

from ..system.errors import UnphysicalError

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from .release_events import Events
    from .stage_end import StageEnd
    from .stepping import FlowSolver

HALVINGS = 5  # of the time step, before a run is stopped


class Guard:
    """Keeps the last valid state of a time integration.

    Parameters
    ----------
    solver : FlowSolver
    events : Events
    stage_end : StageEnd

    Attributes
    ----------
    resolved : list of str
        Failures that were resolved with smaller steps, one line each.
    """

    def __init__(self, solver: "FlowSolver", events: "Events", stage_end: "StageEnd") -> None:
        self._solver, self._events, self._stage_end = solver, events, stage_end
        self._kept, self._calm_since, self._halvings, self._first = None, -1.0, 0, ""
        self._energies = None  # of the last valid state
        self.resolved = []

    def keep(self, frame: "Frame") -> None:
        """Keep a frame as the last valid state, and continue with full steps.

        Parameters
        ----------
        frame : Frame
            With the state of solver and events.
        """
        if self._halvings:
            self._solver.share_step(1.0)
            self.resolved.append(
                f"{self._first}: continued from t = {self._kept.time:.3f} s on with steps of 1/{2**self._halvings}"
            )
        ids = SimpleNamespace(id=frame.particles.id)
        self._kept = SimpleNamespace(time=frame.time, state=frame.state, particles=ids)
        self._energies = self._solver.energy_look()
        self._calm_since, self._halvings, self._first = self._stage_end.calm_since, 0, ""

    def trouble(self, code: int, at_frame: bool) -> str:
        """Return a message with E and N about a present error; '' for none.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        at_frame : bool
            It is the time of a frame: the energy is checked too.
        """
        trouble = self._solver.trouble(code)
        if trouble or not at_frame or self._energies is None or not self._solver.particles:
            return trouble
        return self._solver.energy_trouble(self._energies)

    def go_back(self, trouble: str) -> None:
        """Return to the last valid state, with half the step.

        Parameters
        ----------
        trouble : str
            Message about the error.

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
