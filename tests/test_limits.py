"""The page of limits against the code: every number on it is the constant that it names."""

import importlib
import re
from pathlib import Path

import pytest

import mpmgis

PAGE = Path(mpmgis.__file__).parent / "docs" / "limits.md"
ROW = re.compile(r"^\| (?P<limit>[^|]+) \| (?P<number>[0-9.e+-]+)[^|]* \| `(?P<constant>[\w.]+)` \|", re.MULTILINE)
ROWS = {found["limit"]: found for found in ROW.finditer(PAGE.read_text(encoding="utf-8"))}


def value_of(constant):
    """The value of module.NAME, of a default of one of its classes (module.Class.name), or of one entry: NAME.0."""
    *path, name = constant.split(".")
    if name.isdigit():
        return value_of(".".join(path))[int(name)]
    owner = value_of(".".join(path)) if path[-1][0].isupper() else importlib.import_module("mpmgis." + ".".join(path))
    return getattr(owner, name)


@pytest.mark.parametrize("limit", ROWS)
def test_a_limit_is_the_constant_that_it_names(limit):
    assert float(ROWS[limit]["number"]) == float(value_of(ROWS[limit]["constant"]))


def test_every_row_that_names_a_constant_is_held():
    named = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("|") and "| `" in line]
    assert len(ROWS) == len(named) >= 15
