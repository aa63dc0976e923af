"""Print messages on stderr and data on stdout; -v prints more messages, -q only errors."""

import argparse
import logging
import re
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path

from ...system.messages import log, logged_after_success
from ..verb import Verb
from ..verb_calls import with_flags

volume = 0  # -1 with -q, 1 with -v
_flags = str  # a message with flags of the command for names of options
_LEVELS = {-1: logging.ERROR, 0: logging.INFO, 1: logging.DEBUG}
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")  # control characters without tab and newline


def name_flags_of(verb: Verb) -> None:
    """Write names of options in messages as flags of a verb from now on.

    Parameters
    ----------
    verb : Verb
    """
    global _flags
    _flags = partial(with_flags, verb=verb)


def escape_missing_characters() -> None:
    """Write characters that the terminal's encoding lacks as escapes (\\xf6) instead of raising an error."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def escaped(text: object) -> str:
    """Replace control characters, which file names can contain and a terminal executes, by escapes.

    Parameters
    ----------
    text : object

    Returns
    -------
    str
    """
    return _CONTROL.sub(lambda found: f"\\x{ord(found.group()):02x}", str(text))


def print_error(text: str) -> None:
    """Print a line on stderr, also with -q.

    Parameters
    ----------
    text : str
    """
    print(escaped(_flags(text)), file=sys.stderr, flush=True)


def note(text: str) -> None:
    """Print a line on stderr, unless -q.

    Parameters
    ----------
    text : str
    """
    if volume >= 0:
        print_error(text)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add -v and -q, which every verb has.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    """
    group = parser.add_mutually_exclusive_group()
    group.add_argument("-v", "--verbose", action="store_true", help="print more messages on stderr")
    group.add_argument("-q", "--quiet", action="store_true", help="print only errors on stderr")


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add --trust to a verb that reads scenes, frames and files of other people in this process alone.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    """
    parser.add_argument(
        "--trust",
        action="store_true",
        help="read all formats of GDAL and follow links to other files and to the network: virtual rasters, web "
        "services, external links of HDF5 (default: only the file itself, in the formats of the formats page)",
    )


def set_volume(arguments: argparse.Namespace) -> None:
    """Take -v or -q from the parsed arguments.

    Parameters
    ----------
    arguments : argparse.Namespace
    """
    global volume
    volume = 1 if getattr(arguments, "verbose", False) else -1 if getattr(arguments, "quiet", False) else 0
    log.setLevel(_LEVELS[volume])


class _OnStderr(logging.Handler):
    """Prints messages of the package on stderr as they come."""

    def emit(self, record):
        print_error(record.getMessage())


def show_messages() -> None:
    """Print messages of the package's logger on stderr from now on."""
    if not any(isinstance(handler, _OnStderr) for handler in log.handlers):
        log.addHandler(_OnStderr())


@contextmanager
def without_font_warnings() -> Iterator[None]:
    """Ignore within this block that a font lacks letters; a plot has boxes in their place."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from ", UserWarning)
        yield


def notes_after_success() -> AbstractContextManager:
    """Return a context that prints messages after it, so that an error is printed alone; at once with -v."""
    return nullcontext() if volume > 0 else logged_after_success()


def list_files(paths: Iterable[str | Path], arguments: argparse.Namespace) -> None:
    """Print the paths of written files: all with --list-files or -v, otherwise the first, and the count as a note.

    Parameters
    ----------
    paths : iterable of path
    arguments : argparse.Namespace
    """
    paths = list(paths)
    if not paths:
        return
    if volume > 0 or getattr(arguments, "list_files", False):
        print("\n".join(map(str, paths)))
        return
    print(paths[0])
    if len(paths) > 1:
        folders = {path.parent for path in map(Path, paths)}
        top = min(folders, key=lambda folder: len(folder.parts))
        note(f"wrote {len(paths)} files to {top} (--list-files prints their paths)")
