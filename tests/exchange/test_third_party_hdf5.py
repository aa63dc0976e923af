"""HDF5 of anyone: particles by the names of datasets, in the root or one level of groups, the same from any layout."""

import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pyproj
import pytest
from exporting import NORTH, WEST, terrain, write_run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations
from mpmgis.exchange.frame_list import list_frames
from mpmgis.exchange.readers.reader_list import OWN, reader_of
from mpmgis.frames.frame_files import read_frame
from mpmgis.laws.quantities import Quantity
from mpmgis.system.errors import FormatError, InputError, MpmgisError
from mpmgis.terrain.georeference import crs_of_text, same_place
from mpmgis.terrain.raster_output import write_geotiff

COUNT = 40
PLACE = ("x", "y", "z")
MAP = {"axes": ("e", "n", "u"), "origin": (WEST, NORTH - 200.0, 500.0)}


def cloud(step=0):
    """Arrays by our names; float32 and float16 hold their numbers."""
    n = np.arange(COUNT)
    position = np.stack([40.0 + n % 8 + step, 60.0 + n // 8, 300.0 + 0.25 * (n % 4)], axis=1)
    velocity = np.stack([1.0 + 0.5 * (n % 3), -0.25 * (n % 5), -2.0 + 0 * n], axis=1)
    return {"position": position, "velocity": velocity, "mass": 2.0 + n % 4, "volume": 0.25 + 0.125 * (n % 2)}


def written_vector(group, name, values, kind):
    """A vector as one dataset, or as one a component; the --columns that name them."""
    if kind == "vector":
        group[name] = values
        return {"": name}
    for axis, letter in enumerate("xyz"):
        group[f"{name}{letter}"] = values[:, axis] if kind == "scalars" else values[:, axis : axis + 1]
    return {letter: f"{name}{letter}" for letter in "xyz"}


LAYOUTS = st.fixed_dictionaries(
    {
        "group": st.sampled_from(["", "particles", "PartType0", "my particles", "step_3", "ä"]),
        "names": st.sampled_from(
            [
                ("position", "velocity", "mass", "volume"),
                ("Pos", "VEL", "Masses", "Volume"),
                ("Coordinates", "v", "mass", "volumes"),
                ("q", "p", "m", "dV"),
                ("a.b", "c-d", "e f", "g:h"),
            ]
        ),
        "kind": st.sampled_from(["vector", "scalars", "columns", "table"]),
        "dtype": st.sampled_from(["<f8", ">f8", "<f4", ">f4", "<f2"]),
        "packed": st.booleans(),
        "user_block": st.sampled_from([0, 512, 1024]),
        "extras": st.booleans(),
        "full_paths": st.sampled_from(["", "path", "/path"]),
    }
)


def write_layout(path, layout, step=0):
    """A file of that layout; the --columns that its names need."""
    arrays = {name: values.astype(layout["dtype"]) for name, values in cloud(step).items()}
    said = {}
    with h5py.File(path, "w", userblock_size=layout["user_block"]) as file:
        group = file.create_group(layout["group"]) if layout["group"] else file
        if layout["kind"] == "table":
            kinds = [
                (name, layout["dtype"], values.shape[1:])
                for name, values in zip(layout["names"], arrays.values(), strict=True)
            ]
            table = np.zeros(COUNT, kinds)
            for name, values in zip(layout["names"], arrays.values(), strict=True):
                table[name] = values
            group["table"] = table
            said = dict(zip(arrays, layout["names"], strict=True))
        else:
            for ours, name in zip(arrays, layout["names"], strict=True):
                if ours in ("position", "velocity"):
                    prefix = "" if ours == "position" else "v"
                    found = written_vector(group, name, arrays[ours], layout["kind"])
                    said |= {prefix + letter if letter else ours: column for letter, column in found.items()}
                else:
                    packed = {"chunks": (7,), "compression": "gzip", "shuffle": True} if layout["packed"] else {}
                    group.create_dataset(name, data=arrays[ours], **packed)
                    said[ours] = name
        if layout["extras"]:  # of other lengths, of text, of no use
            file["grid"] = np.zeros((5, 6, 7))
            file.create_group("other")["nodes"] = np.zeros((11, 3))
            file["words"] = "text"
            group["stress"] = np.zeros((COUNT, 3, 3))
            group["label"] = np.array([b"abc"] * COUNT)
    if layout["full_paths"] and layout["group"] and layout["kind"] != "table":
        slash = "/" if layout["full_paths"] == "/path" else ""
        said = {ours: f"{slash}{layout['group']}/{column}" for ours, column in said.items()}
    return tuple(said.items())


@given(LAYOUTS)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_layout_gives_the_same_particles(tmp_path, layout):
    path = tmp_path / "slide_12.h5"
    columns = write_layout(path, layout)
    (entry,) = list_frames([path], Declarations(**MAP, frame_step=0.5, columns=columns, density=8.0))
    particles, expected = entry.read().particles, cloud()
    for name, values in expected.items():
        np.testing.assert_array_equal(getattr(particles, name), values)
    assert entry.reader == "hdf5" and entry.time == (1.5 if layout["group"] == "step_3" else 6.0)


@pytest.mark.parametrize("names", [("step_{}", "pos"), ("Step#{}", "Coordinates"), ("{:04d}", "position")])
def test_groups_by_number_are_the_frames_of_a_series(tmp_path, names):
    with h5py.File(tmp_path / "run.hdf5", "w") as file:
        for k in (10, 2, 0):
            group = file.create_group(names[0].format(k))
            arrays = cloud(k)
            group[names[1]], group["velocity"], group["mass"] = arrays["position"], arrays["velocity"], arrays["mass"]
            group.attrs["time"] = 0.25 * k
    entries = list_frames([tmp_path / "run.hdf5"], Declarations(**MAP, density=10.0))
    assert [entry.time for entry in entries] == [0.0, 0.5, 2.5]
    for entry, k in zip(entries, (0, 2, 10), strict=True):
        np.testing.assert_array_equal(entry.read().particles.position, cloud(k)["position"])


def gadget(path, kinds=(0,)):
    with h5py.File(path, "w") as file:
        file.create_group("Header").attrs["Time"] = 3.5
        for kind in kinds:
            group = file.create_group(f"PartType{kind}")
            group["Coordinates"], group["Velocities"] = cloud()["position"] + kind, cloud()["velocity"]
            group["Masses"], group["ParticleIDs"] = cloud()["mass"], np.arange(COUNT, dtype="u8")[::-1]


def test_gadget_is_read_and_several_kinds_of_particles_are_asked_for(tmp_path):
    gadget(tmp_path / "snap_001.hdf5")
    terms = Declarations(**MAP, density=10.0, columns=(("velocity", "Velocities"),))
    (entry,) = list_frames([tmp_path / "snap_001.hdf5"], terms)
    particles = entry.read().particles
    assert entry.time == 3.5 and particles.id.tolist() == list(range(COUNT))[::-1]
    np.testing.assert_array_equal(particles.volume, cloud()["mass"] / 10.0)
    gadget(tmp_path / "two.hdf5", (0, 1))
    with pytest.raises(InputError, match=r"several groups \(PartType0, PartType1\); choose one.*PartType0/Coordinates"):
        list_frames([tmp_path / "two.hdf5"], terms)
    columns = (("position", "PartType1/Coordinates"), ("velocity", "PartType1/Velocities"))
    (entry,) = list_frames([tmp_path / "two.hdf5"], Declarations(**MAP, density=10.0, columns=columns))
    np.testing.assert_array_equal(entry.read().particles.position, cloud()["position"] + 1)


def refused(path, **terms):
    with pytest.raises(MpmgisError) as caught:
        list_frames([path], Declarations(**{**MAP, "frame_step": 1.0, "density": 10.0, "reader": "hdf5"} | terms))
    assert "\n" not in str(caught.value) and path.name in str(caught.value)
    return str(caught.value)


def test_ambiguous_names_are_refused_with_the_candidates(tmp_path):
    path = tmp_path / "a_1.h5"
    with h5py.File(path, "w") as file:
        file["pos"], file["coordinates"] = cloud()["position"], cloud()["position"] + 1
        file["velocity"], file["mass"] = cloud()["velocity"], cloud()["mass"]
    word = refused(path)
    assert "position may be" in word and "pos.x" in word and "coordinates.x" in word and "--columns" in word
    (entry,) = list_frames([path], Declarations(**MAP, frame_step=1.0, density=1.0, columns=(("position", "pos"),)))
    np.testing.assert_array_equal(entry.read().particles.position, cloud()["position"])
    with h5py.File(path, "a") as file:
        file.create_group("a")["m"], file.create_group("b")["m"] = cloud()["mass"], cloud()["mass"]
    word = refused(path, columns=(("position", "pos"), ("mass", "m")))
    assert "m is in several groups (a/m, b/m)" in word


def test_no_particles_are_refused_with_what_there_is(tmp_path):
    path = tmp_path / "grid.h5"
    with h5py.File(path, "w") as file:
        file["depth"], file.create_group("out")["q"] = np.zeros((20, 3)), np.zeros(20)
    word = refused(path)
    assert (
        "no array has the name and the shape of a position" in word and "depth (20, 3)" in word and "out/q (20)" in word
    )
    assert "--columns" in word
    with h5py.File(tmp_path / "empty.h5", "w"):
        pass
    assert "it contains no rows of numbers" in refused(tmp_path / "empty.h5")
    assert "no group has all of" in refused(path, columns=(("position", "nothing"),))


def test_the_two_refusals_never_send_a_user_from_one_to_the_other(tmp_path, capsys):
    """A stranger's file is never called a frame of mpmgis, and a frame of mpmgis never no frame of mpmgis."""
    run = write_run(tmp_path / "own", times=(0.0,))
    write_layout(
        tmp_path / "other_1.h5",
        {
            "group": "",
            "names": ("q", "p", "m", "dV"),
            "kind": "vector",
            "dtype": "<f8",
            "packed": False,
            "user_block": 0,
            "extras": False,
            "full_paths": "",
        },
    )
    ours, theirs = str(run[0]), str(tmp_path / "other_1.h5")
    for path, is_own in ((ours, True), (theirs, False)):
        for options in (
            [],
            ["--columns", "position=q"],
            ["--reader", "mpmgis"],
            ["--reader", "hdf5"],
            ["--reader", "mpmgis", "--columns", "position=q"],
            ["--reader", "hdf5", "--columns", "x=q.x"],
        ):
            for verb in (["export-raster", "-o", str(tmp_path / "out"), "--overwrite"], ["info"]):
                main([*verb, path, *options])
                word = capsys.readouterr().err
                assert not ("is a frame of mpmgis" in word and not is_own), (path, options, word)
                assert not ("not an mpmgis frame" in word and is_own), (path, options, word)
                assert word.count("\n") <= 4 and "Traceback" not in word


def test_an_export_by_columns_of_the_command_line(tmp_path, capsys):
    ground = terrain()
    write_geotiff(tmp_path / "dtm.tif", ground.grid, [(Quantity("elevation", "m", ""), ground.elevation)], {})
    (tmp_path / "results").mkdir()
    for k in range(3):
        with h5py.File(tmp_path / "results" / f"out_{k}.h5", "w") as file:
            group, arrays = file.create_group("particles"), cloud(k)
            for axis, letter in enumerate("xyz"):
                group[f"p{letter}"], group[f"u{letter}"] = arrays["position"][:, axis], arrays["velocity"][:, axis]
            group["m"] = arrays["mass"]
            file.attrs["crs"] = "EPSG:32632"
    columns = "x=px,y=py,z=pz,vx=ux,vy=uy,vz=uz,mass=m"
    words = [
        "export-raster",
        str(tmp_path / "results"),
        "--dem",
        str(tmp_path / "dtm.tif"),
        "--columns",
        columns,
        "--density",
        "10",
        "--dt",
        "1",
        "--origin",
        "600000,5170000,500",
        "-o",
        str(tmp_path / "gis"),
        "--no-qgis",
    ]
    assert main(words) == 0
    said = capsys.readouterr()
    assert f"{COUNT} particles, {cloud()['mass'].sum():g} kg" in said.err
    assert (tmp_path / "gis/rasters/results_0002.tif").exists()


WKT = pyproj.CRS.from_epsg(32632).to_wkt()
PROJ = "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs"


@pytest.mark.parametrize("crs", ["EPSG:32632", "epsg:32632", WKT, WKT.encode(), PROJ, "+init=epsg:32632"])
def test_a_crs_may_be_wkt_epsg_or_proj(tmp_path, crs):
    """In a stranger's file, in a sidecar and in our own frames."""
    place = pyproj.CRS.from_epsg(32632)
    with h5py.File(tmp_path / "a_1.h5", "w") as file:
        for name, values in cloud().items():
            file[name] = values
        file.attrs["crs"] = crs
    (entry,) = list_frames([tmp_path / "a_1.h5"], Declarations(frame_step=1.0))
    assert same_place(entry.header.crs, place) and entry.header.origin == (0.0, 0.0, 0.0)
    (own,) = write_run(tmp_path / "own", times=(0.0,))
    with h5py.File(own, "a") as file:
        file.attrs["crs"] = crs.decode() if isinstance(crs, bytes) else crs
    assert same_place(read_frame(own).crs, place)


def test_a_crs_that_is_none_is_refused_and_can_be_overridden(tmp_path):
    path = tmp_path / "a_1.h5"
    with h5py.File(path, "w") as file:
        for name, values in cloud().items():
            file[name] = values
        file.attrs["crs"] = "somewhere"
    assert "expected EPSG:n, WKT or a PROJ string" in refused(path)
    (entry,) = list_frames([path], Declarations(**MAP, frame_step=1.0, crs=pyproj.CRS.from_epsg(2056)))
    assert entry.header.crs.to_epsg() == 2056


def test_a_proj_string_without_a_datum_is_the_projection_whose_numbers_it_gives():
    swiss = pyproj.CRS.from_epsg(2056)
    text = (
        "+proj=somerc +lat_0=46.9524055555556 +lon_0=7.43958333333333 +k_0=1 +x_0={} +y_0=1200000 +ellps=bessel "
        "+units=m +no_defs"
    )
    assert same_place(crs_of_text(text.format(2600000)), swiss)
    assert not same_place(crs_of_text(text.format(600000)), swiss)
    assert not same_place(crs_of_text("+proj=utm +zone=32 +ellps=bessel"), pyproj.CRS.from_epsg(32632))


# ----------------------------------------------------------------------------------------------- files from strangers


def test_what_declares_more_than_the_machine_holds_takes_no_memory(tmp_path):
    rows = 10**12
    with h5py.File(tmp_path / "rows_1.h5", "w") as file:
        for name, width in (("position", 3), ("velocity", 3), ("mass", 1)):
            file.create_dataset(name, (rows, width), "f4", chunks=(1000, width))
    with h5py.File(tmp_path / "wide_1.h5", "w") as file:
        file.create_dataset("position", (10, 10**11), "f4", chunks=(1, 1000))
    with h5py.File(tmp_path / "record_1.h5", "w") as file:
        kinds = [("position", "f8", (3,)), ("velocity", "f8", (3,)), ("mass", "f8")]
        file.create_dataset("table", (rows,), np.dtype(kinds), chunks=(10,))
    tracemalloc.start()
    assert "GB are free" in refused(tmp_path / "rows_1.h5")
    assert "position (10, 100000000000)" in refused(tmp_path / "wide_1.h5")
    assert "GB are free" in refused(tmp_path / "record_1.h5")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_a_chunk_larger_than_memory_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a_1.h5"
    with h5py.File(path, "w") as file:
        for name, values in cloud().items():
            shape = (None, *values.shape[1:])
            file.create_dataset(name, data=values, chunks=(500_000, *values.shape[1:]), maxshape=shape)
    terms = Declarations(**MAP, frame_step=1.0)
    (entry,) = list_frames([path], terms)
    assert len(entry.read().particles) == COUNT
    monkeypatch.setattr("mpmgis.system.memory.available_memory", lambda: 1e6)
    with pytest.raises(FormatError, match="GB are free"):
        entry.read()


def test_a_truncated_file_and_one_that_changed_are_refused(tmp_path):
    path = tmp_path / "a_1.h5"
    columns = write_layout(
        path,
        {
            "group": "",
            "names": ("position", "velocity", "mass", "volume"),
            "kind": "vector",
            "dtype": "<f8",
            "packed": True,
            "user_block": 0,
            "extras": True,
            "full_paths": "",
        },
    )
    (entry,) = list_frames([path], Declarations(**MAP, frame_step=1.0, columns=columns))
    with h5py.File(path, "a") as file:
        del file["position"]
        file["position"] = np.zeros((3, 3))
    with pytest.raises(FormatError, match="the file has changed"):
        entry.read()
    path.write_bytes(path.read_bytes()[:3000])
    assert reader_of(path, lenient=True) == OWN  # and that reader says that it is damaged
    with pytest.raises(FormatError, match="truncated or damaged"):
        list_frames([path], Declarations(columns=columns))


def test_our_own_frames_stay_ours(tmp_path):
    (own,) = write_run(tmp_path / "own", times=(0.0,))
    assert reader_of(own) == reader_of(own, lenient=True) == OWN
    with pytest.raises(FormatError, match="is a file of mpmgis; omit --reader hdf5"):
        list_frames([own], Declarations(**MAP, reader="hdf5"))
    assert Path(own).exists()
