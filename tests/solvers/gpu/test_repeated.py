"""When launches are recorded, repeated and recorded again, with a stand-in for the graphs of a device."""

import importlib.util
from types import SimpleNamespace

import pytest

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("numba_cuda") is None, reason="numba-cuda is not installed (pip install 'mpmgis[gpu]')"
)


class Steps:
    """Counts the launches of a sequence from the host."""

    def __init__(self):
        self.direct = 0

    def step(self):
        self.direct += 1


@pytest.fixture
def repeated(monkeypatch):
    """The module, with graphs that write down what is done with them."""
    from mpmgis.solvers.gpu import launch_graph

    done = []

    class Graph:
        def __init__(self, launches, stream):
            launches()
            done.append(("recorded", stream))

        def launch(self):
            done.append("repeated")

    monkeypatch.setattr(launch_graph, "SIMULATED", False)
    monkeypatch.setattr(launch_graph, "cuda", SimpleNamespace(stream=lambda: "stream", synchronize=lambda: None))
    monkeypatch.setattr(launch_graph, "_Graph", Graph)
    launch_graph.done = done
    return launch_graph


def test_the_first_sequence_is_launched_and_the_others_are_repeated(repeated):
    steps = Steps()
    sequence = repeated.Repeated(steps.step)
    sequence(0)
    assert (steps.direct, repeated.done) == (0, [])
    sequence(1)
    assert (steps.direct, repeated.done) == (1, [])  # kernels are compiled, nothing is recorded before it is needed
    sequence(2)
    assert (steps.direct, repeated.done) == (3, [])  # too few to record them
    sequence(3)
    assert repeated.done == [("recorded", "stream"), *3 * ["repeated"]] and steps.direct == 4
    sequence(2)
    assert repeated.done[1:] == 5 * ["repeated"] and steps.direct == 4


def test_a_sequence_with_other_arguments_is_recorded_again(repeated):
    steps = Steps()
    sequence = repeated.Repeated(steps.step)
    sequence(4)
    sequence.forget()
    sequence(3)
    assert repeated.done == 2 * [("recorded", "stream"), *3 * ["repeated"]]


def test_an_object_is_released_though_its_steps_are_repeated(repeated):
    import weakref

    steps = Steps()
    steps.sequence = repeated.Repeated(steps.step)
    alive = weakref.ref(steps)
    del steps
    assert alive() is None


def test_an_error_of_the_driver_is_one_line(repeated):
    class Status(int):
        name = "CUDA_ERROR_ILLEGAL_ADDRESS"

    assert repeated._checked((Status(0), 7)) == 7 and repeated._checked((Status(0),)) is None
    with pytest.raises(RuntimeError, match="CUDA_ERROR_ILLEGAL_ADDRESS"):
        repeated._checked((Status(700),))
