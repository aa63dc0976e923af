"""What this machine has: memory that is free, and whether it is enough."""

import os
import re
from contextlib import suppress
from pathlib import Path

ADDRESS_SPACE = 1_000_000_000  # [bytes] with one thread 0.85e9 are enough for `run` and `export-raster`, 0.75e9 are not
_AVAILABLE = re.compile(r"^MemAvailable:\s+(\d+) kB", re.MULTILINE)


def available_memory():
    """Memory that a program may take [bytes]; infinite where the system does not tell.

    On Linux what the system holds of files counts as free: it gives that back.
    """
    with suppress(OSError, ValueError):
        found = _AVAILABLE.search(Path("/proc/meminfo").read_text(encoding="ascii"))
        if found:
            return 1024 * int(found[1])
    with suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return float("inf")


def address_space_lack():
    """In words what is wrong with the limit on this process's address space; "" where there is none, or room enough.

    Beyond it libraries of C and C++ do not fail but abort, in the middle of whatever is being done.
    """
    try:
        import resource
    except ImportError:  # Windows, which has no such limit
        return ""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY or limit >= ADDRESS_SPACE:
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
