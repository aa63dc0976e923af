"""Input files of unknown origin: trust (`--trust`), no pipes or devices, zip archives within the free memory.

Checks of untrusted files before GDAL opens them: references to other files and to the network.

A file that the user names may be a list of files or a web service if its suffix shows that. A file that a scene, a
frame or a folder names may come from another person: no part of it may lie in the network (on Windows: on another
computer), unless the user trusts it (`zip_archives.trusting`).
"""

import os
import re
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

from . import operating_system
from .errors import FormatError, one_line
from .operating_system import memory_lack

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


def require_undisguised(path):
    """Refuse pipes, devices, and virtual rasters or web services whose suffix hides them.

    Raises
    ------
    FormatError
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


def require_local(path, named_by):
    """Refuse references to the network in `path` and in the virtual rasters that it refers to.

    Parameters
    ----------
    path : path
    named_by : str
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


def _head(path):
    """The first bytes of a file; b"" for other objects and unreadable files."""
    try:
        if not path.is_file():
            return b""
        with open(path, "rb") as file:
            return file.read(HEAD)
    except (OSError, ValueError):
        return b""


def _require_local_name(name, named_by):
    elsewhere = operating_system.WINDOWS and share(name) not in ("", share(os.path.abspath(named_by)))
    if elsewhere or _NETWORK.search(name) or (_DRIVER.match(name) and not Path(name).exists()):
        raise FormatError(
            f"{one_line(name)[:120]}, which {named_by} refers to, is in the network or in a database; download it, "
            "give it as an option, or give --trust, where the command has one of these"
        )


def share(path):
    """Network computer and share of a Windows path, in lower case; "" for a local path.

    Opening such a path, `\\\\host\\share\\file` or `//host/share/file`, sends the user's name and a digest of the
    password to that computer.
    """
    drive = PureWindowsPath(path).drive.lower().removeprefix("\\\\?\\unc\\")
    if drive.startswith(("\\\\?\\", "\\\\.\\")):
        return ""
    return drive.lstrip("\\") if "\\" in drive else ""


def _sources(path, named_by):
    """Paths of the files that a virtual raster or vector file refers to; network references are refused."""
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


_trusted = ContextVar("mpmgis_trusted", default=False)


@contextmanager
def trusting(trust: bool = True) -> Iterator[None]:
    """Within this block, where `trust` is true, files may refer to other files and to the network.

    This holds for the threads of a FramePool that start within the block, not for other processes. `gdal_input` and
    `hdf5` decide which references are followed.
    """
    token = _trusted.set(bool(trust))
    try:
        yield
    finally:
        _trusted.reset(token)


def is_trusted() -> bool:
    """Whether files may refer to other files and to the network now; false unless the user gives `--trust`."""
    return _trusted.get()


def require_file(path):
    """Refuse a pipe, a socket, a device or a folder; the caller reports missing files.

    Raises
    ------
    FormatError
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FormatError(f"{path} is a {'folder' if path.is_dir() else 'device or pipe'}, expected a file")


def require_file_or_folder(path):
    """As `require_file`, folders are accepted too.

    Raises
    ------
    FormatError
    """
    if not Path(path).is_dir():
        require_file(path)


MAGIC = b"PK\x03\x04"
MOST_MEMBERS = 100_000
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods decompress without a limit
DAMAGE = (zipfile.BadZipFile, EOFError, zlib.error, OSError, NotImplementedError, KeyError, ValueError, RuntimeError)


@contextmanager
def opened_zip(path, kind):
    """The zipfile.ZipFile at `path` for this block; `kind` is the type of file for messages.

    Raises
    ------
    FormatError
        A pipe, no archive, damaged, too many members, another compression than deflate.
    """
    require_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > MOST_MEMBERS:
                raise FormatError(
                    f"{path} holds {len(members)} files, expected at most {MOST_MEMBERS}; it is not a {kind}"
                )
            other = next((member for member in members if member.compress_type not in METHODS), None)
            if other is not None:
                name = one_line(other.filename)[:80]
                raise FormatError(f"{path}: {name} is not compressed by deflate, as a {kind} is; compress it again")
            yield archive
    except DAMAGE as error:
        raise FormatError(f"{path} is not a readable {kind} ({one_line(error)[:100]}); it is damaged") from error


def require_unpacked(where, size, most):
    """Refuse a declared uncompressed `size` [bytes] of a member above `most`; zipfile decompresses no more than that.

    Raises
    ------
    FormatError
    """
    if size > most:
        raise FormatError(
            f"{where} has {size / 1e6:.0f} MB uncompressed, expected at most {most / 1e6:.0f} MB; it is damaged"
        )


def require_zip_fits(path):
    """Refuse a zip archive larger than the free memory, before a library decompresses it.

    Raises
    ------
    FormatError
    """
    with open(path, "rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return
    with opened_zip(path, "zip archive") as archive:
        require_unpacked_fits(path, sum(member.file_size for member in archive.infolist()))


def require_unpacked_fits(where, size):
    """Refuse members that need more than the free memory uncompressed: `size` [bytes].

    Raises
    ------
    FormatError
    """
    if lack := memory_lack(size):
        raise FormatError(f"{where} uncompressed needs {lack}; it is damaged, or needs a larger machine")
