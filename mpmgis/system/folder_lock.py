"""Locks and links: one writer per folder at a time, the process that writes a file, and links that are never followed.

Machines and containers can share a folder, and process numbers are valid only inside one of them. A process is
identified by its machine, the start of that machine, its number and its own start. Where one of these is unknown, the
process counts as alive and its incomplete files are kept.

A folder from another person may contain links, hard links, pipes and devices under the names that this program uses.
All functions that write or remove files in an output folder check with this module first.
"""

import errno
import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from . import operating_system
from .errors import OutputError

_JUNCTIONS = (0xA000000C, 0xA0000003)  # reparse tags of Windows' symbolic links and mount points


def status(path):
    """os.lstat of `path` (of a link, not of its target); None where nothing exists."""
    try:
        return os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None


def is_link(found):
    """Whether a `status` is that of a link or a Windows junction."""
    if found is None:
        return False
    return stat.S_ISLNK(found.st_mode) or getattr(found, "st_reparse_tag", 0) in _JUNCTIONS


def is_folder(path):
    """Whether `path` is a folder and not a link to one."""
    found = status(path)
    return found is not None and stat.S_ISDIR(found.st_mode) and not is_link(found)


def refuse_link(path):
    """Raise OutputError unless `path` is a regular file, a folder or nothing.

    Raises
    ------
    OutputError
        A link, also a broken one; a pipe, a socket, a device; a name that is invalid on this system.
    """
    wrong = operating_system.wrong_name(path)
    if wrong:
        raise OutputError(f"{path}: {wrong}; give another -o")
    found = status(path)
    if found is None:
        return
    if is_link(found):
        raise OutputError(f"{path} is a link, and output is never written through links; remove it, or give another -o")
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OutputError(f"{path} is a pipe, a socket or a device, expected a file; remove it, or give another -o")


def refuse_links(folder, patterns=("*",)):
    """As `refuse_link` for `folder` and all entries in it, hidden ones too, that match one of the `patterns`."""
    folder = Path(folder)
    refuse_link(folder)
    if not is_folder(folder):
        return
    for entry in sorted(folder.iterdir()):
        if any(entry.match(pattern) for pattern in patterns):
            refuse_link(entry)


def real_place(path):
    """`path` with all links in its parents resolved; the last name itself may be a link."""
    path = Path(path)
    if path.name in ("", ".."):
        return Path(os.path.realpath(path))
    return Path(os.path.realpath(path.parent)) / path.name


def open_own(path):
    """Descriptor of the regular file `path` for reading and writing, created if missing.

    Raises
    ------
    OutputError
        A link, a folder, a pipe, a device, or a file with further hard links.
    """
    refuse_link(path)
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | operating_system.own_flags(), 0o666)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR) or is_folder(path):  # Windows: no permission
            raise OutputError(f"{path} is not a regular file; remove it, or give another -o") from error
        raise
    found = os.fstat(handle)
    followed = operating_system.follows_links() and is_link(status(path))  # a link created since the check above
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1 or followed:
        os.close(handle)
        raise OutputError(f"{path} is another name (hard link) of a file; remove it, or give another -o")
    return handle


def require_free(path, still="nothing has changed"):
    """Raise OutputError where a program has a file at `path`, or in the folder `path`, open.

    Only Windows prevents the replacement of open files. `still` describes the unchanged state, for the message.

    Raises
    ------
    OutputError
    """
    held = operating_system.held_open(path)
    if held is not None:
        raise OutputError(
            f"{held} is open in another program, for example QGIS; {still}; close it there, or give another -o"
        )


def is_above(path, folder):
    """Whether `folder` is `path` or inside it, under any name."""
    for place in (folder, *folder.parents):
        with suppress(OSError):
            if os.path.samefile(place, path):
                return True
    return False


def remove(path):
    """Remove `path`: a file, a folder with its content, or a link but not its target."""
    if is_folder(path):
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            os.unlink(path)


def within(folder, inputs):
    """The first of the paths `inputs` that is in `folder` or its subfolders, under any name; None where none is."""
    if not is_folder(folder):
        return None
    known = {}
    for given in inputs:
        with suppress(OSError):
            found = os.stat(given)
            known.setdefault((found.st_dev, found.st_ino), given)
    for place, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                found = os.stat(os.path.join(place, name))
                if (found.st_dev, found.st_ino) in known:
                    return known[found.st_dev, found.st_ino]
    return None


def one_of(path, inputs):
    """The first of the paths `inputs` that is the same file as `path`, under any name; None where none is."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    for other in inputs:
        with suppress(OSError):
            if os.path.samestat(found, os.stat(other)):
                return other
    return None


_INITIAL_SPACE = "pid:[4026531836]"  # PID namespace of a Linux machine itself, not of a container
_TEXT = re.compile(r"(\d{1,10})-([0-9a-f]{8})([0-9a-f]{8})-([0-9a-f]{1,16})")
PATTERN = r"\d{1,10}-[0-9a-f]{16}-[0-9a-f]{1,16}-[0-9a-f]{8}"  # of `new_token`
UNKNOWN = operating_system.UNKNOWN


class Writer(NamedTuple):
    """A process: `number`, digests of its `host` and the host's `boot`, `start` (UNKNOWN if not available)."""

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
            return _is_no_container()  # the machine was restarted; a container has only its own start
        return not _runs(self.number, self.start)


def this_process():
    """The Writer of this process."""
    return Writer(os.getpid(), host(), boot(), started(os.getpid()))


def new_token():
    """Text for the names of temporary files: this process and eight random digits."""
    return f"{this_process()}-{secrets.token_hex(4)}"


def written_by(text):
    """The Writer at the beginning of a text or token; None where there is none."""
    found = _TEXT.match(text)
    return None if found is None else Writer(int(found[1]), found[2], found[3], int(found[4], 16))


@cache
def host():
    """Eight digits for this machine and, in a container, its PID namespace."""
    return _digest(socket.gethostname(), operating_system.machine_number(), _space())


@cache
def boot():
    """Eight digits for the start of this machine; constant where the start dates of processes are available."""
    return _digest(operating_system.start_of_machine())


def started(number):
    """Start of process `number` in the system's units; UNKNOWN where it is not available."""
    return operating_system.process_start(number)


def _runs(number, start):
    """Whether process `number` with this `start` may still run on this machine."""
    if not operating_system.runs(number):
        return False
    now = started(number)
    return UNKNOWN in (now, start) or now == start


def _is_no_container():
    return _space() == _INITIAL_SPACE and bool(operating_system.machine_number())


@cache
def _space():
    return operating_system.process_space()


def _digest(*texts):
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:8]


LOCK_FILE = ".lock"
# errors of file systems without locks; macOS has two numbers for one of them, Windows returns EINVAL
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)
_FIRST = b"p"  # first byte of the file
_HOLDER = re.compile(rf"process \d+( on [^,]*)?(, ({PATTERN}))?", re.DOTALL)  # of this and earlier versions
_LONGEST = 1000  # [bytes] read from the file


@contextmanager
def sole_writer(folder):
    """Lock the existing `folder` for this block; yields a Hold.

    The lock is a system lock on the file LOCK_FILE, not the existence of this file: the file of a killed process does
    not block other processes. Where the file system has no locks, the folder is locked as long as the process named
    in the file may be alive.

    The library filelock provides the system locks (flock, LockFileEx). It gets the descriptor of the file opened
    here, so that the holder can be reported and a removed or replaced folder is detected.

    Raises
    ------
    OutputError
        Another process, or another run of this process, has locked it; LOCK_FILE is a link or another file.
    """
    hold = Hold(Path(folder))
    try:
        yield hold
    finally:
        hold.release()


class Hold:
    """Exclusive lock on a folder until `release`."""

    def __init__(self, folder):
        self.folder, self._path = folder, folder / LOCK_FILE
        self._handle = self._locked()
        os.ftruncate(self._handle, 0)
        os.lseek(self._handle, 0, os.SEEK_SET)
        os.write(self._handle, f"process {os.getpid()} on {socket.gethostname()}, {new_token()}".encode())

    def _locked(self):
        """Descriptor of the lock file, locked; repeated if its holder released and removed it meanwhile."""
        while True:
            handle = open_own(self._path)
            try:
                holder = _read(handle)
                self._require_own(holder)
                self._lock(handle, holder)
                if self._is(handle):
                    return handle
            except BaseException:
                os.close(handle)
                raise
            os.close(handle)

    def _require_own(self, holder):
        """Refuse a file of this name that is not a lock of this program."""
        if holder and _HOLDER.fullmatch(holder) is None:
            raise OutputError(f"{self._path} was not written by mpmgis; move it away, or give another -o")

    def _lock(self, handle, holder):
        from filelock import lock_descriptor  # 30 ms, needed only by commands that write a run

        try:
            locked = lock_descriptor(handle, blocking=False)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            self._lock_by_name(holder)
        else:
            if not locked:
                raise self._held(holder, "wait for it to end")

    def _lock_by_name(self, holder):
        """Lock of file systems without locks: valid as long as the process named in the file may be alive."""
        found = _HOLDER.fullmatch(holder)
        if found is not None and found[3] is not None and not written_by(found[3]).is_over():
            raise self._held(holder, f"wait for it to end, remove {self._path} if it has ended")

    def _held(self, holder, fix):
        """The error with the holder of the lock."""
        who = holder.partition(",")[0] or "another process"
        return OutputError(f"{self.folder} is being written by {who}; {fix}, or give another -o")

    def _is(self, handle):
        """True where the path of the lock is still the file that is open as `handle`."""
        found = status(self._path)
        return found is not None and os.path.samestat(found, os.fstat(handle))

    def require(self):
        """Raise OutputError if the folder was removed, moved or replaced."""
        if not self._is(self._handle):
            raise OutputError(f"{self.folder} was removed or replaced while it was written; run the command again")

    def release(self):
        """Remove the file while it is locked, then unlock it."""
        own = self._is(self._handle)
        if own:
            with suppress(OSError):
                os.ftruncate(self._handle, 0)  # without a holder, also where it cannot be removed
                self._path.unlink()
        os.close(self._handle)
        if own and operating_system.WINDOWS:  # Windows cannot remove open files
            with suppress(OSError):
                self._path.unlink()


def _read(handle):
    """The text of the lock file. On Windows the first byte, which another process has locked, cannot be read."""
    try:
        text = os.read(handle, _LONGEST)
    except PermissionError:
        os.lseek(handle, len(_FIRST), os.SEEK_SET)
        text = _FIRST + os.read(handle, _LONGEST)
    return text.decode("utf-8", "replace")
