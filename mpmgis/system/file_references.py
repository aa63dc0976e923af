"""Files of unknown origin that lead to other files or to the network, refused before a library opens them.

An input is one file, or files that lie together. What leads elsewhere is followed only where the user trusts it
(`trusted_files.trusting`): names in the network, virtual paths, virtual rasters of files outside their folder, lists of
files of all kinds. A virtual raster is read without that if it is a plain mosaic: it has only elements and attributes
of `_TAGS`, and its sources are in its folder and begin as rasters of a kind that no other driver of GDAL takes.
"""

import os
import re
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

from . import operating_system, zip_archives
from .errors import FormatError, one_line
from .source_names import SourceName, network_share, source_of
from .trusted_files import is_trusted, require_file_or_folder

HEAD = 8192  # [bytes] GDAL detects the format from fewer
LARGEST_VRT = 20_000_000  # [bytes]; 10 000 tiles need 5 MB
_LONGEST_NAME = 80  # [letters] of a file in a message
TRUST = "give --trust where the command has it"
VRT_SUFFIXES = (".vrt", ".ovf")
_SIDECARS = (".ovr", ".msk", ".ovr.ovr", ".ovr.msk", ".msk.ovr", ".msk.msk")  # GDAL opens these next to a raster
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_AUXILIARY = b"EHFA_HEADER_TAG"  # of a .aux next to a raster, which GDAL opens too
_HDF5 = b"\x89HDF\r\n\x1a\n"
# Beginnings of rasters that no other driver takes: GeoTIFF, JPEG 2000, PNG, JPEG, NetCDF, HDF5.
_BEGINNINGS = (
    *(*_TIFF, b"\0\0\0\x0cjP  ", b"\xffO\xffQ", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"),
    *(b"CDF\x01", b"CDF\x02", b"CDF\x05", _HDF5),
)
# Patterns are texts: they are compiled when a file needs them.
_VIEW = rb"(?i)create\s+view|IsSeamless|Type\s+LINKED"  # of a .tab that shows others
_ASCII_GRID = rb"(?i)\s*(?:ncols|nrows|xll|yll|cellsize|dx|dy|nodata_value)"
_NUMBERS = rb"[-+.,;0-9eE \t\r\n]*"  # of an XYZ file
_BINARY = rb"[\0-\x08\x0b\x0c\x0e-\x1f\x80-\xff]"  # no text has it; drivers that follow names read texts
_WORD = rb"[A-Za-z_<>=]{7}"  # which some of them look for anywhere before the first zero byte
# What lists of files and services begin with, and what they are; for messages.
_KINDS = (
    (b"<VRTDataset", "a virtual raster (VRT)"),
    (b"<OGRVRTDataSource", "a virtual vector file (VRT)"),
    (b"<MRF_META", "a raster that is copied from another one and writes files (MRF)"),
    (b"<GDALTileIndexDataset", "a list of rasters (GTI)"),
    (b"gdal_streamed_alg", "a list of GDAL commands (GDALG)"),
    (b"stac_version", "a list of rasters (STAC)"),
    (b"<GDAL_WM", "a web service (WMS)"),
    (b"<WMS_Tile_Service", "a web service (WMS)"),
    (b"<TileMap", "a web service (TMS)"),
    (b"<WCS_GDAL", "a web service (WCS)"),
    (b"<OGRWFSDataSource", "a web service (WFS)"),
    (b"Capabilities", "a web service"),
    (b"opengis.net/spec/ogcapi", "a web service (OGC API)"),
    (b"<Dimap_Document", "a list of rasters (DIMAP)"),
    (b"PDS_VERSION_ID", "a label of a raster in other files (PDS)"),
    (b"IsisCube", "a label of a raster in other files (ISIS)"),
    (b"DatasetHeader Begin", "a label of a raster in other files (ERS)"),
)
_POINTED = (
    r"((?:https?|ftp|s3)://[^\s\"'<>]+|/vsi[^\s\"'<>]+)|"
    r"<(?:Source(?:Filename|Dataset|Array)?|SrcDataSource|SrcDSN?|\w*File(?:[Nn]ame)?)\b[^<>]*>\s*([^\s<>][^<>]*?)\s*<|"
    r"(?:\^\w+\s*=|DataFile\s*=|href\s*=|\"(?:href|location|url)\"\s*:|\bread\s)\s*\\?\"?([^\s\"'<>\\]+)"
)
_NAMESPACE = r"//www\.(?:opengis\.net|w3\.org)/"  # names of XML that are no addresses
_TAGS = {  # of a plain mosaic, as gdalbuildvrt and this program write it, with their attributes
    "VRTDataset": {"rasterXSize", "rasterYSize"},
    "SRS": {"dataAxisToSRSAxisMapping", "coordinateEpoch"},
    "GeoTransform": set(),
    "BlockXSize": set(),
    "BlockYSize": set(),
    "OverviewList": {"resampling"},
    "Metadata": {"domain"},
    "MDI": {"key"},
    "VRTRasterBand": {"dataType", "band", "blockXSize", "blockYSize"},
    "MaskBand": set(),
    "Description": set(),
    "UnitType": set(),
    "Offset": set(),
    "Scale": set(),
    "CategoryNames": set(),
    "Category": set(),
    "ColorInterp": set(),
    "ColorTable": set(),
    "Entry": {"c1", "c2", "c3", "c4"},
    "NoDataValue": set(),
    "HideNoDataValue": set(),
    "SimpleSource": {"resampling"},
    "ComplexSource": {"resampling"},
    "AveragedSource": {"resampling"},
    "SourceFilename": {"relativeToVRT", "shared"},
    "SourceBand": set(),
    "SourceProperties": {"RasterXSize", "RasterYSize", "DataType", "BlockXSize", "BlockYSize"},
    "SrcRect": {"xOff", "yOff", "xSize", "ySize"},
    "DstRect": {"xOff", "yOff", "xSize", "ySize"},
    "ScaleOffset": set(),
    "ScaleRatio": set(),
    "NODATA": set(),
    "LUT": set(),
    "Exponent": set(),
    "SrcMin": set(),
    "SrcMax": set(),
    "DstMin": set(),
    "DstMax": set(),
    "UseMaskBand": set(),
}
_DOMAINS = ("", "mpmgis", "IMAGE_STRUCTURE")  # of metadata that lead nowhere
_DECLARATION = rb"(?i)\s*(?:<\?xml version=[\"']1\.0[\"'](?: encoding=[\"'](?:utf-8|us-ascii)[\"'])?\s*\?>)?"
_NO_PATH = r"(?i)[<{\"\s]|/vsi|[^/\\:]{2,}:"  # beginnings of names that GDAL does not take for a path


def require_local(name: str | Path, named_by: str | Path = "") -> None:
    """Refuse what leads elsewhere, pipes and devices; the caller reports missing files.

    Parameters
    ----------
    name : str or Path
        Of a raster or vector file, as in `source_names`.
    named_by : str or Path
        File that contains the name, for messages; "" for a name that the user typed.

    Raises
    ------
    FormatError
        Not trusted: a name in the network or a virtual path; a virtual raster or vector file other than a plain mosaic
        of rasters in its folder; a table of MapInfo that is a view of others; an overview or a mask beside it that is
        no TIFF.
    """
    if not is_trusted():
        _require_this_computer(name, named_by)
    source = source_of(name)
    if source.elsewhere and not is_trusted():
        raise FormatError(
            f"{one_line(source.text)[:120]}{_which(named_by)} is {source.elsewhere}; download it, or {TRUST}"
        )
    if source.elsewhere:
        return
    require_file_or_folder(source.file)
    if is_trusted():
        return
    if source.part and not source.driver:
        _require_plain_member(source)
    elif source.file.is_file():
        _require_plain_file(source.file)
    for name, head in _tables_of_mapinfo(source.file):
        if re.search(_VIEW, head):
            raise FormatError(f"{name} is a table of MapInfo that shows other files; give these, or {TRUST}")


def _which(named_by):
    return f", which {named_by} refers to," if str(named_by) else ""


def _require_plain_file(path):
    """Refuse a file that leads elsewhere, and its sidecars."""
    began = head_of(path)
    if began.startswith(_HDF5):
        _require_own_values(path)
    head = _text(began)
    if b"<VRTDataset" in head and path.suffix.lower() in VRT_SUFFIXES:
        about = path.stat()
        _require_mosaic(path.resolve(), path, about.st_size, about.st_mtime_ns)
    elif b"<VRTDataset" in head or b"<OGRVRTDataSource" in head:
        raise FormatError(f"{path} {leads_to(path)}")
    for suffix in _SIDECARS:
        for place in (Path(f"{path}{suffix}"), Path(f"{path}{suffix.upper()}")):
            if place.exists():
                _require_tiff(place, head_of(place))
    for place in (Path(f"{path}.aux"), path.with_suffix(".aux")):
        if place != path and place.is_file():
            began = head_of(place)
            if began.startswith(_AUXILIARY) and not began.startswith(_AUXILIARY + b"\0"):
                raise FormatError(f"{place} is not what its beginning says; remove it, or {TRUST}")


def _tables_of_mapinfo(path):
    """(name, first bytes) of the .tab files that GDAL reads: the file, those in the folder or in the archive."""
    if path.is_dir() or path.suffix.lower() == ".tab":
        files = path.iterdir() if path.is_dir() else (path,)
        return [(file, head_of(file)) for file in files if file.suffix.lower() == ".tab"]
    names = [name for name in zip_archives.members(path) if name.lower().endswith(".tab")]
    return [(f"{path}: {name}", zip_archives.head_of(path, name, HEAD)) for name in names]


def _require_own_values(path):
    """Refuse an HDF5 file, such as NetCDF 4, with values in other files."""
    from .hdf5_reading import opened_whole

    with suppress(OSError), opened_whole(path):  # a damaged one is refused by the library that reads it
        pass


def _require_tiff(place, head):
    if not head.startswith(_TIFF):
        what = leads_to(place) if isinstance(place, Path) else ""
        raise FormatError(
            f"{place} {what}" if what else f"{place} is no TIFF, as an overview or a mask is; remove it, or {TRUST}"
        )


def _require_plain_member(source: SourceName) -> None:
    """Refuse a member of an archive that leads elsewhere, or whose overview or mask does."""
    zip_archives.require_zip_fits(source.file)
    names = set(zip_archives.members(source.file))
    if any(word in zip_archives.head_of(source.file, source.part, HEAD) for word in (b"<VRTDataset", b"<OGRVRT")):
        raise FormatError(f"{source} is a list of other files in an archive; unpack it, or {TRUST}")
    for suffix in _SIDECARS:
        for name in (f"{source.part}{suffix}", f"{source.part}{suffix.upper()}"):
            if name in names:
                _require_tiff(f"{source.file}: {name}", zip_archives.head_of(source.file, name, HEAD))


def head_of(path: Path) -> bytes:
    """Return the first bytes of a file; b"" for other objects and unreadable files.

    Parameters
    ----------
    path : Path
    """
    try:
        if not path.is_file():
            return b""
        with open(path, "rb") as file:
            return file.read(HEAD)
    except (OSError, ValueError):
        return b""


def leads_to(path: Path) -> str:
    """Return what a list of files or a service is and what it points at, with the remedy; "" for other files.

    Parameters
    ----------
    path : Path
    """
    head = head_of(path)
    kind = next((kind for word, kind in _KINDS if word in head), None)
    if kind is None:
        return ""
    names = (next(filter(None, found)) for found in re.findall(_POINTED, head.decode("utf-8", "replace")))
    names = list(dict.fromkeys(_short(one_line(name)) for name in names if not re.search(_NAMESPACE, name)))
    at = f", which points at {', '.join(names[:2])}{' and others' if len(names) > 2 else ''}" if names else ""
    return f"is {kind}{at}; if you trust it, {TRUST}"


def _short(name):
    return name if len(name) <= _LONGEST_NAME else f"...{name[-_LONGEST_NAME:]}"


def _require_this_computer(path: str | Path, named_by: str | Path) -> None:
    """Refuse a path of Windows on another computer than that of the file that names it, without a look at the path."""
    if not (operating_system.WINDOWS and str(named_by)):
        return
    if network_share(path) not in ("", network_share(os.path.abspath(named_by))):
        raise FormatError(f"{path}{_which(named_by)} is in the network; download it, or {TRUST}")


@lru_cache(maxsize=64)
def _require_mosaic(place: Path, path: Path, size: int, changed: int) -> None:
    """Refuse a virtual raster that is more than a mosaic of rasters in its folder; checked once for each state of it.

    Parameters
    ----------
    place : Path
        Resolved.
    path : Path
        For messages.
    size : int [bytes]
    changed : int [ns]
    """
    left, seen = [(place, path)], set()
    while left:
        place, path = left.pop()
        if place in seen:
            continue
        seen.add(place)
        for source, name in _mosaic_sources(place, path):
            head = head_of(source)
            if b"<VRTDataset" in _text(head):
                if source.suffix.lower() not in VRT_SUFFIXES:
                    raise FormatError(f"{path} refers to {name}, which {leads_to(source)}")
                left.append((source, source))
                continue
            if not _is_known(head):
                what = leads_to(source) or f"is in a format that is not read in a virtual raster; {TRUST}"
                raise FormatError(f"{path} refers to {name}, which {what}, or convert it: rio convert {path} one.tif")
            _require_plain_file(source)


def _text(head: bytes) -> bytes:
    """Return the bytes before the first zero: what GDAL searches for words."""
    return head.partition(b"\0")[0]


def _is_known(head: bytes) -> bool:
    """Return whether a file that begins so is read by the driver of its format and by no other."""
    return (
        head.startswith(_BEGINNINGS)
        or re.match(_ASCII_GRID, head) is not None
        or (len(head) > 0 and re.fullmatch(_NUMBERS, head) is not None)
        or (re.search(_BINARY, head[:4]) is not None and re.search(_WORD, _text(head)) is None)
    )


def _mosaic_sources(place: Path, path: Path) -> list[tuple[Path, str]]:
    """Return (resolved path, name) of the sources of a plain mosaic; refuse others."""
    if place.stat().st_size > LARGEST_VRT:
        raise FormatError(f"{path} has {place.stat().st_size / 1e6:.0f} MB, expected a list of files below 20 MB")
    raw = place.read_bytes()
    start = re.match(_DECLARATION, raw).end()
    if b"<!" in raw or b"<?" in raw[start:]:
        raise FormatError(f"{path} contains a comment, CDATA or another declaration, which is not read; {TRUST}")
    try:
        root = ElementTree.fromstring(raw)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise FormatError(
            f"{path} is not a readable list of files ({one_line(error)[:80]}); create it again"
        ) from error
    found = {}
    for element in root.iter():
        unknown = set(element.keys()) - _TAGS.get(element.tag, set())
        other = element.tag == "Metadata" and element.get("domain", "") not in _DOMAINS
        if element.tag not in _TAGS or unknown or other:
            what = f"<{element.tag}>" if element.tag not in _TAGS else f"<{element.tag} {' '.join(sorted(unknown))}>"
            raise FormatError(
                f"{path} is more than a mosaic ({one_line(what)[:60]}{_also(path)}); if you trust it, {TRUST}, or make "
                f"one raster of it: rio convert {path} one.tif"
            )
        if element.tag == "SourceFilename":
            found[element.text or "", element.get("relativeToVRT") == "1"] = None
    return [_source(place, path, name, relative) for name, relative in found]


def _also(path):
    at = leads_to(path).partition(", which ")[2].partition("; if you")[0]
    return f"; it {at}" if at else ""


def _source(place: Path, path: Path, name: str, relative: bool) -> tuple[Path, str]:
    """Return (resolved path, name) of a source of the virtual raster at `place`; refuse one that is not beside it."""
    shown = one_line(name)[:120]
    if re.match(_NO_PATH, name) and not (operating_system.WINDOWS and Path(name).is_absolute()):
        elsewhere = source_of(name.strip()).elsewhere or "no path"
        raise FormatError(f"{shown!r}, which {path} refers to, is {elsewhere}; if you trust it, {TRUST}")
    _require_this_computer(name, place)
    try:
        source = (place.parent / name if relative else Path(name)).resolve()
        there = source.is_file()
    except (OSError, ValueError, RuntimeError):  # too long, a zero byte, or links in a circle
        source, there = Path(name), False
    if not there:
        if source.exists():
            require_file_or_folder(source)
        raise FormatError(f"{path} refers to {shown}, which does not exist; copy it there, or create {path.name} again")
    if not source.is_relative_to(place.parent):
        raise FormatError(
            f"{path} points at {shown}, which is not in its folder; if you trust it, {TRUST}, or make one raster of "
            f"it: rio convert {path} one.tif"
        )
    return source, shown
