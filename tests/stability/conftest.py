import pytest

from mpmgis.compiled.jit import set_threads


@pytest.fixture
def one_thread():
    """A hard case runs on one thread; `test_same_bits.py` has the same bits on two."""
    set_threads(1)
    yield
    set_threads(None)
