"""The generated pages of the website: commands, scene, bands, Python functions. Each returns page name -> Markdown.

`python .ci/docs/pages.py` writes what the repository and the wheel have of them: short lists of commands and functions,
and the whole tables of scenes and bands.
"""

import argparse
import ast
import importlib
import re
import sys
from dataclasses import MISSING, fields
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "mpmgis"
MARK = re.compile(r"^<!-- generated: \w+ -->\n.*", re.MULTILINE | re.DOTALL)  # the generated part ends a page
NOT_DOCUMENTED = (("commands", "shell"), ("qgis_plugin",), ("__main__",))
PLAIN_TYPES = {float: "number", int: "whole number", str: "text", bool: "true, false", list: "list", dict: "table"}


def cell(text):
    """Text as a cell of a Markdown table."""
    return " ".join(str(text).split()).replace("|", "\\|").replace("<", "&lt;")


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def toctree(names, **options):
    settings = "".join(f":{name}: {value}\n" for name, value in ({"maxdepth": 1} | options).items())
    return "```{toctree}\n" + settings + "\n" + "\n".join(names) + "\n```"


# ----------------------------------------------------------------------------------------------------------- commands


def parser_of(verb):
    """The argparse parser of a Verb, as the command makes it."""
    from mpmgis.commands.shell import main

    parsers = argparse.ArgumentParser(prog="mpmgis").add_subparsers(parser_class=main.OneLineParser)
    return main.add_verb(parsers, verb)


def verbs_by_group():
    """Title -> Verbs, in the order of the command."""
    from mpmgis.commands.verb import GROUPS, all_verbs

    groups = {}
    for verb in all_verbs():
        groups.setdefault(GROUPS[verb.place // 10], []).append(verb)
    return groups


def command_pages():
    groups, pages, index = verbs_by_group(), {}, []
    for title, verbs in groups.items():
        rows = [[f"[mpmgis {verb.name}](commands/{verb.name}.md)", cell(verb.line)] for verb in verbs]
        index += [f"## {title[0].upper()}{title[1:]}", table(["command", "purpose"], rows)]
    every = [verb for verbs in groups.values() for verb in verbs]
    index.append(toctree([f"commands/{verb.name}" for verb in every], hidden=""))
    pages["reference/commands"] = "\n\n".join(index)
    for verb in every:
        pages[f"reference/commands/{verb.name}"] = command_page(parser_of(verb))
    return pages


def command_page(parser):
    """One command: description, usage, options by group, example."""
    parts = [f"# {parser.prog}", parser.description or ""]
    usage = parser.format_usage().removeprefix("usage: ")
    parts.append(f"```text\n{usage.rstrip()}\n```")
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if action.help != argparse.SUPPRESS]
        if actions:
            parts += [f"## {group.title[0].upper()}{group.title[1:]}", "\n\n".join(map(option, actions))]
    example = (parser.epilog or "").removeprefix("example:").strip()
    if example:
        parts += ["## Examples", "```sh\n" + "\n".join(line.strip() for line in example.splitlines()) + "\n```"]
    return "\n\n".join(parts)


def option(action):
    """An option with its help as an entry of a definition list."""
    formatter = argparse.HelpFormatter("")
    name = formatter._format_action_invocation(action)
    text = formatter._expand_help(action) if action.help else ""
    text = re.sub(r"[<*_]", r"\\\g<0>", " ".join(text.split()))
    return f"`{name}`\n: " + re.sub(r"(?<![\w-])--[a-z][\w-]*", r"`\g<0>`", text)


# -------------------------------------------------------------------------------------------------------------- scene


def scene_pages():
    from mpmgis.scene.tables import LISTED, TABLES, keys_of

    parts = [
        "## Solver",
        '`solver = "columns"` (default) selects the depth-averaged solver, `solver = "points"` the 3D solver. In a '
        "scene with `[[stage]]` each stage has its own `solver`.",
    ]
    for name, kind in TABLES.items():
        heading = f"[[{name}]]" if name in LISTED else f"[{name}]"
        parts += [f"## `{heading}`", " ".join(kind.__doc__.split())]
        if kind.rule.solver:
            parts.append(f'Only with `solver = "{kind.rule.solver}"`.')
        rows = [key_row(f) for f in keys_of(kind).values()]
        parts.append(table(["key", "type", "default", "allowed", "description"], rows))
        for f in fields(kind):
            if "by_place" in f.metadata:
                parts.append("In addition: parameters of the friction law, each a number, a column name or a raster.")
            parts += [laws_text(f.metadata["parameters_of"])] if "parameters_of" in f.metadata else []
    return {"reference/scene": "\n\n".join(parts)}


def key_row(f):
    """Cells about one key of a table."""
    data = f.metadata
    kinds = data["kind"] if isinstance(data["kind"], tuple) else (data["kind"],)
    default = "required" if f.default is MISSING else "-" if f.default is None else f"`{shown(f.default)}`"
    only = f' (`solver = "{data["solver"]}"` only)' if data.get("solver") else ""
    words = " or ".join(PLAIN_TYPES[kind] for kind in kinds)
    return [f"`{f.name}`", words, default, cell(allowed(data)), cell(data["doc"]) + only]


def shown(value):
    if isinstance(value, tuple):
        return str(list(value))
    return str(value).lower() if isinstance(value, bool) else str(value)


def allowed(data):
    if data["choices"]:
        return ", ".join(f"`{choice}`" for choice in data["choices"])
    low, high = data["low"], data["high"]
    lowest = None if low is None else (f"> {low:g}" if data["above"] else f">= {low:g}")
    return ", ".join(bound for bound in (lowest, None if high is None else f"<= {high:g}") if bound)


def laws_text(laws):
    """The parameters of every law of a table."""
    parts = []
    for name, (law, parameters) in laws.items():
        summary = (law.__doc__ or "").strip().split("\n\n")[0]
        rows = [
            [
                f"`{key}`",
                cell(p.unit),
                "required" if p.default is None else f"`{p.default:g}`",
                f"{p.smallest:g} to {p.largest:g}",
                cell(p.meaning),
            ]
            for key, p in parameters.items()
        ]
        parts += [f'### `law = "{name}"`', cell(summary).replace("*", "\\*").replace("_", "\\_")]
        parts += [table(["parameter", "unit", "default", "range", "description"], rows)] if rows else []
    return "\n\n".join(parts)


# -------------------------------------------------------------------------------------------------------------- bands


def band_pages():
    from mpmgis.laws.quantities import BAND, NODATA, PARTICLE

    def rows(quantities):
        return [[f"`{q.name}`", cell(q.unit), q.dtype, cell(q.long_name), cell(q.total)] for q in quantities.values()]

    head = ["name", "unit", "type", "description", "sum of a raster"]
    text = [
        "## Raster bands",
        f"A band has the description `name [unit]`. Nodata is {NODATA:g}.",
        table(head, rows(BAND)),
        "## Particles",
        "Datasets of the group `particles` in a frame.",
        table(head[:4], [row[:4] for row in rows(PARTICLE)]),
    ]
    return {"reference/bands": "\n\n".join(text)}


# --------------------------------------------------------------------------------------------------- Python functions


def summary_of(path):
    """First line of a module's docstring."""
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n")[0]


def modules():
    """Page name -> modules on it, by the folders of the package."""
    pages = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if not any(parts[: len(left)] == left for left in NOT_DOCUMENTED) and parts[-1] != "__init__":
            pages.setdefault(".".join(parts[:-1]), []).append((".".join(("mpmgis", *parts)), path))
    return pages


def api_pages():
    pages = {}
    for name, found in modules().items():
        title = f"mpmgis.{name}"
        package = PACKAGE.joinpath(*name.split("."), "__init__.py")
        intro = summary_of(package) if package.is_file() else ""
        rows = [[f"[`{module}`](#{module.lower().replace('.', '')})", cell(summary_of(path))] for module, path in found]
        parts = [f"# {title}", intro, table(["module", "contents"], rows)]
        for module, _ in found:
            directive = f".. automodule:: {module}\n   :members:\n   :ignore-module-all:"
            parts.append(f"## `{module}`\n\n```{{eval-rst}}\n{directive}\n```")
        pages[f"api/{name}"] = "\n\n".join(part for part in parts if part)
    rows = [[f"[{name}](api/{name}.md)".replace("(api/", "("), str(len(found))] for name, found in modules().items()]
    tail = ["## All modules", table(["package", "modules"], rows), toctree(list(modules()), hidden="")]
    pages["api/index"] = "\n\n".join([public_text(), *tail])
    return pages


def public_text():
    """The public names of `import mpmgis` by the task of the command of the same name."""
    import mpmgis

    left, parts = sorted(mpmgis.__all__), []
    tasks = {title: [verb.name.replace("-", "_") for verb in verbs] for title, verbs in verbs_by_group().items()}
    tasks["commands with another name in Python"] = ["solver_start", "scene_effects", "effect_catalogue", "sample_site"]
    tasks |= {"results, particles and errors": list(left)}
    for title, names in tasks.items():
        here = [name for name in names if name in left]
        left = [name for name in left if name not in here]
        if here:
            parts += [f"## {title[0].upper()}{title[1:]}", *map(public_entry, here)]
    return "\n\n".join(parts)


def public_entry(name):
    import mpmgis

    thing = getattr(mpmgis, name)
    if isinstance(thing, type):
        first = (thing.__doc__ or "").strip().split("\n")[0]
        return f"`mpmgis.{name}`\n: {{py:class}}`~{thing.__module__}.{name}`: {first}"
    return f"```{{eval-rst}}\n.. autofunction:: {thing.__module__}.{name}\n   :no-index:\n```"


def generated():
    """Page name -> the generated part of it."""
    sys.path.insert(0, str(ROOT))
    importlib.invalidate_caches()
    return {**command_pages(), **scene_pages(), **band_pages(), **api_pages()}


# --------------------------------------------------------------------------------------------- repository and wheel


def stored_pages():
    """Page name -> the generated part of it in the repository, where links lead to no page of a command or function."""
    return {**scene_pages(), **band_pages(), "reference/commands": command_list(), "api/index": function_list()}


def command_list():
    parts = []
    for title, verbs in verbs_by_group().items():
        rows = [[f"`mpmgis {verb.name}`", cell(verb.line)] for verb in verbs]
        parts += [f"## {title[0].upper()}{title[1:]}", table(["command", "purpose"], rows)]
    return "\n\n".join(parts)


def function_list():
    import mpmgis

    rows = []
    for name in sorted(mpmgis.__all__):
        first = (getattr(mpmgis, name).__doc__ or "").strip().split("\n\n")[0]
        rows.append([f"`mpmgis.{name}`", cell(first)])
    return table(["name", "purpose"], rows)


def with_part(text, part):
    """A page with `part` in place of what was generated before."""
    mark = MARK.search(text)[0].split("\n", 1)[0]
    return MARK.sub("", text) + f"{mark}\n\n{part}\n"


def main():
    sys.path.insert(0, str(ROOT))
    for name, part in stored_pages().items():
        page = PACKAGE / "docs" / f"{name}.md"
        page.write_text(with_part(page.read_text(encoding="utf-8"), part), encoding="utf-8")


if __name__ == "__main__":
    main()
