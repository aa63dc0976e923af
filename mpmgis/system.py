"""Differences between Linux, macOS and Windows: folders, names, open files, processes, signals.

No other module asks which system it runs on, but for the toolbox for QGIS; a test holds that. It is called as
`system.name`, so that tests can emulate another system (`tests/cli/as_on_windows.py`).
"""

import errno
import math
import os
import re
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

WINDOWS = os.name == "nt"
MACOS = sys.platform == "darwin"
PROCESSES = Path("/proc")  # process and system information on Linux
PATIENCE_SECONDS = 2.0  # in which a virus scanner or a search index has let go of a new file
UNKNOWN = 0  # start of a process that cannot be known

_FIRST_WAIT_SECONDS = 0.01
_DEVICE = re.compile(r"(?:con|prn|aux|nul|conin\$|conout\$|(?:com|lpt)[0-9¹²³])(?: *\..*)?", re.IGNORECASE | re.DOTALL)
_NO_NAME = re.compile(r'[\x00-\x1f<>:"|?*\\/]')


# ------------------------------------------------------------------------------------------------------------- folders


def cache_root() -> Path:
    """The folder in which programs of this user keep what they can make again."""
    if WINDOWS:
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path.home() / "Library" / "Caches" if MACOS else Path.home() / ".cache"


def modes_count() -> bool:
    """Whether the mode of a file shows who may write to it. On Windows all have the same, and the owner is unknown."""
    return not WINDOWS


def slashed(path, folder) -> str:
    """`path` as seen from `folder`, with forward slashes; absolute where they have no root in common: two drives."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(path).resolve().as_posix()


# --------------------------------------------------------------------------------------------------------------- names


def wrong_name(path) -> str:
    """What is wrong with the names in `path` on this system, in words; "" where they can be given to files.

    Windows takes `nul.tif` for a device and `a:b` for a second stream of a file `a`, and drops dots and spaces at the
    end: what is written there is lost, or is another file.
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


def file_name(text) -> str:
    """`text` as a part of file names that every system allows: other letters become _, so that it is no path either."""
    name = _NO_NAME.sub("_", str(text)).rstrip(". ")
    return f"_{name}" if not name or name.startswith(".") or _DEVICE.fullmatch(name) else name


# --------------------------------------------------------------------------------------------------------------- files


def flush(descriptor) -> None:
    """Have all that was written through `descriptor` on the disk; on macOS fsync leaves it in the disk's own memory.

    Windows flushes only what is open for writing.
    """
    if MACOS:
        import fcntl

        with suppress(OSError):  # network file systems have none
            fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
            return
    os.fsync(descriptor)


def own_flags() -> int:
    """Flags of `os.open`: no link is followed, nothing is waited for, bytes stay as they are; those that there are."""
    return sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY", "O_NOINHERIT"))


def follows_links() -> bool:
    """Whether `os.open` follows a link in spite of `own_flags`."""
    return not hasattr(os, "O_NOFOLLOW")


def replace(source, target) -> None:
    """As `os.replace`; on Windows tried again for PATIENCE_SECONDS while somebody has one of the two open."""
    _patiently(os.replace, source, target)


def _patiently(act, source, target):
    wait, end = _FIRST_WAIT_SECONDS, time.monotonic() + PATIENCE_SECONDS
    while True:
        try:
            return act(source, target)
        except PermissionError:
            if not WINDOWS or time.monotonic() + wait > end:
                raise
        time.sleep(wait)
        wait *= 2.0


def held_open(path):
    """The first file at `path`, or in the folder `path`, that cannot be renamed or removed now; None where all can.

    On Windows that is one which a program has open. Anywhere else open files can be replaced, and nothing is asked.
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


def is_held_open(error) -> bool:
    """Whether an OSError may mean that somebody has a file open; elsewhere it means that there is no permission."""
    return WINDOWS and error.errno in (errno.EACCES, errno.EPERM, errno.EBUSY)


def is_unread(stream, error) -> bool:
    """Whether an OSError means that the reader of a `stream` of this process is gone; Windows has EINVAL for that."""
    if isinstance(error, BrokenPipeError):
        return True
    if not (WINDOWS and error.errno == errno.EINVAL and error.filename is None):
        return False
    try:
        stream.flush()  # what could not be written is still in it
    except OSError:
        return True
    return False


# ----------------------------------------------------------------------------------------------------------- processes


def cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def address_space_limit() -> float:
    """Bytes of addresses that this process may use; infinite where there is no limit, as always on Windows."""
    try:
        import resource
    except ImportError:
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return math.inf if limit == resource.RLIM_INFINITY else float(limit)


def machine_number() -> str:
    """Text that no other machine has."""
    if WINDOWS or MACOS:
        import uuid

        return f"{uuid.getnode():012x}"
    return text_of("/etc/machine-id")


def start_of_machine() -> str:
    """Text of this start of the machine on Linux; elsewhere "", as processes there have the date of their own start."""
    return text_of(PROCESSES / "sys/kernel/random/boot_id")


def process_space() -> str:
    """The space of process numbers on Linux, which is another one in each container; "" elsewhere."""
    try:
        return os.readlink(PROCESSES / "self/ns/pid")
    except OSError:
        return ""


def process_start(number) -> int:
    """When process `number` was started; UNKNOWN where the system does not report it, or where there is none.

    In Linux' ticks since the start of the machine, elsewhere in hundredths of a second since 1970.
    """
    if _has_processes():
        facts = process_facts(number)
        return int(facts[19]) if len(facts) > 19 and facts[19].isdecimal() else UNKNOWN
    import psutil

    try:
        return round(100.0 * psutil.Process(number).create_time())
    except (psutil.Error, OSError, OverflowError, ValueError):
        return UNKNOWN


def runs(number) -> bool:
    """Whether there may be a process `number`; one that has ended, of which nobody has asked how, is none."""
    if _has_processes():
        return _may_be_signalled(number) and process_facts(number)[:1] not in (["Z"], ["X"])
    import psutil

    try:
        return psutil.Process(number).status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    except (psutil.NoSuchProcess, OverflowError, ValueError):
        return False
    except (psutil.Error, OSError):
        return True


def process_facts(number) -> list:
    """The fields of process `number` on Linux after its name: its state, ..., its start; [] elsewhere."""
    return text_of(PROCESSES / str(number) / "stat").rpartition(")")[2].split()


def _has_processes():
    return (PROCESSES / "self/stat").exists()


def _may_be_signalled(number):
    try:
        os.kill(number, 0)  # only on Linux: on Windows it would end the process
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass
    return True


def text_of(path) -> str:
    """The text of a system information file; "" where there is none."""
    try:
        return Path(path).read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""


# ------------------------------------------------------------------------------------------------------------- signals


def stop_signals() -> tuple:
    """The signals by which a user, a terminal or a system asks a program to end; Windows also has Ctrl+Break."""
    return tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))


def ignore_interrupts() -> None:
    """Leave Ctrl+C, which a terminal sends to all of a program's processes, to the one that started this one."""
    for name in ("SIGINT", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
