"""Names of rasters and vector files as people write them: paths, and the names that GDAL and QGIS give.

Some names are no paths: `NETCDF:f.nc:dem` (a subdataset), `/vsizip/d.zip/dem.tif` (a file in an archive),
`a.gpkg|layername=b` (a layer, as QGIS copies it). Their file is on this disk, and they are relative to a folder by it.
"""

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path, PureWindowsPath

from . import operating_system

SUBDATASETS = ("NETCDF", "GPKG", "GTIFF_DIR")  # drivers whose subdatasets are read
ZIP = "/vsizip/"  # GDAL's prefix of files in a zip archive
LAYER_OPTIONS = ("layername", "layerid", "geometrytype", "subset")  # of QGIS, after a |
# patterns are texts: they are compiled for a name that is no path
_OPTION = r"\|(\w+(?::\w+)?)="
_DRIVER = r"([A-Za-z][A-Za-z0-9_+]+):"
_VIRTUAL = r"(?i)/vsi\w+"
_NETWORK = r"(?i)/vsi(?:curl|s3|gs|az|adls|oss|swift|hdfs|webhdfs|kerchunk|std)\w*[/?]|(?:https?|ftps?|s3|gs):/"
_ONE_SLASH = r"(?i)\b(https?|ftps?|s3|gs):/(?!/)"  # a path of Python has lost the second


@dataclass(frozen=True)
class SourceName:
    """A name and the file on this disk that it means.

    Parameters
    ----------
    file : Path
        The file or folder; for a member of an archive, the archive.
    driver : str
        Of a subdataset, "" for others.
    part : str
        Name of the subdataset, or of the member of the archive.
    options : tuple of (str, str)
        Those after a `|`: key and value.
    elsewhere : str
        What the name is if it is none of a file on this disk: "in the network", ...; else "".
    text : str
        A name that is not of a file on this disk, for GDAL.
    """

    file: Path
    driver: str = ""
    part: str = ""
    options: tuple = ()
    elsewhere: str = ""
    text: str = ""

    @property
    def base(self) -> str:
        """The name without what follows a `|`, for GDAL."""
        if self.elsewhere:
            return self.text
        if self.driver == "GTIFF_DIR":
            return f"{self.driver}:{self.part}:{self.file}"
        if self.driver:
            return f'{self.driver}:"{self.file}":{self.part}'
        if self.part:
            return f"{ZIP}{{{self.file}}}/{self.part}"
        return f"./{self.file}" if re.match(_DRIVER, str(self.file)) else str(self.file)

    @property
    def is_plain(self) -> bool:
        """Whether the name is the path of a file or folder, perhaps with options."""
        return not (self.elsewhere or self.driver or self.part)

    def __str__(self):
        base = self.base
        if self.driver and self.driver != "GTIFF_DIR" and ":" not in str(self.file):
            base = f"{self.driver}:{self.file}:{self.part}"
        elif self.part and not self.driver and ".zip/" not in str(self.file).lower():
            base = f"{ZIP}{self.file}/{self.part}"
        return base + "".join(f"|{key}={value}" for key, value in self.options)


def source_of(name: str | Path, folder: str | Path = "") -> SourceName:
    """Return what a name of a raster or vector file means.

    Parameters
    ----------
    name : str or Path
        A name of GDAL that was made a path has lost slashes; they are restored.
    folder : str or Path
        To which the name is relative.
    """
    text, folder = str(name), Path(folder)
    if operating_system.WINDOWS and network_share(text):  # the name may be refused: no look at it
        return SourceName(Path(text))
    if _is_there(folder / text):
        return SourceName(folder / text)
    base, options = _with_options(text)
    if base != text:
        return replace(source_of(base, folder), options=options)
    if re.match(_NETWORK, text) or (re.search(_NETWORK, text) and re.match(_VIRTUAL, text)):
        restored = re.sub(_ONE_SLASH, r"\1://", text)
        return SourceName(Path(text), elsewhere="in the network or in a database", text=restored)
    if text.lower().startswith(ZIP):
        return _in_archive(text, folder)
    if virtual := re.match(_VIRTUAL, text):
        return SourceName(Path(text), elsewhere=f"a virtual path of GDAL ({virtual[0]})", text=text)
    if found := re.match(_DRIVER, text):
        return _subdataset(text, found[1], folder)
    return SourceName(folder / _at_home(text))


def _at_home(text):
    """The Path of a text with ~ as the home folder; ~name without such a user stays."""
    return Path(os.path.expanduser(text))


def _is_there(path):
    try:
        return os.path.lexists(path)
    except ValueError:  # a zero byte
        return False


def _with_options(text):
    """Return the name before the options of QGIS, and the options; `text` and () without any.

    The SQL of a subset may contain |.
    """
    found = []
    for match in re.finditer(_OPTION, text):
        if not (found and found[-1][1].lower() == "subset" and match[1].lower() not in LAYER_OPTIONS):
            found.append(match)
    if not found:
        return text, ()
    ends = [match.start() for match in found[1:]] + [len(text)]
    options = tuple((match[1], text[match.end() : end]) for match, end in zip(found, ends, strict=True))
    return text[: found[0].start()], options


def _in_archive(text, folder):
    """Return the SourceName of a member of a zip archive: the archive is the first part of the path that is a file."""
    rest = text[len(ZIP) :]
    if braced := re.match(r"/?\{([^}]*)\}/?(.*)", rest):
        return SourceName(folder / _at_home(braced[1]), part=braced[2])
    parts = rest.strip("/").split("/")
    for start in ("/", "") if rest.startswith("/") else ("", "/"):
        for count in range(1, len(parts) + 1):
            path = folder / _at_home(start + "/".join(parts[:count]))
            if path.is_file():
                return SourceName(path, part="/".join(parts[count:]))
    count = next((k for k, part in enumerate(parts, 1) if part.lower().endswith(".zip")), len(parts))
    return SourceName(folder / Path("/".join(parts[:count])), part="/".join(parts[count:]))


def _subdataset(text, driver, folder):
    """Return the SourceName of DRIVER:file:part."""
    if driver.upper() not in SUBDATASETS:
        kind = f"a name of GDAL's driver {driver}, in the network or in a database"
        return SourceName(Path(text), elsewhere=kind, text=text)
    rest = text[len(driver) + 1 :]
    if driver.upper() == "GTIFF_DIR":
        part, _, file = rest.rpartition(":")
    elif quoted := re.fullmatch(r'"([^"]*)"(?::(.*))?', rest):
        file, part = quoted[1], quoted[2] or ""
    else:
        file, _, part = rest.partition(":")
        if re.match(r"[\\/]", part) and len(file) == 1:  # the drive of a path of Windows
            drive = file
            file, _, part = part.partition(":")
            file = f"{drive}:{file}"
    if re.search(_NETWORK, file):
        return SourceName(
            Path(text), elsewhere="in the network or in a database", text=re.sub(_ONE_SLASH, r"\1://", text)
        )
    if file.startswith("/vsi"):
        return SourceName(Path(text), elsewhere="a subdataset in an archive", text=text)
    return SourceName(folder / _at_home(file), driver=driver.upper(), part=part)


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


def joined(folder: str | Path, name: str | Path) -> Path | str:
    """Return a name that is relative to a folder as one relative to the current folder; a str if it is no path.

    Parameters
    ----------
    folder : str or Path
    name : str or Path
    """
    found = source_of(name, folder)
    return found.file if found.is_plain and not found.options else str(found)


def file_of(name: str | Path) -> Path:
    """Return the file or folder on this disk that a name means; of a member of an archive, the archive.

    Parameters
    ----------
    name : str or Path
    """
    return source_of(name).file


def moved(name: str | Path, folder: str | Path) -> str:
    """Return a name relative to `folder`, with forward slashes; absolute if they are on different drives.

    Parameters
    ----------
    name : str or Path
    folder : str or Path
    """
    found = source_of(name)
    if found.elsewhere:
        return found.text
    return str(replace(found, file=Path(operating_system.slashed(found.file, folder))))
