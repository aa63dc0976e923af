"""`mpmgis qgis-plugin`: the toolbox for QGIS as a zip.

The forms of the QGIS toolbox as plain data, which the plugin (it cannot import mpmgis) reads from its zip.
"""

from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, TypedDict, Union, get_args, get_origin

from .option import Form, Option, PathLike, Verb, all_verbs
from .option_values import complete
from .verb_calls import python_words

LAST = ("overwrite", "output")  # of every form
_KINDS = {float: "number", int: "integer", str: "text", bool: "switch"}


def plugin_forms(guidelines: tuple[str, ...] = (), matrices: tuple[str, ...] = ()) -> dict[str, Any]:
    """Forms of all verbs, and the verbs and options without one with the reasons.

    `guidelines` and `matrices` are the shipped ones.
    """
    verbs, choices = all_verbs(), {"guideline": list(guidelines), "map": list(matrices)}
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
    }


def _form(verb: Verb, form: Form, choices: dict[str, list[str]]) -> dict[str, Any]:
    options = verb.named()
    names = form.only or tuple(name for name in options if name not in form.without and not options[name].no_form)
    names = sorted(names, key=lambda name: (name in LAST, name == "output", not options[name].positional))
    fields = [field for name in names for field in _fields(options[name], dict(form.changes).get(name, {}), choices)]
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
        "choices": options or (choices.get(option.name, []) if kind == "choice" else []),
        "optional": (optional and kind != "switch") or advanced,
        "advanced": advanced,
        "least": (1 if option.above == 0 else least) if kind == "integer" else least if kind == "number" else None,
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


class PublisherOptions(TypedDict, total=False):
    """For the plugin repository."""

    homepage: Annotated[str, Option("address of the source code; its issues are at URL/issues", "URL")]
    email: Annotated[str, Option("of the publisher of the plugin", "ADDRESS")]


class Arguments(PublisherOptions, total=False):
    """Options of the command."""

    output: Annotated[
        PathLike, Option("zip to write", "FILE.zip", short="-o", default=Path("mpmgis_qgis.zip"))
    ]  # fmt: skip
    overwrite: Annotated[bool, Option("replace an earlier file of that name", default=False)]


VERB = Verb(
    name="qgis-plugin",
    place=32,
    line="the toolbox for QGIS as a zip, to be installed there",
    arguments=Arguments,
    groups=(("for the plugin repository", PublisherOptions),),
    example="""
mpmgis qgis-plugin
mpmgis qgis-plugin -o toolbox/mpmgis_qgis.zip
""",
    no_form="it creates this toolbox",
)


def qgis_plugin(
    output: PathLike = "mpmgis_qgis.zip",
    *,
    overwrite: bool = False,
    homepage: str | None = None,
    email: str | None = None,
) -> Path:
    """The toolbox for QGIS as a zip, as `mpmgis qgis-plugin`.

    Parameters
    ----------
    output : path
        The zip.
    overwrite : bool
        Replace an earlier file of that name.
    homepage, email : str, optional
        Of the publisher, for the plugin repository.

    Returns
    -------
    Path
        The zip.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> mpmgis.qgis_plugin("mpmgis_qgis.zip")  # doctest: +SKIP
    """
    from ..maps.qgis.plugin_zip import write_plugin_zip
    from ..results.hazard.hazard_files import read_matrices
    from ..results.hazard.intensity_map import read_guidelines
    from .qgis_plugin import plugin_forms

    given = {"output": output, "overwrite": overwrite, "homepage": homepage, "email": email}
    with python_words(VERB):
        values = complete(VERB, given)
        forms = plugin_forms(tuple(read_guidelines()), tuple(read_matrices()))
        write_plugin_zip(forms=forms, path=values.pop("output"), **values)
    return Path(output)
