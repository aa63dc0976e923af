"""Results on disk as bands by name: an export, a region, rasters named as in ISeeSnow and AvaFrame, one raster."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...frames.flow_end import DEPOSIT, LAST, FlowEnd
from ...frames.many_runs_folder import MAPS, REGION
from ...frames.region_maps import LARGEST
from ...laws.quantities import Quantity
from ...system.errors import FormatError, GeoreferenceError, InputError
from ...system.messages import muted
from ...terrain.elevation import Terrain
from ...terrain.georeference import name_of, require_metric, same_place, warp_command
from ...terrain.grid import Grid
from ...terrain.raster_input import grid_of, open_raster, read_raster
from ...terrain.raster_output import NAMESPACE
from ...terrain.undeclared_nodata import RESULT, THICKNESS

PEAK_KINDS = {  # end of the file name -> quantity, factor of its values
    "pft": (Quantity("pft", "m", "peak flow thickness"), 1.0),
    "pfv": (Quantity("pfv", "m s-1", "peak flow velocity"), 1.0),
    "ppr": (Quantity("ppr", "Pa", "peak pressure, kPa in the file"), 1000.0),
}
# band names of the same quantity in rasters of mpmgis, ISeeSnow and AvaFrame
SAME_QUANTITY = (("pft", "h_max"), ("pfv", "Ut_max"), ("ppr", "p_max"))
UNNAMED = "value"  # name of a band without a description
LAST_STEPS = (f"_{DEPOSIT}", f"_{LAST}")  # ends of the file of an export's last step, and of its bands here
STRIP = 1024  # [rows] of the maps of a region that are read at a time
_PEAK_NAME = re.compile(r"(?:(.*)_)?(pft|pfv|ppr)\.(?:asc|tif|tiff)", re.IGNORECASE)


@dataclass(frozen=True)
class BandSource:
    """A band in a file.

    Parameters
    ----------
    path : Path
    number : int
        From 1.
    quantity : Quantity
    factor : float
        Of the values in the file.
    """

    path: Path
    number: int
    quantity: Quantity
    factor: float = 1.0

    def read(self) -> tuple[np.ndarray, Grid]:
        """Read the band, in a CRS in metres.

        All values may be nodata: no flow, or never above the minimum depth of velocities.

        Returns
        -------
        (float64[rows, columns], Grid)
            NaN for nodata.
        """
        role = THICKNESS if self.quantity.name == UNNAMED else RESULT  # without a name: metres, or a mask
        values, grid = read_raster(self.path, role, self.number, may_be_empty=True)
        if grid.crs is not None:
            with muted():
                require_metric(grid.crs, grid.bounds, str(self.path))
        return values * self.factor, grid


@dataclass(frozen=True)
class CroppedBand:
    """A band of a map of a region within the extent of its flow.

    Parameters
    ----------
    path : Path
    number : int
        From 1.
    quantity : Quantity
    extent : (int, int, int, int)
        First row, row after the last, first column, column after the last.
    """

    path: Path
    number: int
    quantity: Quantity
    extent: tuple

    def read(self) -> tuple[np.ndarray, Grid]:
        """Read the band within the extent.

        Returns
        -------
        (float64[rows, columns], Grid)
            NaN for nodata.
        """
        top, bottom, left, right = self.extent
        with open_raster(self.path) as source:
            values = source.read(self.number, window=((top, bottom), (left, right)), masked=True)
            grid = grid_of(source, self.path).part(top, left, (bottom - top, right - left))
        return values.astype(float).filled(np.nan), grid


@dataclass(frozen=True)
class BandInMemory:
    """A band of frames that is not written.

    Parameters
    ----------
    path : Path
        Of the frames.
    quantity : Quantity
    values : float32[rows, columns]
    grid : Grid
    """

    path: Path
    quantity: Quantity
    values: np.ndarray
    grid: Grid

    def read(self) -> tuple[np.ndarray, Grid]:
        """Return the values in double precision.

        Returns
        -------
        (float64[rows, columns], Grid)
            NaN for nodata.
        """
        return self.values.astype(float), self.grid


@dataclass(frozen=True)
class Result:
    """Rasters of one model run.

    Parameters
    ----------
    name : str
    kind : str
        "export", "rasters" or "raster".
    bands : dict of str to BandSource
    terrain : Path, Terrain or None
        The terrain of the export or of the frames.
    end : FlowEnd or None
        State of the flow in its last step, where it is known.
    ground : Grid or None
        Of a region: that of its DTM, on which the cells beyond the bands are dry.
    """

    name: str
    kind: str
    bands: dict
    terrain: Path | Terrain | None = None
    end: FlowEnd | None = None
    ground: Grid | None = None

    def read(self, band: str, crs_of: Grid | None = None) -> tuple[np.ndarray, Grid]:
        """Read one band.

        Parameters
        ----------
        band : str
        crs_of : Grid, optional
            The band must be in the same CRS, or have none.

        Returns
        -------
        (float64[rows, columns], Grid)

        Raises
        ------
        FormatError, GeoreferenceError, InputError
        """
        values, grid = self.bands[band].read()
        if crs_of is not None and None not in (grid.crs, crs_of.crs) and not same_place(grid.crs, crs_of.crs):
            path, code = self.bands[band].path, crs_of.crs.to_epsg() or "n"
            if self.kind == "run":  # its raster is temporary
                raise GeoreferenceError(
                    f"{self.name} is in {name_of(grid.crs)}, the other result in {name_of(crs_of.crs)}; export it "
                    "(mpmgis export-raster) and reproject the raster to compare"
                )
            raise GeoreferenceError(
                f"{path} is in {name_of(grid.crs)}, the other rasters in {name_of(crs_of.crs)}; reproject one of them: "
                f"{warp_command(path, f'EPSG:{code}', 'nearest')}"
            )
        return values, grid

    def with_export_names(self) -> "Result":
        """Return the result with its peaks also under the names that an export gives them."""
        ours = {own: self.bands[other] for other, own in SAME_QUANTITY if other in self.bands}
        return replace(self, bands=ours | self.bands)


def names_rasters(path: str | Path) -> bool:
    """Return whether a path names rasters: a folder of *_pft, *_pfv or *_ppr, a prefix of them, one of them, a region.

    Parameters
    ----------
    path : str or Path
    """
    path = Path(path)
    if _region_maps(path) is not None:
        return True
    if path.is_file():
        return _PEAK_NAME.fullmatch(path.name) is not None
    if path.is_dir():
        return bool(_peak_files(path))
    return path.parent.is_dir() and bool(_peak_files(path.parent, path.name))


def open_result(path: str | Path) -> Result:
    """Open the result at a path: an export folder, a folder or common prefix of `..._pft.asc`, a region, or one raster.

    A region is its folder, for all areas, or the prefix of the maps of one scenario (`region/maps/scenario_30`).

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError, InputError
        None of these, or several results at once.
    """
    path = Path(path)
    maps = _region_maps(path)
    if maps is not None:
        return _region(maps)
    if path.is_dir():
        return _folder(path)
    siblings = _peak_files(path.parent, path.name) if not path.exists() and path.parent.is_dir() else {}
    if siblings:
        return Result(path.name, "rasters", _peak_bands(siblings, path))
    return _single(path)


def _folder(folder):
    name = folder.resolve().name
    exported = _exported(folder)
    if exported is not None:
        return exported
    files = _peak_files(folder)
    if files:
        return Result(name, "rasters", _peak_bands(files, folder))
    raise FormatError(
        f"{folder} contains no result: expected an export (rasters/*_max.tif), *_pft, *_pfv, *_ppr rasters (.asc, "
        ".tif), or the frames of a run (*.h5)"
    )


def _exported(folder):
    """The export in `folder` or its parent; None where there is none."""
    inside = folder / "rasters" if (folder / "rasters").is_dir() else folder
    maxima = sorted(inside.glob("*_max.tif"))
    if not maxima:
        return None
    if len(maxima) > 1:
        raise InputError(
            f"{inside} contains {len(maxima)} exports ({', '.join(file.name for file in maxima[:4])}); give one file"
        )
    run = maxima[0].name.removesuffix("_max.tif")
    bands = _named_bands(maxima[0])
    end = None
    for ending in LAST_STEPS:
        last = inside / f"{run}{ending}.tif"
        if last.is_file():
            bands |= _named_bands(last, ending)
            end = _end_of(last)
    peaks = _peak_files(inside)
    bands |= _peak_bands(peaks, inside) if peaks else {}
    terrain = inside.parent / "dtm.tif"
    shown = folder if inside != folder else folder.parent
    return Result(shown.resolve().name, "export", bands, terrain if terrain.is_file() else None, end)


def _end_of(path):
    """Return the FlowEnd in the tags of the raster of a last step; None without."""
    with open_raster(path) as source:
        tags = source.tags(ns=NAMESPACE)
    try:
        return FlowEnd(float(tags["time"]), float(tags["still_moving"]), tags["came_to_rest"] == "true")
    except (KeyError, ValueError):
        return None


def _region_maps(path):
    """Prefix of the maps of a region at `path`; None for anything else."""
    if path.is_dir():
        return path / MAPS / "all" if (path / REGION.record).is_file() and (path / MAPS).is_dir() else None
    there = path.parent.name == MAPS and (path.parent.parent / REGION.record).is_file()
    return path if there and path.with_name(f"{path.name}_h_max.tif").is_file() else None


def _region(maps):
    """The Result of the largest values of a region's areas: nodata is a cell without flow, as in an export."""
    found = {}
    for key in LARGEST:
        found |= _named_bands(maps.with_name(f"{maps.name}_{key}.tif"))
    largest = maps.with_name("all_h_max.tif")
    extent = _extent_of_flow(largest)  # the same for all scenarios
    with open_raster(largest) as source:
        ground = grid_of(source, largest)
    bands = {name: CroppedBand(band.path, band.number, band.quantity, extent) for name, band in found.items()}
    name = maps.parent.parent.resolve().name
    return Result(name if maps.name == "all" else f"{name} {maps.name}", "export", bands, ground=ground)


def _extent_of_flow(path):
    """(first row, end, first column, end) of the cells with data and one cell around, read in strips."""
    with open_raster(path) as source:
        rows, columns = source.shape
        held, across = [], np.zeros(columns, bool)
        for first in range(0, rows, STRIP):
            last = min(first + STRIP, rows)
            known = source.read_masks(1, window=((first, last), (0, columns))) > 0
            across |= known.any(axis=0)
            held.extend((first + np.flatnonzero(known.any(axis=1))).tolist())
    if not held:
        raise FormatError(f"{path} has no cell with flow")
    there = np.flatnonzero(across)
    left, right = int(there[0]), int(there[-1]) + 1
    return max(held[0] - 1, 0), min(held[-1] + 2, rows), max(left - 1, 0), min(right + 1, columns)


def _named_bands(path, ending=""):
    """The bands of a raster by the names in their descriptions, `NAME [unit]`, plus an `ending`."""
    bands = {}
    with open_raster(path) as source:
        for number, text in enumerate(source.descriptions, start=1):
            name, _, unit = (text or "").partition(" [")
            if name:
                quantity = Quantity(name + ending, source.units[number - 1] or unit.rstrip("]"), "")
                bands[quantity.name] = BandSource(path, number, quantity)
        if not bands and source.count > 1:
            raise InputError(
                f"{path} has {source.count} bands without names; if mpmgis wrote it, it is damaged: export it again; "
                f"otherwise extract one: rio stack {path} --bidx N -o one.tif"
            )
    return bands


def _peak_files(folder, beginning=None):
    """Kind -> files of a folder with its ending; with `beginning` only those named `beginning`_KIND."""
    found = {}
    for file in sorted(folder.iterdir()):
        match = _PEAK_NAME.fullmatch(file.name)
        if match and file.is_file() and beginning in (None, match[1]):
            found.setdefault(match[2].lower(), []).append(file)
    return found


def _peak_bands(files, where):
    for kind, several in files.items():
        if len(several) > 1:
            raise InputError(
                f"{where} contains {len(several)} *_{kind} rasters ({', '.join(f.name for f in several[:3])}, ...); "
                f"give the prefix of the files of one result, for example "
                f"{several[0].parent / _PEAK_NAME.fullmatch(several[0].name)[1]}"
            )
    return {kind: _peak_band(several[0], kind) for kind, several in files.items()}


def _peak_band(path, kind):
    quantity, factor = PEAK_KINDS[kind]
    return BandSource(path, 1, quantity, factor)


def _single(path):
    match = _PEAK_NAME.fullmatch(path.name)
    if match:
        return Result(path.stem, "raster", {match[2].lower(): _peak_band(path, match[2].lower())})
    bands = _named_bands(path, next((ending for ending in LAST_STEPS if path.stem.endswith(ending)), ""))
    terrain = path.parent.parent / "dtm.tif"
    beside = path.parent.name == "rasters" and terrain.is_file()
    return Result(
        path.stem,
        "raster",
        bands or {UNNAMED: BandSource(path, 1, Quantity(UNNAMED, "", ""))},
        terrain if beside else None,
    )
