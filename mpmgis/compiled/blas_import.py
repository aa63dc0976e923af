"""Import numba's functions of arrays without `scipy.linalg`.

Numba needs `numba.np.arraymath` at the first kernel. That module calls `numba.np.linalg.ensure_blas` once, which
imports `scipy.linalg`, to find out whether there is a BLAS library (numba 0.68). No kernel here calls BLAS, and the
import takes 0.2 s of every command. SciPy is a dependency, so the answer is known; code that does call BLAS (`np.dot`)
still imports `scipy.linalg` when it is compiled.

`tests/compiled/test_blas_import.py` fails when numba no longer needs this.
"""


def import_array_functions() -> None:
    """Import `numba.np.arraymath` while its test for BLAS is switched off."""
    from numba.np import linalg

    ensure_blas = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = ensure_blas
