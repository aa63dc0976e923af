"""Maps of a region: largest values of the flows of all release areas, written tile by tile."""

from collections import defaultdict
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import rasterio

from ..laws.quantities import BAND, MEMBER_BANDS, NODATA, Quantity
from ..system.whole_files import whole_file
from ..terrain.raster_input import open_raster
from ..terrain.raster_output import BLOCK, LAYOUT, NAMESPACE, tag_text
from ..terrain.raster_tags import band_metadata, dataset_metadata

if TYPE_CHECKING:
    from ..terrain.grid import Grid


TILE = 4 * BLOCK  # [pixels] along a side; memory follows it, not the DTM
LARGEST = ("h_max", "Ut_max", "p_max")  # bands of the members, a map each
COUNTS = (
    Quantity("areas", "1", "number of release areas whose flow reaches the cell"),
    Quantity("deepest_area", "1", "number of the release area with the largest depth; of equal ones the smallest"),
)
CHANCES = (
    Quantity("frequency", "a-1", "events a year that reach the cell: sum of the areas' frequencies"),
    Quantity("probability", "1", "of at least one event in a year: 1 - exp(-frequency), independent events"),
)


class AreaRaster(NamedTuple):
    """Raster of the maxima of one release area.

    Parameters
    ----------
    number : int
        Number of the area.
    path : Path
    row, column : int
        First row and column of the raster on the DTM.
    extent : (int, int, int, int)
        First row, end, first column, end of the flow, counted in the raster.
    frequency : float [a-1]
        Events a year.
    came_to_rest : bool
        Whether its flow did.
    """

    number: int
    path: object
    row: int
    column: int
    extent: tuple  # first row, end, first column, end, counted in the raster
    frequency: float = 0.0
    came_to_rest: bool = True

    @property
    def place(self) -> tuple[int, int, int, int]:
        """First row, end, first column, end of the flow on the DTM."""
        top, bottom, left, right = self.extent
        return self.row + top, self.row + bottom, self.column + left, self.column + right


def not_at_rest(areas: Iterable[AreaRaster]) -> int:
    """Return the number of areas whose flow did not come to rest.

    Parameters
    ----------
    areas : iterable of AreaRaster
    """
    return sum(not area.came_to_rest for area in areas)


def write_region_maps(
    folder: Path,
    name: str,
    grid: "Grid",
    areas: Iterable[AreaRaster],
    min_depth: float,
    tags: dict,
    frequency: bool = False,
) -> list[Path]:
    """Write the maps of a region as `{name}_h_max.tif`, ...

    The largest values are of all cells with flow; a cell is reached where the largest depth is at least `min_depth`.
    Tiles without flow are not written (sparse). The order of `areas` has no effect.

    Parameters
    ----------
    folder : Path
    name : str
        Beginning of the file names.
    grid : Grid
        Grid of the DTM.
    areas : iterable of AreaRaster
    min_depth : float [m]
    tags : dict
        Metadata of the rasters; the numbers of areas and of those that did not come to rest are added.
    frequency : bool
        Write the map of frequencies and probabilities, too.

    Returns
    -------
    list of Path
        Paths of the maps.
    """
    areas = sorted(areas)
    moving = not_at_rest(areas)
    tags = tags | {"areas": len(areas), "not_at_rest": moving, "came_to_rest": str(not moving).lower()}
    kinds = {key: ((BAND[key],), {}) for key in LARGEST}
    kinds["areas"] = COUNTS, {"dtype": "int32", "nodata": 0, "predictor": 2}
    if frequency:
        kinds["probability"] = CHANCES, {}
    paths = {key: folder / f"{name}_{key}.tif" for key in kinds}
    with ExitStack() as stack:
        files = {}
        for key, (quantities, layout) in kinds.items():
            part = stack.enter_context(whole_file(paths[key]))
            files[key] = stack.enter_context(_file(part, grid, quantities, tags, layout))
        for (row, column), there in sorted(_by_tile(areas).items()):
            place = row, min(row + TILE, grid.shape[0]), column, min(column + TILE, grid.shape[1])
            for key, bands in _tile(there, place, min_depth, frequency).items():
                window = ((place[0], place[1]), (place[2], place[3]))
                files[key].write(bands, window=window)
    return list(paths.values())


def _file(
    path: Path, grid: "Grid", quantities: tuple[Quantity, ...], tags: dict, layout: dict
) -> rasterio.io.DatasetWriter:
    """Open a new raster on `grid` with a band for each quantity."""
    rows, columns = grid.shape
    crs = None if grid.crs is None else rasterio.crs.CRS.from_wkt(grid.crs.to_wkt())
    target = rasterio.open(
        path,
        "w",
        **(LAYOUT | layout),
        crs=crs,
        transform=grid.transform,
        width=columns,
        height=rows,
        count=len(quantities),
    )
    target.update_tags(**dataset_metadata(quantities, tags))
    target.update_tags(ns=NAMESPACE, **{key: tag_text(value) for key, value in tags.items()})
    for band, quantity in enumerate(quantities, 1):
        target.set_band_description(band, quantity.band)
        target.set_band_unit(band, quantity.unit)
        target.update_tags(band, **band_metadata(quantity))
    return target


def _by_tile(areas: list[AreaRaster]) -> dict[tuple[int, int], list[AreaRaster]]:
    """Return the areas with flow in each tile, in their order, by first row and first column of the tile."""
    tiles = defaultdict(list)
    for area in areas:
        top, bottom, left, right = area.place
        for row in range(top - top % TILE, bottom, TILE):
            for column in range(left - left % TILE, right, TILE):
                tiles[row, column].append(area)
    return tiles


def _tile(
    areas: list[AreaRaster], place: tuple[int, int, int, int], min_depth: float, frequency: bool
) -> dict[str, np.ndarray]:
    """Return the bands [bands, rows, columns] of one tile by the keys of the maps, nodata where there is none."""
    shape = place[1] - place[0], place[3] - place[2]
    largest = {key: np.full(shape, np.float32(NODATA), np.float32) for key in LARGEST}
    counts, often = np.zeros((2, *shape), np.int32), np.zeros(shape)
    deepest = np.zeros(shape, np.float32)
    for area in areas:
        cells, values = _values(area, place)
        for key in LARGEST:
            kept, new = largest[key][cells], values[key]
            kept[...] = np.where(np.isnan(new), kept, np.where(kept == np.float32(NODATA), new, np.fmax(kept, new)))
        depth = np.nan_to_num(values["h_max"], nan=-1.0)
        reached = depth >= np.float32(min_depth)
        counts[0][cells] += reached
        deeper = reached & (depth > deepest[cells])
        counts[1][cells][deeper] = area.number
        deepest[cells][deeper] = depth[deeper]
        often[cells] += area.frequency * reached
    bands = {key: values[None] for key, values in largest.items()} | {"areas": counts}
    if frequency:
        both = np.stack([often, -np.expm1(-often)])
        bands["probability"] = np.where(counts[0] > 0, both, NODATA).astype(np.float32)
    return bands


def _values(area: AreaRaster, place: tuple[int, int, int, int]) -> tuple[tuple[slice, slice], dict[str, np.ndarray]]:
    """Read the values of an area within a tile.

    Returns
    -------
    cells : (slice, slice)
        Rows and columns in the tile.
    values : dict
        Band -> float32[rows, columns], NaN without flow.
    """
    top, bottom, left, right = area.place
    top, bottom = max(top, place[0]), min(bottom, place[1])
    left, right = max(left, place[2]), min(right, place[3])
    window = ((top - area.row, bottom - area.row), (left - area.column, right - area.column))
    with open_raster(area.path) as source:
        read = source.read([MEMBER_BANDS.index(key) + 1 for key in LARGEST], window=window)
        read[read == np.float32(source.nodata)] = np.nan
    cells = slice(top - place[0], bottom - place[0]), slice(left - place[2], right - place[2])
    return cells, dict(zip(LARGEST, read, strict=True))
