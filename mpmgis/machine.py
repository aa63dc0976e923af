"""Free memory of this machine, and whether it is sufficient."""

import re
from contextlib import suppress
from pathlib import Path

_LINUX = Path("/proc/meminfo")
ADDRESS_SPACE = 1_000_000_000  # [bytes] with one thread 0.85e9 are enough for `run` and `export-raster`, 0.75e9 are not
_AVAILABLE = re.compile(r"^MemAvailable:\s+(\d+) kB", re.MULTILINE)


def available_memory():
    """Memory that a program may take [bytes]; infinite where the system does not report it.

    What the system holds of files counts as free: it gives that back.
    """
    with suppress(OSError, ValueError):
        found = _AVAILABLE.search(_LINUX.read_text(encoding="ascii"))
        if found:
            return 1024 * int(found[1])
    with suppress(Exception):  # psutil's own errors, on systems without this information
        import psutil

        return psutil.virtual_memory().available
    return float("inf")


def address_space_lack(limit):
    """In words what is wrong with a `limit` [bytes] of this process's address space; "" where there is room enough.

    Beyond it libraries of C and C++ do not fail but abort, in the middle of whatever is being done.
    """
    if limit >= ADDRESS_SPACE:
        return ""
    return f"address space is limited to {limit / 1e9:.3g} GB, the libraries need {ADDRESS_SPACE / 1e9:g} GB"


def memory_lack(needed, share=1.0):
    """In words what is wrong with `needed` [bytes]; "" where they are at most a `share` of the memory that is free.

    For a refusal before the work: what is refused, and what helps, only the caller knows.
    """
    free = available_memory()
    if needed <= share * free:
        return ""
    return f"about {needed / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free"
