"""`mpmgis effects --measure`: the share of a step that goes into each effect, on the screen and as JSON."""

import json

import pytest
from slope_site import SCENE, write_site

from mpmgis.commands.shell.main import main


@pytest.mark.thorough
def test_the_command_measures_a_scene(tmp_path, capsys):
    site = write_site(tmp_path)
    text = SCENE.replace('"Voellmy"', '"Coulomb"').replace("xi = 1000\n", "")
    (site / "scene.toml").write_text(text + '[curvature]\nuse = "off"\n')
    assert main(["effects", str(site / "scene.toml"), "--measure", "--json"]) == 0
    out, err = capsys.readouterr()
    told = {d["effect"]: d for d in json.loads(out)}
    assert [name for name, d in told.items() if d["cost_share"] is not None] == ["friction"]
    assert -0.5 < told["friction"]["cost_share"] < 1.0
    assert all(d["cost_noise"] == told["friction"]["cost_noise"] >= 0.0 for d in told.values())
    assert "noise" in err
    assert sorted(path.name for path in site.iterdir()) == ["dtm.tif", "release.geojson", "scene.toml"]
    assert main(["effects", str(site / "scene.toml"), "-q"]) == 0
    assert " cost " not in capsys.readouterr().out
    assert main(["effects", "--measure"]) == 2
    assert "requires a scene" in capsys.readouterr().err
