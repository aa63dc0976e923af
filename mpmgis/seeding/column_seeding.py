"""Seeding of columns on a terrain: Algorithm 1 of MOX report 15/2025."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .. import __version__
from ..frames.particles import Frame, Particles
from ..system.errors import InputError
from ..system.messages import log
from ..terrain.dtm import TerrainFile
from ..terrain.elevation import Terrain
from ..terrain.georeference import name_of
from ..terrain.release_parts import ReleaseArea, require_on_terrain
from . import raster_values
from .column_sources import column_sources
from .part_scene import PartScene
from .release_bed import bed_under, extended_elevation, steepness
from .release_volume import PartVolume, part_volume
from .seeding_options import SeedOptions

THINNEST = 1e-9  # [m] mean thickness of a release; no unit of length makes a flow of less
_LARGEST_CLOSURE = 0.02  # [1] of the volume; with more the thickness raster is too coarse for the columns
_SLAB = 1 << 20  # [columns] made at a time; 100 MB


def seed_columns(terrain: Terrain, release: ReleaseArea, **options: object) -> Frame:
    """Seed columns of material on a terrain, at time 0.

    Parameters
    ----------
    terrain : Terrain
    release : ReleaseArea
        In the terrain's CRS.
    **options
        Fields of `SeedOptions`: cell_size, anchor, per_cell | count | spacing, points, mass, density, refine_slope,
        velocity, seed.

    Returns
    -------
    Frame
        Of dimension 2. Its origin is the terrain's south-west corner in whole metres at height 0; its `header` has the
        seed's record.

    Raises
    ------
    InputError
        The release leaves the terrain, lies on nodata, or is too coarse for its raster; impossible options.
    """
    return plan_seed(terrain, release, **options).frame()


def plan_seed(terrain: Terrain | TerrainFile, release: ReleaseArea, **options: object) -> "Seed":
    """Plan columns of material on a terrain; they are made later, in slabs of any size.

    Parameters
    ----------
    terrain : Terrain or TerrainFile
        Of a TerrainFile no more is read than what lies under the release.
    release : ReleaseArea
        In the terrain's CRS.
    **options
        Fields of `SeedOptions`.

    Raises
    ------
    InputError
        As from `seed_columns`.
    """
    options = SeedOptions(**options)
    for part in release.parts:
        require_on_terrain(part, terrain.grid)
    near = bed_under(release.parts, terrain)
    volumes = [part_volume(part, release.thickness_mode, near) for part in release.parts]
    _require_thickness(volumes)
    origin = float(math.floor(terrain.grid.bounds[0])), float(math.floor(terrain.grid.bounds[1]))
    bed = np.ascontiguousarray(extended_elevation(near))
    scenes = [PartScene(origin, bed, near.grid, d.raster.values, d.raster.grid) for d in volumes]
    slope = (steepness(near), near.grid) if options.refine_slope else None
    sources = column_sources(terrain.grid, release, volumes, scenes, slope, options)
    closure = _close(sources, scenes, volumes, options)
    record = _record(terrain, release, options, volumes, closure)
    if options.mass == "paper":
        log.info(
            f"mass 'paper' gives every column the same mass whatever its thickness, so a grid sees the mean thickness: "
            f"predicted relative error of the thickness field {100 * record['predicted_field_error']:.1f} %"
        )
    return Seed(sources, scenes, closure.law, near, options.velocity, origin, record)


@dataclass(frozen=True, eq=False)
class _Closure:
    """Closure of the columns' mass to the reference volume.

    Parameters
    ----------
    law : float64[3]
        Factor, density, volume of every column or 0, as in Ground.
    volume : float [m3]
        Reference volume.
    lightest, heaviest : float [m3]
        Smallest and largest volume of a column.
    """

    law: np.ndarray
    volume: float
    lightest: float
    heaviest: float


def _require_thickness(volumes):
    """Refuse a release whose mean thickness is below THINNEST: no unit of length makes one of a flow."""
    mean = math.fsum(part.volume for part in volumes) / math.fsum(part.area for part in volumes)
    if not mean >= THINNEST:
        raise InputError(
            f"release: its mean thickness is {mean:.3g} m, expected at least {THINNEST:g} m; check the thickness's unit"
        )


def _close(sources: list, scenes: list[PartScene], volumes: list[PartVolume], options: SeedOptions) -> _Closure:
    """Return the closure of the total mass: one factor k for mode T, one mass for modes E and P."""
    volume = math.fsum(part.volume for part in volumes)
    number = sum(source.count for source in sources)
    if options.mass != "thickness":
        each = volume / number
        return _Closure(np.array([1.0, options.density, each]), volume, each, each)
    pairs = zip(sources, scenes, strict=True)
    sums = np.vstack([source.fill(0, len(source.counts), scene, np.zeros(3)) for source, scene in pairs])
    factor = volume / math.fsum(sums[:, 0])
    if abs(factor - 1.0) > _LARGEST_CLOSURE:
        raise InputError(
            f"release: the columns hold {100 / factor:.1f} % of its volume {volume:.6g} m3, expected within "
            f"{100 * _LARGEST_CLOSURE:g} %; the thickness raster is too coarse or too rough for this spacing: use "
            "more columns"
        )
    lightest, heaviest = factor * float(sums[:, 1].min()), factor * float(sums[:, 2].max())
    return _Closure(np.array([factor, options.density, 0.0]), volume, lightest, heaviest)


def _record(
    terrain: Terrain | TerrainFile,
    release: ReleaseArea,
    options: SeedOptions,
    volumes: list[PartVolume],
    closure: _Closure,
) -> dict:
    """Return the record of the seed for the frame's header: plain numbers and strings."""
    area = math.fsum(part.area for part in volumes)
    mean = closure.volume / area
    mean_square = math.fsum(part.square for part in volumes) / area
    error = math.sqrt(max(mean_square - mean**2, 0.0) / mean_square)
    cells = options.cells(terrain.grid)
    record = {
        "release": release.name,
        "release_path": release.path,
        "release_sha256": release.sha256,
        "release_area": release.area,
        "thickness_mode": release.thickness_mode,
        "density": float(options.density),
        "reference_volume": closure.volume,
        "reference_mass": closure.volume * options.density,
        "closure_factor": float(closure.law[0]),
        "mass_mode": options.mass,
        "points": options.points,
        "refine_slope": float(options.refine_slope),
        "seed": int(options.seed),
        "cell_corner": list(map(float, cells.origin)),
        "cell_matrix": cells.matrix.ravel().tolist(),
        "lightest_column": closure.lightest * options.density,
        "heaviest_column": closure.heaviest * options.density,
        "dem_transform": list(map(float, terrain.grid.transform[:6])),
        "version": __version__,
        **release.record,
    }
    asked = {name: getattr(options, name) for name in ("per_cell", "count", "spacing")}
    record.update({f"asked_{name}": value for name, value in asked.items() if value is not None})
    if options.mass == "paper":
        record["predicted_field_error"] = error
    return record


class Seed:
    """A planned seed: everything is counted and closed, the columns themselves are made slab by slab.

    Parameters
    ----------
    sources : list
        Sources of columns, one a part of the release.
    scenes : list of PartScene
    law : float64[3]
        As in Ground.
    terrain : Terrain
        Part of the terrain around the release.
    velocity : (float, float) [m s-1]
        To the east and north.
    origin : (float, float) [m]
        x, y of the particles' origin.
    record : dict

    Attributes
    ----------
    count : int
        Number of columns.
    record : dict
        Numbers and strings that go into the frame's header; among them `reference_volume` [m3], `reference_mass` [kg]
        and `closure_factor` [1].
    """

    def __init__(
        self,
        sources: list,
        scenes: list[PartScene],
        law: np.ndarray,
        terrain: Terrain,
        velocity: tuple[float, float],
        origin: tuple[float, float],
        record: dict,
    ):
        self._sources, self._scenes, self._law = sources, scenes, law
        self._terrain, self._velocity, self._origin = terrain, tuple(map(float, velocity)), origin
        self.count = sum(source.count for source in sources)
        self.record = record

    def empty_frame(self) -> Frame:
        """Return the Frame without its particles: time, CRS, origin, header."""
        return Frame(
            Particles(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0)),
            dimension=2,
            solver="seed",
            crs=self._terrain.grid.crs,
            origin=(*self._origin, 0.0),
            dem=self._terrain.path,
            dem_sha256=self._terrain.sha256,
            header=self.record | self._terrain_facts(),
        )

    def _terrain_facts(self) -> dict:
        """Return how the file of the DTM is reprojected, where it is not in metres, or not in the CRS of the frame."""
        how = self._terrain.reprojection
        return {} if how is None else {"to_crs": how.word, "dem_crs": name_of(how.source)}

    def frame(self) -> Frame:
        """Return all columns in one Frame."""
        (particles,) = self.slabs(self.count)
        return replace(self.empty_frame(), particles=particles)

    def slabs(self, size: int = _SLAB) -> Iterator[Particles]:
        """Yield the particles in order, slab by slab.

        Parameters
        ----------
        size : int
            About so many particles at a time; at least one row of cells.

        Yields
        ------
        Particles
        """
        start = 0
        for group in self._groups(size):
            particles = self._fill(group, start)
            start += len(particles)
            yield particles

    def _groups(self, size: int) -> Iterator[list[tuple]]:
        """Yield lists of (source, scene, first block, block after the last) that hold at most about `size` columns."""
        group, held = [], 0
        for source, scene in zip(self._sources, self._scenes, strict=True):
            first, blocks = 0, len(source.counts)
            ends = np.cumsum(source.counts)
            while first < blocks:
                before = ends[first - 1] if first else 0
                last = int(np.searchsorted(ends, before + size - held, side="right"))
                if last <= first and not held:
                    last = first + 1
                if last > first:
                    group.append((source, scene, first, last))
                    held += int(ends[last - 1] - before)
                    first = last
                if first < blocks:
                    yield group
                    group, held = [], 0
        if group:
            yield group

    def _fill(self, group, start):
        sizes = [int(source.counts[first:last].sum()) for source, _, first, last in group]
        n = sum(sizes)
        position, columns, at = np.empty((n, 3)), np.empty((4, n)), 0
        for (source, scene, first, last), m in zip(group, sizes, strict=True):
            source.fill(first, last, scene, self._law, position, columns, at)
            at += m
        thickness, area, volume, mass = columns
        number = np.arange(start, start + n, dtype=np.uint64)
        return Particles(position, self._tangent_velocity(position), mass, volume, thickness, area, number)

    def _tangent_velocity(self, position: np.ndarray) -> np.ndarray:
        """Return the given (east, north) velocity with the vertical part u . grad b, float64[n, 3] [m s-1]."""
        velocity = np.zeros((len(position), 3))
        if any(self._velocity):
            near = self._terrain.grid.moved(-self._origin[0], -self._origin[1])
            row, column = near.rowcol(position[:, 0], position[:, 1])
            velocity[:, :2] = self._velocity
            for axis in (0, 1):
                slope = np.ascontiguousarray(self._terrain.gradient[..., axis])
                velocity[:, 2] += self._velocity[axis] * raster_values.valid_values(slope, row, column)
        return velocity
