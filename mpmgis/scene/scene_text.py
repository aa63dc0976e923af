"""Scenes as TOML text, and the commented template."""

import json
from collections.abc import Iterator
from dataclasses import MISSING, fields
from typing import Any

from ..laws import friction
from .material_table import STICKING_LAW
from .scene import Scene
from .tables import LISTED, TABLES, keys_of, laws_of

_EXAMPLES = {
    "mu": 0.2,
    "xi": 1000.0,
    "erosion_energy": 5000.0,
    "bulk_modulus": 6.7e6,
    "shear_modulus": 4e6,
    "friction_angle": 40.0,
    "cohesion": 1000.0,
}


def toml_value(value: Any) -> str:
    """Return a value as TOML writes it.

    Parameters
    ----------
    value : bool, str, dict, list, tuple or number
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml_value(part)}" for key, part in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return repr(value)


def scene_text(scene: Scene, note: str = "") -> str:
    """Write the scene as TOML text that `read_scene` reads back to the same scene.

    Parameters
    ----------
    scene : Scene
    note : str
        Comment in the first line.
    """
    lines = [f"# {note}"] if note else []
    for name, values in scene.as_tables().items():
        if name not in TABLES:
            lines.append(f"{name} = {toml_value(values)}")
            continue
        for table in values if name in LISTED else [values]:
            lines += ["", _heading(name)] + [f"{key} = {toml_value(value)}" for key, value in table.items()]
    return "\n".join(lines) + "\n"


def _heading(name):
    return f"[[{name}]]" if name in LISTED else f"[{name}]"


def template() -> str:
    """Write a commented scene made from the tables; lines with a leading # are optional and show their default."""
    lines = [
        "# A scene for `mpmgis run`. Paths are relative to this file; SI units. Lines with # are optional.",
        "",
        'solver = "columns"  # depth-averaged; "points": 3D; not with [[stage]], where each stage has its own',
    ]
    for name, kind in TABLES.items():
        shown = kind.rule.in_use
        only = f" With solver = {kind.rule.solver!r}." if kind.rule.solver else ""
        lines += ["", f"# {kind.__doc__.strip()}{only}", f"{'' if shown else '# '}{_heading(name)}"]
        for f in fields(kind):
            if "kind" in f.metadata:
                lines.append(_template_line(f, shown))
            elif "by_place" in f.metadata:
                lines.append(f"{'# ' + f.metadata['by_place']:<34} # parameters of the law: number, column or raster")
            elif "parameters_of" in f.metadata:
                lines += _template_parameters(laws_of(kind), keys_of(kind)["law"].metadata["example"], shown)
    return "\n".join(lines) + "\n"


def _template_line(f, shown):
    value = f.metadata["example"] if f.default in (MISSING, None) else f.default
    optional = "" if shown and (f.default is MISSING or f.metadata["in_use"]) else "# "
    choices = f" ({' | '.join(map(str, f.metadata['choices']))})" if f.metadata["choices"] else ""
    return f"{optional + f.name + ' = ' + toml_value(value):<34} # {f.metadata['doc']}{choices}"


def _template_parameters(laws: dict[str, tuple], example: str, shown: bool) -> Iterator[str]:
    """Yield the parameters of the `example` law, then a line for each law."""
    for name, (unit, doc, *_) in laws[example][1].items():
        yield f"{('' if shown else '# ') + name + ' = ' + toml_value(_EXAMPLES[name]):<34} # [{unit}] {doc}"
    for law, (_, parameters) in laws.items():
        yield f"# law = {law!r} takes {', '.join(parameters)}"
    if laws is friction.LAWS:
        for name, (parameter, (unit, doc, *_)) in friction.IN_PLACE_OF.items():
            value = toml_value(round(friction.turbulent_coefficient(_EXAMPLES[parameter]), 5))
            yield f"{'# ' + name + ' = ' + value:<34} # [{unit}] {doc}; in place of {parameter}"
        size, sizes = toml_value(friction.BY_VOLUME), " | ".join((*friction.SIZES, friction.BY_VOLUME))
        yield f"{f'# {friction.SIZE} = {size}':<34} # of {friction.SIZED_LAW} ({sizes}); in place of mu"
        yield f"# law = {STICKING_LAW!r} takes no parameters; with solver = 'points'"
