"""The map of an export around its flow: ground on every side, layers of height, and what the first view shows."""

import json
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
from exporting import AFFINES, sheet_frames, terrain, write_frames, write_run
from test_export_folder import export

from mpmgis.maps.export import step_rasters


def project_of(folder):
    with zipfile.ZipFile(folder / f"{folder.name.removesuffix('_gis')}.qgz") as archive:
        return ElementTree.fromstring(archive.read(f"{folder.name.removesuffix('_gis')}.qgs"))


def read(path):
    with rasterio.open(path) as source:
        return source.read(1, masked=True).filled(np.nan), source.transform, source.bounds


@pytest.mark.parametrize("affine", AFFINES)
def test_the_terrain_of_the_map_keeps_its_cells_and_covers_the_dtm(tmp_path, affine):
    """The rasters of the flow are cropped to it; the hillshade is not, also where the DTM is rotated."""
    ground = terrain(AFFINES[affine], holes=[(2, 3)])
    folder, _ = export(write_run(tmp_path / "slide", dimension=2, ground=ground), cell_size=2.0, qgis=True)
    around, transform, _ = read(folder / "dtm_around.tif")
    assert transform == ground.grid.transform
    np.testing.assert_allclose(around, ground.elevation.astype(np.float32), atol=1e-3)
    sources = [layer.findtext("datasource") for layer in project_of(folder).iter("maplayer")]
    assert sources.count("./dtm_around.tif") == 2 and "./dtm.tif" not in sources
    assert (folder / "dtm_around.qml").is_file()


def test_an_export_on_the_cells_of_the_dtm_has_no_second_terrain(tmp_path):
    folder, _ = export(write_run(tmp_path / "slide", dimension=2), qgis=True, extent="dtm")
    assert not (folder / "dtm_around.tif").exists()


def test_the_map_of_a_large_dtm_shows_one_length_of_the_flow_on_every_side(tmp_path, monkeypatch):
    monkeypatch.setattr(step_rasters, "MOST_AROUND", 100)
    ground = terrain(shape=(200, 220))
    frames = write_frames(tmp_path / "wide", ground, sheet_frames(20.0, [0.0, 1.0]))
    folder, _ = export(frames, cell_size=2.0)
    assert not (folder / "dtm_around.tif").exists()  # without QGIS files
    folder, _ = export(frames, cell_size=2.0, qgis=True)
    with rasterio.open(folder / "rasters" / "wide_max.tif") as source:
        row, column = np.nonzero(source.read(1) > 0)
        x, y = source.transform * (column + 0.5, row + 0.5)
    length = np.hypot(np.ptp(x), np.ptp(y))
    _, _, bounds = read(folder / "dtm_around.tif")
    west, south, east, north = ground.grid.bounds
    wanted = x.min() - length, y.min() - length, x.max() + length, y.max() + length
    clipped = max(wanted[0], west), max(wanted[1], south), min(wanted[2], east), min(wanted[3], north)
    assert np.allclose(bounds, clipped, atol=2 * ground.grid.cell_size) and bounds != ground.grid.bounds


def test_the_first_view_shows_where_the_flow_starts_and_goes(tmp_path):
    folder, _ = export(write_run(tmp_path / "slide", dimension=2), cell_size=2.0, qgis=True)
    tree = project_of(folder).find("layer-tree-group")
    (group,) = (node for node in tree.iter("layer-tree-group") if node.get("name") == "release and envelope")
    shown = {layer.get("name"): layer.get("checked") for layer in group.iter("layer-tree-layer")}
    assert shown == {"envelope of all steps": "Qt::Checked", "release area": "Qt::Checked"}


def test_layers_of_height_are_styled_and_in_the_project_and_in_the_catalogue(tmp_path):
    folder, _ = export(
        write_run(tmp_path / "slide", dimension=3), cell_size=5.0, qgis=True, stac=True, layers=(0.0, 0.5, 2.0)
    )
    rasters = sorted((folder / "layers").glob("*.tif"))
    assert len(rasters) == 3 and all(path.with_suffix(".qml").is_file() for path in rasters)
    text = rasters[0].with_suffix(".qml").read_text()
    assert 'band="2"' in text and "singlebandpseudocolor" in text
    names = ("rho_0_0.5", "p_0_0.5", "rho_0.5_2", "p_0.5_2", "mass_outside")
    sources = [layer.findtext("datasource") for layer in project_of(folder).iter("maplayer")]
    for number, name in enumerate(names, 1):
        assert f"./slide_{name}.vrt" in sources
        with rasterio.open(folder / f"slide_{name}.vrt") as stack, rasterio.open(rasters[2]) as layer:
            assert np.array_equal(stack.read(3), layer.read(number))
    assets = json.loads((folder / "slide.stac.json").read_text())["assets"]
    assert [asset["href"] for key, asset in assets.items() if key.startswith("layers_")] == [
        f"./layers/{path.name}" for path in rasters
    ]
    assert [band["name"] for band in assets["layers_0001"]["bands"]] == list(names)
    assert assets["terrain_around"]["href"] == "./dtm_around.tif"
