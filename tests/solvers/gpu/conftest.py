import pytest
from device_cases import results_of


@pytest.fixture(scope="module")
def found(request):
    """Results of all cases of the SCRIPT of a module, by name."""
    return results_of(request.module.SCRIPT)
