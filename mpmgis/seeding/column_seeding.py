"""Seeding of columns on a terrain: Algorithm 1 of MOX report 15/2025."""

import math
from dataclasses import dataclass, replace

import numpy as np

from .. import __version__
from ..frames.particles import Frame, Particles
from ..system.errors import InputError
from ..system.messages import log
from ..terrain.georeference import name_of
from ..terrain.grid import Grid
from ..terrain.release_parts import require_on_terrain
from . import cell_fill, raster_values
from .column_sources import column_sources
from .release_bed import bed_under, extended_elevation, steepness
from .release_thickness import deposit_of
from .seeding_options import SeedOptions

THINNEST = 1e-9  # [m] mean thickness of a release
_LARGEST_CLOSURE = 0.02  # beyond it the region is too coarse for its raster
_SLAB = 1 << 20  # [columns]


def seed_columns(terrain, release, **options):
    """Columns of material on `terrain`: a Frame of dimension 2 at time 0.

    Parameters
    ----------
    terrain : Terrain
    release : ReleaseArea
        In the terrain's CRS.
    **options
        As in `SeedOptions`: cell_size, anchor, per_cell | count | spacing, points, mass, density, refine_slope,
        velocity, seed.

    Returns
    -------
    Frame
        Its origin is the terrain's south-west corner in whole metres at height 0; its `header` has the seed's record.

    Raises
    ------
    InputError
        The release leaves the terrain, lies on nodata, or is too coarse for its raster; impossible options.
    """
    return plan_seed(terrain, release, **options).frame()


def plan_seed(terrain, release, **options):
    """As `seed_columns`, but answers a `Seed` whose columns are still to be made, in slabs of any size.

    `terrain` may be a TerrainFile, too: no more of it is read than what lies under the release.
    """
    options = SeedOptions(**options)
    for part in release.parts:
        require_on_terrain(part, terrain.grid)
    near = bed_under(release.parts, terrain)
    deposits = [deposit_of(part, release.thickness_mode, near) for part in release.parts]
    _require_thickness(deposits)
    origin = float(math.floor(terrain.grid.bounds[0])), float(math.floor(terrain.grid.bounds[1]))
    bed = np.ascontiguousarray(extended_elevation(near))
    scenes = [PartScene(origin, bed, near.grid, d.raster.values, d.raster.grid) for d in deposits]
    slope = (steepness(near), near.grid) if options.refine_slope else None
    sources = column_sources(terrain.grid, release, deposits, scenes, slope, options)
    closure = _close(sources, scenes, deposits, options)
    record = _record(terrain, release, options, deposits, closure)
    if options.mass == "paper":
        log.info(
            f"mass 'paper' gives every column the same mass whatever its thickness, so a grid sees the mean thickness: "
            f"predicted relative error of the thickness field {100 * record['predicted_field_error']:.1f} %"
        )
    return Seed(sources, scenes, closure.law, near, options.velocity, origin, record)


@dataclass(frozen=True, eq=False)
class PartScene:
    """What a kernel reads for one part: bed and vertical thickness rasters [m] on their grids, origin (x, y) [m]."""

    origin: tuple
    bed: np.ndarray
    bed_grid: Grid
    thickness: np.ndarray
    thickness_grid: Grid

    def ground(self, lattice, window, law):
        """The Ground of kernels for the cells of `window`; `law` as in `Ground`."""
        return cell_fill.Ground(
            lattice.map_affine(window, self.origin),
            self.bed,
            lattice.raster_affine(window, self.bed_grid),
            self.thickness,
            lattice.raster_affine(window, self.thickness_grid),
            law,
        )


@dataclass(frozen=True, eq=False)
class _Closure:
    """How the columns' mass meets the reference: `law` (factor, density, volume of every column or 0) for kernels."""

    law: np.ndarray
    volume: float
    lightest: float
    heaviest: float


def _require_thickness(deposits):
    """Refuse a release whose mean thickness is below THINNEST: no unit of length makes one of a flow."""
    mean = math.fsum(deposit.volume for deposit in deposits) / math.fsum(deposit.area for deposit in deposits)
    if not mean >= THINNEST:
        raise InputError(
            f"release: its mean thickness is {mean:.3g} m, expected at least {THINNEST:g} m; check the thickness's unit"
        )


def _close(sources, scenes, deposits, options):
    """Closure of the total mass: one factor k for mode T, one mass for modes E and P."""
    volume = math.fsum(deposit.volume for deposit in deposits)
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


def _record(terrain, release, options, deposits, closure):
    """Record of the seed for the frame's header: plain numbers and strings."""
    area = math.fsum(deposit.area for deposit in deposits)
    mean = closure.volume / area
    mean_square = math.fsum(deposit.square for deposit in deposits) / area
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

    Attributes
    ----------
    count : int
    record : dict
        Numbers and strings that go into the frame's header; among them `reference_volume` [m3], `reference_mass` [kg]
        and `closure_factor` [1].
    """

    def __init__(self, sources, scenes, law, terrain, velocity, origin, record):
        self._sources, self._scenes, self._law = sources, scenes, law
        self._terrain, self._velocity, self._origin = terrain, tuple(map(float, velocity)), origin
        self.count = sum(source.count for source in sources)
        self.record = record

    def empty_frame(self):
        """The Frame without its particles: time, CRS, origin, header."""
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

    def _terrain_facts(self):
        """What the file of the DTM has to be brought to, where it is not in metres, or not in the CRS of the frame."""
        how = self._terrain.reprojection
        return {} if how is None else {"to_crs": how.word, "dem_crs": name_of(how.source)}

    def frame(self):
        """All columns in one Frame."""
        (particles,) = self.slabs(self.count)
        return replace(self.empty_frame(), particles=particles)

    def slabs(self, size=_SLAB):
        """Particles in order, about `size` at a time (at least one row of cells)."""
        start = 0
        for group in self._groups(size):
            particles = self._fill(group, start)
            start += len(particles)
            yield particles

    def _groups(self, size):
        """Lists of (source, scene, first block, block after the last) that hold at most about `size` columns."""
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

    def _tangent_velocity(self, position):
        """float64[n, 3] [m s-1]: the given (east, north) velocity with the vertical part u . grad b."""
        velocity = np.zeros((len(position), 3))
        if any(self._velocity):
            near = self._terrain.grid.moved(-self._origin[0], -self._origin[1])
            row, column = near.rowcol(position[:, 0], position[:, 1])
            velocity[:, :2] = self._velocity
            for axis in (0, 1):
                slope = np.ascontiguousarray(self._terrain.gradient[..., axis])
                velocity[:, 2] += self._velocity[axis] * raster_values.valid_values(slope, row, column)
        return velocity
