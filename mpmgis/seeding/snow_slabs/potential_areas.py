"""Find the potential release areas of snow slabs in a DTM and write them as polygons: `mpmgis release`.

The DTM is classified by blocks, by threads or on a Dask cluster; units and outlines are found on all classes together,
so that blocks leave no trace.
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyproj

from ...frames.region_layers import write_layer
from ...system.errors import InputError
from ...system.memory import memory_lack
from ...system.messages import Progress, log, muted, unwatched
from ...system.parallel import FramePool, frame_pool
from ...system.source_names import file_of
from ...system.whole_files import refuse_existing
from ...terrain.area_masks import AreaMask, read_area_mask
from ...terrain.dtm import BY_BLOCK, TerrainFile, whole_or_parts
from ...terrain.dtm_blocks import Block, block_heights, dtm_blocks
from ...terrain.elevation import Terrain
from .slab_criteria import SCENARIOS, SlabCriteria
from .slab_ground import CRITERIA, SlabGround, halo, slab_ground
from .slab_thickness import NewSnow
from .slab_units import Units, divided
from .unit_means import unit_means
from .unit_outlines import outlines

LAYER = "release_areas"  # name of the layer
SUFFIX = ".gpkg"  # of the file
BLOCK = 1024  # [cells] side of a block
FINE_CELL, COARSE_CELL = 2.0, 15.0  # [m] outside them the thresholds, published for 5 m, are reported as uncertain
_BYTES_PER_CELL = 24  # of the classes of a whole DTM, the numbers of its units and their outlines


@dataclass(frozen=True)
class SlabSearch:
    """What is searched for, and with what.

    Parameters
    ----------
    criteria : SlabCriteria
    snow : NewSnow
    forest : str or Path, optional
        Polygons or raster of the forest, where no slab releases.
    workers : int, optional
        Threads; default one for each core.
    dask : str, optional
        Address of a Dask scheduler.
    block : int [cells]
        Side of a block; it does not change the result.
    """

    criteria: SlabCriteria = SCENARIOS["extreme"]
    snow: NewSnow = field(default_factory=NewSnow)
    forest: str | Path | None = None
    workers: int | None = None
    dask: str | None = None
    block: int = BLOCK


@dataclass(frozen=True)
class SlabAreas:
    """Potential release areas, the largest first.

    Parameters
    ----------
    polygons : object[n]
        Of shapely.Polygon [m], along the sides of cells of the DTM.
    columns : dict of str to array[n]
        name, slope and aspect [degrees], elevation [m], area [m2] in plan, and with a snow depth thickness [m], normal
        to the bed, and volume [m3]; both also by return period, as thickness_30.
    crs : pyproj.CRS or None
    path : Path or None
        File of the areas, where they were written.
    """

    polygons: np.ndarray
    columns: dict
    crs: pyproj.CRS | None
    path: Path | None = None

    @property
    def files(self) -> list[Path]:
        """Files that were written."""
        return [] if self.path is None else [self.path]


def find_slab_areas(terrain: Terrain | TerrainFile, search: SlabSearch, progress: Progress = unwatched) -> SlabAreas:
    """Find the potential release areas of snow slabs in a DTM.

    Parameters
    ----------
    terrain : Terrain or TerrainFile
        A TerrainFile is read by block; a Dask cluster needs one.
    search : SlabSearch
    progress : callable
        Called with (blocks done, blocks in all).

    Raises
    ------
    InputError
        No area meets the criteria; too little memory; or a DTM or forest that cannot be used.
    """
    grid, criteria = terrain.grid, search.criteria
    if lack := memory_lack(_BYTES_PER_CELL * math.prod(grid.shape)):
        raise InputError(
            f"{terrain.path}: {grid.shape[0]} x {grid.shape[1]} cells need {lack}; cut it to the region (rio clip, "
            "QGIS: Clip raster by extent)"
        )
    if not FINE_CELL <= grid.cell_size <= COARSE_CELL:
        log.info(
            f"{terrain.path} has cells of {grid.cell_size:.3g} m; limits of curvature and ruggedness were published "
            f"for 5 m and are uncertain outside {FINE_CELL:g} to {COARSE_CELL:g} m"
        )
    forest = None if search.forest is None else read_area_mask(search.forest, terrain, "forest")
    with frame_pool(search.workers, search.dask) as pool, pool.ended():
        ground = _whole_ground(terrain, forest, search, pool, progress)
    units = divided(ground.classes, ground.aspect, math.ceil(criteria.min_area / grid.cell_area * (1 - 1e-9)))
    if not len(units.cells):
        raise InputError(_nothing_found(terrain, ground, criteria))
    return SlabAreas(outlines(units.labels, grid), _columns(units, ground, grid.cell_area, search.snow), grid.crs)


def write_slab_areas(
    dem: str | Path,
    output: str | Path | None = None,
    search: SlabSearch | None = None,
    *,
    crs: str | None = None,
    dem_band: int | None = None,
    to_crs: str | None = None,
    overwrite: bool = False,
    progress: Progress = unwatched,
) -> SlabAreas:
    """Find the potential release areas of snow slabs in a DTM and write them to a GeoPackage.

    Parameters
    ----------
    dem : str or Path
    output : str or Path, optional
        Default ``<dem name>_release.gpkg`` in the current folder.
    search : SlabSearch, optional
    crs, dem_band, to_crs
        As for `read_terrain`.
    overwrite : bool
    progress : callable
        As for `find_slab_areas`.

    Raises
    ------
    OutputError
        The file exists or cannot be written.
    InputError
        As from `find_slab_areas`; the file is no GeoPackage.
    """
    path = Path(output) if output is not None else Path(f"{file_of(dem).stem}_release{SUFFIX}")
    if path.suffix.lower() != SUFFIX:
        raise InputError(f"{path}: release areas are written as a GeoPackage; give a name that ends with {SUFFIX}")
    refuse_existing(path, overwrite)
    search = search or SlabSearch()
    terrain = whole_or_parts(TerrainFile(dem, crs, dem_band, to_crs=to_crs), BY_BLOCK, search.dask is not None)
    found = replace(find_slab_areas(terrain, search, progress), path=path)
    log.info(_summary(found))
    write_layer(path, LAYER, found.polygons, found.columns, found.crs)
    return found


def _block_ground(
    block: Block, terrain: Terrain | TerrainFile, forest: AreaMask | None, criteria: SlabCriteria
) -> SlabGround:
    """Classify the cells of a block, from its elevations and those of the halo around it."""
    with muted():
        elevation = block_heights(terrain, block, halo(terrain.grid.sides))
        grid = terrain.grid.part(*block.first, block.shape)
        open_ground = np.ones(grid.shape, bool) if forest is None else ~forest.inside(grid)
    return slab_ground(elevation, grid.matrix, open_ground, criteria)


def _whole_ground(
    terrain: Terrain | TerrainFile, forest: AreaMask | None, search: SlabSearch, pool: FramePool, progress: Progress
) -> SlabGround:
    """Classify all cells, block by block."""
    shape = terrain.grid.shape
    whole = SlabGround(
        np.zeros(shape, np.uint8),
        np.zeros(shape, np.uint16),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(CRITERIA, np.int64),
        math.nan,
    )
    blocks = dtm_blocks(terrain, search.block)
    parts = pool.map(_block_ground, blocks, terrain, forest, search.criteria)
    for number, (block, part) in enumerate(zip(blocks, parts, strict=True), 1):
        if part.counts[-1]:  # elsewhere the zeros take no memory
            for here, values in zip(whole[:4], part[:4], strict=True):
                here[block.cells] = values
        whole.counts[:] += part.counts
        whole = whole._replace(steepest=float(np.fmax(whole.steepest, part.steepest)))
        progress(number, len(blocks))
    return whole


def _columns(units: Units, ground: SlabGround, cell_area: float, snow: NewSnow) -> dict[str, np.ndarray]:
    """Return the columns of the areas."""
    slope, surface, elevation = unit_means(units.labels, ground.slope, ground.elevation, len(units.cells))
    area = units.cells * cell_area
    columns = {
        "name": np.array([f"release {k + 1}" for k in range(len(area))], object),
        "slope": slope,
        "aspect": units.aspect,
        "elevation": elevation,
        "area": area,
    }
    thickness = snow.thickness(slope, elevation)
    if not thickness:
        return columns
    largest = thickness[max(thickness)]
    if bare := int(np.count_nonzero(largest == 0)):
        log.info(f"{bare} release areas are too low for any new snow; their thickness is 0")
    columns |= {"thickness": largest, "volume": largest * area * surface}
    for years, one in thickness.items():
        if years:
            columns |= {f"thickness_{years}": one, f"volume_{years}": one * area * surface}
    return columns


def _summary(found: SlabAreas) -> str:
    """Return the message about areas that were found."""
    area = found.columns["area"]
    text = f"{len(area)} release areas of {area.min():.4g} to {area.max():.4g} m2, together {area.sum() / 1e4:.4g} ha"
    if "thickness" not in found.columns:
        return f"{text}; without `snow_depth` they have no thickness"
    thick, volume = found.columns["thickness"], found.columns["volume"]
    return f"{text}; thickness {thick.min():.3g} to {thick.max():.3g} m, volume up to {volume.max():.4g} m3"


def _nothing_found(terrain: Terrain | TerrainFile, ground: SlabGround, criteria: SlabCriteria) -> str:
    """Return the message that no area meets the criteria, with the first criterion that leaves none."""
    band = f"`slope_min` {criteria.slope_min:g} to `slope_max` {criteria.slope_max:g} degrees"
    steep, bent, rugged, open_ground = ground.counts.tolist()
    if not steep:
        steepest = "no cell has a slope" if math.isnan(ground.steepest) else f"the steepest has {ground.steepest:.3g}"
        return (
            f"{terrain.path}: no release area, because no cell has a slope of {band} ({steepest}); choose another "
            "band, or check the unit of the elevations"
        )
    left = f"of {steep} cells with a slope of {band}, {bent} have little curvature, {rugged} of them are smooth"
    if open_ground != rugged:
        left += f", {open_ground} have no forest"
    if open_ground:
        left += f", and none of their units has {criteria.min_area:g} m2 (`min_area`)"
    return f"{terrain.path}: no release area: {left}; raise the limits, or choose another scenario"
