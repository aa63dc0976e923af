"""The shipped cases of `make study`: each is written as files; the cheapest one runs up to its row of the table."""

import pytest
import study as shipped

from mpmgis.scene import read_scene

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize("name", shipped.CASES)
def test_each_case_is_a_scene_with_its_files(name, tmp_path):
    shipped.CASES[name].write(tmp_path)
    scene = read_scene(tmp_path / "scene.toml")
    assert scene.path(scene.terrain.dem).exists() and scene.path(scene.release.source).exists()
    assert (tmp_path / "exact.tif").exists() == (shipped.CASES[name].finer is None)


def test_the_dam_is_studied_to_its_row(tmp_path):
    words, settings, error, *_, order, _, _ = shipped.studied("dam", tmp_path, 1)
    assert words == "water from a dam onto dry ground" and settings == "1 m, 9 a cell, cfl 0.6"
    assert 0.5 < float(error.removesuffix(" %")) < 1.5 and 1.0 < float(order) < 2.2
    assert (tmp_path / "dam" / "study" / "study.png").exists()
