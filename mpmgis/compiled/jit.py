"""Compiler interface: `jit`, `jit_parallel`, their disk cache, and laws as arguments of kernels.

Where compiled kernels are kept, `cache_folder` decides; `compilation` compiles those of a loop side by side. Set
MPMGIS_CACHE_DIR to move the cache, NUMBA_DISABLE_JIT=1 to run every kernel as plain Python.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .cache_folder import cache_folder, choose, given_cache_folder

# Waiting threads spin for some tens of microseconds and then sleep. Without spinning, 25 600 columns take 0.83 ms per
# step on 2 threads instead of 0.23, because waking takes a tenth of a millisecond; with unlimited spinning 7.4 ms
# instead of 1.7 on busy cores (measured 2026-11-21). Read by GCC's OpenMP runtime at its start.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "2000")
# OpenMP before TBB, which numba would prefer if it is installed: late in a session of tests a step of 500 columns took
# about 80 ms with TBB; two simultaneous runs take 0.8 ms, with OpenMP 0.3 (measured 2026-11-22).
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp tbb workqueue")

GIVEN_CACHE_DIR = given_cache_folder()
if GIVEN_CACHE_DIR is None:
    choose(cache_folder())

import numba  # noqa: E402  (the cache folder must be known before numba is imported)
from numba import types  # noqa: E402
from numba.extending import overload, overload_method, register_jitable  # noqa: E402

from .blas_import import import_array_functions  # noqa: E402
from .checked_cache import keep_checked  # noqa: E402
from .float32_constants import of_precision  # noqa: E402

# numba may have been imported before this module.
numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]
numba.config.THREADING_LAYER_PRIORITY = os.environ["NUMBA_THREADING_LAYER_PRIORITY"].split()
# LLVM's SLP pass stays off, the default of numba: it vectorises parts of loops, which then cannot be vectorised as a
# whole. With it the 3D step takes 190 ns instead of 105, the depth-averaged one 48 instead of 44 (measured 2026-11-21).

if not numba.config.DISABLE_JIT:
    import_array_functions()

# Only flags that keep IEEE 754 results. "contract" lets the compiler choose which product of a*b + c*d goes
# into a fused multiply-add; numba's order of instructions varies from process to process, and so would the last bits
# between two compilations (measured). "nnan" and "ninf" fold x != x to False, and kernels count non-finite values.
FASTMATH = {"nsz"}

# Kernels are called from Python and from kernels, never by the address of a C function: numba need not compile that
# entry as well.
OPTIONS = {"cache": True, "fastmath": FASTMATH, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
INNER = {"no_cfunc_wrapper": True, "no_cpython_wrapper": True}  # for functions that only kernels call

prange = numba.prange

_kernels = []  # all that have a cache on disk
_own_laws = set()  # digests of the files of user-defined laws in this process


def include_own_laws(sha256: str) -> None:
    """Use a separate cache folder from now on, whose name includes the digest of a file of user-defined laws.

    Must be called before the first kernel is compiled with one of these laws; compiled kernels stay valid.

    Parameters
    ----------
    sha256 : str
        Digest of the file.
    """
    if sha256 in _own_laws:
        return
    _own_laws.add(sha256)
    folder = cache_folder(_own_laws)
    if GIVEN_CACHE_DIR is not None:
        folder = Path(GIVEN_CACHE_DIR) / folder.name
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    choose(folder)
    numba.config.CACHE_DIR = str(folder)
    for kernel in _kernels:
        kernel.enable_caching()
        keep_checked(kernel)


def _kept(kernel):
    """Register `kernel` and return it, if it has a cache (it has none with NUMBA_DISABLE_JIT)."""
    if hasattr(kernel, "enable_caching"):
        _kernels.append(kernel)
        keep_checked(kernel)
    return kernel


def jit(function: Callable) -> Callable:
    """Compile a serial kernel, cached on disk; the GIL is released.

    Parameters
    ----------
    function : callable
    """
    return _kept(numba.njit(**OPTIONS)(function))


def jit_inline(function: Callable) -> Callable:
    """Compile a function as `jit_borrowing` does, which LLVM inlines wherever kernels call it.

    Its types are inferred once. With numba's own inlining, which copies its source into every caller and infers the
    types there again, `update_nodes` of columns took 9 s to compile instead of 3 (measured 2026-11-25).

    Parameters
    ----------
    function : callable
    """
    return jit_borrowing(function, forceinline=True)


def jit_borrowing(function: Callable, **more: Any) -> Callable:
    """Compile a serial function that works on its array arguments only: it neither creates nor returns arrays.

    References to arrays are not counted in it. A count costs as much as twenty additions, and the compiler leaves some
    of them in loops: they took half of the 3D step (measured 2026-11-21).

    The compiled function has no entry from Python, from which it runs as plain Python: these entries took an eighth of
    the time to compile the 3D step (measured 2026-11-28).

    Parameters
    ----------
    function : callable
    more : dict
        Further options of numba.
    """
    kernel = _kept(numba.njit(**OPTIONS | INNER, _nrt=False, **more)(function))
    if hasattr(kernel, "overloads"):
        kernel.add_overload = lambda compiled: kernel.overloads.update({tuple(compiled.signature.args): compiled})
        kernel._compile_for_args = lambda *_, **__: function
    return kernel


def kernel_part(function: Callable) -> Callable:
    """Register a part of kernels for both precisions; its constants have the precision of its first array.

    Parameters
    ----------
    function : callable
    """
    law_function(function, inlined=False)
    return function


def jit_parallel(function: Callable) -> Callable:
    """Compile a kernel with `prange` loops, cached on disk. No atomics: each loop writes only its own data.

    Parameters
    ----------
    function : callable
    """
    return _kept(numba.njit(**OPTIONS, parallel=True)(function))


def set_threads(count: int | None) -> int:
    """Set the number of threads; return the number in use.

    Parameters
    ----------
    count : int, optional
        None: all that there are.
    """
    available = numba.config.NUMBA_NUM_THREADS
    numba.set_num_threads(available if count is None else max(1, min(int(count), available)))
    return numba.get_num_threads()


def threads_in_use() -> int:
    """Return the number of threads that parallel kernels use in the calling thread."""
    return numba.get_num_threads()


def ready_threads() -> None:
    """Start the threads before a kernel from the disk cache is called.

    A cached kernel does not start them if its parallel loops came from the cache when it was compiled (for example
    after an interrupted first run); called without them, the process crashes.
    """
    numba.get_num_threads()


def own_law_method(name: str) -> None:
    """Let kernels call a method of user-defined laws: a kernel is compiled for the type of each.

    Parameters
    ----------
    name : str
        Name of the method.
    """

    @overload_method(types.BaseNamedTuple, name, jit_options=INNER)
    def specialise(law, *arguments):
        method = of_precision(getattr(law.instance_class, name), (law, *arguments))
        method = register_jitable(**INNER)(method)
        return lambda law, *arguments: method(law, *arguments)


def law_function(function: Callable, inlined: bool = True) -> None:
    """Let laws' methods call a plain function.

    Parameters
    ----------
    function : callable
    inlined : bool
        Whether it is put into the loop of the caller whatever its length; otherwise loops over points are not
        vectorised: 12 ns instead of 130 for Drucker-Prager (measured 2026-11-21).
    """
    options = INNER | ({"forceinline": True} if inlined else {})

    @overload(function, jit_options=options, strict=False)
    def specialise(*arguments):
        return of_precision(function, arguments)


def own_or_built_in(function: Callable, record: type, built_in: Callable) -> None:
    """Let kernels call a function of a law that is a record of this package or a user-defined law.

    A user-defined law is a type of its own, for which kernels are compiled anew: its method of the function's name is
    called.

    Parameters
    ----------
    function : callable
        Its first argument is the law.
    record : type
    built_in : callable
        Called where the law is of the type `record`.
    """

    @overload(function, jit_options=INNER, strict=False)
    def specialise(law, *arguments):
        is_built_in = law.instance_class is record
        chosen = built_in if is_built_in else getattr(law.instance_class, function.__name__)
        return of_precision(chosen, (law, *arguments))
