"""Talk goes to stderr, data to stdout; -v says more, -q says nothing but errors."""

import sys

volume = 0


def add_arguments(parser):
    """Add -v and -q, which every verb has."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument("-v", "--verbose", action="store_true", help="say more on stderr")
    group.add_argument("-q", "--quiet", action="store_true", help="say nothing on stderr but errors")


def set_volume(arguments):
    """Take -v or -q from the parsed arguments."""
    global volume
    volume = 1 if getattr(arguments, "verbose", False) else -1 if getattr(arguments, "quiet", False) else 0


def say(text):
    """A line for the user, unless -q."""
    if volume >= 0:
        print(text, file=sys.stderr, flush=True)


def detail(text):
    """A line for the user who asked for -v."""
    if volume > 0:
        print(text, file=sys.stderr, flush=True)
