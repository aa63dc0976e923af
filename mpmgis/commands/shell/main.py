"""Run the command `mpmgis`: a parser per verb from its option table; only the module of the verb in use is imported."""

import argparse
import difflib
import gc
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

from ... import __version__
from ...system import operating_system
from ...system.errors import MpmgisError, one_line
from ...system.memory import address_space_lack
from ...system.trusted_files import trusting
from ..verb import GROUPS, Verb, all_verbs, verb_names, verb_of
from . import terminal
from .parser import OneLineParser, add_arguments
from .progress import ended_by_signals

DESCRIPTION = "Landslides, debris flows, snow and ice avalanches on real terrain with the Material Point Method."
MODULES = {  # of verbs that are more than an option table and a function
    **dict.fromkeys(("run", "demo", "ensemble", "region", "study", "calibrate"), "simulation_verbs"),
    **dict.fromkeys(("seed", "convert", "qgis-plugin"), "file_verbs"),
    "completion": "completion_script",
    "effects": "effects_text",
    "info": "info_text",
}
LONGEST_NAME = 80  # [characters] of a file's name in a message of the system


def command() -> int:
    """Run `main` with few garbage collections, which would take a third of a short run; entry point of the script.

    Imports create hundreds of thousands of objects that are never freed.
    """
    gc.set_threshold(100_000)
    code = main()
    gc.freeze()
    return code


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Default: the arguments of the process.

    Returns
    -------
    int
        Exit code: 0 done, 2 bad input, 3 unphysical, 130 or 143 interrupted.
    """
    argv = list(sys.argv[1:] if argv is None else argv)
    terminal.escape_missing_characters()
    verbs = verb_names()
    name = next((word for word in argv if word in verbs), None)
    parser = OneLineParser(
        prog="mpmgis",
        description=DESCRIPTION + ("" if name else "\n\n" + verbs_by_group()),
        epilog="mpmgis COMMAND --help shows the options of a command, with an example.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"mpmgis {__version__}")
    parsers = parser.add_subparsers(
        dest="verb", metavar="COMMAND", help="one of the above", required=True, parser_class=OneLineParser
    )
    if name is None and argv and not argv[0].startswith("-"):
        near = difflib.get_close_matches(argv[0], verbs, 1)
        parser.error(f"unknown command {argv[0]!r}" + (f"; did you mean {near[0]}?" if near else ""))
    for other in verbs:
        if other == name:
            add_verb(parsers, verb_of(name))
        else:
            parsers.add_parser(other, add_help=False)
    arguments = parser.parse_args(argv)
    terminal.set_volume(arguments)
    terminal.show_messages()
    return _guarded(arguments)


def whole_parser() -> tuple[OneLineParser, dict[str, OneLineParser]]:
    """Return the parser with the options of all verbs.

    Returns
    -------
    (OneLineParser, dict of str to OneLineParser)
        The parser; the parser of each verb.
    """
    parser = OneLineParser(prog="mpmgis", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"mpmgis {__version__}")
    parsers = parser.add_subparsers(dest="verb", metavar="COMMAND", required=True, parser_class=OneLineParser)
    return parser, {verb.name: add_verb(parsers, verb) for verb in all_verbs()}


def add_verb(parsers: Any, verb: Verb) -> OneLineParser:
    """Add the parser of a Verb.

    Parameters
    ----------
    parsers : subparsers of argparse
    verb : Verb

    Returns
    -------
    OneLineParser
        Of the verb.
    """
    description = verb.line[0].upper() + verb.line[1:] + "."
    if verb.description:
        description = verb.description.strip()
    if verb.name == "intensity":
        description += f"\n\nguidelines:\n{_guidelines()}"
    if verb.name == "report":
        description += f"\n\nmatrices:\n{_matrices()}"
    sub = parsers.add_parser(
        verb.name,
        help=verb.line.replace("%", "%%"),
        description=description,
        epilog="example:\n  " + verb.example.strip().replace("\n", "\n  "),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_arguments(sub, verb)
    terminal.add_arguments(sub)
    if verb.trust:
        terminal.add_trust(sub)
    return sub


def _guidelines():
    from ...results.hazard.guideline_files import read_guidelines

    return "\n".join(f"  {name:<30}{entry.title}" for name, entry in read_guidelines().items())


def _matrices():
    from ...results.hazard.hazard_files import read_matrices

    return "\n".join(f"  {name:<30}{entry.title}" for name, entry in read_matrices().items())


def verbs_by_group() -> str:
    """Return text with a line for every verb and its purpose, by GROUPS."""
    lines, group = [], None
    for verb in all_verbs():
        if verb.place // 10 != group:
            group = verb.place // 10
            lines.append(f"{GROUPS[group]}:")
        lines.append(f"  {verb.name:<15}{verb.line}")
    return "\n".join(lines)


def _run(arguments):
    verb = arguments.verb
    module = MODULES.get(verb, "answers")
    function = verb.replace("-", "_") if module.endswith("_verbs") else "run"
    return getattr(importlib.import_module(f".{module}", __package__), function)(arguments)


def _guarded(arguments):
    """Run the verb; errors and interruptions become one line on stderr and an exit code."""
    name, verb = f"mpmgis {arguments.verb}", verb_of(arguments.verb)
    terminal.name_flags_of(verb)
    if lack := address_space_lack(operating_system.address_space_limit()):
        terminal.print_error(f"{name}: {lack}; raise the limit (ulimit -v)")
        return 2
    try:
        with ended_by_signals(), terminal.without_font_warnings(), trusting(getattr(arguments, "trust", False)):
            return _run(arguments) or 0
    except MpmgisError as error:
        terminal.print_error(f"{name}: {one_line(error)}")
        return error.exit_code
    except KeyboardInterrupt as error:
        terminal.print_error(f"{name}: interrupted")
        return getattr(error, "exit_code", 130)
    except MemoryError:
        terminal.print_error(f"{name}: not enough memory; use larger cells, fewer particles or a smaller DTM")
        return 2
    except OSError as error:
        if operating_system.is_unread(sys.stdout, error):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        terminal.print_error(f"{name}: {_os_error_words(error)}")
        return 2
    except Exception as error:
        if terminal.volume > 0:
            raise
        kind = type(error).__name__
        terminal.print_error(f"{name}: internal error, please report it: {kind}: {one_line(error)} (-v: traceback)")
        return 1


def _os_error_words(error):
    """The message of an OSError; a name that is too long for the system is shortened."""
    text, file = one_line(error), str(error.filename)
    return text if len(file) <= LONGEST_NAME else text.replace(file, f"{file[: LONGEST_NAME - 3]}...")
