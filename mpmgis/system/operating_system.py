"""Differences between Linux, macOS and Windows: folders, names, open files, processes, signals.

No other module except the QGIS toolbox depends on the system; a test checks this. Functions are called as
`operating_system.name`, so that tests can emulate another system (`tests/system/as_on_windows.py`).
"""

import errno
import math
import os
import re
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO

WINDOWS = os.name == "nt"
MACOS = sys.platform == "darwin"
PROCESSES = Path("/proc")  # process and system information on Linux
PATIENCE_SECONDS = 2.0  # a virus scanner or a search index closes a new file within this time
UNKNOWN = 0  # start of a process that is not known

_FIRST_WAIT_SECONDS = 0.01
_DEVICE = re.compile(r"(?:con|prn|aux|nul|conin\$|conout\$|(?:com|lpt)[0-9¹²³])(?: *\..*)?", re.IGNORECASE | re.DOTALL)
_NO_NAME = re.compile(r'[\x00-\x1f<>:"|?*\\/]')


def cache_root() -> Path:
    """Return the folder for cached files of this user."""
    if WINDOWS:
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path.home() / "Library" / "Caches" if MACOS else Path.home() / ".cache"


def modes_count() -> bool:
    """Return whether the mode of a file shows who can write to it.

    On Windows it does not, and the owner is unknown.
    """
    return not WINDOWS


def slashed(path: str | Path, folder: str | Path) -> str:
    """Return `path` relative to `folder`, with forward slashes; absolute if they are on different drives.

    Parameters
    ----------
    path, folder : str or Path
    """
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(path).resolve().as_posix()


def wrong_name(path: str | Path) -> str:
    """Return why the names in `path` are invalid on this system; "" if they are valid.

    On Windows `nul.tif` is a device and `a:b` a second stream of a file `a`, and dots and spaces at the end are
    dropped: data written there would be lost, or be in another file.

    Parameters
    ----------
    path : str or Path
    """
    if not WINDOWS:
        return ""
    path = Path(path)
    for name in path.parts[1:] if path.anchor else path.parts:
        if name in (".", ".."):
            continue
        if _DEVICE.fullmatch(name):
            return f"{name} is the name of a device on Windows"
        if _NO_NAME.search(name) or name[-1] in ". ":
            return f'{name!r} is not a valid file name on Windows (none of < > : " | ? *, no dot or space at its end)'
    return ""


def file_name(text: object) -> str:
    """Return a text as a part of file names that is valid on every system: other characters, also slashes, become _.

    Parameters
    ----------
    text : object
        Converted to str.
    """
    name = _NO_NAME.sub("_", str(text)).rstrip(". ")
    return f"_{name}" if not name or name.startswith(".") or _DEVICE.fullmatch(name) else name


def flush(descriptor: int) -> None:
    """Write all data of an open file to the disk; on macOS fsync alone leaves it in the cache of the disk.

    Windows flushes only files that are open for writing.

    Parameters
    ----------
    descriptor : int
    """
    if MACOS:
        import fcntl

        with suppress(OSError):  # not supported on network file systems
            fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
            return
    os.fsync(descriptor)


def own_flags() -> int:
    """Return the flags of `os.open` that exist here: follow no links, do not block, binary mode."""
    return sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY", "O_NOINHERIT"))


def follows_links() -> bool:
    """Return whether `os.open` follows a link in spite of `own_flags`."""
    return not hasattr(os, "O_NOFOLLOW")


def replace(source: str | Path, target: str | Path) -> None:
    """Rename a file or folder and replace an existing one (`os.replace`).

    On Windows this is repeated for PATIENCE_SECONDS while another program has one of the files open.

    Parameters
    ----------
    source, target : str or Path
    """
    _patiently(os.replace, source, target)


def _patiently(act: Callable, source: str | Path, target: str | Path) -> None:
    wait, end = _FIRST_WAIT_SECONDS, time.monotonic() + PATIENCE_SECONDS
    while True:
        try:
            return act(source, target)
        except PermissionError:
            if not WINDOWS or time.monotonic() + wait > end:
                raise
        time.sleep(wait)
        wait *= 2.0


def held_open(path: str | Path) -> Path | None:
    """Find the first file at `path`, or in the folder `path`, that cannot be renamed or removed now.

    On Windows that is a file which a program has open. On other systems open files can be replaced: always None.

    Parameters
    ----------
    path : str or Path
    """
    if not WINDOWS:
        return None
    path = Path(path)
    files = [path] if path.is_file() else (Path(place) / name for place, _, names in os.walk(path) for name in names)
    return next((file for file in files if _is_held(file)), None)


def _is_held(file):
    try:
        _patiently(os.rename, file, file)
    except PermissionError:
        return True
    except OSError:
        pass
    return False


def is_held_open(error: OSError) -> bool:
    """Return whether an error can mean that a program has the file open (Windows only).

    Parameters
    ----------
    error : OSError
    """
    return WINDOWS and error.errno in (errno.EACCES, errno.EPERM, errno.EBUSY)


def is_unread(stream: IO, error: OSError) -> bool:
    """Return whether an error means that the reader of a stream of this process has closed it (EINVAL on Windows).

    Parameters
    ----------
    stream : file object
        Standard output or standard error.
    error : OSError
        Met while writing to it.
    """
    if isinstance(error, BrokenPipeError):
        return True
    if not (WINDOWS and error.errno == errno.EINVAL and error.filename is None):
        return False
    try:
        stream.flush()  # the unwritten data is still in the buffer
    except OSError:
        return True
    return False


def cores() -> int:
    """Return the number of processor cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def address_space_limit() -> float:
    """Return the limit of this process's address space [bytes]; infinite without one, as always on Windows."""
    try:
        import resource
    except ImportError:
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return math.inf if limit == resource.RLIM_INFINITY else float(limit)


def machine_number() -> str:
    """Return a text that identifies this machine."""
    if WINDOWS or MACOS:
        import uuid

        return f"{uuid.getnode():012x}"
    return text_of("/etc/machine-id")


def start_of_machine() -> str:
    """Return a text that identifies this boot on Linux; "" on other systems.

    Start times of processes are absolute there.
    """
    return text_of(PROCESSES / "sys/kernel/random/boot_id")


def process_space() -> str:
    """Return the namespace of process numbers on Linux, different in each container; "" elsewhere."""
    try:
        return os.readlink(PROCESSES / "self/ns/pid")
    except OSError:
        return ""


def process_start(number: int) -> int:
    """Return the start time of a process; UNKNOWN without one, or if there is no such process.

    In ticks since the start of the machine on Linux, elsewhere in hundredths of a second since 1970.

    Parameters
    ----------
    number : int
        Of the process.
    """
    if _has_processes():
        facts = process_facts(number)
        return int(facts[19]) if len(facts) > 19 and facts[19].isdecimal() else UNKNOWN
    import psutil

    try:
        return round(100.0 * psutil.Process(number).create_time())
    except (psutil.Error, OSError, OverflowError, ValueError):
        return UNKNOWN


def runs(number: int) -> bool:
    """Return whether a process may be running; a zombie process is not.

    Parameters
    ----------
    number : int
        Of the process.
    """
    if _has_processes():
        return _may_be_signalled(number) and process_facts(number)[:1] not in (["Z"], ["X"])
    import psutil

    try:
        return psutil.Process(number).status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    except (psutil.NoSuchProcess, OverflowError, ValueError):
        return False
    except (psutil.Error, OSError):
        return True


def process_facts(number: int) -> list[str]:
    """Return the fields of a process on Linux after its name (state, ..., start time); [] elsewhere.

    Parameters
    ----------
    number : int
        Of the process.
    """
    return text_of(PROCESSES / str(number) / "stat").rpartition(")")[2].split()


def _has_processes():
    return (PROCESSES / "self/stat").exists()


def _may_be_signalled(number):
    try:
        os.kill(number, 0)  # only on Linux: on Windows this ends the process
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass
    return True


def text_of(path: str | Path) -> str:
    """Read the text of a system information file; "" if it does not exist.

    Parameters
    ----------
    path : str or Path
    """
    try:
        return Path(path).read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return the signals with which a user, a terminal or the system stops a program; Windows also has Ctrl+Break."""
    return tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))


def ignore_interrupts() -> None:
    """Ignore Ctrl+C in this process; its parent process, which also receives it, handles it."""
    for name in ("SIGINT", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
