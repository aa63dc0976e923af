"""The player in a report: its values are those of the cells, the page is small, and a browser plays it."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
from block_frames import write_block_run
from headless_browser import opened

from mpmgis.commands.shell.main import main
from mpmgis.results.reports import flow_player, run_report

pytest.importorskip("bokeh")
MOST = 15_000_000  # [bytes] of a page that goes by mail
PLACE = """(x, y) => {  // a place [m] as pixels of the window
  const [drawing] = Bokeh.documents, map = drawing.get_model_by_name("map");
  const plot = Bokeh.index.get_by_id(drawing.roots()[0].id).child_views.find((view) => view.model === map);
  const box = plot.canvas.el.getBoundingClientRect();
  return [box.left + plot.frame.x_scale.compute(x), box.top + plot.frame.y_scale.compute(y)];
}"""


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    """(frames, page): three steps of a block that slides, at 1, 20 and 0 m/s on level ground."""
    folder = tmp_path_factory.mktemp("played")
    frames = write_block_run(folder, speeds=(1.0, 20.0, 0.0))
    assert main(["report", str(frames), "-o", str(folder / "r.html")]) == 0
    return frames, folder / "r.html"


def content_of(page):
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="player-content">(.*?)</script>', text)[1])


def decoded(text, kind):
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), kind)


def values_of(content, band, step):
    """float64[rows, columns] of a band in the window, north up; NaN without a value."""
    rows, columns = content["shape"]
    values = np.full(rows * columns, np.nan)
    codes = decoded(content["bands"][band]["steps"][step], "<u2")
    numbers = np.where(codes == content["none"], np.nan, codes * content["bands"][band]["precision"])
    values[decoded(content["cells"], "<i4")] = numbers
    return values.reshape(rows, columns)[::-1]


def test_embedded_values_are_the_cells_to_their_precision(reported, tmp_path):
    import mpmgis

    frames, page = reported
    content, results = content_of(page), mpmgis.open_results(frames)
    west, south, east, north = content["bounds"]
    cells = results.sel(x=slice(west, east), y=slice(north, south))
    assert cells.h.shape[1:] == tuple(content["shape"]) and content["times"] == ["0", "10", "20"]
    for step in range(3):
        depth, speed = (values_of(content, band, step) for band in (0, 1))
        wanted = cells.h.values[step]
        inside = np.isfinite(depth)
        assert np.abs(depth - wanted)[inside].max() <= 0.0005 + 1e-9 and not np.nan_to_num(wanted)[~inside].any()
        wanted = cells.Ut.values[step]
        assert np.array_equal(np.isfinite(wanted), np.isfinite(speed))
        assert np.nanmax(np.abs(speed - wanted)) <= 0.005 + 1e-6
    assert [band["precision"] for band in content["bands"]] == [0.001, 0.01]


def test_the_page_goes_by_mail_and_loads_nothing(reported):
    text = reported[1].read_text(encoding="utf-8")
    assert len(text) < MOST
    assert not re.search(r'<(script|link|img|iframe)[^>]*(src|href)="(?!data:)', text)


def test_an_export_plays_too(reported, tmp_path):
    frames, page = reported
    assert main(["export-raster", str(frames), "--no-qgis", "-o", str(tmp_path / "maps")]) == 0
    assert main(["report", str(tmp_path / "maps"), "-o", str(tmp_path / "r.html")]) == 0
    for step in range(3):
        ours, theirs = (values_of(content_of(one), 0, step) for one in (page, tmp_path / "r.html"))
        assert np.nansum(ours) == pytest.approx(np.nansum(theirs), rel=1e-3)


def test_large_values_are_coarser_and_many_steps_fewer(reported, tmp_path, monkeypatch, caplog):
    assert flow_player._precision(0.001, [np.array([np.nan, 65.0])]) == 0.001
    assert flow_player._precision(0.001, [np.array([66.0])]) == pytest.approx(0.01)
    assert flow_player._precision(0.001, []) == 0.001
    content = content_of(reported[1])
    size = sum(len(step) for band in content["bands"] for step in band["steps"])
    monkeypatch.setattr(flow_player, "MOST_BYTES", size // 2 + 10)
    caplog.set_level("INFO")
    assert main(["report", str(reported[0]), "-o", str(tmp_path / "r.html")]) == 0
    assert content_of(tmp_path / "r.html")["times"] == ["0", "20"]


def test_without_the_library_or_on_request_there_is_no_player(reported, tmp_path, monkeypatch, capsys):
    assert main(["report", str(reported[0]), "--no-player", "-o", str(tmp_path / "a.html")]) == 0
    assert "mpmgis[player]" not in capsys.readouterr().err
    monkeypatch.setattr(run_report, "can_play", lambda: False)
    assert main(["report", str(reported[0]), "-o", str(tmp_path / "b.html")]) == 0
    assert 'Bokeh is not installed: pip install "mpmgis[player]"' in capsys.readouterr().err
    for name in ("a.html", "b.html"):
        assert "<script" not in (tmp_path / name).read_text(encoding="utf-8")


@pytest.mark.thorough
def test_a_browser_plays_it_and_a_click_gives_the_value_of_the_cell(reported):
    content = content_of(reported[1])
    rows, columns = content["shape"]
    with opened(reported[1]) as page:
        page.until("document.getElementById('player-time').textContent === 't = 0 s'")
        page.value("document.querySelector('.player').scrollIntoView()")
        pictures = []
        for step in range(3):
            page.value(
                f"(() => {{ const slider = document.getElementById('player-step'); slider.value = {step};"
                "slider.dispatchEvent(new Event('input')); })()"
            )
            page.until(f"document.getElementById('player-time').textContent === 't = {content['times'][step]} s'")
            pictures.append(page.picture())
            depth, speed = (values_of(content, band, step) for band in (0, 1))
            row, column = np.argwhere(np.isfinite(speed))[np.isfinite(speed).sum() // 2]
            west, south, east, north = content["bounds"]
            x = west + (column + 0.5) / columns * (east - west)
            y = north - (row + 0.5) / rows * (north - south)
            expected = (
                f"t = {content['times'][step]} s: depth {depth[row, column]:.3f} m, speed {speed[row, column]:.2f} m/s"
            )
            shown = f"document.getElementById('player-value').textContent.endsWith({json.dumps(expected)})"
            page.click_until(f"({PLACE})({x}, {y})", shown)
        assert len(set(pictures)) == 3
        page.value("document.getElementById('player-play').click()")
        page.until("document.getElementById('player-step').value === '1'")
        assert page.errors == []
