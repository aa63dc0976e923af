"""Results on disk as bands by name: an exported folder, rasters named as in ISeeSnow and AvaFrame, one raster."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

from ..analysis.comparison import SAME_QUANTITY
from ..errors import FormatError, GeoreferenceError, InputError
from ..fields import Quantity
from ..messages import muted
from ..terrain.georeference import name_of, require_metric, same_place, warp_command
from .raster import open_raster, read_raster

PEAK_KINDS = {  # ending of the file's name -> quantity, and what its values are multiplied by
    "pft": (Quantity("pft", "m", "peak flow thickness"), 1.0),
    "pfv": (Quantity("pfv", "m s-1", "peak flow velocity"), 1.0),
    "ppr": (Quantity("ppr", "Pa", "peak pressure, kPa in the file"), 1000.0),
}
UNNAMED = "value"  # the band of a raster that does not say what it is
DEPOSIT = "_deposit"  # of an export's last step: ends the name of its file, and the names of its bands here
_PEAK_NAME = re.compile(r"(?:(.*)_)?(pft|pfv|ppr)\.(?:asc|tif|tiff)", re.IGNORECASE)


@dataclass(frozen=True)
class BandSource:
    """Where a band lies: `path`, its `number` (from 1), what it is, and what its values are multiplied by."""

    path: Path
    number: int
    quantity: Quantity
    factor: float = 1.0

    def read(self):
        """(float64[rows, columns] with NaN for nodata, Grid). Refuses degrees and what else is no map in metres.

        All of it may be nodata: nothing flowed, or never as deep as the velocities want it.
        """
        values, grid = read_raster(self.path, self.number, may_be_empty=True)
        if grid.crs is not None:
            with muted():
                require_metric(grid.crs, grid.bounds, str(self.path))
        return values * self.factor, grid


@dataclass(frozen=True)
class Result:
    """What one model run left behind, as rasters.

    Parameters
    ----------
    name : str
    kind : str
        In a word: "export", "rasters" or "raster".
    bands : dict of str to BandSource
    terrain : Path or None
        The terrain that lies beside them.
    """

    name: str
    kind: str
    bands: dict
    terrain: Path | None = None

    def read(self, band, crs_of=None):
        """(values, Grid) of one band; with `crs_of` (a Grid) it must be in the same CRS, or in none.

        Raises
        ------
        FormatError, GeoreferenceError, InputError
        """
        values, grid = self.bands[band].read()
        if crs_of is not None and None not in (grid.crs, crs_of.crs) and not same_place(grid.crs, crs_of.crs):
            path, code = self.bands[band].path, crs_of.crs.to_epsg() or "n"
            if self.kind == "run":  # whose raster is gone when this is read
                raise GeoreferenceError(
                    f"{self.name} is in {name_of(grid.crs)}, the other side in {name_of(crs_of.crs)}; export it "
                    "(mpmgis export-raster) and reproject the raster that is to be compared"
                )
            raise GeoreferenceError(
                f"{path} is in {name_of(grid.crs)}, the other rasters in {name_of(crs_of.crs)}; reproject one of them: "
                f"{warp_command(path, f'EPSG:{code}', 'nearest')}"
            )
        return values, grid

    def with_our_names(self):
        """The Result whose peaks have the names that an export gives them, besides their own."""
        ours = {own: self.bands[other] for other, own in SAME_QUANTITY if other in self.bands}
        return replace(self, bands=ours | self.bands)


def names_rasters(path):
    """Whether `path` is a folder of *_pft, *_pfv or *_ppr rasters, the beginning of their names, or one of them."""
    path = Path(path)
    if path.is_file():
        return _PEAK_NAME.fullmatch(path.name) is not None
    if path.is_dir():
        return bool(_peak_files(path))
    return path.parent.is_dir() and bool(_peak_files(path.parent, path.name))


def open_result(path):
    """The Result at `path`: an exported folder, a folder or common beginning of `..._pft.asc`, or one raster.

    Raises
    ------
    FormatError, InputError
        Nothing of the kind, or several results at once.
    """
    path = Path(path)
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
        f"{folder} holds no result: wanted an export (rasters/*_max.tif), *_pft, *_pfv, *_ppr rasters (.asc, .tif), "
        "or the frames of a run (*.h5)"
    )


def _exported(folder):
    """The export in `folder` or around it; None where it is none."""
    inside = folder / "rasters" if (folder / "rasters").is_dir() else folder
    maxima = sorted(inside.glob("*_max.tif"))
    if not maxima:
        return None
    if len(maxima) > 1:
        raise InputError(
            f"{inside} holds {len(maxima)} exports ({', '.join(file.name for file in maxima[:4])}); name one file"
        )
    run = maxima[0].name.removesuffix("_max.tif")
    bands = _named_bands(maxima[0])
    deposit = inside / f"{run}{DEPOSIT}.tif"
    if deposit.is_file():
        bands |= _named_bands(deposit, DEPOSIT)
    peaks = _peak_files(inside)
    bands |= _peak_bands(peaks, inside) if peaks else {}
    terrain = inside.parent / "dtm.tif"
    shown = folder if inside != folder else folder.parent
    return Result(shown.resolve().name, "export", bands, terrain if terrain.is_file() else None)


def _named_bands(path, ending=""):
    """The bands of a raster by the names in their descriptions, `NAME [unit]`, with an `ending`."""
    bands = {}
    with open_raster(path) as source:
        for number, text in enumerate(source.descriptions, start=1):
            name, _, unit = (text or "").partition(" [")
            if name:
                quantity = Quantity(name + ending, source.units[number - 1] or unit.rstrip("]"), "")
                bands[quantity.name] = BandSource(path, number, quantity)
        if not bands and source.count > 1:
            raise InputError(
                f"{path} has {source.count} bands without names; extract one: rio stack {path} --bidx N -o one.tif"
            )
    return bands


def _peak_files(folder, beginning=None):
    """Kind -> files of a folder that are named for it; with `beginning` only those called `beginning`_KIND."""
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
                f"{where} holds {len(several)} *_{kind} rasters ({', '.join(file.name for file in several[:3])}, ...); "
                f"name one result by the beginning of its files, for example "
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
    bands = _named_bands(path, DEPOSIT if path.stem.endswith(DEPOSIT) else "")
    terrain = path.parent.parent / "dtm.tif"
    beside = path.parent.name == "rasters" and terrain.is_file()
    return Result(
        path.stem, "raster", bands or {UNNAMED: BandSource(path, 1, Quantity(UNNAMED, "", ""))},
        terrain if beside else None,
    )  # fmt: skip
