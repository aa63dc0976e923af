"""Classes of guidelines against the documents, and validation of tables."""

import numpy as np
import pytest

from mpmgis.results.hazard.guideline_classes import UNREAD, class_areas, classify, parse_guidelines
from mpmgis.results.hazard.guideline_files import choose_guideline, read_guidelines
from mpmgis.system.errors import InputError


def classes(name, h=0.2, v=0.1, p=0.0, deposit=0.0):
    """Class names of cells with these largest values [m, m/s, kPa, m]."""
    guideline = read_guidelines()[name]
    values = np.broadcast_arrays(*np.atleast_1d(h, v, p, deposit))
    bands = {"h_max": values[0], "Ut_max": values[1], "p_max": values[2] * 1000.0, "h_deposit": values[3]}
    bands = {band: np.array(value, float)[None] for band, value in bands.items()}
    numbers = classify(guideline, bands, np.ones(bands["h_max"].shape, bool))
    return [guideline.classes[k - 1].name for k in numbers[0]]


@pytest.mark.parametrize(
    ("name", "values", "wanted"),
    [
        ("swiss-debris-flow", {"h": [0.3, 2, 0.9, 1.0], "v": [5, 0.5, 0.9, 1.0]}, ["medium"] * 3 + ["strong"]),
        (
            "swiss-flood",
            {"h": [0.4, 0.4, 0.6, 0.8, 2.0], "v": [1, 2, 0, 3, 0]},
            ["weak", *["medium"] * 2, *["strong"] * 2],
        ),
        ("swiss-avalanche", {"p": [2.9, 3, 29, 30]}, ["weak", "medium", "medium", "strong"]),
        ("swiss-hillslope-debris-flow", {"h": [0.9, 1.0]}, ["medium", "strong"]),
        ("austrian-avalanche", {"p": [0.9, 1, 9.9, 10]}, ["below the yellow zone", "yellow", "yellow", "red"]),
        ("austrian-torrent-deposit", {"deposit": [0.6, 0.7]}, ["yellow", "red"]),
        ("italian-avalanche-30", {"p": [2.9, 3]}, ["blue", "red"]),
        ("italian-avalanche-100", {"p": [2.9, 3, 14, 15]}, ["yellow", "blue", "blue", "red"]),
    ],
)
def test_cells_have_the_class_of_the_document(name, values, wanted):
    assert classes(name, **values) == wanted


def test_a_limit_in_single_precision_belongs_to_the_higher_class():
    """As in a hazard map: 0.7 m and 30 kPa of a raster are 0.69999999 m and may be 29999.998 Pa."""
    deposit, pressure = float(np.float32(0.7)), float(np.nextafter(np.float32(30e3), np.float32(0))) / 1000.0
    assert deposit < 0.7 and pressure < 30.0
    assert classes("austrian-torrent-deposit", deposit=deposit) == ["red"]
    assert classes("swiss-avalanche", p=pressure) == ["strong"]


def test_every_shipped_guideline_names_its_document():
    for guideline in read_guidelines().values():
        assert guideline.source and guideline.title and guideline.bands is not None


def test_every_shipped_number_has_a_source_or_is_marked_as_not_read():
    entries = [(name, entry) for name, guideline in read_guidelines().items() for entry in guideline.classes]
    for name, entry in entries:
        assert bool(entry.read_in) == any(entry.when), (name, entry.name)
    unread = {(name, entry.name) for name, entry in entries if entry.read_in == UNREAD}
    assert ("swiss-avalanche", "medium") in unread and ("swiss-avalanche", "strong") not in unread
    said = dict(entries)["swiss-avalanche"].origin(), dict(entries)["italian-avalanche-100"].origin()
    assert "DORA" in said[0] and "check it there" in said[1]


def test_depth_times_speed_squared_in_user_guidelines():
    table = {"mine": {"source": "s", "class": [{"name": "a", "colour": "#000000", "when": [{"vvh": 10}]}]}}
    guideline = parse_guidelines(table, "mine.toml")["mine"]
    bands = {"h_max": np.array([[2.0, 2.0]]), "Ut_max": np.array([[2.2, 2.3]])}
    assert guideline.bands == ("h_max", "Ut_max") and guideline.classes[0].words() == "vvh >= 10 m3/s2"
    assert classify(guideline, bands, np.ones((1, 2), bool)).tolist() == [[0, 1]]  # 9.68 and 10.58 m3 s-2


def test_nodata_and_cells_without_flow_have_no_class():
    guideline = read_guidelines()["swiss-debris-flow"]
    bands = {"h_max": np.array([[2.0, 2.0, np.nan]]), "Ut_max": np.array([[np.nan, 5.0, 5.0]])}
    numbers = classify(guideline, bands, np.array([[True, True, False]]))
    assert numbers.tolist() == [[1, 2, 0]] and numbers.dtype == np.uint8
    assert class_areas(guideline, numbers, 4.0).tolist() == [4, 4]


def test_user_guidelines_replace_and_add(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[swiss-avalanche]\nsource = "x"\n[[swiss-avalanche.class]]\nname = "all"\ncolour = "#123456"\nwhen = [{}]\n'
        '[mine]\nsource = "us"\n[[mine.class]]\nname = "a"\ncolour = "#000000"\nwhen = [{h = 1}, {vh = 2, p = 3}]\n'
    )
    assert len(choose_guideline("swiss-avalanche", path).classes) == 1
    mine = choose_guideline("mine", path)
    assert mine.bands == ("h_max", "Ut_max", "p_max")
    assert mine.classes[0].words() == "h >= 1 m or vh >= 2 m2/s and p >= 3 kPa"
    with pytest.raises(InputError, match="choose from swiss-debris-flow"):
        choose_guideline("theirs", path)


GOOD = {"source": "s", "class": [{"name": "a", "colour": "#000000", "when": [{"h": 1}]}]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"source": 3}, "expected text"),
        ({"klass": []}, "unknown key 'klass'"),
        ({"class": []}, "one or more"),
        ({"class": [{"name": "a", "colour": "red", "when": [{}]}]}, "expected #rrggbb"),
        ({"class": [{"name": "a", "colour": "#000000"}]}, "when is missing"),
        ({"class": [{"name": "a", "colour": "#000000", "when": {"h": 1}}]}, "list of conditions"),
        ({"class": [{"name": "a", "colour": "#000000", "when": [{"depth": 1}]}]}, "unknown quantity 'depth'"),
        ({"class": [{"name": "a", "colour": "#000000", "when": [{"h": True}]}]}, "expected a number above 0"),
        ({"class": [{"name": "a", "colour": "#000000", "when": [{"h": float("nan")}]}]}, "expected a number above 0"),
        ({"class": ["a"]}, "expected a table"),
    ],
)
def test_invalid_tables_are_rejected(change, words):
    with pytest.raises(InputError, match=words):
        parse_guidelines({"mine": GOOD | change}, "mine.toml")
    assert parse_guidelines({"mine": GOOD}, "mine.toml")["mine"].note == ""
