"""Maxima of all steps of points through the commands: run, stages, export, reading back, messages."""

import json

import numpy as np
import pytest
import rasterio
import shapely
from slope_site import run, slide, write_block_site, write_shapes

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.frames.peaks import PEAK_NAMES, lattices_of
from mpmgis.maps.averaging.maxima import SolverPeaks

pytestmark = pytest.mark.thorough

END = 7
BANDS = ("h_max", "t_max", "Ut_max", "p_max", "t_arrival")
STAGES = '[[stage]]\nsolver = "columns"\nuntil = {time = 3}\n[[stage]]\nsolver = "points"\n'


def scene(interval, maxima="true", **more):
    """The block slides for END seconds."""
    return slide(4.0, END, interval, friction='law = "Coulomb"\nmu = 0.1', **more) + f"maxima = {maxima}\n"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Runs of one scene: 2 frames with maxima, 2 without, and 71 without; and two of stages."""
    folder = write_block_site(tmp_path_factory.mktemp("maxima"))
    head = {"head": "", "more": "particles_per_cell = 4"}
    scenes = {
        "few": scene(END),
        "off": scene(END, "false"),
        "dense": scene(0.1, "false"),
        "single": scene(END, more='precision = "float32"'),
        "staged": scene(3, **head) + STAGES,
        "finer": scene(3, **head) + STAGES.replace('solver = "columns"', 'solver = "columns"\ncell_size = 6'),
    }
    for name, text in scenes.items():
        assert run(folder, text, "-q", "-o", str(folder / name)) == 0
    return folder


def last(folder):
    """The last frame of a run's folder."""
    return read_frame(sorted(folder.glob("frame_*.h5"))[-1])


def exported(site, name, capsys, *options):
    """(band -> float64[rows, columns], tags, lines on stderr) of the maxima that `mpmgis export-raster` writes."""
    capsys.readouterr()
    output = site / f"{name}_out"
    words = ["export-raster", str(site / name), "-o", str(output), "--no-qgis", "--extent", "dtm", "--overwrite"]
    assert main([*words, *options]) == 0
    with rasterio.open(output / "rasters" / f"{name}_max.tif") as source:
        names = [text.split(" ")[0] for text in source.descriptions]
        values = np.where(source.read() == source.nodata, np.nan, source.read().astype(float))
        tags = source.tags(ns="mpmgis")
    return dict(zip(names, values, strict=True)), tags, capsys.readouterr().err.splitlines()


def missed(values, reference, name):
    """Share of the reference's sum that `values` are short of."""
    want, got = np.nan_to_num(reference[name]), np.nan_to_num(values[name])
    return np.maximum(want - got, 0.0).sum() / want.sum()


@pytest.mark.parametrize("cell_size", ["10", "4", "7"])
def test_two_frames_with_solver_maxima_show_what_seventy_frames_show(site, capsys, cell_size):
    """In cells of the DTM's size, the solver's and another; two frames alone miss the middle of the path."""
    few, tags, said = exported(site, "few", capsys, "--cs-e", cell_size)
    off, off_tags, _ = exported(site, "off", capsys, "--cs-e", cell_size)
    dense, _, _ = exported(site, "dense", capsys, "--cs-e", cell_size)
    assert tags["maxima"] == "solver, every step" and tags["maxima_solver"].split(", ") == list(BANDS)
    assert off_tags["maxima"] == "frames"
    assert any("of points, h_max and t_max include the thickness from mass" in line for line in said)
    for name, most in (("Ut_max", 0.05), ("p_max", 0.04), ("h_max", 0.15)):
        assert missed(few, dense, name) < most < missed(off, dense, name), name
    core = np.nan_to_num(dense["h_max"]) > 3.0
    assert np.isfinite(few["Ut_max"])[core].mean() > 0.99 > 0.95 > np.isfinite(off["Ut_max"])[core].mean()
    both = np.isfinite(few["t_arrival"]) & np.isfinite(dense["t_arrival"])
    assert np.abs(few["t_arrival"] - dense["t_arrival"])[both].mean() < 0.2 + 0.05 * float(cell_size)


def test_solver_maxima_hold_the_thickness_of_all_frames(site):
    """t_vol of the dense frames, on the solver's cells, is nowhere above the solver's peak but at the rims."""
    dense = mpmgis.open_results(site / "dense", products=("t_vol",), cell_size=8.0)["t_vol"].max("time")
    kept = mpmgis.open_results(site / "few", cell_size=8.0)
    peak = kept["t_max"].values
    thick = dense.values > 2.0
    assert thick.sum() > 40 and (peak[thick] > 0.8 * dense.values[thick]).all()
    assert set(BANDS) <= set(kept.data_vars)


def test_single_precision_keeps_the_same_peaks(site):
    one, other = (SolverPeaks.of(last(site / name).maxima, END) for name in ("few", "single"))
    assert one.spacing == other.spacing == 4.0
    assert one.thickness.max() == pytest.approx(other.thickness.max(), rel=1e-3)
    assert one.speed.max() == pytest.approx(other.speed.max(), rel=1e-2)


def test_stages_of_one_cell_size_have_one_lattice_that_holds_both(site):
    """Peaks of the columns' stage are in every later frame, and grow with those of the points."""
    first, at_switch, end = (read_frame(site / "staged" / f"frame_{k:06d}.h5").maxima for k in (0, 1, 3))
    assert [len(lattices_of(kept)) for kept in (first, at_switch, end)] == [1, 1, 1]
    peaks = [SolverPeaks.of(kept, 0.0) for kept in (at_switch, end)]
    row, column = (round((getattr(peaks[0], a) - getattr(peaks[1], a)) / 4.0) for a in ("south", "west"))
    rows, columns = peaks[0].thickness.shape
    part = slice(row, row + rows), slice(column, column + columns)
    for name in PEAK_NAMES[:3]:
        assert (getattr(peaks[1], name)[part] >= getattr(peaks[0], name)).all(), name
    arrived = peaks[0].arrival_time >= 0
    np.testing.assert_array_equal(peaks[1].arrival_time[part][arrived], peaks[0].arrival_time[arrived])
    later = peaks[1].arrival_time[peaks[1].arrival_time > 3.0]
    assert len(later) > 100


def test_stages_of_other_cells_keep_a_lattice_each_and_export_as_one(site, capsys):
    kept = last(site / "finer").maxima
    assert [float(lattice["transform"][0]) for lattice in lattices_of(kept)] == [4.0, 6.0]
    assert "other1_thickness" in kept and "other2_thickness" not in kept
    one, _, _ = exported(site, "staged", capsys, "--cs-e", "4")
    two, tags, _ = exported(site, "finer", capsys, "--cs-e", "4")
    assert tags["maxima_solver"].split(", ") == list(BANDS)
    both = np.isfinite(one["Ut_max"]) & np.isfinite(two["Ut_max"])
    assert both.sum() > 0.85 * np.isfinite(one["Ut_max"]).sum()
    assert np.abs(one["Ut_max"] - two["Ut_max"])[both].mean() < 0.1 * np.nanmax(one["Ut_max"])
    upper = SolverPeaks.of(read_frame(site / "finer" / "frame_000000.h5").maxima, 0.0)
    assert upper is None  # nothing has moved yet


def test_the_record_the_report_and_info_report_them(site, capsys):
    told = json.loads((site / "finer" / "run.json").read_text())["maxima"]
    kept = last(site / "finer").maxima
    assert told["thickness"] == max(float(kept[name].max()) for name in ("thickness", "other1_thickness"))
    assert [one["cell_size"] for one in told["reached"]] == [4.0, 6.0] and told["reached"][0]["area"] > 1000
    assert told["arrival_thickness"] == 0.05
    assert json.loads((site / "off" / "run.json").read_text())["maxima"] == {}
    capsys.readouterr()
    assert main(["info", str(site / "finer" / "frame_000003.h5"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    facts = facts[0] if isinstance(facts, list) else facts
    assert facts["thickness_so_far"] == told["thickness"] and facts["speed_so_far"] == told["speed"]
    assert main(["report", str(site / "few"), "-o", str(site / "few_report")]) == 0
    text = (site / "few_report" / "report.html").read_text()
    assert "peaks of every step, at the solver" in text


def test_points_in_a_window_and_columns_beside_it_have_peaks_together(site):
    write_shapes(site / "box.geojson", [shapely.box(140, 100, 390, 300)])
    beside = STAGES.replace('solver = "points"', 'solver = "points"\nwindow = "box.geojson"\noutside = "columns"')
    text = scene(3, head="", more="particles_per_cell = 4") + beside
    assert run(site, text, "-q", "-o", str(site / "beside")) == 0
    peaks, whole = (SolverPeaks.of(last(site / name).maxima, END) for name in ("beside", "staged"))
    assert peaks.others == () and peaks.spacing == 4.0
    assert peaks.west == pytest.approx(whole.west, abs=8.0) and peaks.bounds(0.05)[2] == pytest.approx(
        whole.bounds(0.05)[2], abs=16.0
    )
    assert peaks.speed.max() == pytest.approx(whole.speed.max(), rel=0.1)


def test_members_of_an_ensemble_of_points_keep_them(site):
    from mpmgis.scene import read_scene
    from mpmgis.studies.ensemble_plan import with_peaks

    (site / "scene.toml").write_text(scene(END, "false"))
    output = with_peaks(read_scene(site / "scene.toml"), 0.1)["output"]
    assert output["maxima"] is True and output["arrival_thickness"] == 0.1
