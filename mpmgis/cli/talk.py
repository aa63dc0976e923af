"""Talk goes to stderr, data to stdout; -v says more, -q says nothing but errors."""

import logging
import re
import sys
from contextlib import nullcontext

from ..messages import log, logged_after_success

volume = 0
_LEVELS = {-1: logging.ERROR, 0: logging.INFO, 1: logging.DEBUG}
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")


def use_any_terminal():
    """Write what a terminal's encoding lacks as an escape (\\xf6) from now on, where it would end the program."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def harmless(text):
    """`text` with its control characters, which names in files may have and a terminal obeys, as escapes."""
    return _CONTROL.sub(lambda found: f"\\x{ord(found.group()):02x}", str(text))


def complain(text):
    """An error's line, also with -q."""
    print(harmless(text), file=sys.stderr, flush=True)


def add_arguments(parser):
    """Add -v and -q, which every verb has."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument("-v", "--verbose", action="store_true", help="say more on stderr")
    group.add_argument("-q", "--quiet", action="store_true", help="say nothing on stderr but errors")


def add_trust(parser):
    """Add --trust to a verb that reads what scenes, frames and files of others name, in this process alone."""
    parser.add_argument(
        "--trust",
        action="store_true",
        help="follow what a scene, a frame or another code's file names: the network, virtual rasters behind another "
        "suffix, external links and virtual datasets of HDF5 (default: only what lies in it and on this disk)",
    )


def set_volume(arguments):
    """Take -v or -q from the parsed arguments."""
    global volume
    volume = 1 if getattr(arguments, "verbose", False) else -1 if getattr(arguments, "quiet", False) else 0
    log.setLevel(_LEVELS[volume])


class _OnStderr(logging.Handler):
    """Prints messages of the package on stderr as they come."""

    def emit(self, record):
        print(harmless(record.getMessage()), file=sys.stderr, flush=True)


def show_messages():
    """Print what the package logs on stderr from now on."""
    if not any(isinstance(handler, _OnStderr) for handler in log.handlers):
        log.addHandler(_OnStderr())
    log.propagate = False


def notes_after_success():
    """A context that prints messages after it, so that an error stands alone; at once with -v."""
    return nullcontext() if volume > 0 else logged_after_success()


def say(text):
    """A line for the user, unless -q."""
    if volume >= 0:
        print(harmless(text), file=sys.stderr, flush=True)


def detail(text):
    """A line for the user who asked for -v."""
    if volume > 0:
        print(harmless(text), file=sys.stderr, flush=True)
