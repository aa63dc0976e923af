"""Another code's file of particles, and the frame that it makes with what the user says besides.

A reader is one module that offers `READER`, a ForeignReader; a row in `foreign/readers` brings it in. It parses, and
tells what the file says of itself; what that means on the map is decided here, the same for all codes. Nothing is
guessed: what neither file nor user says is asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...errors import FormatError, InputError
from ...particles import Frame, Particles
from .terms import NAMES, axis_matrix

PLACE, VELOCITY = ("x", "y", "z"), ("vx", "vy", "vz")


@dataclass(frozen=True)
class ForeignFile:
    """What one file says.

    Parameters
    ----------
    count : int
        Particles in it.
    columns : tuple of str
        Its columns.
    read : callable
        `read(names)` gives float64[n] (ids: uint64[n]) of each of some columns, by name.
    meant : dict of str to str
        Our names (`terms.NAMES`) and the columns that this code has for them.
    number : int or None
        Its number in the series.
    time : float or None
        [s], where the file stores it.
    frames_per_second : float or None
        [s-1], where the code says it.
    particle_volume, density, cell_size : float or None
        [m3] of every particle, [kg m-3], [m] of the code's grid, where they are said.
    axes_word : str
        A word on where the axes of this code's files usually point, for the question.
    """

    count: int
    columns: tuple
    read: Callable
    meant: dict = field(default_factory=dict)
    number: int | None = None
    time: float | None = None
    frames_per_second: float | None = None
    particle_volume: float | None = None
    density: float | None = None
    cell_size: float | None = None
    axes_word: str = ""


class ForeignReader(NamedTuple):
    """A code's reader: its `name`, `pattern` of its files in a folder, `recognises(path)`, `open(path)`."""

    name: str
    pattern: str
    recognises: Callable
    open: Callable


def require_told(path, reader, file, terms):
    """Refuse a file that, with what the user says, does not tell all that a frame needs: one line with every cure."""
    missing = untold(path, file, terms)
    if missing:
        raise InputError(f"{path} ({reader}) does not say: {'; '.join(missing)}")


def untold(path, file, terms):
    """What neither file nor user says of all that a frame needs, each with its option; time is `times_of`'s."""
    named = named_columns(path, file, terms)
    missing = [f"a column for {name} (--columns {name}=COLUMN)" for name in (*PLACE, *VELOCITY) if name not in named]
    if "volume" not in named and _particle_volume(file, terms) is None and "mass" not in named:
        missing.append("the particles' volume (--particle-volume V, in m3)")
    if not {"mass", "volume"} <= set(named) and _density(file, terms) is None:
        missing.append("the density (--density R, in kg m-3)")
    if terms.axes is None:
        missing.append(f"where its axes point (--axes{file.axes_word or ' e,n,u or e,u,-n or ..'})")
    if terms.origin is None:
        missing.append("where its origin lies (--origin E,N,H; 0,0,0 if it is in the map's own coordinates)")
    return missing


def foreign_header(path, reader, file, terms, time):
    """The Frame of a file without its particles: `header` says their `count`."""
    header = {"count": file.count}
    density = _density(file, terms)
    header |= {"density": density} if density is not None else {}
    header |= {"cell_size": file.cell_size} if file.cell_size is not None else {}
    return Frame(
        None, time=time, step=file.number or 0, dimension=3, solver=reader, crs=terms.crs,
        origin=tuple(map(float, terms.origin or (0.0, 0.0, 0.0))), header=header,
    )  # fmt: skip


def foreign_particles(path, file, terms):
    """Particles of a file: place and velocity turned to (E, N, up), mass and volume as file and user say.

    Raises
    ------
    FormatError
        Values that are not finite, masses or volumes that are not above 0.
    """
    named = named_columns(path, file, terms)
    values = file.read(tuple(dict.fromkeys(named.values())))
    found = {name: values[column] for name, column in named.items()}
    for name, value in found.items():
        bad = np.flatnonzero(~np.isfinite(value))
        if bad.size:
            raise FormatError(
                f"{path}: {bad.size} values of {named[name]} are NaN or infinite, the first in row {bad[0]}"
            )
        if name in ("mass", "volume") and value.min() <= 0:
            raise FormatError(f"{path}: {named[name]} is {value.min():g} in row {value.argmin()}, wanted above 0")
    matrix = np.eye(3) if terms.axes is None else axis_matrix(terms.axes)
    place, velocity = (np.stack([found[name] for name in names], axis=1) @ matrix for names in (PLACE, VELOCITY))
    mass, volume = _mass_and_volume(file, found, terms)
    ids = found.get("id", np.arange(file.count)).astype(np.uint64)
    return Particles(np.ascontiguousarray(place), np.ascontiguousarray(velocity), mass, volume, id=ids)


def _mass_and_volume(file, found, terms):
    """(float64[n] [kg], float64[n] [m3]); NaN where nothing tells the density."""
    density, each = _density(file, terms), _particle_volume(file, terms)
    density = np.nan if density is None else density
    volume = found.get("volume", None if each is None else np.full(file.count, each))
    mass = found.get("mass", None if volume is None else density * volume)
    if mass is None:
        mass = np.full(file.count, np.nan)
    return mass, mass / density if volume is None else volume


def named_columns(path, file, terms):
    """Dict of our names and the file's columns for them: the code's own, changed by --columns."""
    named = {name: column for name, column in file.meant.items() if column in file.columns}
    for name, column in terms.columns:
        if column not in file.columns:
            raise InputError(
                f"{path}: --columns {name}={column}: it has no such column, only {', '.join(file.columns)}"
            )
        named[name] = column
    return {name: named[name] for name in NAMES if name in named}


def _density(file, terms):
    return file.density if terms.density is None else terms.density


def _particle_volume(file, terms):
    return file.particle_volume if terms.particle_volume is None else terms.particle_volume


def times_of(paths, reader, files, terms):
    """Time [s] of each file: as the user says, else as the code does.

    Raises
    ------
    InputError
        Nobody says it, or not for each file.
    """
    numbers = [file.number for file in files]
    if terms.times is not None:
        if len(terms.times) != len(files):
            raise InputError(f"--times: got {len(terms.times)} times for {len(files)} files; give one for each file")
        order = np.argsort([k if number is None else number for k, number in enumerate(numbers)], kind="stable")
        times = np.empty(len(files))
        times[order] = terms.times
        return times.tolist()
    step = terms.time_step if terms.frames_per_second is None else 1.0 / terms.frames_per_second
    if step is not None and None not in numbers:
        return [number * step for number in numbers]
    if all(file.time is not None for file in files):
        return [file.time for file in files]
    if step is None and None not in numbers and all(file.frames_per_second for file in files):
        return [file.number / file.frames_per_second for file in files]
    silent = next(path for path, file in zip(paths, files, strict=True) if file.time is None)
    cure = (
        "--times T,.." if None in numbers else "--fps F (frames per second), --dt S (seconds a frame) or --times T,.."
    )
    raise InputError(f"{silent} ({reader}) does not say its time: give {cure}")
