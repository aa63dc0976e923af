"""Parse the arguments of a verb, from the table of its options."""

import argparse
import difflib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, NoReturn, get_args, get_origin

from ...system.errors import one_line
from ...system.option import Option, options_of
from ...system.option_values import value_of_text
from ..verb import Verb
from . import terminal

_NUMBERS = {"one": None, "many": "+", "maybe": "?", "any": "*"}  # Option.positional: nargs of argparse


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line and exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Print the error and exit.

        Parameters
        ----------
        message : str
        """
        terminal.print_error(f"{self.prog}: {one_line(message)}; see {self.prog} --help")
        raise SystemExit(2)

    def parse_known_args(
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse arguments; unlike argparse's, unknown ones are an error of this parser, whose message names its help.

        Parameters
        ----------
        args : sequence of str, optional
        namespace : argparse.Namespace, optional

        Returns
        -------
        (argparse.Namespace, list of str)
            The list is empty.
        """
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._meant(unknown[0])}")
        return namespace, unknown

    def _meant(self, word):
        near = difflib.get_close_matches(word.partition("=")[0], self._option_string_actions, 1, cutoff=0.75)
        return f"; did you mean {near[0]}?" if near else ""


def add_arguments(parser: argparse.ArgumentParser, verb: Verb) -> None:
    """Declare all options of a verb.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    verb : Verb
    """
    options, grouped = verb.named(), {}
    for title, table in verb.groups:
        grouped.update(dict.fromkeys(options_of(table), title))
    groups: dict[Any, Any] = {None: parser}
    ordered = sorted(options.values(), key=lambda option: (option.name in grouped, not option.positional))
    for option in ordered:
        title = grouped.get(option.name)
        if title not in groups:
            groups[title] = parser.add_argument_group(title)
        group = groups[title]
        if option.exclusive:
            key = title, option.exclusive
            if key not in groups:
                groups[key] = group.add_mutually_exclusive_group()
            group = groups[key]
        _add(group, option)


def _add(group: Any, option: Option) -> None:
    words = option.words.replace("%%", "%").replace("%", "%%")
    if option.type is bool:
        action = "store_false" if option.turned_off else "store_true"
        group.add_argument(*option.flags, dest=option.name, action=action, help=words)
        return
    given: dict[str, Any] = {"help": words, "type": _converter(option), "metavar": option.metavar or None}
    if get_origin(option.type) is Literal:
        given |= {"type": str, "choices": get_args(option.type), "metavar": None}
    if option.positional:
        group.add_argument(option.name, nargs=_NUMBERS[option.positional], **given)
        return
    if option.repeat:
        given |= {"action": "append"}
    group.add_argument(
        *option.flags,
        dest=option.name,
        required=option.required,
        default=[] if option.default == () and option.repeat else option.default,
        **given,
    )


def _converter(option: Option):
    """The function from text to value for argparse, with the messages of `value_of_text`."""
    one = option
    if option.positional in ("many", "any"):  # a value for each
        one = replace(option, repeat=True)

    def convert(text):
        try:
            return value_of_text(text, one)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return convert


def values_of(arguments: argparse.Namespace, verb: Verb) -> dict[str, Any]:
    """Return the options of a verb by name, as given to the command.

    Parameters
    ----------
    arguments : argparse.Namespace
    verb : Verb
    """
    found = {name: value for name, value in vars(arguments).items() if name in verb.named()}
    return {name: tuple(value) if isinstance(value, list) else value for name, value in found.items()}
