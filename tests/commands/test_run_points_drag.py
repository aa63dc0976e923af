"""`mpmgis run` in 3D with Voellmy's law on the bed, with zones: the same [friction] table as for columns."""

import numpy as np
import pytest
import shapely
from slope_site import decisions, run, slide, write_block_site, write_shapes

from mpmgis.frames.frame_files import read_frame

SCENE = slide(4.0, 4, 4, friction='law = "Voellmy"\nmu = 0.2\nxi = 2000')
ZONES = '[[zones]]\nsource = "rough.geojson"\nxi = 50\n'


def speed(site):
    """Mean speed [m s-1] in the last frame."""
    last = read_frame(sorted((site / "results").glob("frame_*.h5"))[-1]).particles
    return float(np.linalg.norm(last.velocity.mean(axis=0)))


@pytest.mark.slow
def test_drag_in_zones_slows_a_slide_in_3d(tmp_path, capsys):
    """Smooth ground, then the same with a rough zone under the release: xi 50 in place of 2000."""
    site = write_block_site(tmp_path)
    write_shapes(site / "rough.geojson", [shapely.box(0, 100, 200, 300)])
    assert run(site, SCENE, "-q") == 0
    smooth = speed(site)
    both = decisions(site, SCENE + ZONES, capsys)
    assert both["turbulent_drag"]["state"] == both["zones"]["state"] == "on"
    assert run(site, SCENE + ZONES, "-q", "--overwrite") == 0
    assert 0.3 * smooth < speed(site) < 0.9 * smooth
