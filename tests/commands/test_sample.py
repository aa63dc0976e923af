"""The shipped site: there, complete, as its README says, and with its credit."""

import geopandas
import numpy as np
import pytest
import rasterio

from mpmgis.commands.demo_site import sample_folder
from mpmgis.system.errors import InputError

CREDIT = "United States 3DEP (formerly NED) terrain data courtesy of the U.S. Geological Survey"


def test_terrain_agrees_with_its_readme():
    with rasterio.open(sample_folder() / "lava_falls_dem_utm12n_10m.tif") as dataset:
        elevation = dataset.read(1, masked=True)
        assert dataset.shape == (280, 260)
        assert dataset.res == (10.0, 10.0)
        assert dataset.crs.to_epsg() == 32612
        assert dataset.tags()["ATTRIBUTION"] == CREDIT
    assert elevation.count() == elevation.size
    assert np.round([elevation.min(), elevation.max()]).tolist() == [501.0, 1551.0]


@pytest.mark.parametrize(("name", "area", "thickness"), [("", 20970.0, 5.0), ("_small", 6525.0, 1.5)])
def test_releases_agree_with_their_readme(name, area, thickness):
    release = geopandas.read_file(sample_folder() / f"lava_falls_release{name}.shp")
    assert release.crs.to_epsg() == 32612
    assert release.area.tolist() == pytest.approx([area])
    assert release["thickness"].tolist() == [thickness]


def test_readme_carries_the_credit_and_the_limits():
    text = (sample_folder() / "README.md").read_text(encoding="utf-8")
    for words in (CREDIT, "Public domain", "62 m", "hypothetical"):
        assert words in text


def test_the_data_are_small():
    assert sum(path.stat().st_size for path in sample_folder().iterdir()) < 200_000


def test_a_site_that_is_not_there_is_one_line():
    with pytest.raises(InputError, match="'matterhorn' is not in") as caught:
        sample_folder("matterhorn")
    assert "\n" not in str(caught.value)
