"""One member of an ensemble: a scene run, its peaks as a raster, what it came to as a record."""

import time
from dataclasses import dataclass

import numpy as np

from .. import __version__
from ..analysis.cells import Bed
from ..analysis.frame_values import Averaging, average_frame
from ..analysis.maxima import PRODUCTS_NEEDED, RunningMaxima, SolverPeaks
from ..analysis.sampling import export_grid
from ..effects.own_law import NO_OWN_LAWS, load_laws
from ..errors import InputError, UnphysicalError, one_line
from ..experiments.measures import centre_of
from ..experiments.statistics import MEMBER_BANDS
from ..fields import BAND
from ..io.atomic import whole_file
from ..io.ensemble_folder import member_files, read_member, write_member
from ..io.raster_output import write_rows
from ..io.run_folder import RunFolder
from ..kernels.laws import use_own_laws
from ..messages import muted
from ..scene import scene_from_tables
from .run import march_into, use_threads
from .run_setup.prepare import prepare_scene
from .run_setup.sequence import Sequence
from .run_setup.warmup import rehearse

FIGURES = {  # of a member: what it is called in the table -> what it is
    "end_time_s": "simulated time at the end",
    "steps": "steps of the solver",
    "runout_m": "distance on the map from the release's centre of mass to the farthest cell that was reached",
    "travel_angle_degrees": "of the line from the release's centre of mass to that cell",
    "area_m2": "plan area that was reached",
    "h_max_m": "largest flow depth, normal to the slope",
    "Ut_max_m_s": "largest speed along the slope",
    "p_max_Pa": "largest impact pressure",
    "mass_out_share": "share of the mass that left the terrain",
}


@dataclass(frozen=True)
class MemberTask:
    """All that a worker needs to run a member, wherever it is; it goes there as it is.

    Parameters
    ----------
    number : int
    digest : str
        Of everything that decides its result.
    tables : dict
        The scene.
    scene_folder, name : str
        What its paths are relative to, and what it is called in messages.
    law : str or None
        File with laws of friction of the user's own.
    output : str
        Folder for what members leave.
    cell_size : float or None [m]
        Of its raster; None: the DTM's cells.
    min_depth : float [m]
    frames : bool
        Keep them.
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
    frames: bool = False

    def prepared(self):
        """Everything before the first step, as of any run."""
        own = NO_OWN_LAWS if self.law is None else load_laws(self.law)
        use_own_laws(own)
        return prepare_scene(scene_from_tables(self.tables, self.scene_folder, self.name, own))

    def averaging(self, prepared):
        """How its frames are averaged: as an export of them would."""
        return Averaging(
            bed=Bed.of(prepared.terrain),
            grid=export_grid(prepared.terrain.grid, self.cell_size),
            density=prepared.frame.header["density"],
            names=PRODUCTS_NEEDED,
            min_depth=self.min_depth,
        )


def run_member(task, look=lambda *state: None):
    """Run a member unless it is done; answers its record, which lies beside its raster when both are whole.

    A run that stops itself because it became unphysical is an outcome, and so is one that its inputs do not allow.
    `look` is called a few times a second.
    """
    done = read_member(task.output, task.digest, task.frames)
    if done is not None:
        return done
    began, used = time.perf_counter(), time.process_time()
    try:
        record = _run(task, look)
    except UnphysicalError as error:
        record = {"status": "unphysical", "reason": one_line(error)}
    except InputError as error:
        record = {"status": "refused", "reason": one_line(error)}
    record |= {
        "digest": task.digest,
        "wall_seconds": time.perf_counter() - began,
        "processor_seconds": time.process_time() - used,
        "version": __version__,
    }
    write_member(task.output, record)
    return record


@muted()
def _run(task, look):
    prepared = task.prepared()
    use_threads(prepared.particles, 1)
    averaging = task.averaging(prepared)
    sequence = _Peaks(prepared, averaging, look)
    _, raster, kept = member_files(task.output, task.digest)
    if task.frames:
        folder = RunFolder(kept, overwrite=True)
        with folder.held():
            folder.open()
            march_into(folder, sequence, False)
    else:
        for _ in sequence:
            pass
    maxima, grid = sequence.on_cells, averaging.grid
    tags = {"version": __version__, "digest": task.digest, "scene": prepared.digest, "min_depth": task.min_depth}
    with whole_file(raster) as part:
        write_rows(
            part, grid, [BAND[name] for name in MEMBER_BANDS], tags,
            lambda band, first, last: maxima.rows(MEMBER_BANDS[band], first, last, grid.shape[1]),
        )  # fmt: skip
    return {"status": "finished", "reason": sequence.reason, **_figures(prepared, sequence, averaging)}


class _Peaks(Sequence):
    """A run whose frames leave their peaks on the cells of a raster as they go by, and the solver's own at the end."""

    def __init__(self, prepared, averaging, look):
        super().__init__(prepared, look)
        rows, columns = averaging.grid.shape
        self.averaging, self.on_cells = averaging, RunningMaxima(rows * columns, averaging.min_depth)

    def __iter__(self):
        last = None
        for frame in super().__iter__():
            values = average_frame(frame, self.averaging)
            self.on_cells.absorb(values.index, values.values, values.time, values.least)
            last = frame if frame.maxima else last
            yield frame
        peaks = None if last is None else SolverPeaks.of(last.maxima, last.time)
        if peaks is not None:
            for index, values in peaks.on(self.averaging.grid, self.averaging.bed, self.averaging.min_depth):
                self.on_cells.absorb_peaks(index, values)


def _figures(prepared, sequence, averaging):
    """What the table tells of a finished member; `extent` are the rows and columns with any peak, None without."""
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
        "extent": extent,
    }


def _runout(prepared, grid, row, column):
    """(distance [m], angle [degrees]) from the release's centre of mass to the farthest of some cells; None of none."""
    if not len(row):
        return None, None
    start, terrain = centre_of(prepared.seen), prepared.terrain
    x, y = grid.xy(row, column)
    distance = np.hypot(x - start[0], y - start[1])
    far = int(np.argmax(distance))
    heights = terrain.sample(np.array([start[0], x[far]]), np.array([start[1], y[far]]))
    angle = np.degrees(np.arctan2(heights[0] - heights[1], distance[far]))
    return float(distance[far]), float(angle) if np.isfinite(angle) else None


@muted()
def warmed(task, prepared):
    """Compile what a member needs in all its stages, so that workers find it in the disk cache and do not compile."""
    averaging = task.averaging(prepared)
    for frame in rehearse(prepared):
        average_frame(frame, averaging)


@muted()
def warm_worker(tasks):
    """Import and load in a worker what `tasks` need, before the first of them is timed."""
    for task in tasks:
        warmed(task, task.prepared())
