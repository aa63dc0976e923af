"""Matrices of return period and intensity against the documents, and their monotony."""

import itertools
import math

import numpy as np
import pytest

from mpmgis.results.hazard.guideline_classes import UNREAD
from mpmgis.results.hazard.guideline_files import read_guidelines
from mpmgis.results.hazard.hazard_files import choose_matrix, read_matrices
from mpmgis.results.hazard.hazard_levels import combined_hazard, levels_of, parse_matrices
from mpmgis.system.errors import InputError

SHIPPED = read_matrices()


def names(matrix, years, h=1.0, v=1.0, p=0.0, deposit=0.0):
    """Level names of cells with these largest values [m, m/s, kPa, m] for one scenario; "" without a level."""
    matrix = SHIPPED[matrix]
    values = [np.array(value, float)[None] for value in np.broadcast_arrays(*np.atleast_1d(h, v, p, deposit))]
    bands = dict(zip(("h_max", "Ut_max", "p_max", "h_deposit"), values, strict=True))
    bands["p_max"] = bands["p_max"] * 1000.0
    found, _ = levels_of(matrix.period(years), bands, np.ones(values[0].shape, bool))
    return ["" if k == 0 else matrix.levels[k - 1].name for k in found[0]]


# every field of each matrix once: return period -> levels of its intensity classes, from the lowest
FIELDS = {
    "swiss-avalanche": (
        {"p": [2.9, 3, 30]},
        {  # weak: of flowing avalanches
            30: ["high", "high", "high"],
            100: ["moderate", "moderate", "high"],
            300: ["moderate", "moderate", "high"],
            1000: ["residual"] * 3,
        },
    ),
    "swiss-flood": (
        {"h": [0.4, 0.5, 2], "v": [1, 1, 0]},
        {
            30: ["moderate", "high", "high"],
            100: ["moderate", "moderate", "high"],
            300: ["low", "moderate", "high"],
            1000: ["residual"] * 3,
        },
    ),
    "swiss-debris-flow": (
        {"h": [0.9, 1], "v": [5, 1]},
        {30: ["high", "high"], 100: ["moderate", "high"], 300: ["moderate", "high"], 1000: ["residual"] * 2},
    ),
    "swiss-hillslope-debris-flow": (
        {"h": [0.9, 1]},
        {30: ["high", "high"], 100: ["moderate", "high"], 300: ["moderate", "high"], 1000: ["residual"] * 2},
    ),
    "austrian-avalanche": ({"p": [0.9, 1, 10]}, {150: ["", "yellow", "red"]}),
    "austrian-torrent-deposit": ({"deposit": [0.6, 0.7]}, {150: ["yellow", "red"]}),
    "italian-avalanche": ({"p": [2.9, 3, 15]}, {30: ["blue", "red", "red"], 100: ["yellow", "blue", "red"]}),
}


@pytest.mark.parametrize(("matrix", "years"), [(name, years) for name, (_, rows) in FIELDS.items() for years in rows])
def test_every_field_of_a_matrix_has_the_level_of_the_document(matrix, years):
    values, rows = FIELDS[matrix]
    assert names(matrix, years, **values) == rows[years]


def test_all_shipped_matrices_are_tested_and_have_sources():
    assert set(FIELDS) == set(SHIPPED)
    for matrix in SHIPPED.values():
        assert matrix.source and matrix.title
        assert all(period.read_in for period in matrix.periods)
    assert SHIPPED["austrian-avalanche"].periods[0].read_in == UNREAD and SHIPPED["austrian-avalanche"].is_unread


@pytest.mark.parametrize("name", SHIPPED)
def test_level_never_falls_with_intensity_or_frequency(name):
    matrix, random = SHIPPED[name], np.random.default_rng(4)
    longest = min(matrix.periods[-1].up_to, 5000.0)
    limits = {"h_max": [0.5, 1, 2], "Ut_max": [0.5, 1], "p_max": [1e3, 3e3, 1e4, 15e3, 3e4], "h_deposit": [0.7]}
    for _ in range(40):
        low = {band: np.append(random.exponential(3.0 * at[-1], (1, 60)), [at], axis=1) for band, at in limits.items()}
        shape = max(values.shape[1] for values in low.values())
        low = {band: np.resize(values, (1, shape)) for band, values in low.items()}
        more = 1.0 + random.random((1, shape)) * random.integers(0, 3)
        high = {band: values * more for band, values in low.items()}
        long, short = sorted(random.uniform(1.0, longest, 2), reverse=True)
        reached = np.ones((1, shape), bool)
        weak_rare = levels_of(matrix.period(long), low, reached)[0]
        assert (levels_of(matrix.period(long), high, reached)[0] >= weak_rare).all()
        assert (levels_of(matrix.period(short), low, reached)[0] >= weak_rare).all()


def test_period_borders_belong_to_the_more_frequent_column():
    matrix = SHIPPED["swiss-flood"]
    found = [matrix.period(years).name.split()[0] for years in (1, 30, 30.1, 100, 101, 300, 301)]
    assert found == ["high", "high", "medium", "medium", "low", "low", "very"]
    with pytest.raises(InputError, match="ends at 150 years"):
        SHIPPED["austrian-avalanche"].period(300)
    assert [period.name for period in matrix.missing([30, 300])] == ["medium probability", "very low probability"]


def test_limits_in_single_precision_belong_to_the_higher_class():
    deposit = np.array([0.7], np.float32).astype(float)
    assert deposit[0] < 0.7 and names("austrian-torrent-deposit", 100, deposit=deposit) == ["red"]


def test_flow_without_a_needed_value_has_the_highest_possible_level_and_is_counted():
    matrix = SHIPPED["swiss-avalanche"]
    bands = {"p_max": np.array([[np.nan, np.nan, 1e3]])}
    levels, lacking = levels_of(matrix.period(300), bands, np.array([[True, False, True]]))
    assert levels.tolist() == [[4, 0, 3]] and lacking == 1


def test_together_the_highest_level_counts_and_gaps_are_not_none():
    levels = [np.array([[0, 1, 0, 3, 2]], np.uint8), np.array([[0, 2, 0, 0, 0]], np.uint8)]
    known = [np.ones((1, 5), bool), np.array([[True, True, False, False, False]])]
    hazard = combined_hazard(levels, known, np.array([[True, True, True, True, True]]), 3)
    assert hazard.coded().tolist() == [[0, 2, 255, 3, 2]] and hazard.partly.tolist() == [[False] * 4 + [True]]
    hazard = combined_hazard(levels[:1], known[:1], np.array([[False, True, True, True, False]]), 3)
    assert hazard.coded().tolist() == [[255, 1, 0, 3, 2]]


def matrix(**changes):
    whole = {
        "source": "s",
        "level": [{"name": "a", "colour": "#000000"}, {"name": "b", "colour": "#ffffff"}],
        "period": [
            {"name": "p", "up_to": 30, "intensity": "swiss-avalanche", "levels": ["a", "a|b", "b"]},
            {"name": "q", "intensity": "swiss-avalanche", "levels": ["none", "a", "b"]},
        ],
    }
    return {"mine": whole | changes}


def test_own_matrices():
    made = parse_matrices(matrix(), read_guidelines(), "mine.toml")["mine"]
    assert made.periods[0].levels.tolist() == [0, 1, 2, 2] and made.periods[0].cells == ((1,), (1, 2), (2,))
    assert math.isinf(made.periods[1].up_to) and made.periods[1].levels.tolist() == [0, 0, 1, 2]
    assert made.bands == ("p_max",)


PERIOD = {"name": "p", "up_to": 30, "intensity": "swiss-avalanche", "levels": ["a", "a", "b"]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"period": [PERIOD | {"levels": ["b", "a", "b"]}]}, "higher intensity class has a lower level"),
        ({"period": [PERIOD, PERIOD | {"up_to": 100, "levels": ["b", "b", "b"]}]}, "higher level than p"),
        ({"period": [PERIOD, PERIOD]}, "expected ascending"),
        ({"period": [PERIOD, PERIOD | {"up_to": 100}]}, "period 2: the name 'p' is given twice"),
        ({"level": [{"name": "a", "colour": "#000000"}] * 2}, "level 2: the name 'a' is given twice"),
        ({"level": [{"name": "none", "colour": "#000000"}]}, "other than 'none'"),
        ({"level": [{"name": "a|b", "colour": "#000000"}]}, "without '|'"),
        ({"period": [PERIOD | {"levels": ["a", "b"]}]}, "one for each class of swiss-avalanche"),
        ({"period": [PERIOD | {"levels": ["a", "b", "c"]}]}, "unknown level 'c'"),
        ({"period": [PERIOD | {"intensity": "snow"}]}, "'snow' is unknown"),
        ({"period": [PERIOD | {"up_to": -1}]}, "years above 0"),
        ({"period": [PERIOD | {"up_to": "x"}]}, "expected a number"),
        ({"period": []}, "one or more"),
        ({"level": [{"name": "a", "colour": "red"}]}, "expected #rrggbb"),
        ({"levels": 1}, "unknown key"),
        ({"source": 3}, "expected text"),
    ],
)
def test_invalid_matrices_are_refused_in_one_line(change, words):
    with pytest.raises(InputError, match=words) as caught:
        parse_matrices(matrix(**change), read_guidelines(), "mine.toml")
    assert "\n" not in str(caught.value)


def test_unknown_matrix_lists_the_known_ones(tmp_path):
    with pytest.raises(InputError, match="choose from swiss-debris-flow"):
        choose_matrix("swiss")
    file = tmp_path / "own.toml"
    file.write_text("[mine\n")
    with pytest.raises(InputError, match="not a readable TOML"):
        choose_matrix("mine", file)


def test_rows_of_all_matrices_have_one_level_for_each_class():
    for matrix, period in itertools.chain.from_iterable(((m, p) for p in m.periods) for m in SHIPPED.values()):
        assert len(period.cells) == len(period.guideline.classes), (matrix.name, period.name)
