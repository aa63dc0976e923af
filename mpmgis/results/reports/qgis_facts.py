"""Collect facts about QGIS projects and styles, for `mpmgis info`."""

from xml.etree import ElementTree

from ...system.errors import FormatError, one_line
from ...system.trusted_files import require_file
from ...system.zip_archives import opened_zip, require_unpacked
from .fact_table import Kind, ends

LARGEST_PROJECT = 100_000_000  # [bytes] of XML; projects with hundreds of layers have ten
MOST_LAYERS = 10_000  # of a project; more are a damaged or hostile file
_AT_ONCE = 1_000_000  # [bytes] of XML that are parsed together, to limit the memory
_CRS = ["qgis", "projectCrs", "spatialrefsys", "authid"]  # path of elements to the CRS of a project


def _project_facts(seen, found):
    """Version, CRS and layers of a QGIS project, .qgz or .qgs."""
    path, found = seen.path, _Project()
    try:
        for part in _xml(path):
            found.parser.feed(part)
            if len(found.layers) > MOST_LAYERS:
                raise FormatError(f"{path} has more than {MOST_LAYERS} layers; it is not a project that QGIS opens")
        found.parser.close()
    except ElementTree.ParseError as error:
        raise FormatError(f"{path} is not a readable QGIS project ({one_line(error)[:80]})") from error
    if found.root != "qgis":
        raise FormatError(f"{path} is not a QGIS project: its root is <{one_line(found.root)[:40]}>, expected <qgis>")
    return {"qgis": found.version, "crs": found.crs or None, "layers": found.layers}


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
            raise FormatError(f"{path} has no .qgs, it is not a QGIS project")
        require_unpacked(f"{path}: {one_line(inner.filename)[:80]}", inner.file_size, LARGEST_PROJECT)
        with archive.open(inner) as file:
            yield from iter(lambda: file.read(_AT_ONCE), b"")


class _Project:
    """Parser target that keeps only the facts of a project."""

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
        """End of the file."""


def _style_facts(seen, found):
    """Layer type, renderer and classes of a QGIS style."""
    path = seen.path
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise FormatError(f"{path} is not a readable QGIS style ({one_line(error)[:80]})") from error
    renderers = {"raster": root.find("pipe/rasterrenderer"), "vector": root.find("renderer-v2")}
    layer = next((name for name, renderer in renderers.items() if renderer is not None), None)
    if root.tag != "qgis" or (layer is None and not root.get("styleCategories")):
        raise FormatError(f"{path} is not a QGIS style: it has <{root.tag}> without a renderer")
    renderer = renderers.get(layer)
    facts = {"qgis": root.get("version", ""), "layer": layer}
    if renderer is not None:
        classes = [*renderer.iter("item"), *renderer.iter("paletteEntry"), *renderer.iter("category")]
        facts |= {"renderer": renderer.get("type", ""), "classes": [entry.get("label", "") for entry in classes]}
    return facts


QGIS_FILES = (
    Kind("QGIS project", ends(".qgz", ".qgs"), _project_facts),
    Kind("QGIS style", ends(".qml"), _style_facts),
)
