"""HDF5 of anybody: what lies in other files, what is a pipe and what no memory holds is refused in one line."""

import os

import h5py
import netCDF4
import numpy as np
import pytest

from mpmgis.commands.shell.main import main
from mpmgis.exchange.readers import cbgeo
from mpmgis.frames.frame_digest import AS_WRITTEN, check_content, content_of, state_of, stored_digests
from mpmgis.frames.frame_files import drop_state, read_frame, read_maxima, write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.system import memory as machine
from mpmgis.system.errors import FormatError
from mpmgis.system.hdf5_reading import opened_whole

COUNT = 50
READERS = (read_frame, read_maxima, content_of, state_of, stored_digests, drop_state)


@pytest.fixture
def frame(tmp_path):
    """A frame in 3D with a state and maxima."""
    random = np.random.default_rng(3)
    particles = Particles(
        position=random.uniform(0, 9, (COUNT, 3)),
        velocity=random.normal(0, 1, (COUNT, 3)),
        mass=np.full(COUNT, 5.0),
        volume=np.full(COUNT, 0.0025),
    )
    grid = {name: np.ones((4, 5)) for name in ("thickness", "speed", "momentum", "pressure", "arrival_time")}
    maxima = grid | {"transform": np.array([1.0, 0, 0, 0, 1, 0])}
    write_frame(tmp_path / "frame_000000.h5", Frame(particles, 1.0, 2, 3, "mpm3d", state={"a": grid["speed"]}), "")
    with h5py.File(tmp_path / "frame_000000.h5", "r+") as file:
        for name, values in maxima.items():
            file.create_dataset(f"maxima/{name}", data=values)
    return tmp_path / "frame_000000.h5"


def outside(path):
    """Values of another file in place of one of `particles/mass`: by each of the ways of HDF5."""

    def link(file):
        file["particles/mass"] = h5py.ExternalLink(str(path / "other.h5"), "/secret")

    def group(file):
        del file["maxima"]
        file["maxima"] = h5py.ExternalLink(str(path / "other.h5"), "/")

    def virtual(file):
        layout = h5py.VirtualLayout((COUNT,), "f8")
        layout[:] = h5py.VirtualSource(str(path / "missing.h5"), "secret", (COUNT,))
        file.create_virtual_dataset("particles/mass", layout, fillvalue=5.0)

    def raw(file):
        file.create_dataset("particles/mass", (COUNT,), "f8", external=[(str(path / "secret.raw"), 0, 8 * COUNT)])

    return {"an external link": link, "virtual": virtual, "external storage": raw, "external link": group}


@pytest.mark.parametrize("word", ["an external link", "external link", "virtual", "external storage"])
def test_values_of_other_files_are_refused(frame, tmp_path, capfd, word):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["secret"] = np.full(COUNT, 7.0)
    (tmp_path / "secret.raw").write_bytes(np.full(COUNT, 7.0).tobytes())
    with h5py.File(frame, "r+") as file:
        del file["particles/mass"]
        outside(tmp_path)[word](file)
    before = frame.read_bytes()
    for read in READERS:
        with pytest.raises(FormatError, match=f"frame_000000.h5: .*(mass|maxima) is .*{word}"):
            read(frame)
    assert frame.read_bytes() == before
    capfd.readouterr()
    assert main(["info", str(frame)]) == 2
    out, err = capfd.readouterr()
    assert out == "" and err.count("\n") == 1 and word in err


def test_a_link_to_a_pipe_is_not_waited_for(frame, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with h5py.File(frame, "r+") as file:
        file["state/more"] = h5py.ExternalLink(str(tmp_path / "pipe"), "/a")
    with pytest.raises(FormatError, match="state/more is an external link"):
        read_frame(frame)


def test_a_pipe_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "frame_000000.h5")
    for read in READERS:
        with pytest.raises(FormatError, match="device or pipe"):
            read(tmp_path / "frame_000000.h5")


def test_soft_links_and_second_names_within_the_file_are_read(frame):
    with h5py.File(frame, "r+") as file:
        file.move("particles/mass", "kept")
        file["particles/mass"] = h5py.SoftLink("/kept")
        file["again"] = file["particles"]
        file["particles/round"] = file["/"]
    assert (read_frame(frame).particles.mass == 5).all()


def test_compressed_and_chunked_frames_are_read(frame):
    with h5py.File(frame, "r+") as file:
        values = file["particles/mass"][()]
        del file["particles/mass"]
        file.create_dataset("particles/mass", data=values, chunks=(7,), compression="gzip")
    assert (read_frame(frame).particles.mass == 5).all()


@pytest.mark.parametrize("group", ["particles", "state", "maxima"])
def test_declared_shapes_are_held_against_memory(frame, group):
    """A few bytes declare 8 TB: nothing is taken of the memory for it."""
    with h5py.File(frame, "r+") as file:
        if group == "particles":
            for name in ("position", "velocity", "mass", "volume"):
                width = file[group][name].shape[1:]
                del file[group][name]
                file.create_dataset(f"{group}/{name}", (10**12, *width), "f4", chunks=(1000, *width))
        else:
            file.create_dataset(f"{group}/more", (10**6, 10**6), "f8", chunks=(100, 100), compression="gzip")
    readers = {"particles": (read_frame, content_of), "state": (read_frame, state_of)}
    for read in readers.get(group, (read_frame, read_maxima, content_of)):
        with pytest.raises(FormatError, match=f"frame_000000.h5: {group} of (1e.)[0-9+]+ rows needs about .* GB"):
            read(frame)
    assert read_frame(frame, with_state=False, with_particles=False).header["count"] > 0


def test_a_chunk_is_unpacked_as_a_whole(frame):
    with h5py.File(frame, "r+") as file:
        del file["particles/mass"]
        file.create_dataset("particles/mass", (COUNT,), "f8", chunks=(10**8,), maxshape=(None,), compression="gzip")
    before, machine.available_memory = machine.available_memory, lambda: 5e8
    try:
        with pytest.raises(FormatError, match=r"needs about 0\.8 GB"):
            read_frame(frame)
    finally:
        machine.available_memory = before


def test_arrays_that_are_there_already_are_not_asked_for_again(frame, monkeypatch):
    """A frame of more than half the memory is read into the arrays of the one before it."""
    monkeypatch.setattr("mpmgis.system.hdf5_reading.SMALL", 0)
    memory = {}
    read_frame(frame, with_state=False, memory=memory)
    before, machine.available_memory = machine.available_memory, lambda: 10
    try:
        assert (read_frame(frame, with_state=False, memory=memory).particles.mass == 5).all()
        with pytest.raises(FormatError, match="memory"):
            read_frame(frame, with_state=False)
    finally:
        machine.available_memory = before


def test_values_of_any_length_are_refused(frame):
    """Each of them may be the same long text."""
    with h5py.File(frame, "r+") as file:
        file.create_dataset("state/words", data=["x"] * COUNT, dtype=h5py.string_dtype())
    with pytest.raises(FormatError, match="state/words has type object"):
        read_frame(frame)


def test_a_table_of_cbgeo_that_no_memory_holds(tmp_path):
    kind = [(name, "f8") for name in cbgeo.NEEDED]
    with h5py.File(tmp_path / "particles0.h5", "w") as file:
        file.create_dataset("table", (10**12,), kind, chunks=(1000,))
    frame = cbgeo.open_file(tmp_path / "particles0.h5")
    with pytest.raises(FormatError, match=r"particles0.h5: table of 1e\+12 rows needs"):
        frame.read(("coord_x",))


def test_a_mesh_with_an_external_link(tmp_path, capfd):
    with netCDF4.Dataset(tmp_path / "mesh.nc", "w") as data:
        data.createDimension("time", None)
        data.createVariable("time", "f8", ("time",))[:] = [0.0, 1.0]
    assert main(["info", str(tmp_path / "mesh.nc"), "-q"]) == 0
    with h5py.File(tmp_path / "mesh.nc", "r+") as file:
        file["more"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/")
    capfd.readouterr()
    assert main(["info", str(tmp_path / "mesh.nc"), "-q"]) == 2
    assert "mesh.nc: more is an external link" in capfd.readouterr().err


def test_more_objects_than_any_file_of_ours(tmp_path, monkeypatch):
    monkeypatch.setattr("mpmgis.system.hdf5_reading.MOST_OBJECTS", 5)
    with h5py.File(tmp_path / "many.h5", "w") as file:
        for k in range(6):
            file[f"a{k}"] = k
    with pytest.raises(FormatError, match="more than 5 objects"), opened_whole(tmp_path / "many.h5"):
        pass


def test_check_of_a_sound_frame(frame):
    with h5py.File(frame, "r+") as file:
        del file["maxima"]
    assert check_content(frame) == AS_WRITTEN
