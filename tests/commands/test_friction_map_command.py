"""`mpmgis friction-map`: classes, rasters and lines of a scene from a table; a run that reads them."""

import tomllib
from typing import get_args

import numpy as np
import pytest
import rasterio
from affine import Affine
from slope_site import SCENE, contents, record, run, write_site

import mpmgis
from mpmgis.commands.friction_map import EventOptions
from mpmgis.commands.shell.main import main
from mpmgis.laws.friction import LAWS
from mpmgis.simulation import terrain_friction
from mpmgis.system.option import options_of
from mpmgis.terrain import dtm
from mpmgis.terrain.terrain_classes import FLAT, OPEN_SLOPE

TABLE = """terrain,return_period,volume_to,mu,xi
flat,,,0.3,1500
open,300,,0.2,1500
open,30,60000,0.25,1500
gully,,,0.3,1500
channel,,,0.3,1500
"""
LIMITS = ("--channel-radius", "30", "--channel-rise", "0.5", "--gully-rise", "0.5")  # the foot is no channel


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A slope of 27 degrees that runs out on level ground, and a table."""
    monkeypatch.chdir(write_site(tmp_path))
    (tmp_path / "friction.csv").write_text(TABLE)
    return tmp_path


def friction(*words):
    return main(["friction-map", "--dem", "dtm.tif", "--table", "friction.csv", *LIMITS, *words])


def with_friction(lines):
    """The scene with the friction of these lines."""
    return SCENE.replace('[friction]\nlaw = "Voellmy"\nmu = 0.2\nxi = 1000\n', "") + lines


def test_rasters_and_lines_of_a_scene_that_a_run_reads(site, capsys):
    assert friction("--return-period", "300", "-o", "by_class") == 0
    shown = capsys.readouterr().out
    assert "0.2 to 0.3 [1]" in shown and "1500 [m s-2]" in shown
    with rasterio.open("by_class/terrain_class.tif") as source:
        classes = source.read(1)
        assert source.dtypes == ("uint8",) and source.tags(ns="mpmgis")["law"] == "Voellmy"
        assert source.colormap(1)[FLAT][3] == 255
    assert set(np.unique(classes)) == {OPEN_SLOPE, FLAT}
    with rasterio.open("by_class/mu.tif") as source:
        mu = source.read(1)
        assert source.dtypes == ("float32",) and source.tags(ns="mpmgis")["return_period"] == "300"
        assert source.descriptions == ("mu [1]",)
    assert np.array_equal(mu, np.where(classes == FLAT, np.float32(0.3), np.float32(0.2)))
    assert "paletteEntry" in (site / "by_class" / "terrain_class.qml").read_text()
    lines = (site / "by_class" / "friction.toml").read_text()
    expected = {"friction": {"law": "Voellmy", "xi": 1500.0}, "zones": [{"mu": "by_class/mu.tif"}]}
    assert tomllib.loads(lines) == expected
    assert run(site, with_friction(lines)) == 0
    assert {d["effect"]: d["state"] for d in record(site)["effects"]}["zones"] == "on"


def test_a_constant_table_gives_the_constant_run_bit_for_bit(site):
    (site / "friction.csv").write_text(
        "terrain,mu,xi\nflat,0.2,1000\nopen,0.2,1000\nchannel,0.2,1000\ngully,0.2,1000\n"
    )
    assert friction() == 0
    folder = site / "dtm_friction"
    assert sorted(path.name for path in folder.iterdir() if path.name[0] != ".") == [
        "friction.toml",
        "terrain_class.qml",
        "terrain_class.tif",
    ]
    assert run(site, with_friction((folder / "friction.toml").read_text())) == 0
    (site / "results").rename(site / "of_table")
    assert run(site, SCENE) == 0
    assert contents(site / "of_table") == contents(site / "results")


def test_python_writes_the_same(site):
    found = mpmgis.friction_map(
        "dtm.tif", "friction.csv", "own", return_period=30, volume=1000.0, channel_rise=0.5, gully_rise=0.5
    )
    assert found.parameters == {"mu": (0.25, pytest.approx(0.3)), "xi": (1500.0, 1500.0)}
    assert sum(found.areas.values()) == pytest.approx(80 * 40 * 100.0)
    assert found.files[0].name == "friction.toml" and all(file.exists() for file in found.files)


@pytest.fixture
def rough(site):
    """A rotated DTM of several tiles with holes, and a table with a parameter that is the same on all of its cells."""
    shape = 270, 530
    rng = np.random.default_rng(3)
    heights = rng.normal(size=shape).cumsum(0).cumsum(1) * 0.1 + 1000.0
    heights[rng.random(shape) < 0.001] = np.nan
    heights[100:160, 200:320] = np.nan
    place = Affine(4.0, 3.0, 6e5, 3.0, -4.0, 5.2e6)
    with rasterio.open(
        "rough.tif", "w", "GTiff", 530, 270, 1, "EPSG:32632", place, "float32", -1, tiled=True, blockxsize=128
    ) as target:
        target.write(np.where(np.isnan(heights), -1, heights).astype("float32"), 1)
    (site / "rough.csv").write_text(
        "terrain,altitude_from,altitude_to,mu,xi\nflat,,9000,0.2,900\nopen,,9000,0.25,900\nchannel,,9000,0.3,900\n"
        "gully,,9000,0.4,900\n,9000,,1,100\n"
    )
    return site


@pytest.mark.parametrize("side", [61, 256, 400])
def test_blocks_of_any_size_write_the_same_bytes(rough, monkeypatch, capsys, side):
    words = ["friction-map", "--dem", "rough.tif", "--table", "rough.csv", "-o"]
    assert main([*words, "whole"]) == 0
    assert sorted(path.name for path in (rough / "whole").iterdir() if path.name[0] != ".") == [
        "friction.toml",
        "mu.tif",
        "terrain_class.qml",
        "terrain_class.tif",
    ]
    monkeypatch.setattr(dtm, "READ_WHOLE", 100)
    monkeypatch.setattr(terrain_friction, "SIDE", side)
    assert main([*words, "blocks"]) == 0
    assert "270 x 530 cells; it is read by block" in capsys.readouterr().err
    for name in ("mu.tif", "terrain_class.tif", "terrain_class.qml"):
        assert (rough / "whole" / name).read_bytes() == (rough / "blocks" / name).read_bytes(), name


def test_holes_of_a_large_dtm_are_filled_whole(rough, monkeypatch, capsys):
    monkeypatch.setattr(dtm, "READ_WHOLE", 100)
    words = ["friction-map", "--dem", "rough.tif", "--table", "rough.csv", "--fill-nodata", "interpolate"]
    assert main([*words, "-o", "filled"]) == 0
    assert "read at once to fill its holes; without --fill-nodata it is read by block" in capsys.readouterr().err
    with rasterio.open("filled/terrain_class.tif") as source:
        assert source.read(1)[101:159, 201:319].all()


def test_a_dtm_read_by_block_without_any_elevation_is_refused(rough, monkeypatch, capsys):
    with rasterio.open("rough.tif", "r+") as target:
        target.write(np.full((270, 530), -1, "float32"), 1)
    monkeypatch.setattr(dtm, "READ_WHOLE", 100)
    assert main(["friction-map", "--dem", "rough.tif", "--table", "rough.csv", "-o", "empty"]) == 2
    assert "rough.tif: every cell is nodata" in capsys.readouterr().err
    assert not (rough / "empty").exists()


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ((), "return periods of 30, 300 years; choose one (--return-period)"),
        (("--return-period", "100"), "no return period of 100 years"),
        (("--return-period", "30"), "depends on the volume of the release; give it (--volume)"),
        (("--return-period", "30", "--volume", "60000"), "no row for open terrain"),
        (("--law", "Coulomb"), "column 'xi' is neither"),
        (("--return-period", "300", "--gully-radius", "5"), "radius of 5 m"),
        (("--return-period", "300", "--volume", "1", "-o", "mu.tif"), "give a folder"),
        (("--return-period", "300", "-o", "."), ". exists already"),
    ],
)
def test_bad_input_has_one_line_and_writes_nothing(site, capsys, words, part):
    before = sorted(site.iterdir())
    assert friction(*words) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mpmgis")]
    assert part in line
    assert sorted(site.iterdir()) == before


def test_the_command_knows_every_law():
    assert get_args(options_of(EventOptions)["law"].type) == tuple(LAWS)
