"""Cells that need more memory than there is: refused by name before a grid or particles are made."""

import re

import pytest
import shapely
from slope_site import slide, write_block_site, write_shapes

from mpmgis.commands.shell.main import main
from mpmgis.simulation import required_memory
from mpmgis.solvers.columns.node_grid import ColumnGrid

MATERIAL = re.compile(r"\[material\][^\[]*")
STAGES = '[[stage]]\nsolver = "columns"\nuntil = {{time = 1}}\n[[stage]]\nsolver = "points"\n{}'
COLUMNS = {"head": "", "more": "particles_per_cell = 16"}


@pytest.fixture
def site(tmp_path):
    folder = write_block_site(tmp_path)
    write_shapes(folder / "box.geojson", [shapely.box(118, 198, 122, 202)])
    return folder


def finest_grids(monkeypatch):
    """Cell sizes of all grids that are made."""
    made, on = [], ColumnGrid.on.__func__
    monkeypatch.setattr(ColumnGrid, "on", classmethod(lambda cls, *given: made.append(given[1]) or on(cls, *given)))
    return made


@pytest.mark.parametrize(
    ("cell_size", "more", "words"),
    [
        (0.1, {}, "cell_size = 0.1 m makes 4000 x 2000 cells on the terrain"),
        (0.13, {}, "cell_size = 0.13 m makes 7.82e+07 points"),
        (0.13, COLUMNS, "cell_size = 0.13 m and particles_per_cell = 16 make 1.51e+06 columns"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_key_before_it_is_made(site, capsys, monkeypatch, cell_size, more, words):
    made = finest_grids(monkeypatch)
    monkeypatch.setattr("mpmgis.system.memory.available_memory", lambda: 1.0e9 if "columns" not in words else 7.0e8)
    scene = slide(cell_size, 1, 1, **more)
    (site / "scene.toml").write_text(MATERIAL.sub("", scene) if more else scene)
    assert main(["run", str(site / "scene.toml"), "-q"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "[numerics] " + words in line and "GB are free" in line and "take larger cells" in line
    assert all(size > 0.5 for size in made)
    assert not (site / "results").exists()


def test_a_window_that_leaves_few_points_is_not_refused(site, monkeypatch):
    """What becomes points in it is not estimated; the grid of small cells is made."""
    monkeypatch.setattr(required_memory, "FEW_NODES", 100)
    monkeypatch.setattr("mpmgis.system.memory.available_memory", lambda: 6.0e6)
    scene = slide(2.0, 2, 1, head="", more="particles_per_cell = 4")
    for window, code in (("", 2), ('window = "box.geojson"\n', 0)):
        (site / "scene.toml").write_text(scene + STAGES.format(window))
        assert main(["effects", str(site / "scene.toml"), "-q"]) == code
