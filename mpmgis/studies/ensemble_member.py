"""Run one member of an ensemble; write its maxima as a raster and its figures as a record."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import __version__
from ..compiled.law_functions import use_own_laws
from ..frames.many_runs_folder import RunFiles
from ..frames.run_folder import RunFolder
from ..laws.own_law import NO_OWN_LAWS, load_laws
from ..laws.quantities import BAND, MEMBER_BANDS, VOLUME, Quantity
from ..maps.averaging.export_resolution import export_grid
from ..maps.averaging.frame_values import Averaging, average_frame
from ..maps.averaging.maxima import PRODUCTS_NEEDED, RunningMaxima, SolverPeaks
from ..maps.averaging.placement import Bed
from ..scene import scene_from_tables
from ..simulation.companion_run import centre_of, companion_run, farthest, has_companion, headline_numbers
from ..simulation.preparation import prepare_scene
from ..simulation.scene_run import integrate_into, use_threads
from ..simulation.stage_sequence import StageSequence
from ..simulation.warmup import warm_up
from ..system.messages import muted
from ..system.whole_files import whole_file
from ..terrain.raster_output import write_rows

if TYPE_CHECKING:
    from ..simulation.preparation import Prepared

FIGURES = {  # of a member: column of the table -> description
    "end_time_s": "simulated time at the end",
    "steps": "steps of the solver",
    "runout_m": "distance on the map from the release's centre of mass to the farthest cell that was reached",
    "travel_angle_degrees": "of the line from the release's centre of mass to that cell",
    "area_m2": "plan area that was reached",
    "h_max_m": "largest flow depth, normal to the slope",
    "Ut_max_m_s": "largest speed along the slope",
    "p_max_Pa": "largest impact pressure",
    "mass_out_share": "share of the mass that left the terrain",
    "came_to_rest": "1 if the flow came to rest, else 0: then its last step is no deposit",
}


DEPOSITED = Quantity(
    "t_deposit", "m", "vertical thickness at the end, mass over the density of the release", "float32", VOLUME
)


@dataclass(frozen=True)
class MemberTask:
    """All data that a worker needs to run a member; it is pickled.

    Parameters
    ----------
    number : int
    digest : str
        Of all inputs of its result.
    tables : dict
        The scene.
    scene_folder, name : str
        Folder to which its paths are relative, and its name in messages.
    law : str or None
        File with the user's own friction laws.
    output : str
        Folder for results of members.
    cell_size : float or None [m]
        Of its raster; None: the DTM's cells.
    min_depth : float [m]
    keep : {"maxima", "deposit", "frames"}
        Results that are kept: the maxima, with the vertical thickness at the end, or with all frames.
    companion : bool
        State the numerical error, from a companion run.
    """

    number: int
    digest: str
    tables: dict
    scene_folder: str
    name: str
    law: str | None
    output: str
    cell_size: float | None
    min_depth: float
    keep: str = "maxima"
    companion: bool = False

    @property
    def files(self) -> RunFiles:
        """Paths of its files."""
        return RunFiles(Path(self.output), self.digest)

    @property
    def needed(self) -> tuple[Path, ...]:
        """Results without which it is not finished."""
        return self.files.maxima, *([] if self.keep == "maxima" else [getattr(self.files, self.keep)])

    def prepared(self) -> "Prepared":
        """Return the prepared run."""
        own = NO_OWN_LAWS if self.law is None else load_laws(self.law)
        use_own_laws(own)
        return prepare_scene(scene_from_tables(self.tables, self.scene_folder, self.name, own))

    def averaging(self, prepared: "Prepared") -> Averaging:
        """Return the averaging of its frames, as in an export.

        Parameters
        ----------
        prepared : Prepared
        """
        return Averaging(
            bed=Bed.of(prepared.terrain),
            grid=export_grid(prepared.terrain.grid, self.cell_size),
            density=prepared.frame.header["density"],
            names=(*PRODUCTS_NEEDED, "mass") if self.keep == "deposit" else PRODUCTS_NEEDED,
            min_depth=self.min_depth,
        )

    def result(self, look: Callable) -> dict:
        """Run, write the results and return their record, see `run_task`.

        Parameters
        ----------
        look : callable
            Called with (solver, end time [s]) a few times a second.

        Returns
        -------
        dict
        """
        return run_task(self, look)


@muted()
def run_task(task: MemberTask, look: Callable) -> dict:
    """Run a member and write its raster; return its record without digest and time.

    Parameters
    ----------
    task : MemberTask
    look : callable
        Called with (solver, end time [s]) a few times a second.

    Raises
    ------
    UnphysicalError, InputError
    """
    began = time.perf_counter()
    prepared = task.prepared()
    preparing = time.perf_counter() - began
    use_threads(prepared.particles, 1)
    averaging = task.averaging(prepared)
    sequence = _Peaks(prepared, averaging, look)
    if task.keep == "frames":
        folder = RunFolder(task.files.frames, overwrite=True)
        with folder.held():
            folder.open()
            integrate_into(folder, sequence, False)
    else:
        for _ in sequence:
            pass
    maxima, grid = sequence.on_cells, averaging.grid
    tags = {"version": __version__, "digest": task.digest, "scene": prepared.digest, "min_depth": task.min_depth}
    with whole_file(task.files.maxima) as part:
        write_rows(
            part,
            grid,
            [BAND[name] for name in MEMBER_BANDS],
            tags,
            lambda band, first, last: maxima.rows(MEMBER_BANDS[band], first, last, grid.shape[1]),
        )
    if task.keep == "deposit":
        _write_deposit(task, sequence, averaging, tags)
    figures = _figures(prepared, sequence, averaging)
    if task.companion and has_companion(prepared.scene):
        figures["companion"] = companion_run(sequence, headline_numbers(sequence), look)
    return {"status": "finished", "reason": sequence.reason, "prepare_seconds": preparing, **figures}


def _write_deposit(task: MemberTask, sequence: "_Peaks", averaging: Averaging, tags: dict) -> None:
    """Write the vertical thickness of the last frame as a raster."""
    index, thickness = sequence.at_end
    values = np.full(averaging.grid.shape, np.nan)
    values.flat[index] = thickness
    with whole_file(task.files.deposit) as part:
        write_rows(part, averaging.grid, [DEPOSITED], tags, lambda band, first, last: values[first:last])


class _Peaks(StageSequence):
    """A run that collects the maxima of its frames, and at the end those of the solver, on the cells of a raster."""

    def __init__(self, prepared, averaging, look):
        super().__init__(prepared, look)
        rows, columns = averaging.grid.shape
        self.averaging, self.on_cells = averaging, RunningMaxima(rows * columns, averaging.min_depth)
        self.at_end = np.empty(0, int), np.empty(0)

    def __iter__(self):
        last = None
        for frame in super().__iter__():
            values = average_frame(frame, self.averaging)
            self.on_cells.absorb(values.index, values.values, values.time, values.least)
            if "mass" in values.values:
                self.at_end = values.index, values.values["mass"] / self.averaging.density
            last = frame if frame.maxima else last
            yield frame
        peaks = None if last is None else SolverPeaks.of(last.maxima, last.time)
        if peaks is not None:
            for index, values in peaks.on(self.averaging.grid, self.averaging.bed, self.averaging.min_depth):
                self.on_cells.absorb_peaks(index, values)


def _figures(prepared, sequence, averaging):
    """Return the figures of a finished member; `extent` are the rows and columns with maxima, None without."""
    maxima, grid = sequence.on_cells, averaging.grid
    depth, balances = maxima.values["h_max"], sequence.solver.balances()
    any_flow = np.flatnonzero(maxima.seen["h_max"])
    row, column = np.divmod(any_flow, grid.shape[1])
    extent = [int(v) for v in (row.min(), row.max() + 1, column.min(), column.max() + 1)] if len(row) else None
    reached = depth[any_flow] >= averaging.min_depth
    runout, angle = _runout(prepared, grid, row[reached], column[reached])
    height, width = abs(grid.transform.e), abs(grid.transform.a)
    out, come = balances["mass_out"], balances.get("mass_released", balances["mass_start"])
    come += balances.get("mass_entrained", 0.0)
    if prepared.scene.stage:
        mass = sequence.mass_account()
        out, come = mass["left_terrain"], mass["released"] + mass["entrained"]
    return {
        "end_time_s": sequence.solver.time,
        "steps": sequence.steps,
        "runout_m": runout,
        "travel_angle_degrees": angle,
        "area_m2": float(np.count_nonzero(reached) * height * width),
        "h_max_m": maxima.largest("h_max"),
        "Ut_max_m_s": maxima.largest("Ut_max"),
        "p_max_Pa": maxima.largest("p_max"),
        "mass_out_share": float(out / come) if come else 0.0,
        "came_to_rest": int(sequence.end.came_to_rest),
        "extent": extent,
    }


def _runout(prepared, grid, row, column):
    """Return distance [m] and angle [degrees] from the release centre to the farthest cell, or (None, None)."""
    if not len(row):
        return None, None
    start, terrain = centre_of(prepared.seen), prepared.terrain
    x, y = grid.xy(row, column)
    distance, far = farthest(start, x, y)
    heights = terrain.sample(np.array([start[0], x[far]]), np.array([start[1], y[far]]))
    angle = np.degrees(np.arctan2(heights[0] - heights[1], distance))
    return distance, float(angle) if np.isfinite(angle) else None


@muted()
def warmed(task: MemberTask, prepared: "Prepared") -> None:
    """Compile the kernels of a member in all its stages, so that workers load them from the disk cache.

    Parameters
    ----------
    task : MemberTask
    prepared : Prepared
    """
    averaging = task.averaging(prepared)
    for frame in warm_up(prepared):
        average_frame(frame, averaging)


@muted()
def warm_worker(tasks: Iterable[MemberTask]) -> None:
    """Compile or load the kernels of members in all their stages, before a first task is timed.

    Parameters
    ----------
    tasks : iterable of MemberTask
    """
    for task in tasks:
        warmed(task, task.prepared())
