"""`export-raster --animation`, `--kml` and `--stac`: written with the folder, refused before any work."""

import json

import pytest
from block_frames import write_block_run

from mpmgis.commands.shell.main import main

PLACES = (150.0, 450.0, 600.0)


@pytest.fixture
def run(tmp_path):
    return write_block_run(tmp_path, PLACES, speeds=(0.0, 10.0, 0.0))


def test_all_of_them(tmp_path, run, capsys):
    pytest.importorskip("imageio_ffmpeg", reason="no imageio-ffmpeg (pip install mpmgis[animation])")
    film = tmp_path / "flow.mp4"
    words = ["--no-qgis", "--kml", "--stac", "--animation", str(film), "--list-files"]
    assert main(["export-raster", str(run), *words]) == 0
    told = capsys.readouterr().out.splitlines()
    folder = tmp_path / "run_gis"
    assert {str(folder / "run.kmz"), str(folder / "run.stac.json"), str(film)} <= set(told)
    assert film.read_bytes()[4:8] == b"ftyp"
    item = json.loads((folder / "run.stac.json").read_text())
    assert all((folder / asset["href"]).exists() for asset in item["assets"].values()) and "kmz" in item["assets"]


def test_a_film_is_not_replaced_unasked(tmp_path, run, capsys):
    pytest.importorskip("imageio_ffmpeg", reason="no imageio-ffmpeg (pip install mpmgis[animation])")
    (tmp_path / "flow.gif").write_text("mine")
    assert main(["export-raster", str(run), "--no-qgis", "--animation", str(tmp_path / "flow.gif")]) == 2
    assert "exists already" in capsys.readouterr().err and not (tmp_path / "run_gis").exists()
    assert (tmp_path / "flow.gif").read_text() == "mine"


def test_a_film_in_the_folder_of_the_export_is_refused(tmp_path, run, capsys):
    pytest.importorskip("imageio_ffmpeg", reason="no imageio-ffmpeg (pip install mpmgis[animation])")
    film = tmp_path / "run_gis" / "flow.mp4"
    assert main(["export-raster", str(run), "--no-qgis", "--animation", str(film)]) == 2
    assert "which is replaced; give another folder" in capsys.readouterr().err and not film.parent.exists()


def test_a_missing_encoder_is_named_with_its_extra(tmp_path, run, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    assert main(["export-raster", str(run), "--no-qgis", "--animation", str(tmp_path / "flow.mp4")]) == 2
    assert 'pip install "mpmgis[animation]"' in capsys.readouterr().err and not (tmp_path / "run_gis").exists()
