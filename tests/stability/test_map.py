"""README.md of this folder names the test of each hard case: every case is in it, and every test exists."""

import re
from pathlib import Path

HERE = Path(__file__).parent
ROW = re.compile(r"^\| (H\d+) \|.*\| ([^|]+) \|$", re.MULTILINE)
CASES = dict(ROW.findall((HERE / "README.md").read_text()))


def file_of(name):
    """The test file with the `name` on the page."""
    return HERE.parents[1] / name if "/" in name else HERE / name


def test_the_page_has_every_case_once():
    assert list(CASES) == [f"H{number}" for number in range(1, 42)]


def test_every_test_of_the_page_exists():
    named = [(case, *test.strip().split("::")) for case, tests in CASES.items() for test in tests.split(",")]
    assert len(named) > 80
    for case, file, test in named:
        assert f"\ndef test_{test}(" in file_of(file).read_text(), f"{case}: {file} has no test_{test}"


def test_every_hard_case_of_this_folder_is_on_the_page():
    """Cases of all test files except random scenes and this file, which concern all cases."""
    for file in sorted(HERE.glob("test_hard_*.py")):
        for test in re.findall(r"^def test_(\w+)\(", file.read_text(), re.MULTILINE):
            assert f"{file.name}::{test}" in (HERE / "README.md").read_text(), f"{file.name}::{test}"
