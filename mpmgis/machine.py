"""What this machine has: memory that is free."""

import os
import re
from contextlib import suppress
from pathlib import Path

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
