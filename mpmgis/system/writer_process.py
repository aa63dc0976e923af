"""The process that writes a file, as it is named in temporary files and locks.

Machines and containers can share a folder, and process numbers are valid only inside one of them. A process is
identified by its machine, the start of that machine, its number and its own start. Where one of these is unknown, the
process counts as alive and its incomplete files are kept.
"""

import hashlib
import os
import re
import secrets
import socket
from functools import cache
from typing import NamedTuple

from . import operating_system

_INITIAL_SPACE = "pid:[4026531836]"  # PID namespace of a Linux machine itself, not of a container
_TEXT = re.compile(r"(\d{1,10})-([0-9a-f]{8})([0-9a-f]{8})-([0-9a-f]{1,16})")
PATTERN = r"\d{1,10}-[0-9a-f]{16}-[0-9a-f]{1,16}-[0-9a-f]{8}"  # of `new_token`


class Writer(NamedTuple):
    """A process that writes files.

    Parameters
    ----------
    number : int
        Of the process.
    host, boot : str
        Digests of the machine and of its start.
    start : int
        `operating_system.process_start`; UNKNOWN if not available.
    """

    number: int
    host: str
    boot: str
    start: int

    def __str__(self):
        return f"{self.number}-{self.host}{self.boot}-{self.start:x}"

    def is_over(self) -> bool:
        """Return whether this process has certainly ended."""
        if self.host != host():
            return False
        if self.boot != boot():
            return _is_no_container()  # the machine was restarted; a container has only its own start
        return not _still_runs(self.number, self.start)


def this_process() -> Writer:
    """Return the Writer of this process."""
    return Writer(os.getpid(), host(), boot(), operating_system.process_start(os.getpid()))


def new_token() -> str:
    """Return a new text for the names of temporary files: this process and eight random digits."""
    return f"{this_process()}-{secrets.token_hex(4)}"


def written_by(text: str) -> Writer | None:
    """Return the Writer at the beginning of a text or token; None where there is none.

    Parameters
    ----------
    text : str
    """
    found = _TEXT.match(text)
    return None if found is None else Writer(int(found[1]), found[2], found[3], int(found[4], 16))


@cache
def host() -> str:
    """Return eight digits for this machine and, in a container, its PID namespace."""
    return _digest(socket.gethostname(), operating_system.machine_number(), _space())


@cache
def boot() -> str:
    """Return eight digits for the start of this machine; constant where processes have absolute start times."""
    return _digest(operating_system.start_of_machine())


def _still_runs(number: int, start: int) -> bool:
    """Return whether process `number` with this `start` may still run on this machine."""
    if not operating_system.runs(number):
        return False
    now = operating_system.process_start(number)
    return operating_system.UNKNOWN in (now, start) or now == start


def _is_no_container():
    return _space() == _INITIAL_SPACE and bool(operating_system.machine_number())


@cache
def _space():
    return operating_system.process_space()


def _digest(*texts):
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:8]
