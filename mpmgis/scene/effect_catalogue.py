"""The catalogue: every effect of a scene, its description, its parameters and their units."""

import re
from typing import Any

from ..laws import ground_metric
from ..terrain.inflow import COLUMNS
from .tables import TABLES, keys_of, laws_of

# keys of a table without a unit
BESIDES = {"zones": {"mu, xi, ...": "as the law has them"}, "hydrograph": {f"file: {k}": u for k, u in COLUMNS.items()}}


def catalogue() -> list[dict]:
    """Return all effects that a scene can name, in the order of the tables.

    Returns
    -------
    list of dict
        ``table``, ``law``, ``what`` (description), ``parameters`` (name -> unit). Parameters are those of the law, then
        the keys of the table that are quantities. ``law`` is the word by which a scene picks one of several laws, None
        where the table has one law only.
    """
    entries = [entry for name, kind in TABLES.items() if kind.rule.is_effect for entry in _entries(name)]
    return entries + [_entry("numerics", f"form = {form!r}", law, {}) for form, law in ground_metric.FORMS.items()]


def _entries(name):
    """Entries of the table `name`, one for each of its laws."""
    table, laws = BESIDES.get(name, {}) | quantities(TABLES[name]), laws_of(TABLES[name])
    if laws is None:
        return [_entry(name, None, TABLES[name], table)]
    return [
        _entry(name, word, law, {key: unit for key, (unit, *_) in parameters.items()} | table)
        for word, (law, parameters) in laws.items()
    ]


def quantities(table: type) -> dict[str, str]:
    """Return the keys of a scene's table that are numbers with a unit.

    Parameters
    ----------
    table : type
        Class of the table; the description of a key has its unit in brackets.

    Returns
    -------
    dict of str to str
        Key -> unit.
    """
    units = {name: re.search(r"\[([^]]+)\]", f.metadata["doc"]) for name, f in keys_of(table).items()}
    kinds = {name: f.metadata["kind"] for name, f in keys_of(table).items()}
    numbers = (name for name, kind in kinds.items() if float in (kind if isinstance(kind, tuple) else (kind,)))
    return {name: units[name][1] for name in numbers if units[name]}


def _entry(table: str, law: str | None, described: type, parameters: dict[str, str]) -> dict[str, Any]:
    what = described.__doc__.strip().splitlines()[0].removeprefix("Compute ").removeprefix("Return ")
    what = what[0].upper() + what[1:]
    return {"table": table, "law": law, "what": what, "parameters": parameters}
