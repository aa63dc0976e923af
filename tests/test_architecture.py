"""The structure of the package is that of mpmgis/ARCHITECTURE.md, by the figures of .ci/structure.py."""

import ast
import importlib.util
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TOP_LEVEL = {
    *("pyproject.toml", "mpmgis", "tests", "notebooks", "sample_data", "README.md"),
    *("LICENSE", "Makefile", "CHANGELOG.md"),
}
LARGEST_FILE = 3_000_000  # [bytes]
SPECIFICATION = importlib.util.spec_from_file_location("structure", ROOT / ".ci" / "structure.py")
structure = importlib.util.module_from_spec(SPECIFICATION)
SPECIFICATION.loader.exec_module(structure)
PACKAGE, SOURCES, module_name = structure.PACKAGE, structure.SOURCES, structure.module_name


def tracked_files():
    """Paths that git tracks, relative to the root."""
    try:
        listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no git checkout")
    return [Path(name) for name in listing.split("\0") if name and (ROOT / name).exists()]


def test_every_module_is_in_the_table_of_layers():
    outside = [name for name in structure.MODULES if not structure.within(name, structure.LAYER)]
    folders = {unit.split("/")[0] for unit in structure.LAYER if "/" in unit}  # with units of their own within
    assert set(outside) - folders == {"__init__"}
    assert all((PACKAGE / unit).exists() or (PACKAGE / f"{unit}.py").exists() for unit in structure.LAYER)


@pytest.mark.parametrize("title", structure.LIMITS)
def test_figures_of_the_structure_are_within_their_limits(title):
    found = structure.figures()[title]
    assert len(found) <= structure.LIMITS[title], "\n".join(map(str, found))


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_libraries_are_imported_only_by_their_units(path):
    for line, name in structure.imports(path):
        allowed = structure.LIBRARIES.get(name.split(".")[0])
        assert allowed is None or structure.within(module_name(path), allowed), (
            f"{path}:{line} imports {name}, which only these may import: {sorted(allowed)}"
        )


def test_the_table_of_libraries_has_only_libraries_in_use():
    used = {name.split(".")[0] for path in SOURCES for _, name in structure.imports(path)}
    assert set(structure.LIBRARIES) <= used


@pytest.mark.parametrize("path", [path for path in SOURCES if path.name != "__init__.py"], ids=module_name)
def test_modules_have_docstrings(path):
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    first, _, rest = docstring.partition("\n")
    assert len(first.split()) >= 2, f"{path} has no docstring, or one whose first line says nothing"
    assert not rest or first.endswith((".", ":")) or rest.startswith("\n"), f"{path}: {first} goes on in the next line"


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_only_the_command_line_prints(path):
    if structure.within(module_name(path), ["commands/shell"]):
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
