"""Plan of an export: its frames, steps and bands, and how they are averaged."""

from dataclasses import dataclass, field

from ...terrain.elevation import Terrain
from ..averaging.frame_values import Averaging
from ..averaging.maxima import SolverPeaks


@dataclass(frozen=True)
class ExportPlan:
    """The plan of an export.

    Parameters
    ----------
    name : str
        Of the run; prefix of its files.
    entries : tuple of FrameEntry
    steps : tuple of int
        Numbers of the frames that are exported as steps.
    averaging : Averaging
    bands : tuple of str
        Of the raster of a step.
    terrain : Terrain
    time_step : float or None [s]
        None: every frame is a step.
    peaks : SolverPeaks or None
        The solver's maxima of all steps up to the last frame; None if it stored none.
    bed_change : dict
        Of the last frame.
    errors : str
        Numerical errors of the headline numbers of the run; "" where they are unknown.
    dem : str
        Name of the DTM of the user.
    """

    name: str
    entries: tuple
    steps: tuple
    averaging: Averaging
    bands: tuple
    terrain: Terrain
    time_step: float | None
    peaks: SolverPeaks | None = None
    bed_change: dict = field(default_factory=dict)  # of the last frame
    errors: str = ""
    dem: str = ""

    @property
    def frames_text(self) -> str:
        """Number and names of the frames."""
        return f"{len(self.entries)}, {self.entries[0].path.name} to {self.entries[-1].path.name}"
