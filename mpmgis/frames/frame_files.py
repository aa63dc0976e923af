"""Frames on disk: `*.h5`, one file per saved time; docs/formats.md describes the format."""

import shutil
from collections.abc import Collection, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np

from .. import __version__
from ..system.errors import FormatError, InputError, one_line
from ..system.hdf5_reading import opened_whole, require_numbers_that_fit
from ..system.hdf5_writing import written
from ..system.whole_files import whole_file
from .frame_contents import (
    create_dataset,
    particle_count,
    read_particles,
    require_bed_change,
    require_maxima,
    require_particles_fit,
    stored_type,
)
from .frame_digest import BED_CHANGE, CONTENT, RESULT, STATE, ContentDigest, result_after, state_digest
from .particles import Frame, Particles

FORMAT = "mpmgis-frame"
FORMAT_VERSION = 1
_SIZES = {"density", "cell_size", "converted_spacing"}  # attributes of the particles: numbers above 0
_LARGEST_STEP = 2**53  # largest range of integers that float64 represents exactly
HASHING = 4  # threads that hash arrays while a frame is written
FRAMES_WITH_STATE = 2  # the newest of a run: where the last one is damaged, the one before it is left
PLACES = ("position", "area")  # arrays that are read where only positions are needed


def write_frame(path: str | Path, frame: Frame, before: str | None = None) -> str:
    """Write a frame atomically.

    3D frames store position, velocity, mass and volume in float32 (relative to the origin), columns in float64.

    Parameters
    ----------
    path : str or Path
    frame : Frame
    before : str, optional
        Digest of the result up to the previous frame, '' for the first frame. Without it no digest of the result is
        stored.

    Returns
    -------
    str
        Digest of the content of the frame.
    """
    return write_frame_slabs(path, frame, len(frame.particles), [frame.particles], before)


def write_frame_slabs(
    path: str | Path, frame: Frame, count: int, slabs: Iterable[Particles], before: str | None = None
) -> str:
    """Write a frame atomically from slabs of particles; only one slab is in memory at a time.

    Parameters
    ----------
    path : str or Path
    frame : Frame
        Everything except the particles.
    count : int
        Number of particles.
    slabs : iterable of Particles
        With the same arrays each.
    before : str, optional
        As for `write_frame`.

    Returns
    -------
    str
        Digest of the content of the frame.

    Raises
    ------
    ValueError
        The slabs do not contain `count` particles.
    """
    digest = ContentDigest(frame.time, frame.step)
    with whole_file(path) as part, written(part) as file, ThreadPoolExecutor(HASHING) as threads:
        _write_root(file, frame)
        group = file.create_group("particles")
        start = 0
        for particles in slabs:
            hashed = []  # in threads, while the arrays are written
            for name, values in particles.arrays().items():
                if name not in group:
                    create_dataset(group, name, count, frame.dimension)
                values = values.astype(group[name].dtype, copy=False)
                hashed.append(threads.submit(digest.add, f"particles/{name}", values))
                if len(values):
                    group[name][start : start + len(values)] = values
            for one in hashed:
                one.result()
            start += len(particles)
        if start != count:
            raise ValueError(f"got {start} particles in slabs, expected {count}")
        for name, value in frame.header.items():
            group.attrs[name] = value
        _add_groups(digest, frame)
        content = digest.hexdigest()
        state = threads.submit(state_digest, content, frame.state) if frame.state else None
        _write_group(file, "state", frame.state, count)
        _write_group(file, "maxima", frame.maxima, count)
        _write_group(file, BED_CHANGE, frame.bed_change, count)
        file.attrs[CONTENT] = content
        if state is not None:
            file.attrs[STATE] = state.result()
        if before is not None:
            file.attrs[RESULT] = result_after(before, content)
    return content


def _write_root(file, frame):
    file.attrs.update(
        format=FORMAT,
        format_version=FORMAT_VERSION,
        time=float(frame.time),
        step=int(frame.step),
        dimension=int(frame.dimension),
        solver=frame.solver,
        crs=frame.crs.to_wkt() if frame.crs is not None else "",
        origin=np.asarray(frame.origin, dtype="f8"),
        dem=frame.dem,
        dem_sha256=frame.dem_sha256,
        digest=frame.digest,
        version=__version__,
    )


def _write_group(file: h5py.File, name: str, values: dict, count: int) -> None:
    """Write arrays as datasets, numbers and strings as attributes; nothing where `values` is empty.

    Grids are compressed. Arrays with a row for each of the `count` particles are not: compression gains little and
    takes longer than the rest of the frame.
    """
    if not values:
        return
    group = file.create_group(name)
    for key, value in values.items():
        if isinstance(value, np.ndarray):
            grid = value.ndim > 1 and len(value) != count
            packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if grid else {}
            group.create_dataset(key, data=value, **packed)
        else:
            group.attrs[key] = value


def content_digest(frame: Frame) -> str:
    """Compute the digest of the content that `write_frame` would write; nothing is written.

    Parameters
    ----------
    frame : Frame
    """
    digest = ContentDigest(frame.time, frame.step)
    for name, values in frame.particles.arrays().items():
        digest.add(f"particles/{name}", values.astype(stored_type(name, frame.dimension), copy=False))
    _add_groups(digest, frame)
    return digest.hexdigest()


def _add_groups(digest, frame):
    """Add the arrays of `frame` that are not particles to a ContentDigest."""
    for group, arrays in (("maxima", frame.maxima), (BED_CHANGE, frame.bed_change)):
        for name, values in arrays.items():
            if isinstance(values, np.ndarray):
                digest.add(f"{group}/{name}", values)


def drop_state(path: str | Path) -> None:
    """Rewrite the frame at `path` without the restart state, atomically.

    Parameters
    ----------
    path : str or Path
    """
    with opened_whole(path) as source:
        if "state" not in source:
            return
    with whole_file(path) as part, opened_whole(path) as source, written(part) as target:
        target.attrs.update({name: value for name, value in source.attrs.items() if name != STATE})
        for name in source:
            if name != "state":
                source.copy(name, target)


def set_digest(path: str | Path, digest: str) -> None:
    """Rewrite the frame at `path` with the digest of another scene, atomically.

    Parameters
    ----------
    path : str or Path
    digest : str
    """
    with whole_file(path) as part:
        shutil.copyfile(path, part)
        with h5py.File(part, "r+") as target:
            target.attrs["digest"] = digest


def read_frame(
    path: str | Path,
    with_state: bool = True,
    with_particles: bool = True,
    density: float = 1000.0,
    memory: dict | None = None,
    names: Collection[str] | None = None,
) -> Frame:
    """Read the frame at `path`.

    The file must contain position, velocity and mass or volume. Other missing arrays take the default of
    docs/formats.md.

    Parameters
    ----------
    path : str or Path
    with_state : bool
        Read restart state, maxima and bed change.
    with_particles : bool
        Without it only attributes are read: `particles` is None and `header` has `count`.
    density : float [kg m-3]
        Gives the missing one of mass and volume; it is then recorded in the header as `assumed_density`.
    memory : dict, optional
        The arrays of an earlier frame in it are reused where their shapes fit, which is faster.
    names : collection of str, optional
        Particle arrays to read, `position` included; the others are None. Columns without a stored area are read
        completely.

    Raises
    ------
    FormatError
        Missing, truncated, junk, another format, a newer version, wrong shapes, NaN or impossible values.
    """
    path = Path(path)
    if not path.exists():
        raise FormatError(f"{path}: no such file")
    if path.is_dir():
        raise FormatError(f"{path} is a folder, not a frame; give its files, for example {path}/*.h5")
    try:
        with opened_whole(path) as file:
            return _read(path, file, with_state, with_particles, density, memory, names)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        reason = one_line(error)[:120]
        raise FormatError(f"{path} is not a readable HDF5 file ({reason}); it is truncated or damaged") from error


def read_maxima(path: str | Path) -> dict:
    """Read the running peaks of the solver in the frame at `path`.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        Arrays by name, as `peaks` describes them; empty where there are none.

    Raises
    ------
    FormatError
        Unreadable, an array missing or of another shape, values below 0 or not finite, another kind of transform.
    """
    try:
        with opened_whole(path) as file:
            kept = _read_group(path, file, "maxima")
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path}: the maxima cannot be read ({one_line(error)[:120]}); it is damaged") from error
    return require_maxima(path, kept) if kept else {}


def read_bed_change(path: str | Path) -> dict:
    """Read what the flow eroded from its bed up to the frame at `path`.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        eroded_mass float64[rows, columns] [kg m-2], row 0 in the south; transform float64[6]; bed_density [kg m-3];
        with forest detrained_mass [kg m-2] and broken_forest [1]. Empty where nothing is eroded.

    Raises
    ------
    FormatError
        Unreadable, an array missing, or values that are not valid.
    """
    try:
        with opened_whole(path) as file:
            kept = _read_group(path, file, BED_CHANGE)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path}: the bed change cannot be read ({one_line(error)[:120]}); it is damaged") from error
    return require_bed_change(path, kept) if kept else {}


def _read(
    path: Path,
    file: h5py.File,
    with_state: bool,
    with_particles: bool,
    density: float,
    memory: dict | None,
    names: Collection[str] | None,
) -> Frame:
    attrs = _attributes(path, file)
    if attrs.get("format") != FORMAT:
        got = attrs.get("format", "unknown")
        raise FormatError(
            f"{path}: format {one_line(got)[:40]!r}, expected {FORMAT!r}; not an mpmgis frame (particles of another "
            "code: name the datasets with --columns x=..,y=..)"
        )
    version = _number(path, attrs, "format_version", 1)
    if version > FORMAT_VERSION:
        raise FormatError(f"{path}: format version {version}, this mpmgis reads up to {FORMAT_VERSION}; update mpmgis")
    dimension = _number(path, attrs, "dimension", 3)
    if dimension not in (2, 3):
        raise FormatError(f"{path}: dimension {dimension}, expected 2 or 3")
    origin = _origin(path, attrs)
    time = float(_number(path, attrs, "time", 0.0))
    if not np.isfinite(time):
        raise FormatError(f"{path}: time {time}, expected a finite number of seconds")
    if not isinstance(file.get("particles"), h5py.Group):
        raise FormatError(f"{path}: no group 'particles'")
    header = _attributes(path, file["particles"])
    for name in _SIZES & set(header):
        _require_size(path, header, name)
    if with_particles:
        if not file.is_small:
            require_particles_fit(path, file["particles"], memory or {}, names)
        particles = read_particles(
            path, file["particles"], dimension, header, density, {} if memory is None else memory, names
        )
    else:
        particles, header["count"] = None, particle_count(file["particles"])
    return Frame(
        particles,
        time=time,
        step=_step(path, attrs),
        dimension=dimension,
        solver=str(attrs.get("solver", "")),
        crs=_crs(path, attrs.get("crs", "")),
        origin=origin,
        dem=str(attrs.get("dem", "")),
        dem_sha256=str(attrs.get("dem_sha256", "")),
        digest=str(attrs.get("digest", "")),
        header=header,
        state=_read_group(path, file, "state") if with_state else {},
        maxima=_read_group(path, file, "maxima") if with_state else {},
        bed_change=_read_group(path, file, BED_CHANGE) if with_state else {},
    )


def _number(path: Path, attrs: dict, name: str, default: float | None) -> float:
    """Return the attribute `name` as a number."""
    value = np.asarray(attrs.get(name, default))
    if value.size != 1 or value.dtype.kind not in "fiu":
        raise FormatError(f"{path}: {name} is {one_line(value)[:40]!r}, expected a number")
    return value.item()


def _require_size(path, header, name):
    """Refuse an attribute `name` of the particles that is not a finite number above 0."""
    value = _number(path, header, name, None)
    if not (np.isfinite(value) and value > 0):
        raise FormatError(f"{path}: {name} is {value:g}, expected a finite number above 0")


def _step(path: Path, attrs: dict) -> int:
    """Return the number of time steps of the solver."""
    value = _number(path, attrs, "step", 0)
    if not 0 <= value <= _LARGEST_STEP or value != int(value):
        raise FormatError(f"{path}: step is {value:g}, expected an integer from 0 to 2^53")
    return int(value)


def _attributes(path: Path, group: h5py.Group) -> dict:
    """Return the attributes of an HDF5 group; text must be UTF-8, so that it can be written again."""
    found = dict(group.attrs)
    for name, value in found.items():
        if isinstance(value, str):
            try:
                value.encode()
            except UnicodeEncodeError:
                raise FormatError(
                    f"{path}: attribute {name} of {group.name} is {value[:40]!r}, expected UTF-8"
                ) from None
    return found


def _origin(path: Path, attrs: dict) -> tuple[float, float, float]:
    """Return the origin (E, N, H) [m] of the positions."""
    origin = np.asarray(attrs.get("origin", (0.0, 0.0, 0.0)))
    if origin.dtype.kind not in "fiu":
        raise FormatError(f"{path}: origin has type {origin.dtype}, expected three numbers (E, N, H)")
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise FormatError(f"{path}: origin {origin.tolist()}, expected three finite numbers (E, N, H)")
    return tuple(origin.astype(float).tolist())


def _crs(path, text):
    if not text:
        return None
    from ..terrain.georeference import crs_of_text  # imports PROJ, which frames in a local frame do not need

    try:
        return crs_of_text(text)
    except InputError as error:
        raise FormatError(f"{path}: {error}") from error


def _read_group(path, file, name):
    if name not in file:
        return {}
    require_numbers_that_fit(path, file, name)
    group = file[name]
    return {**{key: value[()] for key, value in group.items()}, **_attributes(path, group)}
