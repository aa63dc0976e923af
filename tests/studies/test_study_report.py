"""Conclusions of a study: errors including the reference's, the choice for an error, results of other codes."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes

from mpmgis.scene import scene_from_tables
from mpmgis.simulation.numerical_parameters import cells_times, setting
from mpmgis.studies import study_plots
from mpmgis.studies.run_measures import Errors, Outcome
from mpmgis.studies.study_table import RECORD_NAMES, OtherResult, Row, Study

SIZES = (8.0, 4.0, 2.0 * 2**0.5, 2.0)
SECONDS = (1.0, 8.0, 23.0, 64.0)  # with the inverse cell size to the power of 3
FINEST = 1.0  # [m], of the reference


def outcome(made, seconds):
    return Outcome(made, 100, 10, 1000, (seconds, 0.9 * seconds, 1.2 * seconds), 5.0, 2.0 * seconds, (), 0.0)


def study(error_of, sizes=SIZES, reference=FINEST, beside=()):
    """Cells of `sizes` around the scene's 4 m; `error_of` each is the measured error of thickness."""
    scene = scene_from_tables(
        {
            "terrain": {"dem": "dtm.tif"},
            "release": {"source": "a.shp", "thickness": 1.0},
            "friction": {"law": "Coulomb", "mu": 0.3},
            "numerics": {"cell_size": 4.0},
            "output": {"end_time": 10.0, "frame_interval": 1.0},
        }
    )
    rows = []
    for size, seconds in zip(sizes, SECONDS, strict=False):
        changes = () if size == 4.0 else cells_times(scene, size / 4.0)
        made = setting(scene, "scene" if size == 4.0 else "cell_size", changes)
        rows.append(Row(outcome(made, seconds), Errors(error_of(size), np.nan, np.nan, np.nan)))
    rows.sort(key=lambda row: row.outcome.setting.parameter != "scene")
    return Study(tuple(rows), "thickness", reference, beside=beside)


def test_equal_kind_of_reference_error_is_added_to_all_errors():
    """Richardson: against cells of 1 m an error of 0.02 dx^1.5 lacks 0.02."""
    found = study(lambda dx: 0.02 * (dx**1.5 - FINEST))
    assert found.law.order == pytest.approx(1.5, rel=1e-4) and not found.law.independent
    assert found.reference_error == pytest.approx(0.02, rel=1e-3)
    assert found.errors == pytest.approx([0.02 * row.outcome.setting.cell_size**1.5 for row in found.rows], rel=1e-3)


def test_independent_reference_error_is_not_added():
    found = study(lambda dx: 0.02 * np.hypot(dx**1.5, FINEST))
    assert found.law.independent and found.reference_error == pytest.approx(0.02, rel=1e-3)
    assert found.errors == pytest.approx(found.raw_errors)


def test_without_a_law_the_error_of_the_reference_is_unknown_everywhere(tmp_path, monkeypatch):
    """In text, tables and plot; against an exact reference it is 0, whatever the law."""
    error_of = {8.0: 0.01, 4.0: 0.2, 2.0: 0.03}
    found = study(lambda dx: error_of.get(dx, 0.005))
    assert found.law is None and found.reference_error is None
    assert found.errors == pytest.approx(found.raw_errors)
    assert found.choice(0.004) is None
    assert "follows no power" in found.lines()[0] and "(cells of 1 m) is unknown" in found.lines()[1]
    summary = dict(found.summary())
    assert summary["order"] == "-" and summary["error of the reference"] == "unknown"
    names, rows = found.records()
    assert all(np.isnan(row[names.index("error_with_reference")]) for row in rows)
    labels = []
    monkeypatch.setattr(Axes, "legend", lambda axes, **_: labels.extend(axes.get_legend_handles_labels()[1]))
    study_plots.write_plot(tmp_path / "study.png", found)
    assert "error of the reference: unknown" in labels
    assert study(lambda dx: error_of.get(dx, 0.005), reference=0.0).reference_error == 0.0


def test_choice_is_the_fastest_accurate_setting_else_extrapolated():
    """Exact solution: half the error of the finest cells needs cells of 2 m / 2^(1/2), and 2^1.5 times their time."""
    found = study(lambda dx: 0.01 * dx**2, reference=0.0)
    reached = found.choice(0.2)
    assert (reached.changes, reached.seconds, reached.estimated) == ({}, 8.0, False)
    wanted = found.choice(0.02)
    assert wanted.estimated and wanted.changes == {"cell_size": pytest.approx(2**0.5, rel=2e-3)}
    assert wanted.seconds == pytest.approx(64.0 * 2**1.5, rel=1e-2)
    assert found.choice(0.04 / 4.1**2) is None and found.choice(0.04 / 3.9**2) is not None


def test_results_of_other_codes_are_compared_with_the_fastest_accurate_setting():
    other = OtherResult("other", "as it is", (24.0, 23.0, 26.0), Errors(0.17, np.nan, np.nan, np.nan))
    wrong = OtherResult("third", "at its best", (1.0, 1.0, 1.0), Errors(0.001, np.nan, np.nan, np.nan))
    found = study(lambda dx: 0.01 * dx**2, reference=0.0, beside=(other, wrong))
    assert "other: as it is: 3 times the time of the fastest setting as accurate (unchanged scene)" in found.lines()
    assert "third: at its best: no setting of this study is as accurate" in found.lines()
    names, rows = found.records()
    records = [dict(zip(names, row, strict=True)) for row in rows]
    assert names == RECORD_NAMES and [record["knob"] for record in records[-2:]] == ["beside", "beside"]
    assert records[-2]["time_over_front"] == 3.0 and records[-1]["time_over_front"] == ""
    assert [records[-2][name] for name in ("seconds", "seconds_min", "seconds_max")] == [24.0, 23.0, 26.0]
    assert records[-2]["error_thickness"] == records[-2]["error_with_reference"] == 0.17


def test_overlapping_times_are_ties_in_text_table_and_choice(monkeypatch):
    """Four settings of 10 s each, 9 to 12: none is over the front, and the most accurate is the choice."""
    monkeypatch.setattr("test_study_report.SECONDS", (10.0, 10.5, 9.5, 10.0))
    found = study(lambda dx: 0.01 * dx**2, reference=0.0)
    assert found.over_front.tolist() == [1.0] * 4 and found.front.sum() == 1
    (line,) = (line for line in found.lines() if line.startswith("ties in time"))
    assert line.endswith("cell_size = 8, cell_size = 2.82843, cell_size = 2")
    assert "0.25 times the error for the same time" in " ".join(found.lines())
    assert found.choice(0.2).changes == {"cell_size": 2.0}
    names, rows = found.records()
    assert rows[0][names.index("ties")] == "cell_size = 8; cell_size = 2.82843; cell_size = 2"


def test_a_study_of_single_runs_reports_that_ties_are_not_detected():
    found = study(lambda dx: 0.01 * dx**2, reference=0.0)
    alone = [row._replace(outcome=replace(row.outcome, seconds=row.outcome.seconds[:1])) for row in found.rows]
    assert any("was run once" in line for line in replace(found, rows=tuple(alone)).lines())
    assert not any("was run once" in line for line in found.lines())
