"""H9: a DTM without heights under the release is refused with a fix that works; a scene has no key `fill`."""

import numpy as np
import pytest
import rasterio
from rasterio.fill import fillnodata
from slope_site import SCENE, refused, run, write_site

SHORT = SCENE.replace("end_time = 30", "end_time = 1").replace("frame_interval = 5", "frame_interval = 1")


def holed(folder, value):
    """The slope with a hole of 2 x 3 pixels under its release."""
    site = write_site(folder)
    with rasterio.open(site / "dtm.tif", "r+") as file:
        heights = file.read(1)
        heights[19:21, 8:11] = value
        file.write(heights, 1)
    return site


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -9999.0])
def test_no_heights_under_the_release_are_refused_and_the_fix_works(value, tmp_path, capsys):
    site = holed(tmp_path, value)
    line = refused(site, capsys, SHORT)
    assert "no elevation under release" in line and "(19, 8), (19, 9), (19, 10) and 3 more" in line
    assert "fill the DTM (QGIS: Raster, Analysis, Fill nodata) or clip the release" in line
    with rasterio.open(site / "dtm.tif", "r+") as file:
        heights = file.read(1)
        known = np.isfinite(heights) & (heights != -9999.0)
        file.write(fillnodata(np.where(known, heights, 0.0), mask=known), 1)
    assert run(site, SHORT, "-q") == 0


def test_a_fill_is_no_key_of_a_scene(tmp_path, capsys):
    """The design allowed a named method to fill gaps; the program has none: it does not invent heights."""
    line = refused(holed(tmp_path, np.nan), capsys, SHORT.replace("[terrain]", '[terrain]\nfill = "idw"'))
    assert "fill" in line and "no elevation" not in line
