"""The structure of the package in numbers: `python .ci/structure.py`. Exits with 1 where a figure is beyond its limit.

Layers are those of the table in mpmgis/ARCHITECTURE.md. A unit is the longest path that this table lists.
"""

import ast
import re
import sys
from collections import Counter
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "mpmgis"
PAGE = (PACKAGE / "ARCHITECTURE.md").read_text(encoding="utf-8")
SOURCES = sorted(PACKAGE.rglob("*.py"))
SHOWN = 12  # lines about a figure beyond its limit; with -v all
LONG = 12  # parameters that a function has at most without a record

LIMITS = {
    "imports of higher layers": 0,
    "private names imported": 0,
    "file names that stand twice": 0,
    "top-level folders": 19,
    "arrows between top-level folders": 95,
    "files with constants amid the code": 10,
    "lines that the formatter skips": 0,
    "functions with more than 12 parameters": 0,
    "public functions without annotations, parameters or a verb": 0,
}
# first words of a docstring that are no verb
NO_VERBS = {
    "The",
    "A",
    "An",
    "As",
    "Whether",
    "Of",
    "In",
    "For",
    "One",
    "All",
    "This",
    "It",
    "Its",
    "Each",
    "Every",
    "No",
}


def table(heading):
    """Return the rows of the first table below `heading` of the page, cells as text."""
    section = PAGE.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def names(cell):
    """Return what stands in backticks in a cell."""
    return re.findall(r"`([^`]+)`", cell)


LAYER = {unit: int(row[0]) for row in table("Layers") for unit in names(row[1])}
LIBRARIES = {library: set(names(row[1])) for row in table("Libraries") for library in names(row[0])}


def module_name(path):
    """Return `terrain/grid` for mpmgis/terrain/grid.py, `terrain` for its `__init__.py`."""
    return path.relative_to(PACKAGE).with_suffix("").as_posix().removesuffix("/__init__")


MODULES = {module_name(path): path for path in SOURCES}


def within(name, units):
    """Return the longest of `units` (folders or modules) that contains the module `name`; None for none."""
    return max((unit for unit in units if name == unit or name.startswith(f"{unit}/")), key=len, default=None)


def unit_of(name):
    """Return the unit of the table of layers that a module belongs to."""
    return within(name, LAYER) or name


@cache
def tree(path):
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path):
    """Yield (line, dotted name) of all that a module imports, wherever in it; relative names are made absolute."""
    package = ["mpmgis", *path.relative_to(PACKAGE).parent.parts]
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                yield node.lineno, f"{origin}.{alias.name}"


def imported_modules(path):
    """Yield (line, module, name) of what a module imports from the package; `name` is "" for a whole module."""
    for line, dotted in imports(path):
        parts = dotted.split(".")
        if parts[0] != "mpmgis" or len(parts) == 1:
            continue
        whole, part = "/".join(parts[1:]), "/".join(parts[1:-1])
        yield (line, whole, "") if whole in MODULES else (line, part or "__init__", parts[-1])


def upward_imports():
    """Return a line for each import of a unit that is not in a lower layer."""
    found = []
    for name, path in MODULES.items():
        own = unit_of(name)
        for line, module, _ in imported_modules(path):
            unit = unit_of(module)
            if unit != own and unit != "__init__" and not LAYER.get(unit, 99) < LAYER.get(own, -1):
                found.append(f"mpmgis/{path.relative_to(PACKAGE)}:{line}: {own} imports {unit}")
    return found


def private_imports():
    """Return a line for each name with a leading underscore that a module imports from another one."""
    return [
        f"mpmgis/{path.relative_to(PACKAGE)}:{line}: {name} of {module}"
        for path in SOURCES
        for line, module, name in imported_modules(path)
        if name.startswith("_") and not name.startswith("__")
    ]


def repeated_names():
    """Return the file names that stand in several folders."""
    counts = Counter(path.name for path in SOURCES if path.name not in ("__init__.py", "__main__.py"))
    return sorted(name for name, count in counts.items() if count > 1)


def folders():
    """Return the top-level folders."""
    return sorted({name.split("/")[0] for name in MODULES if "/" in name})


def arrows():
    """Return the pairs (importing, imported) of top-level folders."""
    pairs = set()
    for name, path in MODULES.items():
        if "/" not in name:
            continue
        own = name.split("/")[0]
        pairs |= {(own, module.split("/")[0]) for _, module, _ in imported_modules(path) if module != "__init__"}
    return sorted(pair for pair in pairs if pair[0] != pair[1])


def files_with_late_constants():
    """Return the files in which a constant is defined after a function or class."""
    found = []
    for name, path in MODULES.items():
        defined = False
        for node in tree(path).body:
            defined |= isinstance(node, ast.FunctionDef | ast.ClassDef)
            if defined and isinstance(node, ast.Assign) and _is_constant(node):
                found.append(name)
                break
    return found


def _is_constant(node):
    named = all(isinstance(target, ast.Name) and target.id.isupper() for target in node.targets)
    return named and isinstance(node.value, ast.Constant | ast.Tuple | ast.BinOp | ast.UnaryOp)


def skipped_by_formatter():
    """Return a line for each comment that keeps the formatter from a statement."""
    mark = "fmt: " + "skip"
    return [
        f"mpmgis/{path.relative_to(PACKAGE)}:{number}"
        for path in SOURCES
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if mark in line
    ]


def long_signatures():
    """Return (parameters, place, name) of functions with more than LONG parameters."""
    return sorted(
        (count, f"mpmgis/{path.relative_to(PACKAGE)}:{node.lineno}", node.name)
        for path in SOURCES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.FunctionDef) and (count := len(_parameters(node))) > LONG
    )


def undocumented():
    """Return a line for each public function without annotations, section Parameters, or a verb in its first line."""
    found = []
    for name, path in MODULES.items():
        for node in tree(path).body:
            if isinstance(node, ast.FunctionDef):
                functions = [node]
            elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                functions = [part for part in node.body if isinstance(part, ast.FunctionDef)]
            else:
                continue
            found += [
                f"{name}:{function.lineno}: {function.name} {lack}"
                for function in functions
                if not function.name.startswith("_") and (lack := _lack(function))
            ]
    return found


def _lack(function):
    """Return what the signature or docstring of a public function lacks; "" if nothing."""
    decorators = [ast.unparse(decorator) for decorator in function.decorator_list]
    given = [a for a in _parameters(function) if a.arg not in ("self", "cls")]
    text = ast.get_docstring(function) or ""
    first = text.split(maxsplit=1)[0] if text else ""
    if function.returns is None or any(argument.annotation is None for argument in given):
        return "has no annotations"
    if given and "Parameters\n---" not in text:
        return "has no section Parameters"
    if not any("property" in decorator for decorator in decorators) and (
        not first.strip(",").isalpha() or first in NO_VERBS
    ):
        return "does not begin with a verb"
    return ""


def _parameters(function):
    return function.args.posonlyargs + function.args.args + function.args.kwonlyargs


def figures():
    """Return what LIMITS names, as lists."""
    found = (upward_imports, private_imports, repeated_names, folders, arrows)
    found += (files_with_late_constants, skipped_by_formatter, long_signatures, undocumented)
    return dict(zip(LIMITS, (function() for function in found), strict=True))


def main():
    """Print the figures, and what is beyond a limit; return the exit code."""
    beyond = False
    for title, found in figures().items():
        wrong = len(found) > LIMITS[title]
        beyond |= wrong
        print(f"{len(found):5} {title} (at most {LIMITS[title]})")
        if wrong or "-v" in sys.argv:
            shown = found if "-v" in sys.argv else found[:SHOWN]
            print(*(f"        {line}" for line in shown), sep="\n")
    print(f"{len(SOURCES):5} files")
    return int(beyond)


if __name__ == "__main__":
    sys.exit(main())
