"""Particles are the same from every shape, order of axes, depth, number type and container of arrays."""

import itertools
import os

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations
from mpmgis.exchange.frame_list import list_frames
from mpmgis.exchange.readers.array_shapes import as_rows, first_view, fitting_view, selection
from mpmgis.system.errors import FormatError, InputError, MpmgisError

TOLD = {"axes": ("e", "n", "u"), "origin": (0.0, 0.0, 0.0)}
QUIET = [HealthCheck.function_scoped_fixture]
USUAL = {"position": "position", "velocity": "velocity", "mass": "mass", "volume": "volume", "density": "rho"}
ODD = {"position": "q", "velocity": "p", "mass": "m", "volume": "dV", "density": "d"}
AMOUNTS = {  # arrays that give mass and volume, and the density that they still need
    "mass and volume": (("mass", "volume"), None),
    "mass and its density": (("mass", "density"), None),
    "volume and its density": (("volume", "density"), None),
    "mass": (("mass",), 4.0),
    "volume": (("volume",), 4.0),
}


def cloud(count, frame=0, varied=True):
    """Arrays by our names at one time; float16 holds their numbers. Density is mass over volume."""
    n = np.arange(count)
    position = np.stack([40.0 + n % 8 + frame, 60.0 + n // 8, 300.0 + 0.25 * (n % 4)], axis=1)
    velocity = np.stack([1.0 + 0.5 * (n % 3), -0.25 * (n % 5), -2.0 + frame + 0.0 * n], axis=1)
    density = 2.0 ** (1 + n % 3) if varied else np.full(count, 4.0)
    volume = 0.25 * 2.0 ** (n % 2)
    return {"position": position, "velocity": velocity, "mass": density * volume, "volume": volume, "density": density}


def in_order(steps, order, single):
    """Values (T, n, k) or (T, n) of all times in the order of axes `order` of t, r, c, with axes of length 1 added."""
    axes, values = "trc"[: steps.ndim], steps
    if "t" not in order:
        axes, values = axes[1:], steps[0]
    values = values.transpose([axes.index(axis) for axis in order if axis in axes])
    for place in single:
        values = np.expand_dims(values, min(place, values.ndim))
    return values


def write_matlab(path, write):
    """A file as of `save -v7.3`: a user block, and the class of every variable."""
    with h5py.File(path, "w", userblock_size=512) as file:
        write(file)
        file.create_group("#refs#")["a"] = np.zeros((3, 7))
        words = file.create_dataset("words", data=np.frombuffer("particles".encode("utf-16-le"), "<u2")[:, None])
        words.attrs["MATLAB_class"] = np.bytes_("char")
        nothing = file.create_dataset("nothing", data=np.zeros(2, "u8"))
        nothing.attrs["MATLAB_class"], nothing.attrs["MATLAB_empty"] = np.bytes_("double"), np.uint8(1)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_arrays(path, container, group, arrays):
    """The arrays in one group of an HDF5 file, of a MATLAB file, or in an archive."""
    if container == "npz":
        np.savez(path, **arrays)
        return

    def write(file):
        inner = file.require_group(group) if group else file
        for name, values in arrays.items():
            inner[name] = values
            inner[name].attrs["MATLAB_class"] = np.bytes_("double")

    if container == "matlab":
        write_matlab(path, write)
        return
    with h5py.File(path, "w") as file:
        write(file)


ORDERS = ["".join(order) for order in itertools.permutations("trc")]
LAYOUTS = st.fixed_dictionaries(
    {
        "container": st.sampled_from(["hdf5", "matlab", "npz"]),
        "group": st.sampled_from(
            ["", "particles", "a/b", "Results/cloud/MaterialPoints", "ä/b c/d.e/f", "/".join("g" * 40)]
        ),
        "count": st.sampled_from([1, 2, 4, 40, 150]),
        "times": st.sampled_from([0, 0, 2, 5, 7]),
        "order": st.sampled_from([*ORDERS, "rc", "cr"]),
        "amount": st.sampled_from(list(AMOUNTS)),
        "static": st.booleans(),
        "single": st.lists(st.integers(0, 2), max_size=1),
        "lettered": st.booleans(),
        "names": st.sampled_from(["usual", "Usual", "odd", "path", "/path"]),
        "dtype": st.sampled_from(["<f8", ">f8", "<f4", ">f4", "<f2"]),
    }
)


@given(LAYOUTS)
@settings(max_examples=250, deadline=None, suppress_health_check=QUIET)
def test_every_shape_gives_the_same_particles(tmp_path, layout):
    count, times, order = layout["count"], layout["times"], layout["order"]
    assume(bool(times) == ("t" in order) and count not in (times, 3))
    assume(not (layout["lettered"] and times and count == 1))  # T times of one particle, or T particles
    amounts, density = AMOUNTS[layout["amount"]]
    frames = [cloud(count, k, density is None) for k in range(max(times, 1))]
    names = ODD if layout["names"] in ("odd", "path", "/path") else USUAL
    names = {ours: name.title() for ours, name in names.items()} if layout["names"] == "Usual" else names
    arrays, columns = {}, {}
    for ours in ("position", "velocity", *amounts):
        steps = np.stack([frame[ours] for frame in frames]).astype(layout["dtype"])
        if steps.ndim == 2:
            if layout["static"]:
                arrays[names[ours]] = in_order(steps, "r", layout["single"])
            else:
                arrays[names[ours]] = in_order(steps, order, layout["single"])
            columns[ours] = names[ours]
        elif layout["lettered"]:
            prefix = "" if ours == "position" else "v"
            for k, letter in enumerate("xyz"):
                arrays[prefix + letter] = in_order(steps[:, :, k], order, layout["single"])
                columns[prefix + letter] = prefix + letter
        else:
            arrays[names[ours]] = in_order(steps, order, layout["single"])
            columns[ours] = names[ours]
    if times:
        arrays["time"] = np.arange(times)[:, None] * 0.5
    path = tmp_path / f"slide_3.{'npz' if layout['container'] == 'npz' else 'h5'}"
    group = "" if layout["container"] == "npz" else layout["group"]
    write_arrays(path, layout["container"], group, arrays)
    if "path" in layout["names"] and group:
        slash = "/" if layout["names"] == "/path" else ""
        columns = {ours: f"{slash}{group}/{name}" for ours, name in columns.items()}
    said = tuple(columns.items()) if names is ODD else ()
    entries = list_frames([path], Declarations(**TOLD, density=density, columns=said, frame_step=0.5))
    assert [entry.time for entry in entries] == ([0.5 * k for k in range(times)] if times else [1.5])
    for entry, frame in zip(entries, frames, strict=True):
        particles = entry.read().particles
        for name in ("position", "velocity", "mass", "volume"):
            np.testing.assert_array_equal(getattr(particles, name), frame[name], err_msg=name)


@given(st.permutations("trc"), st.integers(2, 6), st.integers(7, 9), st.integers(0, 5))
@settings(max_examples=60, deadline=None)
def test_a_view_selects_the_rows_of_one_time(order, times, count, frame):
    values = np.random.default_rng(0).random((times, count, 3))
    assume(frame < times and times != 3)
    turned = values.transpose(["trc".index(axis) for axis in order])
    view = first_view(turned.shape, 3, {count}, {times})
    assert (view.times, view.rows) == (times, count)
    np.testing.assert_array_equal(as_rows(turned[selection(view, frame)], view), values[frame])
    assert fitting_view((count,), view).times is None and fitting_view((count + 1,), view) is None


def test_lengths_of_other_arrays_tell_times_from_particles(tmp_path):
    """(n, T, 3) without any other array is read as (T, n, 3); masses, times or --times tell it."""
    steps = np.stack([cloud(40, k)["position"] for k in range(5)])
    turned = steps.transpose(1, 0, 2)
    for extra, terms in (
        ({"mass": np.ones(40)}, {}),
        ({"time": np.arange(5.0)}, {}),
        ({}, {"times": (0.0, 1, 2, 3, 4)}),
    ):
        np.savez(tmp_path / "a_1.npz", position=turned, velocity=turned, **extra)
        with h5py.File(tmp_path / "a_1.h5", "w") as file:
            for name, values in {"position": turned, "velocity": turned, **extra}.items():
                file[name] = values
        told = TOLD | {"frame_step": 1.0} | ({"frame_step": None} | terms if terms else {})
        for suffix in ("npz", "h5"):
            entries = list_frames([tmp_path / f"a_1.{suffix}"], Declarations(**told, density=1.0, particle_volume=1.0))
            assert len(entries) == 5 and entries[0].count == 40
            np.testing.assert_array_equal(entries[3].read().particles.position, steps[3])


@pytest.mark.parametrize("suffix", ["csv", "vtk", "parquet", "ply", "h5", "npz"])
def test_a_density_per_particle_gives_masses_in_every_format(tmp_path, suffix):
    arrays = cloud(40)
    single = dict(zip("xyz", arrays["position"].T, strict=True))
    single |= {f"v{letter}": values for letter, values in zip("xyz", arrays["velocity"].T, strict=True)}
    single |= {"volume": arrays["volume"], "density": arrays["density"]}
    path = tmp_path / f"a_1.{suffix}"
    if suffix == "csv":
        rows = np.column_stack(list(single.values())).tolist()
        path.write_text(",".join(single) + "\n" + "\n".join(",".join(map(repr, row)) for row in rows) + "\n")
    elif suffix == "parquet":
        pyarrow = pytest.importorskip("pyarrow.parquet")
        import pyarrow as arrow

        pyarrow.write_table(arrow.table(single), path)
    elif suffix == "ply":
        head = "ply\nformat binary_little_endian 1.0\nelement vertex 40\n"
        head += "".join(f"property double {name}\n" for name in single) + "end_header\n"
        path.write_bytes(head.encode() + np.column_stack(list(single.values())).astype("<f8").tobytes())
    elif suffix == "vtk":
        text = "# vtk DataFile Version 3.0\nslide\nASCII\nDATASET POLYDATA\nPOINTS 40 double\n"
        text += "\n".join(" ".join(map(str, row)) for row in arrays["position"].tolist())
        text += "\nPOINT_DATA 40\nVECTORS velocity double\n"
        text += "\n".join(" ".join(map(str, row)) for row in arrays["velocity"].tolist()) + "\n"
        for name in ("volume", "density"):
            text += f"SCALARS {name} double 1\nLOOKUP_TABLE default\n" + "\n".join(map(str, arrays[name])) + "\n"
        path.write_text(text)
    else:
        write_arrays(path, suffix, "", single)
    (entry,) = list_frames([path], Declarations(**TOLD, times=(0.0,)))
    particles = entry.read().particles
    for name in ("position", "velocity", "mass", "volume"):
        np.testing.assert_array_equal(getattr(particles, name), arrays[name])
    (declared,) = list_frames([path], Declarations(**TOLD, times=(0.0,), density=3.0))  # of the user comes first
    np.testing.assert_array_equal(declared.read().particles.mass, 3.0 * arrays["volume"])


def test_a_density_that_is_not_above_zero_is_refused(tmp_path):
    arrays = cloud(40)
    arrays["density"][7] = 0.0
    np.savez(tmp_path / "a_1.npz", **{name: arrays[name] for name in ("position", "velocity", "mass", "density")})
    (entry,) = list_frames([tmp_path / "a_1.npz"], Declarations(**TOLD, times=(0.0,)))
    with pytest.raises(FormatError, match="density is 0 in row 7"):
        entry.read()


# ---------------------------------------------------------------------------------------------------- HDF5 at any depth


def nested(path, steps, time_on):
    """Components in groups `position` and `velocity` of `data/<step>/particles/debris`, with a mass beside them."""
    with h5py.File(path, "w") as file:
        for k in steps:
            arrays, group = cloud(40, k), file.create_group(f"data/{100 * k}/particles/debris")
            for ours in ("position", "velocity"):
                for axis, letter in enumerate("xyz"):
                    group[f"{ours}/{letter}"] = arrays[ours][:, axis]
            group["mass"] = arrays["mass"]
            (group if time_on == "inner" else file[f"data/{100 * k}"]).attrs["time"] = 0.5 * k


@pytest.mark.parametrize("time_on", ["inner", "outer"])
def test_series_of_nested_groups_have_the_times_around_them(tmp_path, time_on):
    nested(tmp_path / "deep.h5", (2, 0, 1), time_on)
    entries = list_frames([tmp_path / "deep.h5"], Declarations(**TOLD, density=4.0))
    assert [entry.time for entry in entries] == [0.0, 0.5, 1.0]
    for k, entry in enumerate(entries):
        particles = entry.read().particles
        for name in ("position", "velocity", "mass"):
            np.testing.assert_array_equal(getattr(particles, name), cloud(40, k)[name])


@pytest.mark.parametrize(("offset", "is_refused"), [("none", False), (0.0, False), (5.0, True), ("rows", True)])
def test_positions_with_an_offset_beside_them_are_refused(tmp_path, offset, is_refused):
    nested(tmp_path / "deep.h5", (0,), "inner")
    with h5py.File(tmp_path / "deep.h5", "a") as file:
        group = file["data/0/particles/debris"]
        for letter in "xyz" if offset != "none" else "":
            if offset == "rows":
                group[f"positionOffset/{letter}"] = np.zeros(40)
            else:
                group.create_group(f"positionOffset/{letter}").attrs["value"] = offset
    if is_refused:
        assert "positionOffset has to be added" in refused(tmp_path / "deep.h5")
    else:
        assert len(list_frames([tmp_path / "deep.h5"], Declarations(**TOLD, density=4.0))) == 1


def test_ends_of_paths_name_the_datasets_of_every_step(tmp_path):
    with h5py.File(tmp_path / "steps.h5", "w") as file:
        file["m"] = cloud(40)["mass"]
        for k in range(3):
            file[f"Results/Time_{k}/cloud/where"] = cloud(40, k)["position"].T
            file[f"Results/Time_{k}/fields/motion"] = cloud(40, k)["velocity"]
    columns = (("position", "cloud/where"), ("velocity", "fields/motion"), ("mass", "m"))
    entries = list_frames([tmp_path / "steps.h5"], Declarations(**TOLD, density=4.0, columns=columns, frame_step=2.0))
    assert [entry.time for entry in entries] == [0.0, 2.0, 4.0]
    np.testing.assert_array_equal(entries[2].read().particles.velocity, cloud(40, 2)["velocity"])
    np.testing.assert_array_equal(entries[1].read().particles.position, cloud(40, 1)["position"])


def refused(path, **terms):
    with pytest.raises(MpmgisError) as caught:
        list_frames([path], Declarations(**TOLD | {"frame_step": 1.0, "density": 4.0, "reader": "hdf5"} | terms))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_all_arrays_are_listed_with_path_and_shape_where_nothing_fits(tmp_path, capsys):
    path = tmp_path / "odd_1.h5"
    with h5py.File(path, "w") as file:
        for k in range(40):
            file[f"a/b{k}/q"] = np.zeros((2 + k, 3, 5))
        file["one"], file["none"], file["words"] = 3.0, np.zeros((0, 3)), "text"
        file["a/table"] = np.zeros(6, [("w", "f8", (2,)), ("name", "S4")])
    word = refused(path)
    for k in range(40):
        assert f"a/b{k}/q ({2 + k}, 3, 5)" in word
    assert "one ()" in word and "none (0, 3)" in word and "a/table/w (6, 2)" in word
    assert "words" not in word and "table/name" not in word and "--columns" in word
    assert main(["info", str(path)]) == 2  # without --columns too
    assert "a/b39/q (41, 3, 5)" in capsys.readouterr().err


def test_cells_of_matlab_are_named(tmp_path):
    path = tmp_path / "cells_1.mat"

    def write(file):
        file.create_group("#refs#/b")["pos"] = np.zeros((3, 40))
        cells = file.create_dataset("pos", (1, 4), h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        file["depth"] = np.zeros((1, 40))

    def whole(file):
        write(file)
        del file["#refs#"]

    write_matlab(path, whole)
    word = refused(path)
    assert "pos are cells of MATLAB" in word and "depth (1, 40)" in word and "refs" not in word


def test_three_particles_of_matlab_are_columns(tmp_path):
    arrays = cloud(3)
    turned = {name: np.atleast_2d(values).T if values.ndim == 2 else values[None] for name, values in arrays.items()}
    write_arrays(tmp_path / "three_1.mat", "matlab", "", turned)
    (entry,) = list_frames([tmp_path / "three_1.mat"], Declarations(**TOLD, reader="hdf5", frame_step=1.0))
    np.testing.assert_array_equal(entry.read().particles.position, arrays["position"])


def test_groups_in_circles_and_wells_end(tmp_path):
    path = tmp_path / "circle_1.h5"
    with h5py.File(path, "w") as file:
        for name in ("position", "velocity", "mass"):
            file[f"a/{name}"] = cloud(40)[name]
        file["a/again"] = file["a"]
        file["a/b/root"] = file["/"]
    (entry,) = list_frames([path], Declarations(**TOLD, density=4.0, frame_step=1.0))
    np.testing.assert_array_equal(entry.read().particles.position, cloud(40)["position"])
    with h5py.File(tmp_path / "well_1.h5", "w") as file:
        file.create_group("/".join("g" * 500))
    assert "groups in groups" in refused(tmp_path / "well_1.h5")


def test_nothing_is_read_from_other_files_at_any_depth(tmp_path):
    """External links, soft links, virtual datasets and external storage; a pipe behind a link would hang."""
    with h5py.File(tmp_path / "source.h5", "w") as file:
        file["position"] = cloud(40)["position"]
    (tmp_path / "raw.bin").write_bytes(bytes(8 * 3 * 40))
    os.mkfifo(tmp_path / "pipe")
    layout = h5py.VirtualLayout((40, 3), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "source.h5"), "position", (40, 3))
    storage = [(str(tmp_path / "raw.bin"), 0, 8 * 3 * 40)]
    makers = {
        "link": lambda group: group.__setitem__("position", h5py.ExternalLink("source.h5", "position")),
        "pipe": lambda group: group.__setitem__("position", h5py.ExternalLink("pipe", "position")),
        "group": lambda group: group.__setitem__("particles", h5py.ExternalLink("source.h5", "/")),
        "soft": lambda group: group.__setitem__("position", h5py.SoftLink("/inner")),
        "virtual": lambda group: group.create_virtual_dataset("position", layout),
        "storage": lambda group: group.create_dataset("position", (40, 3), "f8", external=storage),
    }
    for (name, make), depth in itertools.product(makers.items(), (0, 1, 3)):
        path = tmp_path / f"{name}{depth}_1.h5"
        with h5py.File(path, "w") as file:
            group = file.require_group("/".join(["g"] * depth)) if depth else file
            group["velocity"], group["mass"] = cloud(40)["velocity"], cloud(40)["mass"]
            make(group)
        named = (("position", "/".join([*["g"] * depth, "position"])),)
        for columns in ((), named) if name != "group" else ((),):
            word = refused(path, columns=columns)
            assert "are in other files or behind links and are not read" in word, (name, word)


def test_a_recording_that_changed_is_refused(tmp_path):
    path = tmp_path / "a_1.h5"
    with h5py.File(path, "w") as file:
        for name in ("position", "velocity"):
            file[name] = np.stack([cloud(40, k)[name] for k in range(4)])
        file["mass"], file["time"] = cloud(40)["mass"], np.arange(4.0)
    entries = list_frames([path], Declarations(**TOLD, density=4.0))
    with h5py.File(path, "a") as file:
        del file["position"]
        file["position"] = np.zeros((3, 40, 3))
    with pytest.raises(FormatError, match="the file has changed"):
        entries[2].read()
    with h5py.File(path, "a") as file:
        file["time"][1] = np.nan
        del file["position"]
        file["position"] = np.zeros((4, 40, 3))
    with pytest.raises(FormatError, match="NaN or infinite times"):
        list_frames([path], Declarations(**TOLD, density=4.0))


def test_times_of_a_recording_can_be_named(tmp_path):
    with h5py.File(tmp_path / "a_1.h5", "w") as file:
        for name in ("position", "velocity"):
            file[name] = np.stack([cloud(40, k)[name] for k in range(4)])
        file["mass"], file["clock/seconds"] = cloud(40)["mass"], np.arange(4.0) * 3.0
    told = Declarations(**TOLD, density=4.0, columns=(("time", "seconds"),))
    assert [entry.time for entry in list_frames([tmp_path / "a_1.h5"], told)] == [0.0, 3.0, 6.0, 9.0]
    with pytest.raises(InputError, match="no such array"):
        list_frames([tmp_path / "a_1.h5"], Declarations(**TOLD, density=4.0, columns=(("time", "hours"),)))
