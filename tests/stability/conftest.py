import sys
from pathlib import Path

import pytest

# the tests of this folder share `hard_scenes`, the scenes of the solvers' own tests, and the site of the command's
sys.path[:0] = [str(Path(__file__).parent), *(str(Path(__file__).parents[1] / name) for name in ("solvers", "cli"))]


@pytest.fixture(params=[1, pytest.param(2, marks=pytest.mark.thorough)], ids=["1 thread", "2 threads"])
def threads(request):
    """Each hard case runs on one thread and on two."""
    from mpmgis.kernels.jit import set_threads

    yield set_threads(request.param)
    set_threads(None)
