"""Convert a frame of columns on disk to one of points, and back: `mpmgis convert`."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..exchange.frame_list import OWN
from ..exchange.frame_source import SourceOptions, frames_at
from ..frames.frame_files import read_frame, write_frame
from ..frames.particle_files import require_format, write_columns
from ..frames.point_cloud import is_point_cloud, require_point_cloud, write_las
from ..frames.run_terrain import run_terrain
from ..maps.averaging.export_resolution import require_cells_within
from ..system.errors import InputError, OutputError
from ..system.memory import memory_lack
from ..system.messages import log
from ..system.option_values import defaults_of
from ..system.source_names import file_of, moved
from ..system.whole_files import refuse_existing
from .columns_to_points import columns_to_points
from .conversion_account import account_of_columns, account_of_points
from .conversion_options import ColumnOptions, PointOptions
from .points_to_columns import points_to_columns

if TYPE_CHECKING:
    from ..exchange.frame_list import FrameEntry
    from ..frames.particles import Frame

BYTES_PER_POINT = 320  # [bytes] at most, with a velocity gradient and the frame's file


@dataclass(frozen=True, kw_only=True)
class ConvertRequest:
    """A conversion of a frame on disk.

    Parameters
    ----------
    source : Path
        File of the frame.
    output : Path or None
        None: `<name>_points.h5` or `<name>_columns.h5` in the current folder.
    overwrite : bool
    at_time : float or None [s]
        Of one of several frames.
    declared : SourceOptions
        Declarations about DTM and frames.
    """

    source: Path
    output: Path | None = None
    overwrite: bool = False
    at_time: float | None = None
    declared: SourceOptions = field(default_factory=partial(defaults_of, SourceOptions))


@dataclass(frozen=True)
class Written:
    """A converted frame.

    Parameters
    ----------
    path : Path
        Of its file.
    rest : Path or None
        Of the file of points that remain points.
    report : PointsReport, ColumnsReport or None
    """

    path: Path
    rest: Path | None
    report: object


def convert_to_points(request: ConvertRequest, options: PointOptions | None = None) -> Written:
    """Convert the columns of a frame on disk to points.

    Parameters
    ----------
    request : ConvertRequest
    options : PointOptions, optional

    Raises
    ------
    MpmgisError
        Before anything is written.
    """
    options = options or PointOptions()
    path = _output(request, "points")
    if is_point_cloud(path):
        require_point_cloud(path)
    elif path.suffix.lower() != ".h5":
        raise OutputError(f"{path}: points are written as frames, expected a name that ends in .h5 or .las")
    frame, terrain = _inputs(request, path, 2)
    require_cells_within(terrain.grid, options.cell, north_up=True, option="`cell`")
    require_point_memory(options.predicted_points(frame.particles), options.spacing_for(frame.particles))
    points = columns_to_points(frame, terrain, options)
    header = points.frame.header | {
        "converted_outside_columns": points.report.outside.count,
        "converted_outside_mass": points.report.outside.mass,
    }
    state = {name: values.astype(np.float32) for name, values in points.frame.state.items()}
    frame = _with_terrain(replace(points.frame, header=header, state=state), terrain, path)
    (write_las if is_point_cloud(path) else write_frame)(path, frame)
    for line in account_of_points(points.report, options):
        log.info(line)
    return Written(path, None, points.report)


def write_point_cloud(request: ConvertRequest) -> Written:
    """Write the points of a frame on disk unchanged to a .las file.

    Parameters
    ----------
    request : ConvertRequest

    Raises
    ------
    MpmgisError
        Before anything is written.
    """
    path, entry = _output(request, "points"), _entry(request)
    require_point_cloud(path)
    if entry.reader == OWN and request.declared["crs"] is not None:
        raise InputError(f"{entry.path} is a frame of mpmgis, which contains its CRS; leave `crs` out")
    frame = whole_frame(entry)
    if frame.crs is None:
        log.info(f"{path}: the frame has no CRS, so the point cloud has none")
    write_las(path, frame)
    return Written(path, None, None)


def convert_to_columns(request: ConvertRequest, options: ColumnOptions | None = None) -> Written:
    """Convert the points of a frame on disk to columns.

    Points that remain points are written to `<output>_points.h5` beside the output.

    Parameters
    ----------
    request : ConvertRequest
    options : ColumnOptions, optional

    Raises
    ------
    MpmgisError
        Before anything is written.
    """
    path = _output(request, "columns")
    require_format(path)
    rest = path.with_name(f"{path.stem}_points.h5")
    refuse_existing(rest, request.overwrite)
    frame, terrain = _inputs(request, path, 3)
    _refuse_replacing(rest, request, terrain)
    options = options or ColumnOptions()
    require_cells_within(terrain.grid, options.cell, north_up=True, option="`cell`")
    columns = points_to_columns(frame, terrain, options)
    _write_both(columns, path, rest, terrain)
    for line in account_of_columns(columns.report, options):
        log.info(line)
    return Written(path, rest if columns.rest is not None else None, columns.report)


def _write_both(columns, path, rest, terrain):
    """Write the columns to `path` and the remaining points to `rest`, both or none."""
    if columns.rest is not None:
        write_frame(rest, _with_terrain(columns.rest, terrain, rest))
    particles = columns.frame.particles
    try:
        write_columns(path, _with_terrain(columns.frame, terrain, path), len(particles), [particles])
    except BaseException:
        rest.unlink(missing_ok=True)
        raise


def dimension_of(request: ConvertRequest) -> int:
    """Return 2 if the frame to convert contains columns, 3 if points.

    Parameters
    ----------
    request : ConvertRequest
    """
    return _entry(request).header.dimension


def listed(sources: list, declared: SourceOptions) -> Sequence:
    """List the frames in some files, of mpmgis or another code, by time.

    Parameters
    ----------
    sources : list of Path
    declared : SourceOptions

    Returns
    -------
    sequence of FrameEntry

    Raises
    ------
    FormatError, InputError
        As `list_frames`; a density for frames that have their own.
    """
    entries = frames_at(sources, declared)
    if entries[0].reader == OWN and declared["density"] is not None:
        raise InputError(f"{entries[0].path} is a frame of mpmgis, which contains its density; leave `density` out")
    return entries


def whole_frame(entry: "FrameEntry") -> "Frame":
    """Read a frame with all data of its file.

    Parameters
    ----------
    entry : FrameEntry
    """
    if entry.reader == OWN:
        return read_frame(entry.path)
    frame = entry.read()
    return replace(frame, header={name: value for name, value in frame.header.items() if name != "count"})


def _entry(request):
    """The FrameEntry to convert: the only one, or that at `at_time`."""
    entries = listed([request.source], request.declared)
    if request.at_time is not None:
        return entry_at(entries, request.at_time)
    if len(entries) > 1:
        raise InputError(
            f"{request.source} contains {len(entries)} frames, from {entries[0].time:g} to {entries[-1].time:g} s; "
            "choose one with `at_time`"
        )
    return entries[0]


def entry_at(entries: Sequence, time: float) -> "FrameEntry":
    """Return the frame of a time.

    Parameters
    ----------
    entries : sequence of FrameEntry
    time : float [s]

    Raises
    ------
    InputError
        There is none; the nearest is named.
    """
    nearest = min(entries, key=lambda entry: abs(entry.time - time))
    if not np.isclose(nearest.time, time, rtol=1e-6, atol=1e-9):
        raise InputError(f"no frame at {time:g} s; the nearest, {nearest.path.name}, is at {nearest.time:.9g} s")
    return nearest


def _output(request, kind):
    path = Path(request.output) if request.output is not None else Path(f"{Path(request.source).stem}_{kind}.h5")
    refuse_existing(path, request.overwrite)
    if path.is_dir():
        raise OutputError(f"{path} is a folder, expected the name of a file; give another `output`")
    return path


def _inputs(request, path, dimension):
    """(the frame, its terrain); an error if the output would replace one of their files."""
    entry = _entry(request)
    source, is_of = entry.path, entry.header.dimension
    if is_of != dimension:
        kinds = {2: "columns", 3: "points"}
        raise InputError(f"{source} already contains {kinds[is_of]}; `to={kinds[is_of]}` requires {kinds[dimension]}")
    terrain = run_terrain(request.declared, [entry], path)
    _refuse_replacing(path, request, terrain)
    frame = whole_frame(entry)
    if "assumed_density" in frame.header:
        log.info(
            f"{source} contains only mass or volume; a density of {frame.header['assumed_density']:g} kg m-3 is assumed"
        )
    return frame, terrain


def _refuse_replacing(path, request, terrain):
    """Refuse to replace an input, even with `overwrite`."""
    for given in (request.source, terrain.path):
        if given and path.exists() and file_of(given).exists() and path.samefile(file_of(given)):
            raise OutputError(f"{path} is an input and would be replaced; give another `output`")


def require_point_memory(count: float, spacing: float) -> None:
    """Raise an error unless the memory of this machine allows a number of points, before the work.

    Parameters
    ----------
    count : float
    spacing : float [m]
        Named in the message.

    Raises
    ------
    InputError
    """
    if lack := memory_lack(count * BYTES_PER_POINT):
        raise InputError(
            f"{count:.3g} points at a spacing of {spacing:g} m need {lack}; use a wider `spacing`, or larger cells"
        )


def _with_terrain(frame, terrain, path):
    """The frame with its terrain's CRS, and with the terrain's path relative to the frame's file."""
    crs = frame.crs if frame.crs is not None else terrain.grid.crs
    return replace(frame, crs=crs, dem=moved(terrain.path, path.parent), dem_sha256=terrain.sha256)
