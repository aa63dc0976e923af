"""The door to the compiler: `jit`, `jit_parallel`, their disk cache, and laws as arguments of kernels.

The cache folder is named by a hash of the package's sources, because numba does not see that a law in another file
was edited. Set MPMGIS_CACHE_DIR to move it, NUMBA_DISABLE_JIT=1 to run every kernel as plain Python.
"""

import hashlib
import os
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent


def source_digest():
    """Hex digest of all sources that a kernel may be compiled from."""
    digest = hashlib.sha256()
    for folder in ("effects", "kernels"):
        for path in sorted((PACKAGE / folder).glob("*.py")):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder():
    """The writable folder for compiled kernels; the system's temporary folder where no home can be written."""
    root = os.environ.get("MPMGIS_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    root = Path(root) if root else Path.home() / ".cache"
    folder = root / "mpmgis" / source_digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(folder)
    except OSError:
        folder = Path(tempfile.gettempdir()) / f"mpmgis-{os.getuid() if hasattr(os, 'getuid') else 0}" / source_digest()
        folder.mkdir(parents=True, exist_ok=True)
    return folder


# Threads that wait sleep instead of spinning: on an idle machine a small step takes a fifth longer, on a busy one it is
# five times faster (25 600 columns, measured 2026-11-21). Read by the OpenMP runtime when numba starts it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
if "NUMBA_CACHE_DIR" not in os.environ:
    os.environ["NUMBA_CACHE_DIR"] = str(cache_folder())

import numba  # noqa: E402  (the cache folder must be known before numba is imported)
from numba import types  # noqa: E402
from numba.extending import overload_method, register_jitable  # noqa: E402

numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]
numba.config.SLP_VECTORIZE = 1  # 12 % off the step of the depth-averaged solver (measured 2026-11-21)

# Only what leaves every result as IEEE 754 has it. "contract" lets the compiler choose which product of a*b + c*d goes
# into a fused multiply-add; numba's order of instructions varies from process to process, and so would the last bits
# between two compilations (measured). "nnan" and "ninf" fold x != x to False, and kernels count non-finite values.
FASTMATH = {"nsz"}

prange = numba.prange


def jit(function):
    """Compile a serial kernel, cached on disk; the GIL is released."""
    return numba.njit(cache=True, fastmath=FASTMATH, nogil=True, error_model="numpy")(function)


def jit_inline(function):
    """Compile a small function that kernels call; inlined by the compiler."""
    return numba.njit(cache=True, fastmath=FASTMATH, nogil=True, error_model="numpy", inline="always")(function)


def jit_parallel(function):
    """Compile a kernel with `prange` loops, cached on disk. No atomics anywhere: every loop owns what it writes."""
    return numba.njit(cache=True, fastmath=FASTMATH, parallel=True, nogil=True, error_model="numpy")(function)


def set_threads(count):
    """Use `count` threads (None: all that there are); answers the number in use."""
    available = numba.config.NUMBA_NUM_THREADS
    numba.set_num_threads(available if count is None else max(1, min(int(count), available)))
    return numba.get_num_threads()


def law_method(name):
    """Let kernels call method `name` of any law.

    A law is a NamedTuple of numbers with plain methods; the kernel is specialised by the law's type, so that an
    absent law costs nothing and new parameter values compile nothing (architecture.md).
    """

    @overload_method(types.BaseNamedTuple, name)
    def specialise(law, *arguments):
        method = register_jitable(getattr(law.instance_class, name))
        return lambda law, *arguments: method(law, *arguments)
