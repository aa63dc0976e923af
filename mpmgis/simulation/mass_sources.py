"""Read the moving mass of a scene: columns or points at the start, inflow, and secondary releases."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ..conversion.conversion_account import account_of_points
from ..conversion.initial_points import as_columns, particles_in_window, point_options, points_from
from ..exchange.frame_list import files_and_reader
from ..exchange.readers.reader_list import OWN
from ..frames.frame_files import read_frame
from ..frames.particles import Particles
from ..scene.tables import DENSITY, ReleaseTable
from ..seeding.column_seeding import seed_columns
from ..seeding.release_areas import read_release
from ..system.errors import InputError, SceneError
from ..system.messages import log
from ..system.source_names import file_of
from ..terrain.hydrograph_file import read_hydrograph
from ..terrain.release_parts import VERTICAL, polygons_only
from ..terrain.spatial_inputs import read_area
from .memory_need import require_memory_for_points
from .release_events import Events, inlet_of, secondary_releases
from .release_particles import read_release_particles, release_dimension

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..scene import Scene
    from ..solvers.columns.node_grid import ColumnGrid
    from ..terrain.elevation import Terrain

_TOUCHING = 1e-6  # [1] of the smaller area: smaller overlaps are rounding errors of a common border


@dataclass(frozen=True)
class Sources:
    """The columns of one scene.

    Parameters
    ----------
    frame : Frame
        At the start; empty without a release.
    events : Events
    everything : Frame
        All columns of release, inlet (at its largest inflow) and secondary areas, for deciding effects.
    reference_thickness : float or None [m]
        The smallest mean of these; None if there is only the release.
    facts : dict
        Fields of `TerrainFacts` about inflow and secondary releases.
    """

    frame: "Frame"
    events: Events
    everything: "Frame"
    reference_thickness: float | None
    facts: dict


def read_sources(scene: "Scene", terrain: "Terrain", grid: "ColumnGrid") -> Sources:
    """Read the columns of a scene: release, inflow and secondary releases.

    Parameters
    ----------
    scene : Scene
    terrain : Terrain
    grid : ColumnGrid
        Of the solver.

    Returns
    -------
    Sources

    Raises
    ------
    InputError
        The contents of a file are invalid; areas overlap; densities differ.
    """
    release = _release(scene, terrain)
    frame = None if release is None else _start(scene, terrain, grid, release)
    density = _density(scene, frame)
    inlet, reference = _inlet(scene, terrain, grid, density), []
    secondary = _secondary(scene, terrain, grid, density, release)
    frames = [] if frame is None else [frame]
    if inlet is not None:
        frames.append(_standing(inlet))
    frames += [area.frame for area in secondary]
    if frame is None:
        frame = replace(inlet.frame, particles=inlet.frame.particles.take(slice(0, 0)))
    if len(frames) > 1 or inlet is not None:
        reference = [float(np.average(f.particles.thickness, weights=f.particles.mass)) for f in frames]
    events = Events([] if inlet is None else [inlet], secondary)
    everything = _together(frames)
    return Sources(frame, events, everything, min(reference, default=None), _facts(inlet, secondary, frames))


def _release(scene, terrain):
    """Return the ReleaseArea of [release], or its particles as a Frame; None without it."""
    table = scene.release
    if table is None:
        return None
    if table.particles is not None:
        return columns_of(scene.path(table.particles), terrain, DENSITY)
    return _area(scene, table, terrain)


def _start(scene, terrain, grid, release):
    """Return the columns at the start, with their velocity."""
    table = scene.release
    if table.particles is not None:
        return release
    frame = _seeded(scene, terrain, grid, release, table.density, table)
    if table.speed is None:
        return frame
    return replace(frame, particles=replace(frame.particles, velocity=table.speed * grid.downslope(frame)))


def _area(scene, table, terrain):
    thickness, surface = table.thickness, getattr(table, "surface", None)
    if isinstance(thickness, str) and file_of(scene.path(thickness)).exists():
        thickness = str(scene.path(thickness))
    return read_release(
        scene.path(table.source),
        terrain,
        thickness=thickness,
        thickness_mode=table.thickness_mode,
        surface=None if surface is None else scene.path(surface),
    )


def _seeded(scene, terrain, grid, area, density, table=None):
    """Return columns of `area` on the solver's grid cells, in the arrangement of the [release] `table`."""
    west, _, _, north = terrain.grid.bounds
    table = table or ReleaseTable()
    return seed_columns(
        terrain,
        area,
        cell_size=grid.cell_size,
        anchor=(west, north),
        per_cell=scene.columns_per_cell,
        points=table.points,
        density=density,
        velocity=table.velocity,
        seed=table.seed,
    )


def _density(scene, frame):
    """Return the density [kg m-3] of a scene; raise SceneError if its tables differ."""
    named = [] if frame is None else [("[release]", float(frame.header["density"]))]
    named += [(name, density) for name, density in scene.densities() if name != "[release]"]
    for name, density in named[1:]:
        if abs(density - named[0][1]) > 1e-9 * density:
            raise SceneError(
                f"{name} has a density of {density:g} kg m-3 and {named[0][0]} of {named[0][1]:g}; a run has one "
                "density, remove one of them"
            )
    return named[0][1] if named else DENSITY


def _used(table):
    return table is not None and table.use != "off"


def _inlet(scene, terrain, grid, density):
    """Return the Inlet of [hydrograph]; None without it."""
    table = scene.hydrograph
    if not _used(table):
        return None
    hydrograph = read_hydrograph(scene.path(table.file))
    mode = VERTICAL if hydrograph.thickness is None else table.thickness_mode
    area = read_release(scene.path(table.source), terrain, thickness=1.0, thickness_mode=mode)
    inlet = inlet_of(_seeded(scene, terrain, grid, area, density), hydrograph, grid, scene.output.end_time)
    if hydrograph.thickness is None and hydrograph.time[-1] > scene.output.end_time:
        late = hydrograph.volume(scene.output.end_time, np.inf)
        log.info(f"[hydrograph] {late:.6g} m3 would flow in after end_time = {scene.output.end_time:g} s")
    return inlet


def _secondary(scene, terrain, grid, density, release):
    """Return a SecondaryRelease for each polygon of each [[secondary_release]]."""
    others = [("[release]", p) for p in getattr(release, "polygons", ())]
    named = []
    for table in filter(_used, scene.secondary_release):
        area = _area(scene, table, terrain)
        pieces = [(part, piece) for part in area.parts for piece in shapely.get_parts(polygons_only(part.polygon))]
        for number, (part, piece) in enumerate(pieces, 1):
            name = area.name if len(pieces) == 1 else f"{area.name} {number}"
            _require_apart(name, piece, others)
            others.append((f"[[secondary_release]] '{name}'", piece))
            alone = replace(area, parts=(replace(part, name=name, polygon=piece),))
            named.append((name, _seeded(scene, terrain, grid, alone, density), table.trigger_thickness))
    return secondary_releases(named, grid)


def _require_apart(name, polygon, others):
    """Raise InputError for an area that overlaps another one."""
    for other_name, other in others:
        shared = polygon.intersection(other).area
        if shared > _TOUCHING * min(polygon.area, other.area):
            raise InputError(
                f"[[secondary_release]] '{name}' and {other_name} overlap by {shared:.4g} m2; cut one of them (QGIS: "
                "Difference)"
            )


def _standing(inlet):
    """Return the inlet's columns with the thickness at its largest inflow, and the largest entry speed."""
    p, density = inlet.frame.particles, inlet.frame.header["density"]
    thickness = np.full(len(p), inlet.reference_thickness)
    volume = thickness * p.area
    standing = replace(p, thickness=thickness, volume=volume, mass=density * volume, velocity=inlet.fastest_velocity())
    return replace(inlet.frame, particles=standing)


def _together(frames):
    """Return one frame of the columns of all `frames`, relative to the origin of the first."""
    first = frames[0]
    if len(frames) == 1:
        return first
    parts = [
        replace(f.particles, position=f.particles.position + np.subtract(f.origin, first.origin), id=None, parent=None)
        for f in frames
    ]
    names = [name for name in parts[0].arrays() if all(name in part.arrays() for part in parts)]
    return replace(first, particles=Particles(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in names}))


def _facts(inlet, secondary, frames):
    """Return inflow (volume [m3], first and last time [s], batches) and the secondary areas' share of the mass."""
    facts = {}
    if inlet is not None:
        begins, ends = float(inlet.times[0, 0]), float(inlet.times[-1, 1])
        facts["inflow"] = (float(inlet.volumes.sum()), begins, ends, len(inlet.times))
    if secondary:
        mass = sum(float(area.frame.particles.mass.sum()) for area in secondary)
        first = sum(float(frame.particles.mass.sum()) for frame in frames) - mass
        if inlet is not None:
            standing = float(_standing(inlet).particles.mass.sum())
            first += float(inlet.volumes.sum()) * inlet.frame.header["density"] - standing
        facts["secondary"] = (mass / first, len(secondary))
    return facts


def columns_of(
    path: str | Path,
    terrain: "Terrain",
    density: float,
    with_state: bool = False,
    window: shapely.Polygon | None = None,
) -> "Frame":
    """Read columns from a file of `mpmgis seed`, or from an earlier frame, as the start of a run.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain
    density : float [kg m-3]
        For a file without density.
    with_state : bool
        Read the state of the frame too.
    window : shapely.Polygon, optional
        Only particles in it must be on the terrain.

    Raises
    ------
    InputError
        The file contains points, or is in another CRS than the terrain.
    """
    reader = files_and_reader([path])[1]
    frame = None if reader != OWN else read_frame(path, with_state)
    if frame is None or frame.dimension != 2:
        whose = "" if frame is not None else f" of another code ({reader})"
        raise InputError(
            f"{path} contains 3D points{whose}, expected columns; `mpmgis seed` writes them, or set solver = 'points'"
        )
    return start_on_terrain(frame, path, terrain, density, window)


def start_on_terrain(
    frame: "Frame", path: str | Path, terrain: "Terrain", density: float, window: shapely.Polygon | None = None
) -> "Frame":
    """Return a frame that was read from a file as the start of a run, at time 0.

    Parameters
    ----------
    frame : Frame
    path : str or Path
        For messages.
    terrain : Terrain
    density : float [kg m-3]
        For a frame without density.
    window : shapely.Polygon, optional
        Only particles in it, or reaching into it, must be on the terrain.

    Raises
    ------
    InputError
        The frame is in another CRS than the terrain, or particles are outside the terrain.
    """
    if frame.crs is not None and terrain.grid.crs is not None and not frame.crs.equals(terrain.grid.crs, True):
        raise InputError(f"{path} is in {frame.crs.name}, the terrain in {terrain.grid.crs.name}; seed on this terrain")
    if window is not None:
        frame = _without_far(frame, terrain, window)
    _require_on_terrain(frame, path, terrain)
    if frame.dem_sha256 and terrain.sha256 and frame.dem_sha256 != terrain.sha256:
        log.info(f"{path} was made with another DTM file than {terrain.path}: {_terrain_difference(frame, terrain)}")
    header = dict(frame.header)
    header.setdefault("density", float(frame.particles.mass.sum() / frame.particles.volume.sum()) or density)
    return replace(frame, crs=terrain.grid.crs, time=0.0, step=0, header=header)


def _without_far(frame, terrain, window):
    """Return `frame` without particles outside the terrain that do not reach into `window`."""
    west, south, east, north = terrain.grid.bounds
    x, y = frame.map_xy()
    particles = frame.particles
    reach = np.sqrt(particles.area.max(initial=0.0)) if frame.dimension == 2 else 0.0
    off = ~((x >= west) & (x <= east) & (y >= south) & (y <= north))
    far = off & ~shapely.contains_xy(window.buffer(reach), x, y)
    if not far.any():
        return frame
    left = float(particles.mass[far].sum())
    log.info(f"[release] window leaves out {int(far.sum())} particles with {left:.6g} kg outside the terrain")
    state = {name: values[~far] for name, values in frame.state.items() if np.shape(values)[:1] == far.shape}
    return replace(frame, particles=particles.take(~far), state=state)


def _require_on_terrain(frame, path, terrain):
    """Raise InputError for columns outside the terrain, where there is no bed; some points there are only removed."""
    west, south, east, north = terrain.grid.bounds
    x, y = frame.map_xy()
    outside = int(np.count_nonzero(~((x >= west) & (x <= east) & (y >= south) & (y <= north))))
    if outside == len(x) or (outside and frame.dimension == 2):
        raise InputError(
            f"{path}: {outside} of {len(x)} particles lie outside the terrain, E {west:.0f} to {east:.0f}, N "
            f"{south:.0f} to {north:.0f}; give the DTM that was used for them, or a wider [terrain] window"
        )


def _terrain_difference(frame, terrain):
    """Return the difference between `terrain` and that of `frame` in words."""
    x, y = frame.map_xy()
    apart = np.abs(frame.particles.position[:, 2] + frame.origin[2] - terrain.sample(x, y))
    if frame.dimension != 2 or not np.isfinite(apart).any():
        return "their sha256 differ"
    return (
        f"their sha256 differ, the ground under its columns by {np.nanmedian(apart):.3f} m, at most by "
        f"{np.nanmax(apart):.3f} m; its thickness is kept"
    )


@dataclass(frozen=True)
class PointStart:
    """The points of one scene.

    Parameters
    ----------
    frame : Frame
        Dimension 3, at time 0.
    vertical_stress : float64[n] [Pa] or None
        Of their weight; None if unknown.
    affine : float64[n, 3, 3] [s-1] or None
        Velocity gradient; None if unknown or zero.
    seen : Frame
        The same mass as columns, for deciding effects.
    """

    frame: "Frame"
    vertical_stress: np.ndarray | None
    affine: np.ndarray | None
    seen: "Frame"


def read_point_start(scene: "Scene", terrain: "Terrain", grid: "ColumnGrid") -> PointStart:
    """Read the points of a scene, or convert its columns to points.

    Parameters
    ----------
    scene : Scene
    terrain : Terrain
    grid : ColumnGrid
        Of the solver, in plan view.

    Raises
    ------
    InputError
        The contents of a file are invalid; points under the ground; too many points for this machine.
    """
    table, cell_size = scene.release, scene.numerics.cell_size
    path = None if table.particles is None else scene.path(table.particles)
    if path is not None and release_dimension(scene) == 3:
        return _points_of(scene, path, terrain, cell_size, DENSITY, _window(scene, terrain))
    return _converted(_columns_of(scene, path, terrain, grid), scene, terrain)


def _columns_of(scene, path, terrain, grid):
    """Return columns from the file at `path`, or seeded in the release."""
    if path is not None:
        return columns_of(path, terrain, DENSITY, with_state=True, window=_window(scene, terrain))
    return read_sources(scene, terrain, grid).frame


def _converted(columns, scene, terrain):
    """Return points from a frame of columns; the account of the conversion is logged for particles of the user."""
    options = point_options(scene.numerics.cell_size, scene.numerics.points_per_side)
    window = _window(scene, terrain)
    seen = columns if window is None else particles_in_window(columns, window)
    require_memory_for_points(options.predicted_points(seen.particles), options.cell)
    points = points_from(columns, terrain, options, window)
    _log_outside(points.report.outside.mass, points.report.before.mass)
    if scene.release.particles is not None:
        for line in account_of_points(points.report, options)[:2]:
            log.info(line)
    state, frame = points.frame.state, replace(points.frame, state={}, time=0.0, step=0)
    return PointStart(frame, state["vertical_stress"], state.get("affine"), replace(seen, state={}))


def _window(scene, terrain):
    """Return the polygons of [release] window as one; None without it."""
    name = scene.release.window
    return None if name is None else read_area(scene.path(name), terrain)


def _log_outside(outside, mass):
    """Log the mass outside a window."""
    if outside > 0.0:
        log.info(f"[release] window leaves out {outside:.6g} of {mass:.6g} kg ({100 * outside / mass:.2g} %)")


def _points_of(
    scene: "Scene", path: Path, terrain: "Terrain", cell_size: float, density: float, window: shapely.Polygon | None
) -> PointStart:
    """Return points from the file of [release] at `path`, those in `window`."""
    frame = start_on_terrain(read_release_particles(scene, terrain), path, terrain, density, window)
    if window is not None:
        mass = float(frame.particles.mass.sum())
        frame = particles_in_window(frame, window)
        _log_outside(mass - float(frame.particles.mass.sum()), mass)
    stress, affine = frame.particle_state("vertical_stress"), frame.particle_state("affine", 3, 3)
    if stress is None:
        log.info(
            f"{path} contains no stress from the weight of its points (state/vertical_stress): they start without "
            "stress and settle elastically"
        )
    elif not np.isfinite(stress).all():
        raise InputError(
            f"{path}: state/vertical_stress of {int((~np.isfinite(stress)).sum())} of {len(stress)} points is not "
            "finite; correct it or remove it"
        )
    x, y = frame.map_xy()
    above = frame.particles.position[:, 2] + frame.origin[2] - terrain.sample(x, y)
    under = above < -cell_size
    if under.any():
        raise InputError(
            f"{path}: {int(under.sum())} of {len(under)} points start more than a cell of {cell_size:g} m under the "
            f"ground, at most {-above[under].min():.3g} m; use the DTM that was used for them"
        )
    return PointStart(replace(frame, state={}), stress, affine, as_columns(frame, terrain, cell_size))
