"""Untrusted files that refer to other files or to the network, refused before GDAL opens them.

A file that the user names may be a list of files or a web service if its suffix shows that. A file that a scene, a
frame or a folder names may come from another person: no part of it may lie in the network (on Windows: on another
computer), unless the user trusts it (`trusted_files.trusting`).
"""

import os
import re
from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

from . import operating_system
from .errors import FormatError, one_line
from .trusted_files import is_trusted, require_file_or_folder

HEAD = 2048  # [bytes] GDAL detects the format from these
LARGEST_VRT = 20_000_000  # [bytes]; 10 000 tiles need 5 MB
_VRT_SUFFIXES = (".vrt", ".ovf")
_XML_SUFFIXES = (*_VRT_SUFFIXES, ".xml", ".wms", ".wmts", ".wcs", ".gti")
_VIRTUAL = (b"<VRTDataset", b"<OGRVRTDataSource")
_SERVICES = (b"<GDAL_WMS", b"<GDAL_WMTS", b"<WMS_Tile_Service", b"<WCS_GDAL", b"<GDALTileIndexDataset")
_SIDECARS = (".ovr", ".msk")  # GDAL opens these next to a raster
_REMOTE = "curl|s3|gs|az|adls|oss|swift|hdfs|webhdfs|kerchunk|std"  # virtual file systems of GDAL
_LOCAL_DRIVERS = "NETCDF|HDF4_[A-Z]+|HDF5|GTIFF_DIR|GPKG|ZARR|GRIB|BAG|NITF_IM|S10[0-9]|vrt"
_NETWORK = re.compile(rf"/vsi(?:{_REMOTE})\w*[/?]|^(?:https?|ftps?):/", re.IGNORECASE)
_DRIVER = re.compile(rf"(?!(?:{_LOCAL_DRIVERS}):)[A-Za-z][A-Za-z0-9_]+:(?!$)")
_SOURCES = re.compile(r"Source(?:Filename|Dataset|Array|DataSource)?|SrcDataSource|SrcDSN?|.*[Ff]ile[Nn]ame|.*Dataset$")


def require_undisguised(path: str | Path) -> None:
    """Refuse pipes, devices, and virtual rasters or web services whose suffix hides them.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        The file, or its overview (.ovr) or mask (.msk), is one of these.
    """
    path = Path(path)
    require_file_or_folder(path)
    if is_trusted():
        return
    for place in (path, *(Path(f"{path}{suffix}") for suffix in _SIDECARS)):
        head, suffix = _head(place), place.suffix.lower()
        virtual = any(word in head for word in _VIRTUAL) and suffix not in _VRT_SUFFIXES
        if virtual or (any(word in head for word in _SERVICES) and suffix not in _XML_SUFFIXES):
            raise FormatError(
                f"{place} is a list of other files or a web service with the suffix {suffix or 'of none'}; if you "
                f"trust it, rename it to {'.vrt' if virtual else '.xml'}, or give --trust where the command has it"
            )


def require_local(path: str | Path, named_by: str | Path) -> None:
    """Refuse references to the network in `path` and in the virtual rasters that it refers to.

    Parameters
    ----------
    path : str or Path
    named_by : str or Path
        File that contains the name, for the message.

    Raises
    ------
    FormatError
        Also in the cases of `require_undisguised`.
    """
    if is_trusted():
        require_file_or_folder(path)
        return
    left, seen = [Path(path)], set()
    while left:
        place = left.pop()
        if place in seen:
            continue
        seen.add(place)
        _require_local_name(str(place), named_by)
        require_undisguised(place)
        head = _head(place)
        if any(word in head for word in _SERVICES):
            raise FormatError(f"{place}, which {named_by} refers to, is a web service; download the data")
        if any(word in head for word in _VIRTUAL):
            left += _sources(place, named_by)


def _head(path: Path) -> bytes:
    """Return the first bytes of a file; b"" for other objects and unreadable files."""
    try:
        if not path.is_file():
            return b""
        with open(path, "rb") as file:
            return file.read(HEAD)
    except (OSError, ValueError):
        return b""


def _require_local_name(name: str, named_by: str | Path) -> None:
    """Refuse a name in the network or in a database."""
    elsewhere = operating_system.WINDOWS and network_share(name) not in ("", network_share(os.path.abspath(named_by)))
    if elsewhere or _NETWORK.search(name) or (_DRIVER.match(name) and not Path(name).exists()):
        raise FormatError(
            f"{one_line(name)[:120]}, which {named_by} refers to, is in the network or in a database; download it, "
            "give it as an option, or give --trust, where the command has one of these"
        )


def network_share(path: str | Path) -> str:
    """Return the network computer and share of a Windows path, in lower case; "" for a local path.

    Opening such a path, `\\\\host\\share\\file` or `//host/share/file`, sends the user's name and a digest of the
    password to that computer.

    Parameters
    ----------
    path : str or Path
    """
    drive = PureWindowsPath(path).drive.lower().removeprefix("\\\\?\\unc\\")
    if drive.startswith(("\\\\?\\", "\\\\.\\")):
        return ""
    return drive.lstrip("\\") if "\\" in drive else ""


def _sources(path: Path, named_by: str | Path) -> list[Path]:
    """Return the paths of the files that a virtual raster or vector file refers to; refuse network references."""
    if path.stat().st_size > LARGEST_VRT:
        raise FormatError(f"{path} has {path.stat().st_size / 1e6:.0f} MB, expected a list of files below 20 MB")
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise FormatError(
            f"{path} is not a readable list of files ({one_line(error)[:80]}); create it again"
        ) from error
    found = []
    for element in root.iter():
        name = (element.text or "").strip()
        if name and _SOURCES.fullmatch(element.tag):
            _require_local_name(name, path)
            found += [path.parent / name, Path(name)]
        for value in (name, *element.attrib.values()):
            if "/vsi" in value.lower():
                _require_local_name(value, path)
    return [some for some in found if _is_file(some)]


def _is_file(path):
    try:
        return path.is_file() or path.is_fifo()
    except (OSError, ValueError):  # too long, or with a zero byte
        return False
