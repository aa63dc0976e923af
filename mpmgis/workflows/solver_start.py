"""`mpmgis seed --for` and `convert --for`: columns or points in, a folder from which another 3D solver starts out."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import __version__, system
from ..conversion.account import account_of_points
from ..conversion.options import PointOptions
from ..conversion.points import columns_to_points
from ..conversion.solver_start import SolverStart, placed_box, release_density, solver_start, with_material
from ..errors import InputError, OutputError
from ..interop.declarations import SUFFIX, ForeignTerms, axis_matrix, write_sidecar
from ..interop.writers.registry import SOLVER_FILES
from ..interop.writers.start_files import SolverFiles, write_terrain
from ..io.atomic import refuse_existing, whole_folder
from ..machine import memory_lack
from ..messages import log
from ..scene.material_file import EXAMPLE, GivenMaterial, read_material
from .convert import entry_at, listed, require_point_memory, whole_frame
from .export_inputs import refuse_within, run_terrain
from .seed import seed_frame

PLACEHOLDER_END = 10.0  # [s]
README = "README.txt"
BYTES_PER_POINT = 2500  # at the most, while files are written and read back
LARGEST_ERROR = 1e-6  # of the sums of mass and volume, read back


@dataclass(frozen=True)
class StartRequest:
    """Which solver is to start from what: its name, the folder (None: `<name>_<solver>` here), the side of its grid's
    cubes [m], the window of ground that it gets (west, south, east, north) [m], the file with its [material]."""

    solver: str
    output: Path | None = None
    overwrite: bool = False
    cell: float | None = None
    window: tuple | None = None
    material: Path | None = None


@dataclass(frozen=True)
class StartWritten:
    """The folder, and how many points it holds in the first frame, with their mass [kg] and volume [m3]."""

    path: Path
    count: int
    mass: float
    volume: float


def convert_for_solver(request, sources, terrain_request, options=None, of_columns=False):
    """Write what a solver starts from: the frames at `sources`, columns of them turned into points.

    Parameters
    ----------
    request : StartRequest
    sources : list of Path
        Several only where the solver takes several times.
    terrain_request : ConvertRequest
        What it says of the terrain, and about another code's files.
    options : PointOptions, optional
        How columns become points, where there are columns.
    of_columns : bool
        The options mean columns: points are refused.

    Raises
    ------
    MpmgisError
        Before anything is written.
    """
    files = SOLVER_FILES[request.solver]
    entries = listed(sources, terrain_request.terms)
    named = max(len(sources), len(entries))  # a file that is named twice is a mistake as well
    if terrain_request.at_time is not None:
        entries, named = (entry_at(entries, terrain_request.at_time),), 1
    if named > 1 and files.finish is None:
        others = ", ".join(name for name, other in SOLVER_FILES.items() if other.finish)
        raise InputError(
            f"{files.title} starts from one frame, got {named}; say which with --at-time. Several go to {others}"
        )
    first = entries[0]
    folder = _folder(request, first.path.resolve().parent.name if len(entries) > 1 else first.path.stem)
    given = _material(request, files)
    terrain = run_terrain(terrain_request, [first], folder)
    for entry in entries:
        refuse_within(folder, entry.path)
    _refuse_idle(request, files, entries, of_columns)
    request = replace(request, cell=request.cell or _cell_of(first, files))
    return _write(request, files, given, _Frames(entries, terrain, options), terrain, str(first.path), folder)


def _refuse_idle(request, files, entries, of_columns):
    """Refuse options that would do nothing for points."""
    points = next((entry.path for entry in entries if entry.header.dimension == 3), None)
    if points is not None and of_columns:
        raise InputError(
            f"{points} holds points already; --spacing, --vertical-velocity, --relevel and --paper make them of columns"
        )
    if points is not None and request.cell is not None and not files.needs_grid:
        raise InputError(f"{points} holds points already, and {files.title} needs no grid; leave --cell out")


def seed_for_solver(request, dem, release, options=None, **seeding):
    """Seed `release` on `dem`, turn the columns into points and write what a solver starts from.

    Parameters
    ----------
    request : StartRequest
    dem, release : str or Path
    options : PointOptions, optional
        How columns become points; default: so that they fill the request's cells.
    **seeding
        As for `seed_file`.

    Returns
    -------
    (StartWritten, int, dict)
        The number of columns, and the record of design notes 1.5.
    """
    files = SOLVER_FILES[request.solver]
    given = _material(request, files)
    if files.needs_grid and request.cell is None:
        raise InputError(_cell_needed(files))
    if request.output is not None:
        refuse_existing(request.output, request.overwrite)
    frame, terrain, name, record = seed_frame(dem, release, **seeding)
    folder = _folder(request, name)
    refuse_within(folder, Path(dem))
    refuse_within(folder, Path(str(release).partition("|")[0]))
    points = _turned(frame, terrain, options or PointOptions(cell=request.cell))
    return _write(request, files, given, [points], terrain, str(release), folder), len(frame.particles), record


def _folder(request, name):
    folder = Path(request.output) if request.output is not None else Path(f"{name}_{request.solver}")
    refuse_existing(folder, request.overwrite)
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file, wanted a folder; give another -o")
    return folder


def _material(request, files):
    """The GivenMaterial for a solver, None where it needs none."""
    if not files.laws:
        if request.material is not None:
            raise InputError(f"--material: {files.title} needs no material; leave it out")
        return None
    if request.material is None:
        raise InputError(
            f"{files.title} needs a material: --material FILE, a scene with [material] or a file with that alone "
            f"({EXAMPLE})"
        )
    given = read_material(request.material)
    if given.table.law not in files.laws:
        raise InputError(
            f"{request.material} [material]: {files.title} has no counterpart of {given.table.law} that is written "
            f"here, wanted {' or '.join(files.laws)}"
        )
    if files.needs_bed_friction and given.bed_friction is None:
        raise InputError(
            f"{files.title} wants the friction of its terrain: add [friction] to {request.material}, "
            'law = "Coulomb" and mu'
        )
    return given


def _cell_of(entry, files):
    """Side of the grid's cubes that points were made for [m], None where none is needed."""
    cell = entry.header.header.get("cell_size")
    if entry.header.dimension == 3 and isinstance(cell, (int, float, np.number)) and cell > 0:
        return float(cell)
    if files.needs_grid:
        raise InputError(f"{entry.path}: {_cell_needed(files)}")
    return None


def _cell_needed(files):
    return f"{files.title} needs the side of its grid's cells: --cell M, a third of the flow's thickness or less"


def _points_of(entry, terrain, options):
    frame = whole_frame(entry)
    if len(frame.particles) == 0:
        raise InputError(f"{entry.path} holds no particle")
    return frame if frame.dimension == 3 else _turned(frame, terrain, options or PointOptions())


class _Frames:
    """Frames of points, read one by one each time they are gone through; a single one is kept."""

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


def _write(request, files, given, frames, terrain, source, folder):
    """Write the folder; `frames` are gone through several times."""
    box = placed_box(frames, terrain, request.cell if files.needs_grid else None, request.window)
    end, placeholder = _placeholder(given)
    _require_memory(frames)
    first, times = None, []
    with whole_folder(folder, request.overwrite) as part:
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
        write_sidecar(part / SUFFIX, _terms(files, first, times, system.slashed(terrain.path, folder)))
        told = _Told(files, first, times, given, placeholder)
        (part / README).write_text(_readme(told, source, ground), encoding="utf-8", newline="\n")
    for line in _account(told):
        log.info(line)
    return StartWritten(folder, len(first.mass), float(first.mass.sum()), float(_volume(files, first).sum()))


def _require_memory(frames):
    """Refuse before the work what this machine cannot hold (H25)."""
    count = max(len(frame.particles) for frame in frames)
    if lack := memory_lack(count * BYTES_PER_POINT):
        raise InputError(f"files of {count} points need {lack}; take fewer points")


class _Told(NamedTuple):
    """What talk and README.txt are about: the solver, its first start, times [s], material, words on a placeholder."""

    files: SolverFiles
    first: SolverStart
    times: list
    given: GivenMaterial | None
    placeholder: str

    def fate(self):
        """(word, what of the points and their material it is true of)."""
        files, given = self.files, self.given
        stress = self.first.vertical_stress is not None
        kept = ["place", "mass", files.keeps] + (["stress of the weight"] if files.takes_stress and stress else [])
        lost = [files.loses] if files.loses else []
        if not (files.takes_stress and stress):
            lost.append("stress" if stress else "stress, which this frame does not tell")
        left = list(given.lost) if given is not None else []
        if files.needs_bed_friction and given.bed_law != "Coulomb":
            left.append(f"all of {given.bed_law} on the bed but mu")
        return [("kept", ", ".join(kept)), ("lost", ", ".join(lost)), ("not handed over", ", ".join(left))]


def _placeholder(given):
    """(end time [s], words about it where it is none of the user's)."""
    if given is None:
        return None, ""
    if given.end_time is not None:
        return given.end_time, ""
    return PLACEHOLDER_END, f"the end, {PLACEHOLDER_END:g} s, is a placeholder (say [output] end_time in --material)"


def _volume(files, start):
    return start.current_volume if files.now else start.volume


def _require_same(files, folder, number, start):
    """Hold what the files say against what was to be written."""
    place, volume = files.read_back(folder, number)
    wanted = _volume(files, start)
    error = np.inf
    if place.shape == start.position.shape:
        error = np.abs(place - start.position).max() / max(start.box.size)
    if not (error <= files.tolerance and abs(volume.sum() / wanted.sum() - 1) <= LARGEST_ERROR):
        raise OutputError(
            f"{files.title}: read back, {len(place)} points hold {volume.sum():.9g} m3 and are off by {error:.2g} of "
            f"the box, wanted {len(wanted)} points and {wanted.sum():.9g} m3; please report it"
        )


def _terms(files, first, times, dem):
    """What the sidecar says: of all files of the folder, and of the solver's results."""
    of_time = {"times": tuple(times)} if files.finish is not None else {}
    return ForeignTerms(
        crs=first.crs, origin=first.box.origin, axes=files.axes, density=first.density, dem=dem, **of_time
    )


def _account(told):
    """Lines of talk: sums, what is lost, what the grid covers."""
    files, first, box = told.files, told.first, told.first.box
    frames = f" in the first of {len(told.times)} frames" if len(told.times) > 1 else ""
    lines = [
        f"{len(first.mass)} points{frames}, {first.mass.sum():.9g} kg and {_volume(files, first).sum():.9g} m3, read "
        f"back from the files; density {first.density:g} kg m-3",
        f"local coordinates begin at E {box.origin[0]:.0f}, N {box.origin[1]:.0f}, H {box.origin[2]:.0f}; "
        f"{files.title} gets {box.size[0]:g} x {box.size[1]:g} m of ground (--window W,S,E,N says otherwise)",
        *(f"{word}: {what}" for word, what in told.fate() if what),
    ]
    if box.cell is not None:
        nx, ny, nz = box.cells
        lines.append(f"grid of {nx} x {ny} x {nz} cells of {box.cell:g} m; time step {first.time_step:g} s")
    return lines + ([told.placeholder] if told.placeholder else [])


def _readme(told, source, ground):
    """Five lines: what, files, start, what is kept and lost, and how results come back to the map."""
    files, first, (east, north, up) = told.files, told.first, told.first.box.origin
    count = f"{len(told.times)} frames from t = {first.time:g} s" if len(told.times) > 1 else f"t = {first.time:g} s"
    marked = f" PLACEHOLDER: {told.placeholder}." if told.placeholder else ""
    step = f" Time step {first.time_step:g} s, by the speed of pressure waves." if told.given is not None else ""
    lines = (
        f"{len(first.mass)} points, {first.mass.sum():.9g} kg, {_volume(files, first).sum():.9g} m3, {count}, from "
        f"{Path(source.partition('|')[0]).name}, written for {files.title} by mpmgis {__version__}.",
        f"Files: {files.files}; the ground: {', '.join(ground)}.",
        f"Start: {files.start}.{step}{marked}",
        " ".join(f"{word.capitalize()}: {what}." for word, what in told.fate() if what),
        f"Coordinates are local, x y z = {','.join(files.axes)} from E {east:.0f}, N {north:.0f}, H {up:.0f} "
        f"({SUFFIX}). Back on the map: mpmgis export-raster {files.results} --sidecar {SUFFIX}",
    )
    return "\n".join(lines) + "\n"
