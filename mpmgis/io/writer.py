"""Which process on which machine writes something, in a few characters, and whether that process is over.

A folder may be shared by machines, and by containers whose process numbers mean nothing outside. A process is known by
its machine, the start of that machine, its number and its own start. Where any of this cannot be known, the process
counts as alive: what it left half done is left alone.
"""

import hashlib
import os
import re
import secrets
import socket
from functools import cache
from typing import NamedTuple

from .. import system

_INITIAL_SPACE = "pid:[4026531836]"  # of process numbers: that of a Linux machine itself, not of a container
_TEXT = re.compile(r"(\d{1,10})-([0-9a-f]{8})([0-9a-f]{8})-([0-9a-f]{1,16})")
PATTERN = r"\d{1,10}-[0-9a-f]{16}-[0-9a-f]{1,16}-[0-9a-f]{8}"  # of `new_token`
UNKNOWN = system.UNKNOWN


class Writer(NamedTuple):
    """A process: its `number`, digests of its `host` and of the `boot` of that, and its `start` (UNKNOWN: not told)."""

    number: int
    host: str
    boot: str
    start: int

    def __str__(self):
        return f"{self.number}-{self.host}{self.boot}-{self.start:x}"

    def is_over(self):
        """Whether this process has certainly ended."""
        if self.host != host():
            return False
        if self.boot != boot():
            return _is_no_container()  # the machine was started again; of containers only their own start is known
        return not _runs(self.number, self.start)


def this_process():
    """The Writer of this process."""
    return Writer(os.getpid(), host(), boot(), started(os.getpid()))


def new_token():
    """Text for the names of temporary files: this process, and eight digits that nobody foresees."""
    return f"{this_process()}-{secrets.token_hex(4)}"


def written_by(text):
    """The Writer that the text of one, or a token, begins with; None where it is none."""
    found = _TEXT.match(text)
    return None if found is None else Writer(int(found[1]), found[2], found[3], int(found[4], 16))


@cache
def host():
    """Eight digits of this machine and, in a container, of its space of process numbers."""
    return _digest(socket.gethostname(), system.machine_number(), _space())


@cache
def boot():
    """Eight digits of the start of this machine; the same at any time where processes tell the date of their start."""
    return _digest(system.start_of_machine())


def started(number):
    """When process `number` was started, in the system's own count; UNKNOWN where nothing tells it."""
    return system.process_start(number)


def _runs(number, start):
    """Whether process `number` that began at `start` may still run on this machine."""
    if not system.runs(number):
        return False
    now = started(number)
    return UNKNOWN in (now, start) or now == start


def _is_no_container():
    return _space() == _INITIAL_SPACE and bool(system.machine_number())


@cache
def _space():
    return system.process_space()


def _digest(*texts):
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:8]
