"""Georeferencing of frames of other codes with the user declarations.

Nothing is guessed: values that neither files nor user give are reported in one line with their options.
"""

from collections.abc import Collection, Sequence

import numpy as np

from ..frames.particles import Frame, Particles
from ..system.errors import FormatError, InputError
from .declarations import NAMES, Declarations, axis_matrix
from .readers.reader_interface import ThirdPartyFrame, require_memory

PLACE, VELOCITY = ("x", "y", "z"), ("vx", "vy", "vz")
BYTES_PER_PARTICLE = 250  # [bytes] while a frame is read and rotated
MOST_COLUMNS_NAMED = 12  # in a message
_ABOVE_ZERO = ("mass", "volume", "density", "radius", "diameter")


def require_complete(reader: str, frame: ThirdPartyFrame, terms: Declarations) -> None:
    """Refuse a frame without required values, or one that does not fit into memory.

    Parameters
    ----------
    reader : str
        Name of the code.
    frame : ThirdPartyFrame
    terms : Declarations

    Raises
    ------
    FormatError, InputError
    """
    missing = missing_declarations(frame, terms)
    if missing:
        raise InputError(f"{frame.path} ({reader}) lacks: {'; '.join(missing)}")
    require_memory(frame.path, frame.count, BYTES_PER_PARTICLE)


def missing_declarations(frame: ThirdPartyFrame, terms: Declarations, with_time: bool = True) -> list[str]:
    """List the required values that neither files nor user give, each with its option.

    Parameters
    ----------
    frame : ThirdPartyFrame
    terms : Declarations
    with_time : bool
        The time of the frame is required.
    """
    named = named_columns(frame, terms)
    missing = _missing_columns(frame, named)
    if _volume_from(named) is None and _particle_volume(frame, terms) is None and "mass" not in named:
        missing.append("the volume of the particles (--particle-volume V, in m3)")
    if not ("mass" in named and _volume_from(named)) and "density" not in named and _density(frame, terms) is None:
        missing.append(f"the density (--density R, in kg m-3{frame.density_hint})")
    if terms.axes is None:
        missing.append(f"the directions of its axes (--axes{frame.axes_hint or ' e,n,u or e,u,-n or ..'})")
    if terms.origin is None:
        missing.append("its origin (--origin E,N,H; 0,0,0 for map coordinates)")
    if with_time and terms.times is None and own_time(frame, terms) is None:
        missing.append(f"its time ({_time_options(frame)})")
    return missing


def _missing_columns(frame, named):
    lacking = [name for name in (*PLACE, *VELOCITY) if name not in named]
    if not lacking:
        return []
    shown = ", ".join(frame.columns[:MOST_COLUMNS_NAMED]) + (", .." if len(frame.columns) > MOST_COLUMNS_NAMED else "")
    return [f"the columns of {', '.join(lacking)} (--columns {lacking[0]}=COLUMN,..; it has {shown})"]


def _time_options(frame):
    if frame.number is None:
        return "--times T,.."
    return "--fps F, frames per second, --dt S, seconds from one number to the next, or --times T,.."


def third_party_header(reader: str, frame: ThirdPartyFrame, terms: Declarations, time: float) -> Frame:
    """Return the Frame without its particles; `header` has their `count`.

    Parameters
    ----------
    reader : str
        Name of the code.
    frame : ThirdPartyFrame
    terms : Declarations
    time : float [s]
    """
    header = {"count": frame.count}
    density = _density(frame, terms)
    header |= {"density": density} if density is not None else {}
    header |= {"cell_size": frame.cell_size} if frame.cell_size is not None else {}
    return Frame(
        None,
        time=time,
        step=frame.number or 0,
        dimension=3,
        solver=reader,
        crs=terms.crs,
        dem=terms.dem or "",
        origin=tuple(map(float, terms.origin or (0.0, 0.0, 0.0))),
        header=header,
    )


def third_party_particles(frame: ThirdPartyFrame, terms: Declarations) -> Particles:
    """Read the particles of a frame: position and velocity rotated to (E, N, up), mass and volume from files and user.

    Inactive particles are omitted. Velocity or volume without a column are NaN.

    Parameters
    ----------
    frame : ThirdPartyFrame
    terms : Declarations

    Raises
    ------
    FormatError
        Values that are not finite, masses or volumes that are not above 0, no active particle.
    InputError
        No columns of the position.
    """
    named = named_columns(frame, terms)
    lacking = [name for name in PLACE if name not in named]
    if lacking:
        raise InputError(f"{frame.path} lacks: {_missing_columns(frame, named)[0]}")
    require_memory(frame.path, frame.count, BYTES_PER_PARTICLE)
    values = frame.read(tuple(dict.fromkeys(named.values())))
    found = {name: values[column] for name, column in named.items()}
    found, rows = _active(frame, named, found)
    for name, value in found.items():
        _require_sound(frame, name, named[name], value, rows)
    matrix = np.eye(3) if terms.axes is None else axis_matrix(terms.axes)
    count = len(found["x"])
    nothing = np.full(count, np.nan)
    place, velocity = (
        np.stack([found.get(name, nothing) for name in names], axis=1) @ matrix for names in (PLACE, VELOCITY)
    )
    mass, volume = _mass_and_volume(frame, found, terms)
    ids = _ids(frame, found["id"], named["id"]) if "id" in found else rows.astype(np.uint64)
    return Particles(np.ascontiguousarray(place), np.ascontiguousarray(velocity), mass, volume, id=ids)


def _active(
    frame: ThirdPartyFrame, named: dict[str, str], found: dict[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return (columns of the active particles, their rows in the file)."""
    if "active" not in found:
        return found, np.arange(frame.count)
    rows = np.flatnonzero(found.pop("active") != 0)
    if rows.size == 0:
        raise FormatError(f"{frame.path}: by {named['active']} none of its {frame.count} particles is active")
    if rows.size < frame.count:
        found = {name: value[rows] for name, value in found.items()}
    return found, rows


def _require_sound(frame: ThirdPartyFrame, name: str, column: str, value: np.ndarray, rows: np.ndarray) -> None:
    bad = np.flatnonzero(~np.isfinite(value))
    if bad.size:
        raise FormatError(
            f"{frame.path}: {bad.size} values of {column} are NaN or infinite, the first in row {rows[bad[0]]}"
        )
    if name in _ABOVE_ZERO and value.min() <= 0:
        raise FormatError(f"{frame.path}: {column} is {value.min():g} in row {rows[value.argmin()]}, expected above 0")


def _ids(frame: ThirdPartyFrame, values: np.ndarray, column: str) -> np.ndarray:
    if values.min() < 0 or values.max() > 2**63:
        raise FormatError(f"{frame.path}: {column} is from {values.min():g} to {values.max():g}, expected ids from 0")
    return values.astype(np.uint64)


def _volume_from(named: Collection[str]) -> str | None:
    """Return the quantity that gives volumes: volume, or radius or diameter of a sphere; None where there is none."""
    return next((name for name in ("volume", "radius", "diameter") if name in named), None)


def _mass_and_volume(
    frame: ThirdPartyFrame, found: dict[str, np.ndarray], terms: Declarations
) -> tuple[np.ndarray, np.ndarray]:
    """Return (float64[n] [kg], float64[n] [m3]); NaN where the density is unknown.

    A declared density comes before that of each particle, and this before one number in the files.
    """
    density, each, count = terms.density, _particle_volume(frame, terms), len(found["x"])
    if density is None:
        density = found.get("density", np.nan if frame.density is None else frame.density)
    source = _volume_from(found)
    volume = None if each is None else np.full(count, each)
    if source == "volume":
        volume = found["volume"]
    elif source is not None and each is None:
        volume = 4.0 / 3.0 * np.pi * (found[source] if source == "radius" else found[source] / 2.0) ** 3
    mass = found.get("mass", None if volume is None else density * volume)
    if mass is None:
        mass = np.full(count, np.nan)
    return mass, mass / density if volume is None else volume


def named_columns(frame: ThirdPartyFrame, terms: Declarations) -> dict[str, str]:
    """Return the columns of the frame by name (NAMES): those of the code, changed by --columns.

    Parameters
    ----------
    frame : ThirdPartyFrame
    terms : Declarations

    Raises
    ------
    InputError
        The frame has no column of this name.
    """
    named = {name: column for name, column in frame.column_map.items() if column in frame.columns}
    for name, column in terms.column_pairs():
        if column not in frame.columns and not (name == "time" and frame.time is not None):
            raise InputError(
                f"{frame.path}: --columns {name}={column}: unknown column; it has {', '.join(frame.columns)[:400]}"
            )
        named[name] = column
    return {name: named[name] for name in NAMES if name in named and name != "time"}


def _density(frame, terms):
    return frame.density if terms.density is None else terms.density


def _particle_volume(frame, terms):
    return frame.particle_volume if terms.particle_volume is None else terms.particle_volume


def own_time(frame: ThirdPartyFrame, terms: Declarations) -> float | None:
    """Return the time of a frame: from its number and the user's time step, else from its files.

    Parameters
    ----------
    frame : ThirdPartyFrame
    terms : Declarations

    Returns
    -------
    float or None [s]
        None where unknown.
    """
    step = terms.frame_step if terms.frames_per_second is None else 1.0 / terms.frames_per_second
    if step is not None and frame.number is not None:
        return frame.number * step
    return frame.time


def times_of(frames: Sequence[ThirdPartyFrame], terms: Declarations) -> list[float | None]:
    """Return the time of each frame.

    Parameters
    ----------
    frames : sequence of ThirdPartyFrame
    terms : Declarations

    Returns
    -------
    list of float or None [s]
        None where unknown.

    Raises
    ------
    InputError
        --times has another length than the frames.
    """
    if terms.times is None:
        return [own_time(frame, terms) for frame in frames]
    if len(terms.times) != len(frames):
        raise InputError(f"--times: got {len(terms.times)} times for {len(frames)} frames; give one per frame")
    order = sorted(range(len(frames)), key=lambda k: (series_position(frames[k]), k))
    times = np.empty(len(frames))
    times[order] = terms.times
    return times.tolist()


def series_position(frame: ThirdPartyFrame) -> float:
    """Return the position of a frame in its series: by number, else by time, else 0 (order of the given files).

    Parameters
    ----------
    frame : ThirdPartyFrame
    """
    return next((float(value) for value in (frame.number, frame.time) if value is not None), 0.0)
