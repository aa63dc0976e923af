"""Inflow over time and secondary releases by the command: what is refused, what is recorded, what a kill changes."""

import json
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
import shapely
from slope_site import CHILD, SCENE, contents, decisions, record, run, write_shapes, write_site

from mpmgis.commands.shell.main import main

NO_RELEASE = SCENE.replace(SCENE[SCENE.index("[release]") : SCENE.index("[friction]")], "")
INFLOW = '[hydrograph]\nsource = "inlet.geojson"\nfile = "inflow.csv"\n'
DISCHARGE = "time,discharge,speed\n1,0,10\n5,300,10\n13,80,10\n22,0,10\n"
VOLUME = 0.5 * 300 * 4 + 0.5 * 380 * 8 + 0.5 * 80 * 9  # [m3]
SECONDARY = '[[secondary_release]]\nsource = "{0}.geojson"\nthickness = 0.5\nthickness_mode = "vertical"\n'
ALL = SCENE + INFLOW + SECONDARY.format("near") + SECONDARY.format("far")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The slope with an inlet, two areas below and a table of discharge; one run of all of it, never stopped."""
    folder = write_site(tmp_path_factory.mktemp("events"))
    write_shapes(folder / "inlet.geojson", [shapely.box(60, 150, 100, 250)])
    write_shapes(folder / "near.geojson", [shapely.box(240, 160, 280, 240)])
    write_shapes(folder / "far.geojson", [shapely.box(420, 160, 460, 240)])
    (folder / "inflow.csv").write_text(DISCHARGE)
    (folder / "all.toml").write_text(ALL)
    assert main(["run", str(folder / "all.toml"), "-q", "-o", str(folder / "whole")]) == 0
    return folder


def cut_short(site, output, number, what, where):
    """(exit code, stderr) of a run into `output` that gets the signal `number` on its way."""
    command = [sys.executable, "-c", CHILD, str(int(number)), what, str(where)]
    done = subprocess.run(
        [*command, "run", str(site / "all.toml"), "-q", "-o", str(output)], capture_output=True, text=True, timeout=300
    )
    return done.returncode, done.stderr


def resumed(site, output):
    """Exit code of the same run continued."""
    return main(["run", str(site / "all.toml"), "-q", "-o", str(output), "--resume"])


def only_line(capsys):
    """The one line on stderr, with nothing on stdout."""
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1, err
    return err


# -------------------------------------------------------------------------------------------------- what is recorded


def test_what_comes_in_is_the_volume_of_the_hydrograph(site):
    """Nothing is there at the start; the table continues after the end, of which nothing comes."""
    (site / "inflow.csv").write_text("time;discharge\n2,5;100\n10;200\n40;200\n")
    try:
        assert run(site, NO_RELEASE + INFLOW, "-q") == 0
    finally:
        (site / "inflow.csv").write_text(DISCHARGE)
    balances = record(site)["balances"]
    wanted = 1000 * (150 * 7.5 + 200 * 20)
    assert balances["mass_start"] <= 1000 * 200 and balances["mass_released"] == pytest.approx(wanted, rel=1e-9)
    assert balances["mass_now"] + balances["mass_out"] == pytest.approx(wanted, rel=1e-9)
    assert abs(balances["mass_error_relative"]) <= 1e-12


def test_slabs_are_complete_and_as_thick_as_the_table(site):
    """On a plane of slope 1/2; thickness normal to it unless it is reported to be vertical."""
    (site / "slabs.csv").write_text("# snow\ntime,thickness\n0,1.5\n4,0\n12,0.75\n29,0.25\n")
    slabs = NO_RELEASE + INFLOW.replace("inflow.csv", "slabs.csv")
    for line, stretched in (("", np.sqrt(1.25)), ('thickness_mode = "vertical"\n', 1.0)):
        assert run(site, slabs + line, "-q") == 0
        wanted = 1000 * 40 * 100 * 2.5 * stretched
        assert record(site)["balances"]["mass_released"] == pytest.approx(wanted, rel=1e-9)
        assert record(site)["events"] == {"batches": 3, "secondary_releases": []}


def test_the_record_reports_what_flows_in_and_what_is_released(site, capsys):
    told = record(site, "whole")
    assert told["events"]["secondary_releases"] == ["near", "far"] and told["events"]["batches"] > 20
    released = 1000 * (2 * 100 * 100 * np.sqrt(1.25) + VOLUME + 2 * 0.5 * 40 * 80)
    assert told["balances"]["mass_released"] == pytest.approx(released, rel=1e-9)
    assert abs(told["balances"]["mass_error_relative"]) <= 1e-12
    effects = {d["effect"]: d for d in told["effects"]}
    inflow, secondary = effects["hydrograph"], effects["secondary"]
    assert (inflow["state"], inflow["decided_by"], inflow["threshold"]) == ("on", "scene", None)
    assert inflow["reason"].startswith(f"{VOLUME:.6g} m3 from 1 to 22 s")
    assert (secondary["state"], secondary["decided_by"]) == ("on", "scene") and "2 areas" in secondary["reason"]
    share = 1000 * 3200 / (released - 1000 * 3200)
    assert secondary["indicator"] == pytest.approx(share, rel=1e-9)
    assert decisions(site, ALL, capsys) == effects
    assert main(["effects", str(site / "all.toml")]) == 0
    shown = capsys.readouterr().out
    assert f"{VOLUME:.6g} m3" in shown and "2 areas, released when the flow gets there" in shown


def test_what_is_off_is_left_out(site, capsys):
    text = SCENE + INFLOW + 'use = "off"\n' + SECONDARY.format("near") + 'use = "off"\n'
    without = decisions(site, text, capsys)
    assert {without[name]["state"] for name in ("hydrograph", "secondary")} == {"off"}
    assert {without[name]["decided_by"] for name in ("hydrograph", "secondary")} == {"forced"}
    forced = decisions(site, SCENE + INFLOW + 'use = "on"\n' + SECONDARY.format("near") + 'use = "on"\n', capsys)
    assert {(forced[name]["state"], forced[name]["decided_by"]) for name in ("hydrograph", "secondary")} == {
        ("on", "forced")
    }
    assert run(site, text, "-q") == 0
    told = record(site)
    assert told["balances"]["mass_released"] == told["balances"]["mass_start"]
    assert told["events"] == {"batches": 0, "secondary_releases": []}


# --------------------------------------------------------------------------------------------------- kill and resume

KILLS = {
    "before the first frame": (signal.SIGKILL, "name", "terrain.tif:1"),
    "before anything came in": (signal.SIGKILL, "columns", 0.5),
    "inflow midway, both areas armed": (signal.SIGKILL, "columns", 4.9),
    "one area released, one armed": (signal.SIGKILL, "columns", 11.0),
    "all released": (signal.SIGKILL, "columns", 27.0),
    "asked to end": (signal.SIGTERM, "columns", 11.0),
    "between a frame and its name": (signal.SIGKILL, "name", "frame_000003.h5:1"),
    "between a frame and what older ones lose": (signal.SIGKILL, "name", "frame_000001.h5:2"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("when", KILLS)
def test_a_run_that_was_killed_continues_to_the_same_bytes(site, tmp_path, when):
    number, what, where = KILLS[when]
    code, err = cut_short(site, tmp_path / "cut", number, what, where)
    cut = record(tmp_path, "cut")
    if number == signal.SIGTERM:
        assert code == 128 + number and "interrupted" in err and cut["state"] == "interrupted"
    else:
        assert code == -number and cut["state"] == "running"
    before = contents(tmp_path / "cut")
    assert (len(before) > 0) == (when != "before the first frame") and len(before) < len(contents(site / "whole"))
    assert resumed(site, tmp_path / "cut") == 0
    assert contents(tmp_path / "cut") == contents(site / "whole")
    again, whole = record(tmp_path, "cut"), record(site, "whole")
    for part in ("state", "reason", "time", "steps", "frames", "digest", "balances", "events", "effects"):
        assert again[part] == whole[part], part
    names = sorted(path.name for path in (site / "whole").iterdir())
    assert sorted(path.name for path in (tmp_path / "cut").iterdir()) == names


def test_the_kills_are_where_their_names_indicate(site):
    """The areas go between the times of the kills: 5 s and 10 s, and 15 s and 25 s."""
    count = {
        k: before
        for (name, what), before in contents(site / "whole").items()
        if what == "particles/id"
        for k in [int(name[6:12])]
    }
    ids = {k: np.frombuffer(raw, np.uint64) for k, raw in count.items()}
    assert len(ids) == 7 and all(len(ids[k]) < len(ids[k + 1]) for k in range(4))
    arrivals = released_at(site)
    assert 4.9 < arrivals[0] <= 10.0 and 11.0 < arrivals[1] <= 25.0


def released_at(site):
    """Times [s] at which the flow first moves in the two areas of the run that was never stopped, to a frame."""
    import h5py

    times = []
    for west, east in ((240, 280), (420, 460)):
        for path in sorted((site / "whole").glob("frame_*.h5")):
            with h5py.File(path) as file:
                x = file["particles/position"][:, 0] + file.attrs["origin"][0] - 400_000.0
                if ((x > west) & (x < east)).sum() > 50:
                    times.append(float(file.attrs["time"]))
                    break
    return times


@pytest.mark.thorough
def test_inputs_that_changed_are_refused_and_notes_in_them_are_not(site, tmp_path, capsys):
    code, _ = cut_short(site, tmp_path / "cut", signal.SIGKILL, "columns", 4.9)
    assert code == -signal.SIGKILL
    (tmp_path / "cut" / ".lock").unlink()  # a kill leaves it, the next run takes it away
    before = {path.name: path.read_bytes() for path in (tmp_path / "cut").iterdir()}
    shutil.copytree(site, tmp_path / "kept", ignore=shutil.ignore_patterns("whole", "results", "cut"))
    changes = {
        "inflow.csv": lambda file: file.write_text(DISCHARGE.replace("300", "301")),
        "inlet.geojson": lambda file: write_shapes(file, [shapely.box(60, 150, 100, 251)]),
        "far.geojson": lambda file: write_shapes(file, [shapely.box(420, 160, 460, 241)]),
        "dtm.tif": higher,
    }
    try:
        for name, change in changes.items():
            change(site / name)
            capsys.readouterr()
            assert resumed(site, tmp_path / "cut") == 2
            line = only_line(capsys)
            assert "another scene" in line and "changed" in line, name
            shutil.copy(tmp_path / "kept" / name, site / name)
        assert {path.name: path.read_bytes() for path in (tmp_path / "cut").iterdir()} == before
        (site / "inflow.csv").write_text("# checked\n" + DISCHARGE)
        (site / "dtm.tif.aux.xml").write_text("<PAMDataset></PAMDataset>")  # as a GIS writes beside what it shows
        assert resumed(site, tmp_path / "cut") == 0
    finally:
        for name in changes:
            shutil.copy(tmp_path / "kept" / name, site / name)
        (site / "dtm.tif.aux.xml").unlink(missing_ok=True)
    assert contents(tmp_path / "cut") == contents(site / "whole")


def higher(file):
    """One cell of a raster a millimetre higher."""
    import rasterio

    with rasterio.open(file, "r+") as raster:
        values = raster.read(1)
        values[3, 70] += 0.001
        raster.write(values, 1)


# ----------------------------------------------------------------------------------------------------- what is refused

TABLES = {
    "empty": ("", "is empty"),
    "a header alone": ("time,discharge\n", "a header and no rows"),
    "no header": ("0,1\n5,2\n", "the first line must name the columns"),
    "no time": ("discharge\n1\n2\n", "time [s] is missing"),
    "nothing that flows": ("time,speed\n0,1\n1,1\n", "got none"),
    "discharge and thickness": ("time,discharge,thickness\n0,1,1\n", "got both"),
    "a name misspelt": ("time,dischage\n0,1\n1,1\n", "did you mean 'discharge'"),
    "a name twice": ("time,time,discharge\n0,0,1\n1,1,1\n", "occurs twice"),
    "a word": ("time,discharge\n0,1\n5,much\n", "line 3: discharge is 'much'"),
    "nan": ("time,discharge\n0,1\n5,nan\n", "line 3: discharge is nan"),
    "infinite": ("time,discharge\n0,inf\n5,1\n", "finite"),
    "outflow": ("time,discharge\n0,1\n5,-1\n", "outflow is not possible"),
    "an ocean": ("time,discharge\n0,1\n5,1e30\n", "expected at most 1e+09 m3 s-1"),
    "before the start": ("time,discharge\n-5,1\n5,1\n", "runs start at 0"),
    "times back": ("time,discharge\n0,1\n5,1\n4,1\n", "line 4: time 4 s is not after 5 s; sort the rows"),
    "a time twice": ("time,discharge\n0,1\n0,2\n", "is not after 0 s; add 0.001 s"),
    "one time of discharge": ("time,discharge\n3,1\n", "expected at least two"),
    "all zero": ("time,discharge\n0,0\n5,0\n", "there is no inflow"),
    "a value missing": ("time,discharge\n0,1\n5\n", "line 3: 1 values for 2 columns"),
    "decimal commas between commas": ("time,discharge\n0,5,1,5\n", "semicolons between the columns"),
    "half a velocity": ("time,discharge,velocity_east\n0,1,1\n1,1,1\n", "require each other"),
    "speed and velocity": ("time,discharge,speed,velocity_east,velocity_north\n0,1,1,1,1\n1,1,1,1,1\n", "exclude"),
    "after the end": ("time,discharge\n50,1\n60,1\n", "nothing flows in before end_time"),
    "slabs after the end": ("time,thickness\n50,1\n", "nothing flows in before end_time"),
}
SCENES = {
    "no such table": (INFLOW.replace("inflow.csv", "nowhere.csv"), "nowhere.csv: no such file"),
    "a picture for a table": (INFLOW.replace("inflow.csv", "dtm.tif"), "is not readable text"),
    "no such inlet": (INFLOW.replace("inlet.geojson", "nowhere.geojson"), "no such file"),
    "file missing": (INFLOW.replace('file = "inflow.csv"\n', ""), "file is missing"),
    "another density": (INFLOW + "density = 1200\n", "one density"),
    "an area on the release": (SECONDARY.format("release").replace("geojson", "geojson"), "overlap by 1e+04 m2"),
    "one area twice": (SECONDARY.format("near") * 2, "overlap by"),
    "no trigger": (SECONDARY.format("near") + "trigger_thickness = 0\n", "above 0"),
    "key misspelt": (INFLOW.replace("file =", "flie ="), "did you mean 'file'"),
    "one table for several": ("[secondary_release]\n", "write [[secondary_release]]"),
}


@pytest.mark.parametrize("name", [*TABLES, *SCENES, "not text", "nothing at all"])
def test_errors_are_one_line_and_leave_no_files(name, tmp_path, site, capsys):
    folder = tmp_path / "site"
    shutil.copytree(site, folder, ignore=shutil.ignore_patterns("whole", "results"))
    text, words = SCENES.get(name, (INFLOW, TABLES.get(name, ("", "is not readable text"))[1]))
    if name == "nothing at all":
        text, words = None, "[release] is missing"
    (folder / "inflow.csv").write_bytes(
        b"\xff\xfe\x00\xd8\x01" if name == "not text" else TABLES.get(name, (DISCHARGE,))[0].encode()
    )
    (folder / "scene.toml").write_text(NO_RELEASE if text is None else SCENE + text)
    before = sorted(folder.rglob("*"))
    capsys.readouterr()
    assert main(["run", str(folder / "scene.toml"), "-q"]) == 2
    line = only_line(capsys)
    assert words in line and "Traceback" not in line
    assert sorted(folder.rglob("*")) == before


def test_json_holds_the_times_of_the_inflow(site):
    facts = json.loads((site / "whole" / "run.json").read_text())["terrain_facts"]
    assert facts["inflow"][0] == pytest.approx(VOLUME, rel=1e-9) and facts["inflow"][1:3] == [1.0, 22.0]
