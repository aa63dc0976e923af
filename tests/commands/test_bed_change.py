"""Eroded depth in frames and as rasters of an export."""

import json
import shutil
import zipfile

import h5py
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from slope_site import SCENE, record, run, write_shapes, write_site

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_bed_change
from mpmgis.system.errors import FormatError

BED_DENSITY = 1500.0
EROSION = (
    '[entrainment]\nlaw = "ErosionSpeed"\ncoefficient = 0.005\nsource = "loose.gpkg"\nthickness = "depth"\n'
    f"density = {BED_DENSITY:g}\nlower_bed = true\n"
)


@pytest.fixture(scope="module")
def eroded(tmp_path_factory):
    """A run with erosion: its site."""
    site = tmp_path_factory.mktemp("erosion")
    write_site(site)
    write_shapes(site / "loose.gpkg", [shapely.box(150, 0, 400, 400)], depth=[0.5])
    assert run(site, SCENE + EROSION) == 0
    return site


def mass_of(change):
    """Eroded mass [kg] by depth x area x density."""
    depth = change["eroded_mass"] / change["bed_density"]
    return float((depth * change["transform"][0] ** 2 * change["bed_density"]).sum())


def test_eroded_depth_is_the_entrained_mass(eroded):
    frames = sorted((eroded / "results").glob("frame_*.h5"))
    masses = [mass_of(read_bed_change(frame)) for frame in frames]
    entrained = record(eroded)["balances"]["mass_entrained"]
    assert entrained > 0 and masses[0] == 0.0
    assert masses[-1] == pytest.approx(entrained, rel=1e-9)
    assert np.all(np.diff(masses) >= 0)
    last = read_bed_change(frames[-1])
    assert last["bed_density"] == BED_DENSITY
    assert last["eroded_mass"].max() <= 0.5 * BED_DENSITY * np.sqrt(1 + 1.0) and last["eroded_mass"].min() >= 0


def test_without_erosion_nothing_is_added(tmp_path):
    write_site(tmp_path)
    assert run(tmp_path, SCENE) == 0
    for frame in (tmp_path / "results").glob("frame_*.h5"):
        with h5py.File(frame) as file:
            assert "bed_change" not in file
    assert main(["export-raster", str(tmp_path / "results"), "--no-qgis"]) == 0
    assert not list((tmp_path / "results_gis").rglob("*bed*"))


def test_a_changed_array_is_noticed(eroded, tmp_path):
    source = max((eroded / "results").glob("frame_*.h5"))
    copy = tmp_path / source.name
    copy.write_bytes(source.read_bytes())
    with h5py.File(copy, "r+") as file:
        file["bed_change/eroded_mass"][0, 0] = -1.0
    with pytest.raises(FormatError, match="eroded_mass"):
        read_bed_change(copy)


@pytest.mark.parametrize("cell", [None, "7"])
def test_the_export_has_what_the_bed_lost_and_got(eroded, tmp_path, cell):
    output = tmp_path / "maps"
    words = ["export-raster", str(eroded / "results"), "-o", str(output)]
    assert main(words + (["--cs-e", cell] if cell else [])) == 0
    bands = {}
    for word in ("surface", "bed"):
        with rasterio.open(output / "rasters" / f"results_{word}.tif") as file:
            bands |= dict(zip([text.split(" ")[0] for text in file.descriptions], file.read(masked=True), strict=True))
            area, tags = abs(file.transform.a * file.transform.e), file.tags(ns="mpmgis")
    assert set(bands) == {"eroded", "erosion_rate_max", "thickness_end", "bed_new", "surface_new"}  # it still moves
    lost = float(bands["eroded"].sum()) * area * BED_DENSITY
    assert lost == pytest.approx(record(eroded)["balances"]["mass_entrained"], rel=1e-5)  # float32
    assert float(tags["bed_density"]) == BED_DENSITY
    assert (bands["erosion_rate_max"] >= 0).all() and bands["erosion_rate_max"].max() > 0
    kept = float(bands["thickness_end"].sum()) * area * 1000.0
    assert kept == pytest.approx(record(eroded)["balances"]["mass_now"], rel=1e-3)
    with rasterio.open(output / "dtm.tif") as file:
        bed = file.read(1, masked=True)
    np.testing.assert_allclose(bands["bed_new"], bed - bands["eroded"], atol=1e-3)
    np.testing.assert_allclose(bands["surface_new"], bands["bed_new"] + bands["thickness_end"], atol=1e-3)
    assert (output / "rasters" / "results_bed.qml").exists() and (output / "rasters" / "results_surface.qml").exists()
    with zipfile.ZipFile(output / "results.qgz") as project:
        text = project.read("results.qgs").decode()
    assert "results_bed.tif" in text and "results_surface.tif" in text and "eroded depth (vertical)" in text


@pytest.mark.parametrize("cell", [None, "6.3", "40"])
def test_an_export_on_a_rotated_dtm_has_the_entrained_mass(eroded, tmp_path, cell):
    turn = Affine.translation(400_400, 5_100_200) * Affine.rotation(20) * Affine.translation(-600, 500)
    profile = {"driver": "GTiff", "height": 100, "width": 120, "count": 1, "dtype": "float64", "crs": "EPSG:32632"}
    with rasterio.open(tmp_path / "turned.tif", "w", transform=turn * Affine.scale(10, -10), **profile) as target:
        target.write(np.add.outer(np.zeros(100), np.linspace(300.0, 100.0, 120)), 1)
    words = ["export-raster", str(eroded / "results"), "-o", str(tmp_path / "maps"), "--no-qgis"]
    words += ["--dem", str(tmp_path / "turned.tif")] + (["--cs-e", cell] if cell else [])
    assert main(words) == 0
    with rasterio.open(tmp_path / "maps" / "rasters" / "results_bed.tif") as file:
        lost = float(file.read(1).astype(float).sum()) * abs(file.transform.determinant) * BED_DENSITY
        assert file.transform.b != 0
    assert lost == pytest.approx(record(eroded)["balances"]["mass_entrained"], rel=1e-6)


def test_a_resumed_run_has_the_same_bed(eroded, tmp_path):
    """The last frame is taken away and computed again from the one before it."""
    site = tmp_path / "site"
    shutil.copytree(eroded, site)
    last = max((site / "results").glob("frame_*.h5"))
    before = read_bed_change(last)["eroded_mass"]
    last.unlink()
    told = json.loads((site / "results" / "run.json").read_text())
    (site / "results" / "run.json").write_text(
        json.dumps(told | {"state": "interrupted", "frames": told["frames"] - 1})
    )
    assert main(["run", str(site / "scene.toml"), "--resume"]) == 0
    assert np.array_equal(read_bed_change(last)["eroded_mass"], before)


def test_mass_beyond_the_edge_of_the_dtm_is_reported(tmp_path, capsys):
    """The flow erodes where it leaves: half of the squares of the outermost nodes is not in the rasters."""
    write_site(tmp_path)
    write_shapes(tmp_path / "release.geojson", [shapely.box(650, 150, 750, 250)])
    write_shapes(tmp_path / "loose.gpkg", [shapely.box(-50, -50, 900, 500)], depth=[0.5])
    scene = SCENE.replace("thickness = 2.0", "thickness = 2.0\nvelocity = [20, 0]").replace("= 30", "= 8")
    assert run(tmp_path, scene + EROSION) == 0
    entrained = record(tmp_path)["balances"]["mass_entrained"]
    for cell, beyond in ((None, False), ("7", True)):  # cells of 7 m reach beyond the edge
        capsys.readouterr()
        words = ["export-raster", str(tmp_path / "results"), "-o", str(tmp_path / "maps"), "--overwrite", "--no-qgis"]
        assert main([*words, *(["--cs-e", cell] if cell else [])]) == 0
        with rasterio.open(tmp_path / "maps" / "rasters" / "results_bed.tif") as file:
            lost = float(file.read(1).astype(float).sum()) * abs(file.transform.a * file.transform.e) * BED_DENSITY
        said = capsys.readouterr().err
        if beyond:
            assert lost == pytest.approx(entrained, rel=1e-5) and "eroded mass is not" not in said
        else:
            assert f"{100 * (1 - lost / entrained):.2g} % of the eroded mass is not in the rasters" in said
