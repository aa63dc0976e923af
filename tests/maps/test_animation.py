"""The film of an export, read back by ffmpeg and Pillow: a picture a step, the flow in it, all of one size."""

import numpy as np
import pyproj
import pytest
import qgis_run

from mpmgis.maps.export.animation import require_animation, write_animation
from mpmgis.system.errors import InputError
from mpmgis.terrain.dtm import read_terrain

imageio = pytest.importorskip("imageio.v2", reason="no imageio (pip install mpmgis[animation])")
pytest.importorskip("imageio_ffmpeg", reason="no imageio-ffmpeg (pip install mpmgis[animation])")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return qgis_run.make_run(tmp_path_factory.mktemp("film"), pyproj.CRS.from_epsg(32632), times=[0.0, 0.5, 1.5, 2.0])


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_has_a_picture_for_each_half_second(run, suffix):
    path = run.folder / f"flow{suffix}"
    assert write_animation(path, run, read_terrain(run.folder / run.terrain_file)) == 5  # the step of 1 s counts twice
    pictures = [np.asarray(picture)[..., :3].astype(int) for picture in imageio.mimread(path, memtest=False)]
    assert len({picture.shape for picture in pictures}) == 1 and pictures[0].shape[0] > 300
    if suffix == ".mp4":
        assert len(pictures) == 5
        assert np.abs(pictures[1] - pictures[2]).mean() < 0.5 < np.abs(pictures[0] - pictures[4]).mean()
        with imageio.get_reader(path) as film:
            assert film.get_meta_data()["codec"] == "h264"
    else:
        assert len(pictures) >= 4  # Pillow joins pictures that are alike


def test_other_formats_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"\.mp4 or \.gif"):
        require_animation(tmp_path / "flow.avi")
