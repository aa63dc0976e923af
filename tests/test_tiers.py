"""The tiers of tests that the Makefile names: continuous integration runs each test once, and no marker hides one."""

import itertools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
MARKERS = ("slow", "thorough")


def chosen(target, **marks):
    """Whether `make target` runs a test with these markers."""
    recipe = re.search(rf"^{target}: .*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)[1]
    return eval(re.search(r'-m "?([a-z ]+)"?', recipe.replace("-m pytest", ""))[1], {}, marks)


@pytest.mark.parametrize("marks", [*itertools.product([False, True], repeat=2)], ids=str)
def test_every_test_is_in_one_tier(marks):
    marks = dict(zip(MARKERS, marks, strict=True))
    once = [chosen(target, **marks) for target in ("test", "test-thorough", "validate")]
    assert sum(once) == 1
    assert chosen("test-all", **marks) == (once[0] or once[1])
    assert chosen("test-quick", **marks) == once[0]


def test_continuous_integration_runs_both_tiers_and_fails_where_one_does():
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert lines[-4:] == ["failed=0", "make test || failed=1", "make test-thorough || failed=1", 'exit "$failed"']


def test_folders_of_the_quick_tests_are_there():
    for name in " ".join(re.findall(r"^(?:QUICK|LONGER) = (.*)$", MAKEFILE, re.MULTILINE)).split():
        assert (ROOT / "tests" / name).exists(), name
