import pytest


@pytest.fixture(params=[1, pytest.param(2, marks=pytest.mark.thorough)], ids=["1 thread", "2 threads"])
def threads(request):
    """Each hard case runs on one thread and on two."""
    from mpmgis.compiled.jit import set_threads

    yield set_threads(request.param)
    set_threads(None)
