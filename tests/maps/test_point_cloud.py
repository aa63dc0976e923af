"""Points as LAS: places to a millimetre, what each point has, the CRS, and another program that opens it."""

import struct
from pathlib import Path

import numpy as np
import pyproj
import pytest
from qgis_python import report_of

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.frames.point_cloud import write_las
from mpmgis.system.errors import InputError

laspy = pytest.importorskip("laspy", reason="no laspy (pip install mpmgis[pointcloud])")
ORIGIN = (600_000.0, 5_170_000.0, 900.0)


@pytest.fixture
def frame():
    rng = np.random.default_rng(0)
    position, velocity = rng.random((500, 3)) * (300, 200, 20), rng.normal(size=(500, 3))
    particles = Particles(position, velocity, rng.random(500) + 1.0, rng.random(500) * 1e-3)
    return Frame(particles, time=12.5, dimension=3, crs=pyproj.CRS.from_epsg(32632), origin=ORIGIN)


def test_las_has_what_the_frame_has(tmp_path, frame):
    write_las(tmp_path / "a.las", frame)
    cloud = laspy.read(tmp_path / "a.las")
    assert np.abs(cloud.xyz - frame.particles.position - ORIGIN).max() <= 0.5e-3 + 1e-9
    assert np.array_equal(cloud["velocity_u"], frame.particles.velocity[:, 2].astype("f4"))
    assert np.allclose(cloud["speed"], np.linalg.norm(frame.particles.velocity, axis=1), rtol=1e-6)
    assert np.array_equal(cloud["mass"], frame.particles.mass.astype("f4"))
    assert np.array_equal(cloud["volume"], frame.particles.volume.astype("f4"))
    assert np.all(cloud.gps_time == 12.5) and cloud.header.parse_crs().to_epsg() == 32632
    assert str(cloud.header.version) == "1.4" and cloud.header.point_format.id == 6


def test_bytes_are_those_of_the_las_specification(tmp_path, frame):
    """ASPRS LAS 1.4 R15, tables 3 and 15, read without the library that wrote them."""
    write_las(tmp_path / "a.las", frame)
    data = (tmp_path / "a.las").read_bytes()
    assert data[:4] == b"LASF" and data[24:26] == b"\x01\x04" and data[104] == 6
    start, size = struct.unpack_from("<I", data, 96)[0], struct.unpack_from("<H", data, 105)[0]
    scale, offset = (np.array(struct.unpack_from("<3d", data, place)) for place in (131, 155))
    (count,) = struct.unpack_from("<Q", data, 247)
    assert count == 500 and len(data) >= start + count * size
    places = np.array([struct.unpack_from("<3i", data, start + k * size) for k in range(count)]) * scale + offset
    assert np.abs(places - frame.particles.position - ORIGIN).max() <= 0.5e-3 + 1e-9
    assert struct.unpack_from("<d", data, start + 22) == (12.5,)


def test_command_writes_points_as_they_are(tmp_path, frame, capsys):
    write_frame(tmp_path / "frame.h5", frame)
    assert main(["convert", str(tmp_path / "frame.h5"), "-o", str(tmp_path / "points.las")]) == 0
    assert capsys.readouterr().out.splitlines() == [str(tmp_path / "points.las")]
    assert len(laspy.read(tmp_path / "points.las")) == 500
    assert main(["convert", str(tmp_path / "frame.h5"), "-o", str(tmp_path / "b.las"), "--spacing", "1"]) == 2
    assert "--spacing has no effect" in capsys.readouterr().err


def test_a_missing_library_is_named_with_its_extra(tmp_path, frame, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "laspy", None)
    with pytest.raises(InputError, match=r"pip install \"mpmgis\[pointcloud\]\""):
        write_las(tmp_path / "a.las", frame)
    assert not (tmp_path / "a.las").exists()


@pytest.mark.qgis
def test_qgis_opens_it(tmp_path, frame):
    write_las(tmp_path / "a.las", frame)
    found = report_of(Path(__file__).with_name("qgis_point_cloud.py"), tmp_path / "a.las")
    if not found["pdal"]:
        pytest.skip("this QGIS has no provider for .las")
    place = frame.particles.position[:, :2] + ORIGIN[:2]
    assert found["crs"] == "EPSG:32632" and found["count"] == 500
    assert np.allclose(found["extent"], [*place.min(axis=0), *place.max(axis=0)], atol=0.002)
