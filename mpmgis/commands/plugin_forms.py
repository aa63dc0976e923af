"""Describe the forms of the verbs for the QGIS toolbox as plain data.

The plugin, which cannot import mpmgis, reads them from its zip.
"""

from dataclasses import replace
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from ..laws import friction
from ..maps.averaging.band_products import more_products
from ..scene.tables import DENSITY, TABLES, keys_of
from ..studies.calibration_priors import RANGES
from ..system.option import Option, PathLike
from .verb import Form, Verb, all_verbs, verb_of

LAST = ("overwrite", "output")  # of every form
SCENE_LAW = "Voellmy"  # of the form for a usual simulation
SCENE_KEYS = {  # field of that form: table and key of the scene
    "DENSITY": ("release", "density"),
    "CELL_SIZE": ("numerics", "cell_size"),
    "END_TIME": ("output", "end_time"),
    "FRAME_INTERVAL": ("output", "frame_interval"),
}
_KINDS = {float: "number", int: "integer", str: "text", bool: "switch"}


def plugin_forms(guidelines: tuple[str, ...] = (), matrices: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the forms of all verbs, and the verbs and options without one with the reasons.

    Parameters
    ----------
    guidelines, matrices : tuple of str
        Names of the shipped ones.

    Returns
    -------
    dict
        For JSON.
    """
    verbs = all_verbs()
    choices = {"guideline": list(guidelines), "map": list(matrices), "products": list(more_products())}
    return {
        "forms": [_form(verb, form, choices) for verb in verbs for form in verb.forms],
        "left_out_verbs": {verb.name: verb.no_form for verb in verbs if not verb.forms},
        "left_out_options": [
            [verb.name, option.flags[-1], option.no_form]
            for verb in verbs
            if verb.forms
            for option in verb.named().values()
            if option.no_form
        ],
        "scene": {"fields": _scene_fields(), "friction_ranges": _friction_ranges()},
    }


def _scene_fields() -> dict[str, dict[str, Any]]:
    """Properties of the fields of the form for a usual simulation that the scene and its laws state."""
    keys = {name: keys_of(TABLES[table])[key].metadata for name, (table, key) in SCENE_KEYS.items()}
    fields = {name: {"least": checks["low"], "most": checks["high"]} for name, checks in keys.items()}
    laws = friction.LAWS[SCENE_LAW][1].items()
    fields |= {name.upper(): {"least": known.smallest, "most": known.largest} for name, known in laws}
    density = verb_of("seed").named()["density"]
    fields["DENSITY"] |= {
        "label": _with_unit(density),
        "help": _sentence(replace(density, usual="")),
        "default": DENSITY,
    }
    return fields


def _friction_ranges() -> str:
    """Ranges of calibrated parameters of the law, by material, in words."""
    words = []
    for material, ranges in RANGES.items():
        spans = ((key.removeprefix("friction."), span.replace(":", " to ")) for key, span in ranges.items())
        shown = ", ".join(f"{name} {friction.parameter_words(SCENE_LAW, name, span)}" for name, span in spans)
        words.append(f"{material.replace('-', ' ')} {shown}")
    return "; ".join(words)


def _form(verb: Verb, form: Form, choices: dict[str, list[str]]) -> dict[str, Any]:
    options = verb.named()
    names = form.only or tuple(name for name in options if name not in form.without and not options[name].no_form)
    changes = dict(form.changes)

    def place(name):
        """What must be given stands first, OUTPUT last."""
        needed = options[name].required or not changes.get(name, {}).get("optional", True)
        return name in LAST, name == "output", not options[name].positional, not needed

    names = sorted(names, key=place)
    fields = [field for name in names for field in _fields(options[name], changes.get(name, {}), choices)]
    if form.load:
        load = {"name": "LOAD", "kind": "switch", "label": f"Open {form.load} in this project", "default": True}
        fields.append(load | {"option": "", "help": "With their styles and times."})
    alone = [field for field in fields if field["name"] in form.one_of]
    for field in alone:
        field["optional"] = True
    return {
        "verb": verb.name,
        "name": form.name,
        "title": form.title,
        "group": form.group,
        "help": form.text,
        "says": form.prints,
        "project": form.project,
        "plots": form.plots,
        "table": form.table,
        "layers": form.layers,
        "palette": form.palette,
        "one_of": form.one_of,
        "fields": fields,
    }


def _fields(option: Option, changes: dict[str, Any], choices: dict[str, list[str]]) -> list[dict[str, Any]]:
    kind = changes.get("kind") or option.kind or _kind(option)
    options = [*get_args(option.type)] if kind == "choice" else []
    optional = not (option.required or option.positional in ("one", "many"))
    advanced = optional and option.folded
    least = next((bound for bound in (option.above, option.least) if bound is not None), None)
    field = {
        "name": option.field or option.name.upper(),
        "kind": kind,
        "label": _with_unit(option),
        "option": None if option.positional else option.flags[-1],
        "help": _sentence(option),
        "default": _default(option, kind),
        "choices": options or (choices.get(option.name, []) if kind in ("choice", "choices") else []),
        "optional": (optional and kind != "switch") or advanced,
        "advanced": advanced,
        "least": (1 if option.above == 0 else least) if kind == "integer" else least if kind == "number" else None,
        "most": option.most if kind in ("number", "integer") else None,
        "files": option.files or ("Scenes (*.toml)" if option.name == "scene" else ""),
    }
    field |= changes
    field["advanced"] = field["advanced"] and field["optional"]
    also = [field | {"default": None, "choices": [], "files": ""} | dict(more) for more in option.also]
    return [field, *also]


def _kind(option: Option) -> str:
    kind = option.type
    if option.repeat:
        return "files" if PathLike in get_args(kind) else "texts"
    if kind == PathLike:
        return "file"
    if get_origin(kind) is Literal:
        return "choice"
    if get_origin(kind) in (Union, UnionType, tuple):
        return "text"
    return _KINDS[kind]


def _default(option: Option, kind: str) -> Any:
    if kind == "switch":
        return False
    if option.default in (None, ()):
        return None
    if isinstance(option.default, Path):
        return str(option.default)
    if isinstance(option.default, tuple):
        return ",".join(f"{number:g}" for number in option.default)
    return f"{option.default:g}" if kind == "text" and isinstance(option.default, float) else option.default


def _with_unit(option: Option) -> str:
    return f"{option.label} [{option.unit.replace('%%', '%')}]" if option.unit else option.label


def _sentence(option: Option) -> str:
    """Help of a field, from that of the command."""
    usual = option.usual
    words = option.help.replace("%%", "%")
    if option.unit:
        words += f" [{option.unit.replace('%%', '%')}]"
    sentence = f"{words[0].upper()}{words[1:]}."
    return sentence + (f" Empty: {usual}." if usual else "")
