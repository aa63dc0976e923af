"""`mpmgis info`: one screen for people, one JSON object a line for programs."""

import json

import numpy as np
import pytest

from mpmgis.cli.info import screen
from mpmgis.cli.main import main
from mpmgis.io.frames import write_frame
from mpmgis.io.sample import sample_folder
from mpmgis.particles import Frame, Particles


@pytest.fixture
def seed(tmp_path):
    particles = Particles(
        position=np.zeros((12345, 3)),
        velocity=np.full((12345, 3), 2.0),
        mass=np.full(12345, 10.0),
        volume=np.full(12345, 0.01),
        thickness=np.ones(12345),
        area=np.full(12345, 0.01),
    )
    write_frame(tmp_path / "seed.h5", Frame(particles, header={"density": 1000.0}))
    return tmp_path / "seed.h5"


def test_a_screen_for_people(seed, capsys):
    assert main(["info", str(seed)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0].startswith(f"{seed}: particles (")
    said = dict(line.strip().split("  ", 1) for line in lines[1:] if "  " in line.strip())
    assert said["particles"].strip() == "12 345"
    assert said["mass"].strip() == "123450.0 kg"
    assert said["CRS"].strip() == "none"
    assert said["max speed"].strip() == "3.4641 m s-1"


def test_one_object_a_line_for_programs(seed, capsys):
    assert main(["info", "--json", str(seed), str(sample_folder() / "scene.toml")]) == 0
    objects = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [facts["kind"] for facts in objects] == ["particles", "scene"]
    assert set(objects[0]) >= {"reader", "time", "n", "mass", "bbox", "crs"}
    assert objects[0]["n"] == 12345


@pytest.mark.parametrize("files", ["lava_falls_dem_utm12n_10m.tif", "lava_falls_release.shp", "scene.toml", ""])
def test_one_screen_is_one_screen(files, seed, capsys):
    assert main(["info", str(sample_folder() / files) if files else str(seed)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 3 < len(lines) <= 50
    assert max(map(len, lines)) < 160
    assert not any("{" in line or "[" in line or "'" in line for line in lines)


def test_a_bad_file_costs_one_line_and_the_others_are_told(seed, tmp_path, capsys):
    (tmp_path / "junk.h5").write_text("junk")
    assert main(["info", str(tmp_path / "none.tif"), str(seed), str(tmp_path / "junk.h5")]) == 2
    out, err = capsys.readouterr()
    assert out.startswith(str(seed))
    assert [line.split(":")[0] for line in err.splitlines()] == ["mpmgis info"] * 2


def test_no_file_is_bad_input(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["info"])
    assert stop.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_long_lists_are_cut_and_counted():
    facts = {
        "file": "a.gpkg",
        "kind": "vector",
        "layers": [{"name": f"layer{k}"} for k in range(40)],
        "tags": {f"key{k}": k for k in range(100)},
        "columns": [f"column{k}" for k in range(100)],
    }
    lines = screen(facts)
    assert len(lines) < 50
    assert any("... and 28 more" in line for line in lines)
    assert any("and 76 more" in line for line in lines)
    assert any("(100 in all)" in line or line.endswith("...") for line in lines)
