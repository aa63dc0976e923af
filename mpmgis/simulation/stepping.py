"""Interface of all solvers for the time integration and the stages of a run."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from ..frames.flow_end import FlowEnd, moving_share, rests

if TYPE_CHECKING:
    from ..frames.particle_store import Flow
    from ..frames.particles import Frame


class FlowSolver(Protocol):
    """A solver of columns, of points, or of points with columns around them.

    Attributes
    ----------
    RUNNING, REACHED_TIME, ALL_LEFT, TRIGGER_REACHED : int
        Reasons of `advance` to return that do not end a run; TRIGGER_REACHED is None where the solver has none.
    END_REASONS : Mapping of int to str
        Those that end it, in words.
    AT_REST : tuple of int
        Those of a flow at rest.
    effects, numerics, grid
        Those with which it was made.
    """

    RUNNING: int
    REACHED_TIME: int
    ALL_LEFT: int
    TRIGGER_REACHED: int | None
    END_REASONS: Mapping[int, str]
    AT_REST: tuple[int, ...]
    effects: Any
    numerics: Any
    grid: Any

    @property
    def time(self) -> float:
        """Simulated time [s]."""

    @property
    def step(self) -> int:
        """Number of steps taken."""

    @property
    def particles(self) -> int:
        """Number of particles on the terrain now."""

    @property
    def speed_max(self) -> float:
        """Largest speed now [m s-1]."""

    def advance(self, until: float, after: float, max_steps: int, may_stop: bool) -> int:
        """Advance to a time or by a number of steps; return the reason to stop.

        Parameters
        ----------
        until : float [s]
        after : float [s]
            Time that will be requested next.
        max_steps : int
        may_stop : bool
            The flow can come to rest: no inflow follows.
        """

    def wait(self, until: float) -> None:
        """Set the time on an empty terrain.

        Parameters
        ----------
        until : float [s]
        """

    def share_step(self, share: float) -> None:
        """Use shorter steps from now on.

        Parameters
        ----------
        share : float [1]
            Length of the steps over their normal length.
        """

    def at_frame(self, code: int) -> int:
        """Return the reason to stop at the time of a frame, where some solvers check for rest.

        Parameters
        ----------
        code : int
            Reason of `advance`.
        """

    def trouble(self, code: int) -> str:
        """Return a message with E and N about an error; '' for none.

        Parameters
        ----------
        code : int
            Reason of `advance`.
        """

    def energy_look(self) -> Any:
        """Return the present energies, for comparison with later ones."""

    def energy_trouble(self, last: Any) -> str:
        """Return a message with E and N about energy gained since `last`; '' for none.

        Parameters
        ----------
        last : EnergyLook, or one of each solver
            Earlier result of `energy_look`.
        """

    def flow(self) -> "Flow":
        """Return the present Flow."""

    def frame(self) -> "Frame":
        """Return the present Frame, with the state for a restart."""

    def parts(self) -> "tuple[Frame, Frame | None]":
        """Return the present frame of the stage's particles, and that of columns outside its window."""

    def maxima(self) -> dict:
        """Return the running peaks, as in a frame."""

    def balances(self) -> dict:
        """Return mass, energy and outflow so far as plain numbers."""

    def restore(self, frame: "Frame", known: bool = False) -> None:
        """Continue from a frame of this run with its state.

        Parameters
        ----------
        frame : Frame
        known : bool
            The state never left this process and is not checked.
        """

    def started(self) -> dict:
        """Return the numbers of the start that the solver counts from."""

    def start_from(self, started: dict) -> None:
        """Count from the start of another solver.

        Parameters
        ----------
        started : dict
            Result of its `started`.
        """


def end_of(solver: FlowSolver, code: int) -> FlowEnd:
    """Return the state of a flow at its end.

    A flow that reaches end_time has come to rest if it is at rest then. One that left the terrain has not.

    Parameters
    ----------
    solver : FlowSolver
    code : int
        Key of its END_REASONS.
    """
    flow = solver.flow()
    moving = moving_share(flow.mass, flow.speed)
    if code == solver.REACHED_TIME and solver.particles:
        found = solver.balances()
        at_rest = rests(moving, found["kinetic_energy"], found["kinetic_energy_peak"])
    else:
        at_rest = code in solver.AT_REST
    return FlowEnd(float(solver.time), moving, bool(at_rest))
