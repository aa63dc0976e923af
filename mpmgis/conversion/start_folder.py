"""Write start folders for other 3D solvers from columns or points: `mpmgis seed --for` and `convert --for`."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import __version__
from ..exchange.declarations import SUFFIX, Declarations, axis_matrix, write_sidecar
from ..exchange.writers.start_files import SolverFiles, write_terrain
from ..exchange.writers.writer_list import SOLVER_FILES
from ..frames.run_terrain import refuse_within, run_terrain
from ..scene.material_file import EXAMPLE, GivenMaterial, read_material
from ..seeding.seeded_file import seed_frame
from ..system.errors import InputError, OutputError
from ..system.memory import memory_lack
from ..system.messages import log
from ..system.option import PathLike
from ..system.source_names import file_of, moved
from ..system.whole_files import refuse_existing, whole_folder
from ..system.work_options import OverwriteOptions
from .columns_to_points import columns_to_points
from .conversion_account import account_of_points
from .conversion_options import PointOptions
from .frame_conversion import Conversion, entry_at, listed, require_point_memory, whole_frame
from .solver_start import SolverStart, release_density, solver_start, start_box, with_material
from .start_options import SolverOptions

PLACEHOLDER_END = 10.0  # [s] end of the run where the user gives none
README = "README.txt"
BYTES_PER_POINT = 2500  # [bytes] at most, while files are written and read back
LARGEST_ERROR = 1e-6  # [1] relative, of the volume that is read back


class Start(SolverOptions, OverwriteOptions, total=False):
    """A start folder; without `output` it is `<name>_<solver>` in the current folder."""

    cell: float  # [m] of the solver's grid
    output: PathLike


class StartOfFrames(Start, Conversion, total=False):
    """A start folder from frames on disk."""


@dataclass(frozen=True)
class StartWritten:
    """A start folder that was written, with the points of its first frame.

    Parameters
    ----------
    path : Path
    count : int
        Number of points.
    mass : float [kg]
    volume : float [m3]
    """

    path: Path
    count: int
    mass: float
    volume: float


def convert_for_solver(
    asked: StartOfFrames, options: PointOptions | None = None, of_columns: bool = False
) -> StartWritten:
    """Write a start folder from frames on disk; columns are converted to points.

    Parameters
    ----------
    asked : StartOfFrames
        With several sources only if the solver reads several times.
    options : PointOptions, optional
        For the conversion of columns.
    of_columns : bool
        The options require columns: points are refused.

    Raises
    ------
    MpmgisError
        Before anything is written.
    """
    files = SOLVER_FILES[asked["solver"]]
    entries = listed(asked["source"], asked)
    named = max(len(asked["source"]), len(entries))  # a file given twice is also an error
    if asked["at_time"] is not None:
        entries, named = (entry_at(entries, asked["at_time"]),), 1
    if named > 1 and files.finish is None:
        others = ", ".join(name for name, other in SOLVER_FILES.items() if other.finish)
        raise InputError(
            f"{files.title} starts from one frame, got {named}; choose one with `at_time`. Several are for {others}"
        )
    first = entries[0]
    folder = _folder(asked, first.path.resolve().parent.name if len(entries) > 1 else first.path.stem)
    given = _material(asked["material"], files)
    terrain = run_terrain(asked, [first], folder)
    for entry in entries:
        refuse_within(folder, entry.path)
    _refuse_idle(asked["cell"], files, entries, of_columns)
    cell = asked["cell"] or _cell_of(first, files)
    return _write(asked, cell, given, _Frames(entries, terrain, options), terrain, str(first.path), folder)


def _refuse_idle(cell, files, entries, of_columns):
    """Refuse options without effect on points."""
    points = next((entry.path for entry in entries if entry.header.dimension == 3), None)
    if points is not None and of_columns:
        raise InputError(
            f"{points} already contains points; `spacing`, `vertical_velocity`, `relevel` and `paper` require columns"
        )
    if points is not None and cell is not None and not files.needs_grid:
        raise InputError(f"{points} already contains points, and {files.title} needs no grid; leave `cell` out")


def seed_for_solver(
    asked: Start, dem: str | Path, release: str | Path, options: PointOptions | None = None, **seeding: object
) -> tuple[StartWritten, int, dict]:
    """Seed a release on a DTM, convert the columns to points and write a start folder.

    Parameters
    ----------
    asked : Start
    dem, release : str or Path
    options : PointOptions, optional
        For the conversion of columns; default: points that fill its cells.
    **seeding
        As for `seed_file`.

    Returns
    -------
    (StartWritten, int, dict)
        What was written, the number of columns, and the record of the seeding.
    """
    files = SOLVER_FILES[asked["solver"]]
    given = _material(asked["material"], files)
    if files.needs_grid and asked["cell"] is None:
        raise InputError(_cell_needed(files))
    if asked["output"] is not None:
        refuse_existing(asked["output"], asked["overwrite"])
    frame, terrain, name, record = seed_frame(dem, release, **seeding)
    folder = _folder(asked, name)
    refuse_within(folder, file_of(dem))
    refuse_within(folder, file_of(release))
    points = _turned(frame, terrain, options or PointOptions(cell=asked["cell"]))
    written = _write(asked, asked["cell"], given, [points], terrain, str(release), folder)
    return written, len(frame.particles), record


def _folder(asked, name):
    folder = Path(asked["output"] or f"{name}_{asked['solver']}")
    refuse_existing(folder, asked["overwrite"])
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file, expected a folder; give another `output`")
    return folder


def _material(material, files):
    """The GivenMaterial for a solver, None if it needs none."""
    if not files.laws:
        if material is not None:
            raise InputError(f"`material`: {files.title} needs no material; leave it out")
        return None
    if material is None:
        raise InputError(
            f"{files.title} needs a material: `material=FILE`, a scene with [material] or a file with only that table "
            f"({EXAMPLE})"
        )
    given = read_material(material)
    if given.table.law not in files.laws:
        raise InputError(
            f"{material} [material]: no counterpart of {given.table.law} is implemented for {files.title}, "
            f"expected {' or '.join(files.laws)}"
        )
    if files.needs_bed_friction and given.bed_friction is None:
        raise InputError(
            f'{files.title} needs the friction of its terrain: add [friction] to {material}, law = "Coulomb" and mu'
        )
    return given


def _cell_of(entry, files):
    """Cell size of the grid for which the points were made [m], None if none is needed."""
    cell = entry.header.header.get("cell_size")
    if entry.header.dimension == 3 and isinstance(cell, (int, float, np.number)) and cell > 0:
        return float(cell)
    if files.needs_grid:
        raise InputError(f"{entry.path}: {_cell_needed(files)}")
    return None


def _cell_needed(files):
    return f"{files.title} needs the cell size of its grid: `cell=M`, a third of the flow's thickness or less"


def _points_of(entry, terrain, options):
    frame = whole_frame(entry)
    if len(frame.particles) == 0:
        raise InputError(f"{entry.path} contains no particle")
    return frame if frame.dimension == 3 else _turned(frame, terrain, options or PointOptions())


class _Frames:
    """Frames of points, read one by one in each iteration; a single one is kept in memory."""

    def __init__(self, entries, terrain, options):
        self._entries, self._terrain, self._options = entries, terrain, options
        self._only = [self._read(entries[0])] if len(entries) == 1 else None

    def _read(self, entry):
        return _points_of(entry, self._terrain, self._options)

    def __iter__(self):
        return iter(self._only) if self._only else map(self._read, self._entries)


def _turned(frame, terrain, options):
    """Points of a frame of columns."""
    require_point_memory(options.predicted_points(frame.particles), options.spacing_for(frame.particles))
    points = columns_to_points(frame, terrain, options)
    for line in account_of_points(points.report, options):
        log.info(line)
    return points.frame


def _write(asked, cell, given, frames, terrain, source, folder):
    """Write the folder; iterates several times over `frames`."""
    files = SOLVER_FILES[asked["solver"]]
    box = start_box(frames, terrain, cell if files.needs_grid else None, asked["window"])
    end, placeholder = _placeholder(given)
    _require_memory(frames)
    first, times = None, []
    with whole_folder(folder, asked["overwrite"]) as part:
        for number, frame in enumerate(frames):
            crs = frame.crs if frame.crs is not None else terrain.grid.crs
            start = solver_start(frame, box, release_density(frame), crs)
            if given is not None:
                start = with_material(start, given.table, given.bed_friction, end)
            files.write(start, part, number)
            _require_same(files, part, number, start)
            first, times = first or start, [*times, start.time]
        if files.finish is not None:
            files.finish(part, times)
        ground = write_terrain(part, box, axis_matrix(files.axes), files.terrain_on_grid)
        write_sidecar(part / SUFFIX, _terms(files, first, times, moved(terrain.path, folder)))
        facts = _Facts(files, first, times, given, placeholder)
        (part / README).write_text(_readme(facts, source, ground), encoding="utf-8", newline="\n")
    for line in _account(facts):
        log.info(line)
    return StartWritten(folder, len(first.mass), float(first.mass.sum()), float(_volume(files, first).sum()))


def _require_memory(frames):
    """Refuse, before the work, more points than the memory of this machine allows."""
    count = max(len(frame.particles) for frame in frames)
    if lack := memory_lack(count * BYTES_PER_POINT):
        raise InputError(f"files of {count} points need {lack}; use fewer points")


class _Facts(NamedTuple):
    """Contents of messages and README.txt: the solver, its first start, times [s], material, text on a placeholder."""

    files: SolverFiles
    first: SolverStart
    times: list
    given: GivenMaterial | None
    placeholder: str

    def transfer(self):
        """(heading, properties of the points and their material that are kept, lost, or not written)."""
        files, given = self.files, self.given
        stress = self.first.vertical_stress is not None
        kept = ["place", "mass", files.keeps] + (["stress of the weight"] if files.takes_stress and stress else [])
        lost = [files.loses] if files.loses else []
        if not (files.takes_stress and stress):
            lost.append("stress" if stress else "stress, which this frame does not contain")
        left = list(given.lost) if given is not None else []
        if files.needs_bed_friction and given.bed_law != "Coulomb":
            left.append(f"all of {given.bed_law} on the bed but mu")
        return [("kept", ", ".join(kept)), ("lost", ", ".join(lost)), ("not handed over", ", ".join(left))]


def _placeholder(given):
    """(end time [s], text about it if the user did not set it)."""
    if given is None:
        return None, ""
    if given.end_time is not None:
        return given.end_time, ""
    return (
        PLACEHOLDER_END,
        f"the end, {PLACEHOLDER_END:g} s, is a placeholder (set [output] end_time in the material file)",
    )


def _volume(files, start):
    return start.current_volume if files.now else start.volume


def _require_same(files, folder, number, start):
    """Check that the files read back give the points that were to be written."""
    place, volume = files.read_back(folder, number)
    expected = _volume(files, start)
    error = np.inf
    if place.shape == start.position.shape:
        error = np.abs(place - start.position).max() / max(start.box.size)
    if not (error <= files.tolerance and abs(volume.sum() / expected.sum() - 1) <= LARGEST_ERROR):
        raise OutputError(
            f"{files.title}: read back, {len(place)} points have {volume.sum():.9g} m3 and an error in position of "
            f"{error:.2g} of the box, expected {len(expected)} points and {expected.sum():.9g} m3; please report it"
        )


def _terms(files, first, times, dem):
    """Contents of the sidecar, for the files of the folder and the solver's results."""
    of_time = {"times": tuple(times)} if files.finish is not None else {}
    return Declarations(
        crs=first.crs, origin=first.box.origin, axes=files.axes, density=first.density, dem=dem, **of_time
    )


def _account(facts):
    """Messages: sums, lost properties, extent of the grid."""
    files, first, box = facts.files, facts.first, facts.first.box
    frames = f" in the first of {len(facts.times)} frames" if len(facts.times) > 1 else ""
    lines = [
        f"{len(first.mass)} points{frames}, {first.mass.sum():.9g} kg and {_volume(files, first).sum():.9g} m3, read "
        f"back from the files; density {first.density:g} kg m-3",
        f"local coordinates begin at E {box.origin[0]:.0f}, N {box.origin[1]:.0f}, H {box.origin[2]:.0f}; "
        f"{files.title} gets {box.size[0]:g} x {box.size[1]:g} m of ground (`window=W,S,E,N` changes this)",
        *(f"{word}: {what}" for word, what in facts.transfer() if what),
    ]
    if box.cell is not None:
        nx, ny, nz = box.cells
        lines.append(f"grid of {nx} x {ny} x {nz} cells of {box.cell:g} m; time step {first.time_step:g} s")
    return lines + ([facts.placeholder] if facts.placeholder else [])


def _readme(facts, source, ground):
    """Five lines: contents, files, start, kept and lost properties, and the command that reads the results."""
    files, first, (east, north, up) = facts.files, facts.first, facts.first.box.origin
    count = f"{len(facts.times)} frames from t = {first.time:g} s" if len(facts.times) > 1 else f"t = {first.time:g} s"
    marked = f" PLACEHOLDER: {facts.placeholder}." if facts.placeholder else ""
    step = f" Time step {first.time_step:g} s, by the speed of pressure waves." if facts.given is not None else ""
    lines = (
        f"{len(first.mass)} points, {first.mass.sum():.9g} kg, {_volume(files, first).sum():.9g} m3, {count}, from "
        f"{Path(source.partition('|')[0]).name}, written for {files.title} by mpmgis {__version__}.",
        f"Files: {files.files}; the ground: {', '.join(ground)}.",
        f"Start: {files.start}.{step}{marked}",
        " ".join(f"{word.capitalize()}: {what}." for word, what in facts.transfer() if what),
        f"Coordinates are local, x y z = {','.join(files.axes)} from E {east:.0f}, N {north:.0f}, H {up:.0f} "
        f"({SUFFIX}). Back on the map: mpmgis export-raster {files.results} --sidecar {SUFFIX}",
    )
    return "\n".join(lines) + "\n"
