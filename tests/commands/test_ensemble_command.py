"""`mpmgis ensemble` through the command line: members, maps against NumPy, second starts, refusals."""

import csv
import hashlib
import json

import numpy as np
import pytest
import rasterio
from slope_site import FOOT, PIXEL, SCENE, WEST, distances, write_raster, write_shapes, write_site

from mpmgis.commands.shell.main import main
from mpmgis.frames import member_stack
from mpmgis.studies import ensemble_member
from mpmgis.studies.ensemble_options import ensemble_with
from mpmgis.studies.ensemble_plan import read_plan
from mpmgis.studies.ensemble_runs import ensemble
from mpmgis.system.errors import UnphysicalError
from mpmgis.system.messages import collected

SHORT = SCENE.replace("end_time = 30", "end_time = 15")
VARY = ("friction.mu=0.1:0.4", "release.thickness=normal:2:0.3:1:3")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("ensemble"))
    (folder / "scene.toml").write_text(SHORT)
    return folder


def command(site, output, *options, vary=VARY, samples=5, workers=1):
    """Exit code of `mpmgis ensemble` with a few members in this process."""
    words = ["ensemble", str(site / "scene.toml"), "-o", str(output), "--workers", str(workers)]
    for text in vary:
        words += ["--vary", text]
    return main([*words, *(["--samples", str(samples)] if samples else []), *options])


def table(folder):
    with open(folder / "members.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def bands(path):
    """Name -> float32[rows, columns], NaN where there is no data."""
    with rasterio.open(path) as source:
        values = source.read(masked=True).filled(np.nan)
        return {name.split(" [")[0]: values[k] for k, name in enumerate(source.descriptions)}


def digests(folder):
    """File -> digest of its bytes, of all that must not depend on who computed it."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".tif", ".qml", ".png") or path.name == "plan.toml"
    }


@pytest.fixture(scope="module")
def done(site):
    folder = site / "ensemble"
    assert command(site, folder, "-q") == 0
    return folder


def stacked(folder, band):
    """float32[members, rows, columns] in the table's order."""
    return np.stack([bands(folder / "members" / f"{row['digest']}_max.tif")[band] for row in table(folder)])


def test_the_table_has_a_row_a_member_with_its_values_and_figures(done):
    rows = table(done)
    assert [int(row["number"]) for row in rows] == [1, 2, 3, 4, 5]
    assert len({row["digest"] for row in rows}) == 5
    for row in rows:
        assert row["status"] == "finished" and row["reason"]
        assert 0.1 < float(row["friction.mu"]) < 0.4 and 1 < float(row["release.thickness"]) < 3
        assert float(row["wall_seconds"]) > 0 and int(row["steps"]) > 0
        assert 0 < float(row["runout_m"]) < 800 and float(row["Ut_max_m_s"]) > 5
    depth = stacked(done, "h_max")
    np.testing.assert_allclose([float(row["h_max_m"]) for row in rows], np.nanmax(depth, axis=(1, 2)), rtol=1e-6)
    reached = np.nan_to_num(depth) >= 0.05
    np.testing.assert_allclose([float(row["area_m2"]) for row in rows], 100 * reached.sum(axis=(1, 2)))


def test_members_with_less_friction_go_further(done):
    rows = table(done)
    friction, runout = (np.array([float(row[name]) for row in rows]) for name in ("friction.mu", "runout_m"))
    assert np.corrcoef(friction, runout)[0, 1] < -0.9


def test_maps_are_numpys_statistics_of_the_members(done):
    for name, band in (("h", "h_max"), ("Ut", "Ut_max"), ("p", "p_max")):
        stack = stacked(done, band)
        wet, depth = np.isfinite(stack).any(axis=0), np.nan_to_num(stack)
        low, middle, high = np.percentile(depth.astype(float), [5, 50, 95], axis=0)
        found = bands(done / "maps" / "rasters" / f"ensemble_{name}.tif")
        for ending, expected in {
            "mean": depth.mean(axis=0, dtype=float),
            "max": depth.max(axis=0),
            "min": depth.min(axis=0),
            "p5": low,
            "p50": middle,
            "p95": high,
        }.items():
            expected = np.where(wet, expected, np.nan).astype(np.float32)
            between = {"rtol": 1.2e-7 if ending in ("p5", "p95") else 0.0}  # two members, a float32's last bit
            np.testing.assert_allclose(found[f"{name}_{ending}"], expected, **between, err_msg=f"{name}_{ending}")
    depth = stacked(done, "h_max")
    wet = np.isfinite(depth).any(axis=0)
    found = bands(done / "maps" / "rasters" / "ensemble_probability.tif")
    assert list(found) == ["P_h_0.5", "P_h_1", "P_h_2", "P_arrival"]
    for threshold in (0.5, 1, 2):
        expected = np.where(wet, (np.nan_to_num(depth) >= threshold).mean(axis=0), np.nan).astype(np.float32)
        np.testing.assert_array_equal(found[f"P_h_{threshold}"], expected)
    arrival = stacked(done, "t_arrival")
    expected = np.where(np.isfinite(arrival).any(axis=0), np.isfinite(arrival).mean(axis=0), np.nan)
    np.testing.assert_array_equal(found["P_arrival"], expected.astype(np.float32))
    assert 0 < np.nanmin(found["P_arrival"]) < np.nanmax(found["P_arrival"]) == 1


def test_a_member_is_what_run_and_export_make_of_its_scene(done, site, tmp_path):
    """The raster of peaks of a member is that of the two commands, to the last bit."""
    row = table(done)[2]
    scene = SHORT.replace("mu = 0.2", f"mu = {row['friction.mu']}").replace("end_time", "maxima = true\nend_time")
    (site / "third.toml").write_text(scene.replace("thickness = 2.0", f"thickness = {row['release.thickness']}"))
    assert main(["run", str(site / "third.toml"), "-o", str(tmp_path / "third"), "-q"]) == 0
    assert main(["export-raster", str(tmp_path / "third"), "-o", str(tmp_path / "gis"), "--no-qgis", "-q"]) == 0
    exported, member = (
        bands(path) for path in (tmp_path / "gis/rasters/third_max.tif", done / f"members/{row['digest']}_max.tif")
    )
    for name, values in member.items():
        np.testing.assert_array_equal(values, exported[name], name)


def test_rasters_lie_on_the_dtm_and_describe_what_they_are(done, site):
    with rasterio.open(site / "dtm.tif") as terrain:
        transform, shape, crs = terrain.transform, terrain.shape, terrain.crs
    for path in (done / "maps").rglob("*.tif"):
        with rasterio.open(path) as source:
            assert (source.transform, source.shape, source.crs) == (transform, shape, crs), path
            assert source.nodata == -9999 and set(source.dtypes) == {"float32"}
            assert all(d.endswith(f" [{u}]") for d, u in zip(source.descriptions, source.units, strict=True))
        assert path.with_suffix(".qml").exists()
    with rasterio.open(done / "maps/rasters/ensemble_h.tif") as source:
        tags = source.tags(ns="mpmgis")
        assert source.descriptions[0] == "h_mean [m]"
    assert tags["members"] == "5" and tags["sampling"] == "lhs" and tags["dem"] == "dtm.tif"
    assert json.loads(tags["varied"])["friction.mu"] == "0.1:0.4"


def test_a_second_start_runs_nothing_and_other_thresholds_make_other_maps(done, site, capsys, monkeypatch):
    before, written = digests(done), {path: path.stat().st_mtime_ns for path in (done / "members").iterdir()}
    monkeypatch.setattr(ensemble_member, "run_task", lambda *_: pytest.fail("a member that is done was run again"))
    assert command(site, done, "--exceed", "Ut=5", "--percentiles", "50") == 0
    assert "5 of 5 members are already finished" in capsys.readouterr().err
    assert set(bands(done / "maps/rasters/ensemble_probability.tif")) == {"P_arrival", "P_Ut_5"}
    assert command(site, done, "-q") == 0
    assert digests(done) == before
    assert written == {path: path.stat().st_mtime_ns for path in (done / "members").iterdir()}


def test_the_plan_that_was_kept_makes_the_same_members(done, site, tmp_path):
    assert command(site, tmp_path / "again", "--plan", str(done / "plan.toml"), "-q", vary=(), samples=None) == 0
    assert [row["digest"] for row in table(tmp_path / "again")] == [row["digest"] for row in table(done)]


def test_info_reports_what_varies_and_how_far_it_is(done, capsys):
    assert main(["info", "--json", str(done)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["kind"], facts["state"], facts["members"]) == ("ensemble", "finished", {"finished": 5})
    assert set(facts["vary"]) == {text.partition("=")[0] for text in VARY} and facts["sampling"] == "lhs"
    assert facts["maps"] == sorted(path.name for path in (done / "maps" / "rasters").glob("*.tif"))
    assert main(["info", str(done)]) == 0
    assert "finished" in capsys.readouterr().out


def test_another_plan_is_refused_and_with_overwrite_keeps_what_both_have(site, tmp_path, capsys):
    out, sobol = tmp_path / "out", ("--sampling", "sobol")
    assert command(site, out, *sobol, "-q", samples=2) == 0
    assert command(site, out, *sobol, samples=4) == 2
    assert "another plan" in capsys.readouterr().err
    assert command(site, out, *sobol, "--overwrite", samples=4) == 0
    assert "2 of 4 members are already finished" in capsys.readouterr().err
    assert command(site, out, *sobol, "--overwrite", "-q", samples=1) == 0
    assert len(list((out / "members").glob("*.json"))) == 1


def test_an_input_that_changed_is_another_member(tmp_path):
    site = write_site(tmp_path)
    (site / "scene.toml").write_text(SHORT)
    assert command(site, site / "e", "-q", samples=2) == 0
    x, _ = distances()
    write_raster(site / "dtm.tif", np.maximum(0.49 * (FOOT - x), 0.0) + 100.0)
    first = [row["digest"] for row in table(site / "e")]
    assert command(site, site / "e", "-q", samples=2) == 2
    assert command(site, site / "e", "-q", "--overwrite", samples=2) == 0
    assert not set(first) & {row["digest"] for row in table(site / "e")}


def test_files_and_frames_may_vary_and_be_kept(site, tmp_path):
    import shapely

    write_shapes(site / "other.geojson", [shapely.box(100, 100, 140, 300)])
    vary = ("release.source=release.geojson,other.geojson", "friction.mu=0.2,0.3")
    assert command(site, tmp_path / "e", "--keep", "frames", "-q", vary=vary, samples=None) == 0
    rows = table(tmp_path / "e")
    assert [(row["release.source"], row["friction.mu"]) for row in rows] == [
        (source, mu) for source in ("release.geojson", "other.geojson") for mu in ("0.2", "0.3")
    ]
    for row in rows:
        kept = tmp_path / "e" / "members" / row["digest"]
        assert len(list(kept.glob("frame_*.h5"))) == 4 and (kept / "run.json").exists()
    assert main(["info", str(kept), "-q"]) == 0


def test_ctrl_c_leaves_what_a_second_start_continues_from(done, site, tmp_path, capsys):
    class Enough(KeyboardInterrupt):
        pass

    def stop(count, total, left):
        if count == 2:
            raise Enough

    folder = tmp_path / "ensemble"
    asked = ensemble_with(scene=site / "scene.toml", output=folder, vary=VARY, samples=5, workers=1)
    with pytest.raises(Enough):
        ensemble(asked, look=stop)
    assert [row["status"] for row in table(folder)] == ["finished"] * 2 + ["open"] * 3
    assert not (folder / "maps").exists()
    assert not list(tmp_path.rglob(".*part*"))
    assert command(site, folder) == 0
    assert "2 of 5 members are already finished" in capsys.readouterr().err
    assert digests(folder) == digests(done)


def broken(monkeypatch, kind, above):
    """Members whose friction is above a number end with an error of a kind."""
    usual = ensemble_member.run_task

    def run(task, look):
        if task.tables["friction"]["mu"] > above:
            raise kind("step 3, t = 1 s, E 0 N 0: made up")
        return usual(task, look)

    monkeypatch.setattr(ensemble_member, "run_task", run)


def test_unphysical_members_are_left_out_and_reported(site, tmp_path, capsys, monkeypatch):
    broken(monkeypatch, UnphysicalError, 0.33)
    assert command(site, tmp_path / "e", "--tolerate", "0.3") == 0
    said = capsys.readouterr().err
    assert "omit 1 of 5 members (1 unphysical)" in said
    rows = table(tmp_path / "e")
    assert sorted(row["status"] for row in rows) == ["finished"] * 4 + ["unphysical"]
    with rasterio.open(tmp_path / "e/maps/rasters/e_h.tif") as source:
        assert (source.tags(ns="mpmgis")["members"], source.tags(ns="mpmgis")["left_out"]) == ("4", "1")


def test_too_many_unphysical_members_are_refused(site, tmp_path, capsys, monkeypatch):
    broken(monkeypatch, UnphysicalError, 0.2)
    assert command(site, tmp_path / "e") == 3
    last = capsys.readouterr().err.splitlines()[-1]
    assert "of 5 members gave no result" in last and "made up" in last and "members.csv" in last
    assert not (tmp_path / "e" / "maps").exists() and (tmp_path / "e" / "members.csv").exists()


def test_samples_of_lists_are_reported(site, capsys):
    lists = {"scene": site / "scene.toml", "vary": ("friction.mu=0.2,0.3",)}
    with collected() as messages:
        plan, _ = read_plan(ensemble_with(**lists, samples=1000))
    assert plan.count == 2
    assert (
        "`samples=1000` has no effect: all keys have lists of values, and their 2 combinations are run" in messages[0]
    )
    with collected() as messages:
        read_plan(ensemble_with(**lists))
        read_plan(ensemble_with(**lists | {"vary": ("friction.mu=0.2,0.3", "friction.xi=500:800")}, samples=1000))
    assert not messages


REFUSED = [
    (("--vary", "friction.mue=0.1:0.3"), ("friction", "did you mean 'mu'")),
    (("--vary", "friction.mu=-0.1:0.3"), ("member", "mu = -", "at least 0")),
    (("--vary", "friction.mu=0.3:0.1"), ("LOW below HIGH",)),
    (("--vary", "friction.mu"), ("KEY=VALUES",)),
    (("--vary", "friction.mu=0.1:0.3", "--vary", "friction.mu=0.2"), ("twice",)),
    ((), ("nothing varies",)),
    (("--vary", "friction.mu=0.1:0.3", "--exceed", "depth=1"), ("depth", "h, Ut, p")),
    (("--vary", "friction.mu=0.1:0.3", "--percentiles", "5,150"), ("150", "0 to 100")),
    (("--vary", "friction.mu=0.1:0.3", "--sampling", "mc"), ("choose from 'lhs', 'sobol', 'random', 'grid'",)),
    (("--vary", "release.source=release.geojson,gone.shp"), ("gone.shp",)),
    (("--plan", "gone.toml"), ("gone.toml",)),
    (("--vary", "friction.mu=0.1:0.3", "--dask", "tcp://127.0.0.1:9"), ("no scheduler answers",)),
    (("--vary", "friction.mu=0.1:0.3", "--workers", "0"), ("whole number above 0",)),
    (("--vary", "friction.mu=0.1:0.3", "--cs-e", "1e5"), ("expected at most the longer side of the DTM",)),
    (("--vary", "friction.mu=0.1:0.3", "--cs-e", "1e-3"), ("use a larger --cs-e",)),
]


@pytest.mark.parametrize(("options", "words"), REFUSED, ids=[" ".join(options) for options, _ in REFUSED])
def test_refusals_are_one_line_and_leave_nothing(site, tmp_path, capsys, options, words):
    try:
        code = main(["ensemble", str(site / "scene.toml"), "-o", str(tmp_path / "e"), "-q", *options])
    except SystemExit as stop:
        code = stop.code
    lines = capsys.readouterr().err.splitlines()
    assert code == 2 and len(lines) == 1 and all(word in lines[0] for word in words), lines
    assert not (tmp_path / "e").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[vry]\n", "did you mean 'vary'"),
        ('samples = "x"\n', "samples"),
        ("samples = 0\n", "samples"),
        ("vary = 3\n", "vary"),
        ('[vary]\nfriction.mu = "0.3:0.1"\n', "LOW below HIGH"),
        ("exceed = 3\n", "exceed"),
        ("[vary]\n[exceed]\nh = ['a']\n", "nothing varies"),
        ("[vary]\nterrain.window = [[0, 0, 9e6, 9e6], [1, 1, 9e6, 9e6]]\n", "no common grid"),
    ],
)
def test_plans_that_are_none_are_refused(site, tmp_path, capsys, text, words):
    (tmp_path / "plan.toml").write_text(text)
    assert command(site, tmp_path / "e", "--plan", str(tmp_path / "plan.toml"), "-q", vary=()) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and words in lines[0], lines


def test_what_takes_long_asks_first(tmp_path, capsys):
    site = write_site(tmp_path)
    (site / "scene.toml").write_text(
        SHORT.replace("end_time = 15", "end_time = 9000000\nstop_at_rest = false").replace(
            "frame_interval = 5", "frame_interval = 50"
        )
    )
    assert command(site, tmp_path / "e", samples=500) == 2
    assert "give --yes" in capsys.readouterr().err
    assert not (tmp_path / "e").exists()


def test_windows_of_many_members_stay_within_the_memory_that_is_set(done):
    with rasterio.open(next((done / "maps").rglob("*.tif"))) as source:
        shape = source.shape
    from mpmgis.terrain.grid import Grid

    grid = Grid(None, source.transform, (3000, 4000))
    for count in (1, 300, 5000, 100_000):
        stack = member_stack.MemberStack(["x"] * count, grid, (10, 2990, 5, 3900), ("h_max",), threads=2)
        covered = np.zeros(grid.shape, int)
        for first in range(0, 3000, 256):
            for row, row_end, column, column_end in stack.windows(first, min(first + 256, 3000)):
                covered[row:row_end, column:column_end] += 1
                size = 4 * count * (row_end - row) * (column_end - column)
                assert size <= member_stack.STACK_BYTES / 2
        assert (covered[10:2990, 5:3900] == 1).all() and covered.sum() == 2980 * 3895
    assert shape == (40, 80)


# --------------------------------------------------------------------------------------------- against a closed form

SLOPE, TIME = 0.5, 12.0
SLIDE = f"""
[terrain]
dem = "plane.tif"
[release]
source = "release.geojson"
thickness = 0.1
density = 1000
[friction]
law = "Coulomb"
mu = 0.2
[numerics]
cell_size = 5.0
particles_per_cell = 4
[output]
end_time = {TIME}
frame_interval = {TIME}
stop_at_rest = false
"""


def fronts(mu):
    """Where the front of a block with these frictions is after TIME [m from the site's west], on a plane of SLOPE."""
    across = np.cos(np.arctan(SLOPE))
    along = 0.5 * TIME**2 * 9.81 * across * (SLOPE - mu)
    return 160.0 + along * across


@pytest.mark.thorough
def test_the_probability_of_arrival_of_a_sliding_block_is_the_closed_form(tmp_path):
    """Uniform friction makes the front's place uniform: its probability is a straight line down the slope.

    Every cell of the block's middle line lies between the probabilities of a cell nearer and a cell farther, plus and
    minus what one of 32 members weighs.
    """
    site, count = write_site(tmp_path), 32
    x, _ = distances()
    write_raster(site / "plane.tif", SLOPE * (800.0 - x) + 100.0)
    (site / "scene.toml").write_text(SLIDE)
    assert command(site, site / "e", "--exceed", "h=0.04", "-q", vary=("friction.mu=0.1:0.3",), samples=count) == 0
    found = bands(site / "e/maps/rasters/e_probability.tif")["P_h_0.04"][20]
    near = WEST + PIXEL * np.arange(80) - WEST

    def reached(place):
        return np.clip((np.interp(place, fronts(np.array([0.3, 0.1])), [0.3, 0.1]) - 0.1) / 0.2, 0, 1)

    where = near >= 170.0
    exact = reached(near)
    upper, lower = reached(near - PIXEL) + 1 / count, reached(near + 2 * PIXEL) - 1 / count
    values = np.nan_to_num(found)
    assert (values <= upper + 1e-6)[where].all() and (values >= lower - 1e-6)[where].all()
    assert np.abs(values - exact)[where].max() < 0.1
    assert len(np.unique(values[where])) > 8
    runout = np.array([float(row["runout_m"]) for row in table(site / "e")])
    mu = np.array([float(row["friction.mu"]) for row in table(site / "e")])
    np.testing.assert_allclose(runout, fronts(mu) - 110.0, atol=1.5 * PIXEL)
