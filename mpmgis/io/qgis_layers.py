"""What a QGIS project says of its layers, read as a stream: its size in memory is that of the answer."""

from pathlib import Path
from xml.etree import ElementTree

from ..errors import FormatError, one_line
from .plain_file import require_file
from .zip_input import opened_zip, require_unpacked

LARGEST_PROJECT = 100_000_000  # [bytes] of XML; projects with hundreds of layers have ten
MOST_LAYERS = 10_000
_AT_ONCE = 1_000_000
_CRS = ["qgis", "projectCrs", "spatialrefsys", "authid"]


def project_facts(path):
    """Version, CRS and layers of the QGIS project at `path` (.qgz, .qgs).

    Raises
    ------
    FormatError
        No project, damaged, larger than any project.
    """
    path, found = Path(path), _Project()
    try:
        for part in _xml(path):
            found.parser.feed(part)
            if len(found.layers) > MOST_LAYERS:
                raise FormatError(f"{path} has more than {MOST_LAYERS} layers; it is no project that QGIS opens")
        found.parser.close()
    except ElementTree.ParseError as error:
        raise FormatError(f"{path} is no readable QGIS project ({one_line(error)[:80]})") from error
    if found.root != "qgis":
        raise FormatError(f"{path} is no QGIS project: its root is <{one_line(found.root)[:40]}>, wanted <qgis>")
    return {"kind": "QGIS project", "qgis": found.version, "crs": found.crs or None, "layers": found.layers}


def _xml(path):
    """The bytes of the project's XML, in parts."""
    if path.suffix.lower() != ".qgz":
        require_file(path)
        require_unpacked(path, path.stat().st_size, LARGEST_PROJECT)
        with open(path, "rb") as file:
            yield from iter(lambda: file.read(_AT_ONCE), b"")
        return
    with opened_zip(path, "QGIS project") as archive:
        inner = next((member for member in archive.infolist() if member.filename.endswith(".qgs")), None)
        if inner is None:
            raise FormatError(f"{path} holds no .qgs, it is no QGIS project")
        require_unpacked(f"{path}: {one_line(inner.filename)[:80]}", inner.file_size, LARGEST_PROJECT)
        with archive.open(inner) as file:
            yield from iter(lambda: file.read(_AT_ONCE), b"")


class _Project:
    """What is wanted of a project, filled by the parser as it comes by; nothing else is kept."""

    def __init__(self):
        self.root = self.version = self.crs = ""
        self.layers, self.parser = [], ElementTree.XMLParser(target=self)
        self._path, self._text = [], None

    def start(self, tag, attributes):
        """An element begins."""
        if not self._path:
            self.root, self.version = tag, attributes.get("version", "")
        within = self._path[-1] if self._path else ""
        self._path.append(tag)
        if tag == "maplayer":
            self.layers.append({"name": "", "type": attributes.get("type", ""), "source": None})
        elif (within == "maplayer" and tag in ("layername", "datasource")) or self._path == _CRS:
            self._text = []

    def data(self, text):
        """A piece of text."""
        if self._text is not None:
            self._text.append(text)

    def end(self, tag):
        """An element ends."""
        if self._text is not None:
            text, self._text = "".join(self._text), None
            if self._path == _CRS:
                self.crs = text
            elif self._path[-2:-1] == ["maplayer"]:
                self.layers[-1]["name" if tag == "layername" else "source"] = text
        self._path.pop()

    def close(self):
        """The end of the file; what was found is in the attributes."""
