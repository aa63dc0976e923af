"""Numba's own files of compiled kernels: what `checked_cache` puts right, and whether it is still needed.

`test_kernel_cache.py` tests that the checked files do what numba's own do not.
"""

import pickle

import numba
import pytest

from mpmgis.compiled.checked_cache import CheckedFiles
from mpmgis.compiled.jit import OPTIONS, jit

NEEDLESS = "numba no longer needs this: remove module mpmgis/compiled/checked_cache.py, or its {}"
pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def double(number):
    """What is compiled here."""
    return 2 * number


@pytest.fixture
def own_kernel(tmp_path, monkeypatch):
    """Makes a kernel of `double` whose files in `tmp_path` are numba's own."""

    def make():
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))  # each time: numba reads its environment again
        return numba.njit(**OPTIONS)(double)

    return make


def test_numba_lets_its_files_be_replaced():
    kernel = jit(double)
    assert type(kernel._cache._cache_file) is CheckedFiles


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_numba_itself_fails_with_a_file_that_is_cut_off(own_kernel, tmp_path, suffix):
    assert own_kernel()(3) == 6
    (path,) = tmp_path.rglob(f"*{suffix}")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    try:
        assert own_kernel()(3) == 6
    except (pickle.UnpicklingError, EOFError, ValueError):
        return
    pytest.fail(NEEDLESS.format("checksums"))


def test_numba_itself_gives_the_code_of_two_processes_one_name(own_kernel, tmp_path):
    """Both have read the index before either wrote it; the file of the one is then the code of the other."""
    first, second = own_kernel(), own_kernel()
    assert first(3) == 6
    second._cache._cache_file.flush()  # as if it had read the index before
    assert second(3.5) == 7.0
    files = list(tmp_path.rglob("*.nbc"))
    assert len(files) == 1, NEEDLESS.format("names of files")
