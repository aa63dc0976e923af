"""The house stands as mpmgis/ARCHITECTURE.md says: the page's own tables are what the imports are compared with."""

import ast
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "mpmgis"
PAGE = (PACKAGE / "ARCHITECTURE.md").read_text(encoding="utf-8")
TOP_LEVEL = {
    *("pyproject.toml", "mpmgis", "tests", "notebooks", "sample_data", "README.md"),
    *("LICENSE", "Makefile", "CHANGELOG.md"),
}
LARGEST_FILE = 3_000_000  # [bytes]


def table(heading):
    """Rows of the first table below `heading` of the page, cells as text."""
    section = PAGE.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def names(cell):
    return re.findall(r"`([^`]+)`", cell)


LAYER = {unit: int(row[0]) for row in table("Layers") for unit in names(row[1])}
LIBRARIES = {library: set(names(row[1])) for row in table("Libraries") for library in names(row[0])}
SOURCES = sorted(PACKAGE.rglob("*.py"))


def module_name(path):
    """`terrain/grid` for mpmgis/terrain/grid.py; `geo/__init__` for a package's own file."""
    return path.relative_to(PACKAGE).with_suffix("").as_posix()


def unit_of(name):
    """The part of the house that a module belongs to: its folder, or itself where it has none."""
    return name.split("/")[0]


def imports(path):
    """(line, dotted name) of everything that a module imports, wherever in it; relative names made absolute."""
    package = ["mpmgis", *path.relative_to(PACKAGE).parent.parts]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                yield node.lineno, f"{origin}.{alias.name}"


def imported_units(path):
    """(line, unit) of the parts of the house that a module imports; the package's own version is none."""
    for line, name in imports(path):
        parts = name.split(".")
        if parts[0] == "mpmgis" and len(parts) > 1 and not parts[1].startswith("__"):
            yield line, parts[1]


def tracked_files():
    """Paths that git tracks, relative to the root."""
    try:
        listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no git checkout")
    return [Path(name) for name in listing.split("\0") if name and (ROOT / name).exists()]


def test_every_unit_is_in_the_table_of_layers():
    there = {unit_of(module_name(path)) for path in SOURCES} - {"__init__"}
    assert there == set(LAYER)


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_imports_go_down(path):
    own = unit_of(module_name(path))
    for line, unit in imported_units(path):
        assert unit in LAYER, f"{path}:{line} imports mpmgis.{unit}, which is not in ARCHITECTURE.md"
        down = own != "__init__" and (unit == own or LAYER[unit] < LAYER[own])
        assert down, f"{path}:{line}: {own} imports {unit}, which is not in a lower layer"


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_libraries_are_imported_only_by_their_units(path):
    own = unit_of(module_name(path))
    for line, name in imports(path):
        library = name.split(".")[0]
        if library in LIBRARIES:
            assert own in LIBRARIES[library], (
                f"{path}:{line} imports {library}, which only these may import: {sorted(LIBRARIES[library])}"
            )


def test_the_table_of_libraries_has_only_libraries_in_use():
    used = {name.split(".")[0] for path in SOURCES for _, name in imports(path)}
    assert set(LIBRARIES) <= used


@pytest.mark.parametrize("path", [path for path in SOURCES if path.name != "__init__.py"], ids=module_name)
def test_modules_have_docstrings(path):
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    first, _, rest = docstring.partition("\n")
    assert len(first.split()) >= 2, f"{path} has no docstring, or one whose first line says nothing"
    assert not rest or first.endswith((".", ":")) or rest.startswith("\n"), f"{path}: {first} goes on in the next line"


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_only_the_command_line_prints(path):
    if unit_of(module_name(path)) == "cli":
        return
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        printing = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
        assert not printing, f"{path}:{node.lineno} prints; talk is the command line's"


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_public_names_have_docstrings(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    definitions = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    public = [node for node in tree.body if isinstance(node, definitions) and not node.name.startswith("_")]
    silent = [f"{path}:{node.lineno} {node.name}" for node in public if not ast.get_docstring(node)]
    assert not silent


def test_no_module_is_named_for_nothing():
    vague = {"utils", "util", "helpers", "helper", "common", "manager", "misc"}
    assert not [path for path in SOURCES if path.stem in vague]


def test_the_wheel_holds_every_package():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    there = {".".join(path.parent.relative_to(ROOT).parts) for path in PACKAGE.rglob("__init__.py")}
    sites = {f"mpmgis.sample_data.{path.parent.name}" for path in ROOT.glob("sample_data/*/scene.toml")}
    assert set(settings["packages"]) == there | sites


def test_top_level_is_what_the_project_fixed():
    there = {path.parts[0] for path in tracked_files()}
    assert {name for name in there if not name.startswith(".")} == TOP_LEVEL


def test_tracked_files_are_small_and_name_no_machine():
    machine = re.compile(rb"(?<![\w.])/(?:work/(?:main|shared)|tmp/w|root|home/\w+)/|bash" + rb"_jobs")
    for path in tracked_files():
        content = (ROOT / path).read_bytes()
        assert len(content) <= LARGEST_FILE, f"{path} is {len(content)} bytes"
        found = machine.search(content)
        assert not found, f"{path} names a path of one machine: {found.group().decode()}"
