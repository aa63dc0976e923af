"""The folder of a region: release areas with their results, maps tile by tile, record."""

import json
import warnings
from collections import defaultdict
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rasterio

from ..laws.quantities import BAND, MEMBER_BANDS, NODATA, Quantity
from ..system.errors import FormatError, OutputError, one_line
from ..system.folder_lock import LOCK_FILE, sole_writer
from ..system.links import input_at, input_inside, refuse_links
from ..system.optional_libraries import GEOPACKAGE
from ..system.whole_files import output_error, refuse_other, whole_file
from ..terrain.raster_metadata import band_metadata, dataset_metadata
from ..terrain.raster_output import BLOCK, LAYOUT, NAMESPACE, tag_text
from .run_folder import versions

LAYER, FOOTPRINTS = "areas", "footprints"
TILE = 4 * BLOCK  # [pixels] along a side; memory follows it, not the DTM
LARGEST = ("h_max", "Ut_max", "p_max")
COUNTS = (
    Quantity("areas", "1", "number of release areas whose flow reaches the cell"),
    Quantity("deepest_area", "1", "number of the release area with the largest depth; of equal ones the smallest"),
)
CHANCES = (
    Quantity("frequency", "a-1", "events a year that reach the cell: sum of the areas' frequencies"),
    Quantity("probability", "1", "of at least one event in a year: 1 - exp(-frequency), independent events"),
)
RECORD_FILE, AREAS_FILE, RUNS, MAPS = "region.json", "areas.gpkg", "runs", "maps"


def write_footprint_layer(path, shapes, columns, crs):
    """Write a GeoPackage of the footprints of areas: `shapes` with `columns` (name -> sequence)."""
    write_layer(path, FOOTPRINTS, shapes, columns, crs)


def write_layer(path, layer, shapes, columns, crs):
    """Write a GeoPackage with one `layer`: `shapes` with `columns` (name -> sequence)."""
    import geopandas  # 0.5 s

    table = geopandas.GeoDataFrame(columns, geometry=shapes, crs=crs)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a local frame has no CRS
        table.to_file(part, layer=layer, driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)


class AreaRaster(NamedTuple):
    """Maxima of one area: its number, raster, first row and column on the DTM, extent in it, events a year."""

    number: int
    path: object
    row: int
    column: int
    extent: tuple  # first row, end, first column, end, counted in the raster
    frequency: float = 0.0

    @property
    def place(self):
        """(first row, end, first column, end) on the DTM."""
        top, bottom, left, right = self.extent
        return self.row + top, self.row + bottom, self.column + left, self.column + right


def write_region_maps(folder, name, grid, areas, min_depth, tags, frequency=False):
    """Write the maps of `areas` (AreaRaster) as `{name}_h_max.tif`, ...; returns the paths.

    The largest values are of all cells with flow; a cell is reached where the largest depth is at least `min_depth`.
    Tiles without flow are not written (sparse). The order of `areas` has no effect.
    """
    areas = sorted(areas)
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


def _file(path, grid, quantities, tags, layout):
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


def _by_tile(areas):
    """(first row, first column) of a tile -> the areas with flow in it, in their order."""
    tiles = defaultdict(list)
    for area in areas:
        top, bottom, left, right = area.place
        for row in range(top - top % TILE, bottom, TILE):
            for column in range(left - left % TILE, right, TILE):
                tiles[row, column].append(area)
    return tiles


def _tile(areas, place, min_depth, frequency):
    """Key of a map -> its bands [bands, rows, columns] in one tile, nodata where there is none."""
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


def _values(area, place):
    """((slices in the tile), {band: float32[rows, columns], NaN without flow}) of an area within a tile."""
    top, bottom, left, right = area.place
    top, bottom = max(top, place[0]), min(bottom, place[1])
    left, right = max(left, place[2]), min(right, place[3])
    window = ((top - area.row, bottom - area.row), (left - area.column, right - area.column))
    with rasterio.open(area.path) as source:
        read = source.read([MEMBER_BANDS.index(key) + 1 for key in LARGEST], window=window)
        read[read == np.float32(source.nodata)] = np.nan
    cells = slice(top - place[0], bottom - place[0]), slice(left - place[2], right - place[2])
    return cells, dict(zip(LARGEST, read, strict=True))


class RegionFolder:
    """One region on disk; every file in it appears whole or not at all.

    Parameters
    ----------
    path : path
    digest : str
        Of all areas and of the scene; a folder with another digest is not continued without `overwrite`.

    Raises
    ------
    OutputError
    """

    def __init__(self, path, digest, overwrite=False):
        self.path, self.digest = Path(path), digest
        self.runs, self.maps, self.areas = self.path / RUNS, self.path / MAPS, self.path / AREAS_FILE
        refuse_links(self.path, (LOCK_FILE, RECORD_FILE, AREAS_FILE, RUNS, MAPS))
        if not self.path.exists():
            return
        if not (self.path / RECORD_FILE).is_file():
            if not self.path.is_dir() or any(entry.name != LOCK_FILE for entry in self.path.iterdir()):
                refuse_other(self.path, "a region")
        elif self._recorded() != digest and not overwrite:
            raise OutputError(
                f"{self.path} holds a region of another scene, DTM or other areas; give another -o, or --overwrite "
                "(runs that are in both are kept)"
            )

    def _recorded(self):
        file = self.path / RECORD_FILE
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise FormatError(f"{file} cannot be read ({one_line(error)[:80]}); give another folder") from error
        return record.get("digest") if isinstance(record, dict) else None

    def spare(self, inputs):
        """Refuse a folder where one of the `inputs` would be replaced."""
        if not self.path.is_dir():
            return
        inputs = list(inputs)
        given = input_inside(self.runs, inputs) or input_inside(self.maps, inputs)
        for name in (LOCK_FILE, RECORD_FILE, AREAS_FILE):
            given = given or input_at(self.path / name, inputs)
        if given is not None:
            raise OutputError(f"{self.path} contains the input {given}; give another -o")

    @contextmanager
    def held(self):
        """Create the folder and lock it for this block."""
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise output_error(self.path, error) from error
        with sole_writer(self.path):
            yield

    def write_record(self, **record):
        """Write `region.json`."""
        whole = {"format": "mpmgis-region", "format_version": 1, "digest": self.digest, "versions": versions()}
        with whole_file(self.path / RECORD_FILE) as part:
            text = json.dumps(whole | record, indent=1, allow_nan=False) + "\n"
            part.write_text(text, encoding="utf-8", newline="\n")
