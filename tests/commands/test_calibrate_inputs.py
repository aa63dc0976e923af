"""Inputs and runs of a calibration: the volume as text, and which runs are of the prior."""

from types import SimpleNamespace

import numpy as np
import pytest

from mpmgis.studies.calibration import _Study, finished_in_all
from mpmgis.studies.calibration_events import volume_of
from mpmgis.system.errors import InputError


@pytest.mark.parametrize("text", ["1e4:2e3:7", "inf", "1e4:inf", "nan", "1e4:", "1e4:0", "-1", "much"])
def test_a_volume_is_one_number_or_two(text):
    with pytest.raises(InputError, match="expected VOLUME or VOLUME:SD"):
        volume_of(text, 0.2, "`volume`")


def test_a_volume_has_the_usual_or_its_own_deviation():
    assert volume_of("1e4", 0.2, "`volume`") == (1e4, 2e3)
    assert volume_of("1e4:500", 0.2, "`volume`") == (1e4, 500.0)
    assert volume_of(None, 0.2, "`volume`") is None


def rounds_of(*finished):
    """Rounds of two events; `finished` are the runs of each round that finished in the second one."""
    return [
        {"a": SimpleNamespace(finished=np.ones(len(of), bool)), "b": SimpleNamespace(finished=np.array(of))}
        for of in finished
    ]


def test_runs_of_the_prior_are_those_that_finished():
    """With failed runs of the prior, the runs after them in the common order are of the next round."""
    study = object.__new__(_Study)
    study.events = [SimpleNamespace(name="a"), SimpleNamespace(name="b")]
    study.rounds = rounds_of([True, False, True], [True, True])
    assert finished_in_all(study.rounds[0]).sum() == 2
    assert [(of is study.rounds[0]["a"], k) for of, k in study.runs["a"]] == [
        (True, 0),
        (True, 2),
        (False, 0),
        (False, 1),
    ]


@pytest.mark.parametrize("finished", [[], [False] * 30])
def test_too_few_finished_runs_are_one_error(finished):
    study = object.__new__(_Study)
    study.events, study.asked = [SimpleNamespace(name="a"), SimpleNamespace(name="b")], {"seed": 1}
    study.rounds = rounds_of(finished)
    with pytest.raises(InputError, match="only 0 runs finished in all events"):
        study._result(tests=0)
