"""Print a completion script, made by shtab from the parsers; nothing is needed when it is used."""

import argparse
from typing import get_args

import shtab

from ...system.option import PathLike
from ..verb import all_verbs
from .main import whole_parser


def run(arguments: argparse.Namespace) -> int:
    """Print the script of a shell.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    parser, parsers = whole_parser()
    for verb in all_verbs():
        options = verb.named()
        for action in parsers[verb.name]._actions:
            option = options.get(action.dest)
            if option is not None and _is_path(option):
                action.complete = shtab.DIRECTORY if option.kind == "new folder" else shtab.FILE
    print(shtab.complete(parser, shell=arguments.shell))
    return 0


def _is_path(option):
    return option.type == PathLike or PathLike in get_args(option.type)
