"""The printed sheet of a hazard map: what does not fit is made smaller, and what is left out is reported."""

from types import SimpleNamespace

import numpy as np
import pyproj
import pytest
from test_hazard_map import CRS, NORTH_UP

from mpmgis.results.hazard.hazard_files import HazardMap, choose_matrix
from mpmgis.results.hazard.hazard_levels import Hazard
from mpmgis.results.hazard.hazard_sheet import _drawn, sheet_for
from mpmgis.results.hazard.zone_outlines import generalized_zones
from mpmgis.system.errors import MpmgisError
from mpmgis.system.messages import collected
from mpmgis.terrain.grid import Grid


def sheet_of(scenarios, title, paper="A4", facts=20):
    """The figure of a sheet with fake `scenarios`, of which only the words are drawn."""
    level = np.zeros((40, 100), np.uint8)
    level[5:35, 5:95] = 4
    grid, nothing = Grid(pyproj.CRS.from_user_input(CRS), NORTH_UP, level.shape), np.zeros(level.shape, bool)
    matrix = choose_matrix("swiss-flood")
    named = [
        SimpleNamespace(words=lambda words=words: words, period=matrix.periods[0], unfinished="") for words in scenarios
    ]
    made = HazardMap(
        matrix,
        grid,
        Hazard(level, nothing, nothing),
        named,
        generalized_zones(level, 4, NORTH_UP, 5000, 100.0),
        None,
        5000.0,
        100.0,
        title,
        tuple((f"fact {k}", "some words about it") for k in range(facts)),
    )
    figure = _drawn(made, None, sheet_for((600050, 5199650, 600950, 5199950), paper, 5000.0))
    figure.canvas.draw()
    return figure


@pytest.mark.parametrize("words", [2, 20, 200])
def test_a_title_stays_on_the_sheet(words):
    title = " ".join(["Gemeinde"] * words)
    figure = sheet_of(["30 years: a"], title, paper="A3")
    (shown,) = [text for text in figure.texts if text.get_text().startswith("Gemeinde")]
    assert shown.get_window_extent().x1 <= figure.bbox.x1
    assert (shown.get_text() == title) == (words < 200)


def test_many_scenarios_leave_room_for_the_sources():
    for count, lost in ((10, False), (90, True)):
        with collected() as notes:
            figure = sheet_of([f"{k} years: {'a_long_name_' * 4}{k}" for k in range(count)], "title")
        shown = " ".join(text.get_text() for text in figure.texts)
        assert "fact 0: some" in shown and ("fact 19: some" in shown or lost)
        assert any("has no room for" in note for note in notes) == lost
        foot = max(text.get_window_extent().y1 for text in figure.texts if text.get_text() == "N")
        assert min(text.get_window_extent().y0 for text in figure.texts if "years:" in text.get_text()) > foot


def test_a_larger_paper_is_named_only_where_the_zones_fit_on_it():
    for size, fits in ((450.0, True), (900.0, False)):
        with pytest.raises(MpmgisError, match="scale=1:") as caught:
            sheet_for((0, 0, size, 300), "A4", 2000.0)
        assert ("sheet=A3" in str(caught.value)) == fits
