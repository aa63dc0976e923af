"""The particles of [release] from a file: a frame of mpmgis, or particles of another code with their declarations."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..exchange.declarations import Declarations
from ..exchange.frame_georeferencing import missing_declarations, third_party_header, third_party_particles, times_of
from ..exchange.frame_list import files_and_reader, third_party_frames
from ..exchange.map_coordinates import Ground
from ..exchange.readers.reader_list import OWN
from ..frames.frame_files import read_frame
from ..scene.tables import OF_PARTICLES
from ..system.errors import InputError, MpmgisError

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..scene import Scene
    from ..terrain.elevation import Terrain

_OF_OTHER_CODES = ("density", *OF_PARTICLES)
_OPTIONS = "|".join((*_OF_OTHER_CODES, "window")).replace("_", "-")
_OPTION = re.compile(rf"--({_OPTIONS})\b")  # of the command, in messages; others, as --trust, `run` has too


def release_dimension(scene: "Scene") -> int:
    """Return the dimension of the particles of [release]: 2 for columns, 3 for points.

    Parameters
    ----------
    scene : Scene

    Raises
    ------
    FormatError, InputError
        No particles, an unknown reader, keys that the file does not need.
    """
    path, table = scene.path(scene.release.particles), scene.release
    if _files_and_reader(scene)[1] != OWN:
        return 3
    given = [key for key in _OF_OTHER_CODES if getattr(table, key) not in (None, OWN)]
    header = read_frame(path, with_state=False, with_particles=False)
    if given:
        raise InputError(
            f"{path} is a frame of mpmgis, which contains these values; remove {', '.join(given)} from [release]"
        )
    return header.dimension


def read_release_particles(scene: "Scene", terrain: "Terrain") -> "Frame":
    """Read the particles of [release]; those of another code are points in the terrain's coordinates.

    Parameters
    ----------
    scene : Scene
    terrain : Terrain
        Coordinates on it need no axes and origin.

    Raises
    ------
    FormatError, InputError
        Damaged; values that neither file nor scene have; several times.
    """
    path, table = scene.path(scene.release.particles), scene.release
    files, reader = _files_and_reader(scene)
    if reader == OWN:
        return read_frame(path)
    with _words_of_scene():
        terms = _terms(scene)
        frames, terms = third_party_frames(files, reader, terms, Ground(terrain=terrain))
        frame = frames[0] if len(frames) == 1 else _at_time(path, frames, terms, table.at_time)
        missing = missing_declarations(frame, terms, with_time=False)
        if missing:
            raise InputError(f"[release] particles: {path} ({reader}) lacks: {'; '.join(missing)}")
        header = third_party_header(reader, frame, terms, 0.0)
        about = {name: value for name, value in header.header.items() if name != "count"}
        return replace(header, header=about, particles=third_party_particles(frame, terms))


def _files_and_reader(scene):
    """Return the files of [release] particles and their reader."""
    with _words_of_scene():
        return files_and_reader([scene.path(scene.release.particles)], scene.release.reader)


def _terms(scene: "Scene") -> Declarations:
    """Return the declarations of [release]."""
    table = scene.release
    return Declarations(
        origin=None if table.origin is None else tuple(map(float, table.origin)),
        axes=table.axes,
        times=None if table.times is None else tuple(map(float, table.times)),
        frame_step=table.dt,
        frames_per_second=table.fps,
        columns=tuple((table.columns or {}).items()),
        density=table.density,
        particle_volume=table.particle_volume,
        sidecar=None if table.sidecar is None else scene.path(table.sidecar),
    )


def _at_time(path, frames, terms, wanted):
    """The frame of one time."""
    times = times_of(frames, terms)
    if any(time is None for time in times):
        raise InputError(f"{path} contains {len(frames)} frames without times; give times, dt or fps, and at_time")
    if wanted is None:
        raise InputError(
            f"{path} contains {len(frames)} frames, from {min(times):g} to {max(times):g} s; choose one with at_time"
        )
    nearest = int(np.argmin(np.abs(np.subtract(times, wanted))))
    if not np.isclose(times[nearest], wanted, rtol=1e-6, atol=1e-9):
        raise InputError(f"{path}: at_time = {wanted:g} s, but the nearest frame is at {times[nearest]:.9g} s")
    return frames[nearest]


@contextmanager
def _words_of_scene() -> Iterator[None]:
    """Name keys of the scene instead of options of the command in the errors of this block."""
    try:
        yield
    except MpmgisError as error:
        error.args = (_OPTION.sub(lambda found: found[1].replace("-", "_"), str(error)),)
        raise
