"""Scenes from TOML files and from plain dictionaries."""

import re
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any

from ..laws import friction
from ..laws.own_law import NO_OWN_LAWS, OwnLaws
from ..system.errors import SceneError, one_line
from ..system.text_tables import decoded
from .joint_checks import check_together
from .key_checks import listed, made_table, meant, shown
from .scene import Scene, friction_laws
from .solver_checks import check_solver
from .tables import LISTED, SOLVERS, TABLES, StageTable

MOST_DOTS = 100  # in a key; those of a scene have one
_MAY_BE_KEY = re.compile(r"[\w\s.\[\"'-]+")


def read_scene(path: str | Path, own_laws: OwnLaws = NO_OWN_LAWS) -> Scene:
    """Read and check a `scene.toml`.

    Parameters
    ----------
    path : str or Path
    own_laws : OwnLaws
        User-defined laws that the scene may name.

    Raises
    ------
    SceneError
        In one line.
    """
    path = Path(path)
    return scene_from_tables(read_toml(path), path.parent, path.name, own_laws)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read the dictionary in a TOML file as any editor saves it.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    SceneError
        In one line: no readable file, no TOML, keys of too many parts.
    """
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise SceneError(f"{path} is a pipe or a device, expected a file; write the scene into one")
    try:
        text = decoded(path.read_bytes())
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file") from error
    except IsADirectoryError as error:
        raise SceneError(f"{path} is a folder, expected a text file; name the file in it") from error
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path} is not a readable text file ({one_line(error)[:80]})") from error
    _require_short_keys(path, text)
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: of TOML, and for integers with thousands of digits
        raise SceneError(f"{path} is not valid TOML: {one_line(error)[:120]}{_hint(text, error)}") from error
    return tables


def _require_short_keys(path, text):
    """Refuse dotted keys of many parts: the parser's memory and time grow with the square of their number."""
    for number, line in enumerate(text.splitlines(), 1):
        runs = _MAY_BE_KEY.finditer(line)  # a key is at the start of a line and before each = of an inline table
        dots = max(
            (run[0].count(".") for run in runs if run.start() == 0 or line[run.end() : run.end() + 1] == "="), default=0
        )
        if dots > MOST_DOTS:
            raise SceneError(f"{path}, line {number}: a key of {dots + 1} parts; a scene's keys have one or two")


def _hint(text: str, error: Exception) -> str:
    """Return what a line that TOML cannot read most likely means; empty if unknown."""
    number = re.search(r"at line (\d+)", str(error))
    lines = text.splitlines()
    line = lines[int(number[1]) - 1] if number and int(number[1]) <= len(lines) else ""
    if re.search(r"=\s*-?\d+,\d", line):
        return "; numbers take a point, not a comma"
    if "\\" in line:
        return "; write paths with / or in 'single quotes'"
    if re.search(r"=\s*(?!(?:true|false|inf|nan)\b)[A-Za-z]", line):
        return '; put words in "quotes"'
    return ""


def scene_from_tables(
    tables: dict[str, Any], folder: str | Path = ".", where: str = "scene", own_laws: OwnLaws = NO_OWN_LAWS
) -> Scene:
    """Check a plain dictionary and make the Scene of it.

    Parameters
    ----------
    tables : dict of str to Any
        As `read_toml` returns them.
    folder : str or Path
        Paths in the scene are relative to it.
    where : str
        Name of the scene in messages.
    own_laws : OwnLaws
        User-defined laws that the scene may name.

    Raises
    ------
    SceneError
        With table, key, value and fix.
    """
    tables = dict(tables)
    solver = tables.pop("solver", None)
    if solver not in (None, *SOLVERS):
        raise SceneError(f"{where}: solver = {shown(solver)}, this version has {listed(SOLVERS)}")
    for name, value in tables.items():
        if name not in TABLES and not isinstance(value, (dict, list)):
            near = meant(name, ("solver", *TABLES))
            raise SceneError(
                f"{where}: unknown key {shown(name)}{near}; before the first table there is only the key solver"
            )
        if name not in TABLES:
            raise SceneError(f"{where}: unknown table [{name}]{meant(name, TABLES)}; it takes {listed(TABLES)}")
        if name in LISTED:
            if not (isinstance(tables[name], list) and all(isinstance(entry, dict) for entry in tables[name])):
                raise SceneError(f"{where}: there can be several {name}; write [[{name}]] on a separate line")
        elif not isinstance(tables[name], dict):
            raise SceneError(f"{where}: {name} is not a table; write [{name}] on a separate line")
    for name, kind in TABLES.items():
        if kind.rule.required and name not in tables:
            raise SceneError(f"{where}: the table [{name}] is missing; `mpmgis run --template` shows one")
    stages = _made("stage", tables.pop("stage", ()), where, own_laws, (), None)
    solver = _first_solver(solver, stages, where)
    solvers = {stage.solver for stage in stages} or {solver}
    check_solver(tables, solvers, where)
    by_place = {key for zone in tables.get("zones", ()) if zone.get("use") != "off" for key in zone}
    law = tables.get("friction", {}).get("law")
    instead = friction.given_instead(law) if isinstance(law, str) else {}
    by_place |= {friction.replaced_by(name) for name in (*instead, friction.SIZE) if name in by_place}
    contacts = friction_laws(solvers, NO_OWN_LAWS) if "points" in solvers else None
    made = {name: _made(name, values, where, own_laws, by_place, contacts) for name, values in tables.items()}
    scene = Scene(**made, stage=stages, solver=solver, folder=str(folder), own_laws=own_laws)
    if own_laws.laws and (scene.friction is None or scene.friction.law not in own_laws.laws):
        raise SceneError(f"{where}: --law {own_laws.path} was given, but [friction] does not name it; leave --law out")
    check_together(scene, where)
    return scene


def _first_solver(solver: str | None, stages: tuple[StageTable, ...], where: str) -> str:
    """Return the solver that a run begins with: that of the first stage, or `solver` of the scene (None: not given)."""
    if not stages:
        return solver or "columns"
    if solver not in (None, stages[0].solver):
        raise SceneError(
            f"{where}: solver = {solver!r}, but the first [[stage]] has {stages[0].solver!r}; remove this line, the "
            "stages define it"
        )
    return stages[0].solver


def _made(
    name: str, values: Any, where: str, own_laws: OwnLaws, by_place: Collection[str], contacts: dict | None
) -> Any:
    """Make the table `name`, or the tuple of all tables of that name, from TOML."""
    if name == "friction":
        return made_table(TABLES[name], values, f"{where} [{name}]", own_laws, by_place, contacts)
    if name not in LISTED:
        return made_table(TABLES[name], values, f"{where} [{name}]")
    return tuple(made_table(TABLES[name], v, f"{where} [[{name}]] number {k}") for k, v in enumerate(values, 1))
