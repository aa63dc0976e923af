"""The toolbox keeps to names that QGIS 3.22 to 3.44 (Qt 5) and QGIS 4 (Qt 6) have: no QGIS is needed to see that."""

import ast
import re
from pathlib import Path

import pytest
from mpmgis_qgis import forms

FILES = sorted(Path(forms.__file__).parent.glob("*.py"))
NAMES_BY_VERSION = "versions.py"  # the only file that may name constants of QGIS, each with its enumeration
# gone in Qt 6, PyQt 6 or QGIS 4: https://github.com/qgis/QGIS/wiki/Plugin-migration-to-be-compatible-with-Qt5-and-Qt6
REMOVED = {
    "exec_",
    "print_",
    "QRegExp",
    "QDesktopWidget",
    "QVariant",
    "QStringList",
    "qApp",
    "QSignalMapper",
    "QTextCodec",
    "QWebView",
    "QgsWkbTypes",
    "QgsMapLayerType",
    "QgsUnitTypes",
    "pyqtWrapperType",
    "resources_rc",
}
CLASS = re.compile(r"Q(gs)?[A-Z]\w*|Qt|Qgis")
CONSTANT = re.compile(r"[A-Z][a-z]\w*")  # of an enumeration; version numbers and the like are all capitals
SCOPED = re.compile(r"(Q\w+)\.(\w+)\.(\w+)")
FROM_QGIS = {"qgis", "qgis.core", "qgis.gui", "qgis.utils"}


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def dotted(node):
    """A.B.C of nested attributes, or None where they begin with something else than a name."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        before = dotted(node.value)
        return None if before is None else f"{before}.{node.attr}"
    return None


def unscoped(tree):
    """Constants of an enumeration that are named without it, as in QProcess.NormalExit."""
    inner = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        name = dotted(node) if isinstance(node, ast.Attribute) else None
        if name is None or name.count(".") != 1 or id(node) in inner | called:
            continue
        owner, constant = name.split(".")
        if CLASS.fullmatch(owner) and CONSTANT.fullmatch(constant):
            yield name


def imported(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and not node.level:
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, alias.name) for alias in node.names)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_constants_are_named_with_their_enumeration(path):
    assert not list(unscoped(tree_of(path)))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_constant_of_qgis_is_named_but_by_version(path):
    names = {dotted(node) or "" for node in ast.walk(tree_of(path)) if isinstance(node, ast.Attribute)}
    of_qgis = {name for name in names if name.startswith("Qgs") and SCOPED.fullmatch(name)}
    assert (path.name == NAMES_BY_VERSION) == bool(of_qgis), of_qgis


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_qt_comes_through_qgis_and_nothing_that_was_removed(path):
    tree = tree_of(path)
    for module, name in imported(tree):
        assert not module.startswith(("PyQt", "PySide", "sip", "osgeo")), f"{module}: take it from qgis.PyQt"
        assert not module.startswith("qgis") or module in FROM_QGIS or re.fullmatch(r"qgis\.PyQt\.Qt\w+", module)
        assert name not in REMOVED
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    used |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert not used & REMOVED


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("x = QProcess.NormalExit", ["QProcess.NormalExit"]),
        ("x = QProcess.ExitStatus.NormalExit", []),
        ("x = QgsProcessing.TypeVectorPolygon", ["QgsProcessing.TypeVectorPolygon"]),
        ("x = Qgis.Warning", ["Qgis.Warning"]),
        ("x = Qt.AlignLeft | Qt.AlignmentFlag.AlignTop", ["Qt.AlignLeft"]),
        ("x = Qgis.QGIS_VERSION_INT", []),
        ("x = QgsGeometry.fromWkt(y)", []),
    ],
)
def test_what_the_search_finds(line, found):
    assert list(unscoped(ast.parse(line))) == found
