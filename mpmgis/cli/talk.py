"""Talk goes to stderr, data to stdout; -v says more, -q says nothing but errors."""

import re
import sys

volume = 0
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


def say(text):
    """A line for the user, unless -q."""
    if volume >= 0:
        print(harmless(text), file=sys.stderr, flush=True)


def detail(text):
    """A line for the user who asked for -v."""
    if volume > 0:
        print(harmless(text), file=sys.stderr, flush=True)
