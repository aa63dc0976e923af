"""Free memory and address space of this machine, and whether they are sufficient."""

import re
from contextlib import suppress
from pathlib import Path

_LINUX = Path("/proc/meminfo")
ADDRESS_SPACE = 1_000_000_000  # [bytes] `run` and `export-raster` with one thread need more than 0.75e9, at most 0.85e9
_AVAILABLE = re.compile(r"^MemAvailable:\s+(\d+) kB", re.MULTILINE)


def available_memory() -> float:
    """Return the memory available to a program [bytes]; infinite where the system does not report it.

    The file cache of the system counts as free.
    """
    with suppress(OSError, ValueError):
        found = _AVAILABLE.search(_LINUX.read_text(encoding="ascii"))
        if found:
            return 1024 * int(found[1])
    with suppress(Exception):  # psutil's own errors, on systems without this information
        import psutil

        return psutil.virtual_memory().available
    return float("inf")


def address_space_lack(limit: float) -> str:
    """Return an error text where the address space of this process is too small; "" where it is sufficient.

    Beyond the limit C and C++ libraries abort the process.

    Parameters
    ----------
    limit : float [bytes]
        Of the address space.
    """
    if limit >= ADDRESS_SPACE:
        return ""
    return f"address space is limited to {limit / 1e9:.3g} GB, the libraries need {ADDRESS_SPACE / 1e9:g} GB"


def memory_lack(needed: float, share: float = 1.0) -> str:
    """Return a part of an error text where the free memory is too small; "" where it is sufficient.

    The caller adds what needs the memory, and the fix.

    Parameters
    ----------
    needed : float [bytes]
    share : float [1]
        Of the free memory that may be used.
    """
    free = available_memory()
    if needed <= share * free:
        return ""
    return f"about {needed / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free"
