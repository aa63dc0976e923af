"""Frames on disk: what is written is read again, and what is no frame is refused in one line."""

import dataclasses
import hashlib

import h5py
import numpy as np
import pyproj
import pytest
import xarray

from mpmgis.frames import frame_digest
from mpmgis.frames.frame_digest import require_restartable
from mpmgis.frames.frame_files import content_digest, read_frame, write_frame, write_frame_slabs
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import PARTICLE
from mpmgis.system.errors import FormatError

COUNT = 17
CRS = pyproj.CRS.from_epsg(32612)


def columns(**changes):
    random = np.random.default_rng(1)
    area, thickness = random.uniform(1, 2, COUNT), random.uniform(0.1, 5, COUNT)
    particles = Particles(
        position=random.uniform(0, 500, (COUNT, 3)),
        velocity=random.normal(0, 10, (COUNT, 3)),
        mass=2000 * area * thickness,
        volume=area * thickness,
        thickness=thickness,
        area=area,
        id=np.arange(COUNT, dtype=np.uint64) + 2**60,
    )
    frame = Frame(
        particles,
        time=12.5,
        step=321,
        dimension=2,
        solver="columns",
        crs=CRS,
        origin=(311600.0, 4007400.0, 0.0),
        dem="../dtm.tif",
        dem_sha256="ab12",
        digest="cd34",
        header={"density": 2000.0, "mass_mode": "thickness"},
        state={"gradient": random.normal(size=(COUNT, 2)), "time_step": 0.01},
        maxima={"depth": random.uniform(size=(4, 5)), "west": 311600.0},
    )
    return dataclasses.replace(frame, **changes)


def points():
    random = np.random.default_rng(2)
    particles = Particles(
        position=random.uniform(0, 500, (COUNT, 3)),
        velocity=random.normal(0, 10, (COUNT, 3)),
        mass=random.uniform(1, 2, COUNT),
        volume=random.uniform(1, 2, COUNT),
        id=np.arange(COUNT, dtype=np.uint64),
        parent=np.arange(COUNT, dtype=np.uint64)[::-1].copy(),
    )
    return Frame(particles, dimension=3, solver="points", crs=CRS, origin=(4e5, 5.1e6, 1500.0))


@pytest.fixture
def path(tmp_path):
    write_frame(tmp_path / "frame_000001.h5", columns())
    return tmp_path / "frame_000001.h5"


def assert_same(values, others):
    assert values.keys() == others.keys()
    for name, value in values.items():
        assert np.array_equal(value, others[name]), name


def test_columns_come_back_bit_by_bit(path):
    wrote, read = columns(), read_frame(path)
    assert_same(wrote.particles.arrays(), read.particles.arrays())
    assert_same(wrote.state, read.state)
    assert_same(wrote.maxima, read.maxima)
    assert wrote.header == {name: read.header[name] for name in wrote.header}
    for name in ("time", "step", "dimension", "solver", "crs", "origin", "dem", "dem_sha256", "digest"):
        assert getattr(read, name) == getattr(wrote, name), name


def test_state_is_omitted_unless_requested(path):
    read = read_frame(path, with_state=False)
    assert read.state == {} and read.maxima == {}
    assert len(read.particles) == COUNT


def test_points_come_back_to_single_precision_of_a_local_position(tmp_path):
    """H5: float32 of a northing of 5.1e6 m has steps of 0.5 m; relative to the origin they are 3e-5 m."""
    wrote = points()
    write_frame(tmp_path / "a.h5", wrote)
    read = read_frame(tmp_path / "a.h5")
    assert np.abs(read.particles.position - wrote.particles.position).max() < 4e-5
    assert np.allclose(read.particles.velocity, wrote.particles.velocity, rtol=1e-7)
    assert np.array_equal(read.particles.parent, wrote.particles.parent)
    assert all(values.dtype in (np.float64, np.uint64) for values in read.particles.arrays().values())


@pytest.mark.parametrize(("frame", "real"), [(columns(), "f8"), (points(), "f4")], ids=["columns", "points"])
def test_types_units_and_names_on_disk(tmp_path, frame, real):
    write_frame(tmp_path / "a.h5", frame)
    with h5py.File(tmp_path / "a.h5") as file:
        assert set(file["particles"]) == set(frame.particles.arrays())
        for name, dataset in file["particles"].items():
            assert dataset.dtype == np.dtype("u8" if name in ("id", "parent") else real)
            assert dataset.attrs["units"] == PARTICLE[name].unit
            assert dataset.attrs["long_name"] == PARTICLE[name].long_name
        assert file.attrs["format"] == "mpmgis-frame" and file.attrs["format_version"] == 1
        assert file.attrs["origin"].dtype == np.float64 and file.attrs["origin"].shape == (3,)


def test_what_is_unknown_is_empty(tmp_path):
    write_frame(tmp_path / "a.h5", Frame(columns().particles))
    read = read_frame(tmp_path / "a.h5")
    assert (read.crs, read.dem, read.dem_sha256, read.digest) == (None, "", "", "")
    assert read.state == {} and read.maxima == {}


def test_xarray_opens_frames(path):
    with xarray.open_dataset(path, group="particles") as particles:
        assert particles["position"].shape == (COUNT, 3)
        assert particles["thickness"].attrs["units"] == "m"
        assert np.array_equal(particles["mass"], columns().particles.mass)
        assert particles["id"].dtype == np.uint64
    with xarray.open_dataset(path) as root:
        assert root.attrs["time"] == 12.5


@pytest.mark.parametrize(("given", "missing"), [("mass", "volume"), ("volume", "mass")])
def test_mass_and_volume_follow_from_each_other_with_a_message(path, given, missing):
    with h5py.File(path, "a") as file:
        del file["particles"][missing]
    read = read_frame(path)
    assert read.header["assumed_density"] == 1000.0
    assert np.allclose(read.particles.mass, 1000.0 * read.particles.volume, rtol=1e-15)
    assert np.array_equal(getattr(read.particles, given), getattr(columns().particles, given))


@pytest.mark.parametrize("missing", ["area", "thickness"])
def test_area_and_thickness_follow_from_the_volume(path, missing):
    with h5py.File(path, "a") as file:
        del file["particles"][missing]
    assert np.allclose(getattr(read_frame(path).particles, missing), getattr(columns().particles, missing))


def test_a_frame_of_another_program_needs_no_more_than_the_minimum(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["format"] = "mpmgis-frame"
        group = file.create_group("particles")
        group["position"] = np.zeros((2, 3), "f4")
        group["velocity"] = np.zeros((2, 3), ">f8")
        group["mass"] = np.array([1, 2])
    read = read_frame(tmp_path / "a.h5")
    assert (read.dimension, read.time, read.origin) == (3, 0.0, (0.0, 0.0, 0.0))
    assert read.particles.volume.tolist() == [0.001, 0.002]


def without_rows(file):
    for name in list(file["particles"]):
        replace(file, name, file["particles"][name][:0])


def replace(file, name, values):
    del file["particles"][name]
    file["particles"][name] = values


def poke(name, value):
    def change(file):
        file["particles"][name][3] = value

    return change


BROKEN = {
    "another format": (lambda f: f.attrs.update(format="other"), "format 'other', expected 'mpmgis-frame'"),
    "no format": (lambda f: f.attrs.__delitem__("format"), "not an mpmgis frame"),
    "newer format": (lambda f: f.attrs.update(format_version=2), "format version 2, this mpmgis reads up to 1; update"),
    "version a word": (lambda f: f.attrs.update(format_version="two"), "format_version is 'two', expected a number"),
    "dimension 4": (lambda f: f.attrs.update(dimension=4), "dimension 4, expected 2 or 3"),
    "dimension a word": (lambda f: f.attrs.update(dimension="flat"), "dimension is 'flat', expected a number"),
    "time NaN": (lambda f: f.attrs.update(time=np.nan), "time nan, expected a finite number"),
    "step no frame can hold": (lambda f: f.attrs.update(step=-1e300), "step is -1e.300, expected an integer from 0"),
    "step NaN": (lambda f: f.attrs.update(step=np.nan), "step is nan, expected an integer"),
    "step of the next machine": (lambda f: f.attrs.update(step=np.uint64(2**63)), "an integer from 0 to 2.53"),
    "text of bytes": (
        lambda f: f.attrs.create("dem", b"dem\xff", dtype=h5py.string_dtype()),
        "attribute dem of / is 'dem.udcff', expected UTF-8",
    ),
    "text of bytes beside the particles": (
        lambda f: f["particles"].attrs.create("release", b"bytes\xff", dtype=h5py.string_dtype()),
        "attribute release of /particles is 'bytes.udcff', expected UTF-8",
    ),
    "text of bytes in the state": (
        lambda f: f["state"].attrs.create("note", b"\xff", dtype=h5py.string_dtype()),
        "attribute note of /state is '.udcff', expected UTF-8",
    ),
    "time a word": (lambda f: f.attrs.update(time="noon"), "time is 'noon', expected a number"),
    "origin of two": (lambda f: f.attrs.update(origin=[0.0, 1.0]), "expected three finite numbers"),
    "origin infinite": (lambda f: f.attrs.update(origin=[0.0, np.inf, 0.0]), "expected three finite numbers"),
    "origin complex": (lambda f: f.attrs.update(origin=[1j, 0, 0]), "origin has type complex128"),
    "crs junk": (lambda f: f.attrs.update(crs="somewhere"), "expected EPSG:n, WKT or a PROJ string"),
    "no particles": (lambda f: f.__delitem__("particles"), "no group 'particles'"),
    "no position": (lambda f: f["particles"].__delitem__("position"), "no particles/position"),
    "no velocity": (lambda f: f["particles"].__delitem__("velocity"), "no particles/velocity"),
    "neither mass nor volume": (
        lambda f: [f["particles"].__delitem__(name) for name in ("mass", "volume")],
        "neither particles/mass nor particles/volume",
    ),
    "neither thickness nor area": (
        lambda f: [f["particles"].__delitem__(name) for name in ("thickness", "area")],
        "needs particles/thickness or particles/area",
    ),
    "position flat": (lambda f: replace(f, "position", np.zeros((COUNT, 2))), r"position has shape \(17, 2\)"),
    "velocity short": (lambda f: replace(f, "velocity", np.zeros((COUNT - 1, 3))), r"velocity has shape \(16, 3\)"),
    "mass short": (lambda f: replace(f, "mass", np.ones(COUNT - 1)), r"mass has shape \(16,\)"),
    "mass in rows": (lambda f: replace(f, "mass", np.ones((COUNT, 1))), r"mass has shape \(17, 1\)"),
    "position of none": (lambda f: replace(f, "position", np.zeros((0, 3))), r"expected numbers of shape \(0, 3\)"),
    "mass of words": (lambda f: replace(f, "mass", np.array([b"heavy"] * COUNT)), "expected numbers"),
    "mass a number": (lambda f: replace(f, "mass", 1.0), r"mass has shape \(\)"),
    "mass a group": (
        lambda f: [f["particles"].__delitem__("mass"), f["particles"].create_group("mass")],
        "mass is not a dataset",
    ),
    "position NaN": (
        poke("position", np.nan),
        "position contains 3 values that are NaN or infinite, the first in row 3",
    ),
    "velocity infinite": (poke("velocity", np.inf), "velocity contains 3 values"),
    "mass NaN": (poke("mass", np.nan), "mass contains 1 values that are NaN or infinite, the first in row 3"),
    "volume infinite": (poke("volume", np.inf), "volume contains 1 values"),
    "velocity of no flow": (poke("velocity", -1e300), r"velocity reaches 1e\+300 m s-1 in row 3, expected at most"),
    "position on no map": (poke("position", 1e12), r"position reaches 1e\+12 m in row 3"),
    "mass of a galaxy": (poke("mass", 1e40), r"mass reaches 1e\+40 kg in row 3"),
    "mass zero": (poke("mass", 0.0), "mass is 0 in row 3, expected above 0"),
    "volume of nothing": (poke("volume", 5e-324), "volume is 4.94066e-324 in row 3, expected above 0 .1e-30 at"),
    "volume negative": (poke("volume", -1.0), "volume is -1 in row 3, expected above 0"),
    "area zero": (poke("area", 0.0), "area is 0 in row 3"),
    "area of nothing": (poke("area", 5e-324), "area is 4.94066e-324 in row 3, expected above 0 .1e-30 at least"),
    "thickness negative": (poke("thickness", -0.5), "thickness is -0.5 in row 3, expected 0 or more"),
    "thickness zero and no area": (
        lambda f: [poke("thickness", 0.0)(f), f["particles"].__delitem__("area")],
        "thickness is 0 in row 3",
    ),
    "id not whole": (lambda f: replace(f, "id", np.arange(COUNT) + 0.5), "particles/id must contain integers"),
    "id negative": (lambda f: replace(f, "id", np.arange(COUNT) - 1), "particles/id must contain integers"),
    "no rows": (without_rows, "contains no particle"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_frame_is_refused_in_one_line(path, case):
    change, says = BROKEN[case]
    with h5py.File(path, "a") as file:
        change(file)
    with pytest.raises(FormatError, match=says) as caught:
        read_frame(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [0, 7, 100, 0.5, 0.95])
def test_a_truncated_file_is_refused_in_one_line(path, keep):
    content = path.read_bytes()
    path.write_bytes(content[: keep if keep in (0, 7, 100) else int(keep * len(content))])
    with pytest.raises(FormatError, match="truncated or damaged") as caught:
        read_frame(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"not hdf5", b"\x89HDF\r\n\x1a\n" + bytes(range(256)) * 8])
def test_junk_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "a.h5").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.h5 is not a readable HDF5 file"):
        read_frame(tmp_path / "a.h5")


def test_a_missing_file_and_a_folder_are_named_as_such(tmp_path):
    with pytest.raises(FormatError, match=r"none\.h5: no such file"):
        read_frame(tmp_path / "none.h5")
    with pytest.raises(FormatError, match="is a folder, not a frame; give its files"):
        read_frame(tmp_path)


def test_a_frame_that_cannot_be_written_leaves_nothing(tmp_path):
    frame = columns(header={"density": object()})
    with pytest.raises(TypeError):
        write_frame(tmp_path / "a.h5", frame)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("slab", [1, 5, COUNT])
def test_threads_that_hash_arrays_change_no_digest(tmp_path, slab):
    """`content_sha256` is that of the arrays one after the other, in slabs or whole."""
    frame = columns(state={"rows": np.arange(1000.0), "keys": np.arange(9)})
    lines = [f"{frame.time.hex()} {frame.step}"]
    arrays = {f"particles/{name}": values for name, values in frame.particles.arrays().items()}
    for name, values in sorted((arrays | {"maxima/depth": frame.maxima["depth"]}).items()):
        digest = hashlib.sha256(f"{values.dtype.str} {values.shape[1:]} ".encode() + values.tobytes())
        lines.append(f"{name} {digest.hexdigest()}")
    expected = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    slabs = [frame.particles.take(slice(first, first + slab)) for first in range(0, COUNT, slab)]
    path = tmp_path / "frame.h5"
    assert write_frame_slabs(path, frame, COUNT, iter(slabs), "") == expected
    assert content_digest(frame) == expected == frame_digest.content_of(path)
    assert require_restartable(path, tmp_path / "none.h5")
