"""JSON Schema (draft 2020-12) of scene.toml, made from the tables of the scene and the laws, for editors and programs.

It contains the rules on one key or one law: kinds, ranges, choices, unknown keys and parameters. Rules on several
tables together (`joint_checks`) are left to the program.
"""

from dataclasses import MISSING, fields
from typing import Any

from ..laws import friction
from . import material_table
from .tables import LISTED, SOLVERS, TABLES, keys_of, laws_of

DIALECT = "https://json-schema.org/draft/2020-12/schema"
OWN_LAW = r"\.py:[A-Za-z_][A-Za-z0-9_]*$"
_TYPES = {float: "number", int: "integer", str: "string", bool: "boolean", dict: "object"}

Schema = dict[str, Any]


def json_schema() -> Schema:
    """Return the schema as a dictionary."""
    laws = _friction_laws()
    properties: Schema = {"solver": {"enum": list(SOLVERS), "description": "columns: depth-averaged; points: 3D"}}
    for name, kind in TABLES.items():
        table = _table(name, kind)
        properties[name] = {"type": "array", "items": table} if name in LISTED else table
    return {
        "$schema": DIALECT,
        "title": "Scene of mpmgis",
        "description": "A simulation of mpmgis run; all values in SI units, angles in degrees.",
        "type": "object",
        "properties": properties,
        "required": [name for name, kind in TABLES.items() if kind.rule.required],
        "anyOf": [{"required": ["release"]}, {"required": ["hydrograph"]}],
        "allOf": [_zones_of(law, parameters) for law, parameters in laws.items()],
        "additionalProperties": False,
    }


def _friction_laws() -> dict[str, Schema]:
    """Name -> parameters (name -> schema) of the laws of friction of both solvers, with what may be given instead."""
    given = {law: friction.parameters_to_give(law) for law in friction.LAWS} | {material_table.STICKING_LAW: {}}
    found = {law: {name: _parameter(of) for name, of in parameters.items()} for law, parameters in given.items()}
    sizes = [*friction.SIZES, friction.BY_VOLUME]
    found[friction.SIZED_LAW][friction.SIZE] = {"type": "string", "enum": sizes, "description": "in place of mu"}
    return found


def _parameter(parameter: Any) -> Schema:
    schema = {"type": "number", "description": f"{parameter.meaning} [{parameter.unit}]"}
    return schema | _bounds(parameter.smallest, parameter.largest, above=False)


def _bounds(low: float | None, high: float | None, above: bool) -> Schema:
    found = {} if low is None else {"exclusiveMinimum" if above else "minimum": low}
    return found if high is None else found | {"maximum": high}


def _table(name: str, kind: Any) -> Schema:
    keys = keys_of(kind)
    properties = {key: _key(f) for key, f in keys.items()}
    required = [key for key, f in keys.items() if f.default is MISSING]
    schema: Schema = {"type": "object", "properties": properties, "additionalProperties": False}
    schema["description"] = (kind.__doc__ or "").strip().splitlines()[0]
    if required:
        schema["required"] = required
    if name == "friction":
        return _with_laws(schema, _friction_laws(), {}, own=True)
    by_law = laws_of(kind)
    if by_law is not None:
        laws = {law: {key: _parameter(p) for key, p in parameters.items()} for law, (_, parameters) in by_law.items()}
        needed = {law: [key for key, p in ps.items() if p.default is None] for law, (_, ps) in by_law.items()}
        return _with_laws(schema, laws, needed, own=False)
    if any("by_place" in f.metadata for f in fields(kind)):  # parameters of the law of [friction]: see _zones_of
        schema["additionalProperties"] = {"type": ["number", "string"]}
    return schema


def _key(f: Any) -> Schema:
    checks = f.metadata
    kinds = checks["kind"] if isinstance(checks["kind"], tuple) else (checks["kind"],)
    options = [_of_kind(kind, f) for kind in kinds]
    schema = options[0] if len(options) == 1 else {"anyOf": options}
    schema = schema | {"description": checks["doc"]}
    if f.default is not MISSING and f.default is not None:
        schema["default"] = list(f.default) if isinstance(f.default, tuple) else f.default
    return schema


def _of_kind(kind: Any, f: Any) -> Schema:
    checks, entries = f.metadata, f.metadata["entries"]
    if kind is list:
        limits = {"minItems": 1} if entries.length is None else {"minItems": entries.length, "maxItems": entries.length}
        return {"type": "array", "items": {"type": _TYPES[entries.kind]}, **limits}
    if kind is dict and not entries.names:
        return {"type": "object", "additionalProperties": {"type": _TYPES[entries.kind]}}
    if kind is dict:
        types = [_TYPES[one] for one in entries.kind]
        properties = {name: {"type": types} for name in entries.names}
        return {"type": "object", "properties": properties, "additionalProperties": False}
    schema: Schema = {"type": _TYPES[kind]}
    if kind in (float, int):
        schema |= _bounds(checks["low"], checks["high"], checks["above"])
    if checks["choices"]:
        schema["enum"] = list(checks["choices"])
    return schema


def _with_laws(schema: Schema, laws: dict[str, Schema], needed: dict[str, list[str]], own: bool) -> Schema:
    """A table with parameters of the law that it names; `own`: the law may be in a Python file, with any numbers."""
    keys = dict(schema["properties"])
    named: Schema = {"enum": list(laws)}
    described = {"description": keys["law"]["description"]}
    keys["law"] = described | ({"anyOf": [named, {"type": "string", "pattern": OWN_LAW}]} if own else named)
    every = {name: {"type": of["type"]} for parameters in laws.values() for name, of in parameters.items()}
    branches = []
    for law, parameters in laws.items():
        then: Schema = {"properties": parameters, "propertyNames": {"enum": [*keys, *parameters]}}
        if needed.get(law):
            then["required"] = needed[law]
        branches.append({"if": _law_is(law), "then": then})
    return schema | {
        "properties": every | keys,
        "allOf": branches,
        "additionalProperties": {"type": "number"} if own else False,
    }


def _law_is(law: str) -> Schema:
    return {"properties": {"law": {"const": law}}, "required": ["law"]}


def _zones_of(law: str, parameters: Schema) -> Schema:
    """With a built-in law of friction zones have its parameters only: numbers, columns or rasters."""
    own = list(keys_of(TABLES["zones"]))
    values = {
        name: {"anyOf": [schema, {"type": "string"}], "description": schema["description"]}
        for name, schema in parameters.items()
        if schema["type"] == "number"
    }
    items = {"properties": values, "propertyNames": {"enum": [*own, *values]}}
    return {
        "if": {"properties": {"friction": _law_is(law)}, "required": ["friction"]},
        "then": {"properties": {"zones": {"items": items}}},
    }
