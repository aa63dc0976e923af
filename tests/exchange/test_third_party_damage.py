"""Damaged files of other codes: each ends in one line that names the file, soon, and in little memory."""

import base64
import json
import pickle
import random
import re
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from third_party_writers import (
    CODES,
    cbgeo_table,
    cloud,
    dump_step,
    kratos_vtk,
    table,
    vtk_xml,
    write_anura3d,
    write_geotaichi,
    write_kratos_gid,
    write_mpm_geomechanics,
    write_npz,
    write_parquet,
    write_pieces,
    write_ply,
)

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations
from mpmgis.exchange.frame_list import list_frames
from mpmgis.exchange.readers.reader_list import FOREIGN
from mpmgis.system.errors import MpmgisError

TOLD = Declarations(axes=("e", "n", "u"), origin=(0.0, 0.0, 0.0), density=1500.0, particle_volume=1.0, frame_step=1.0)


def read_all(path, reader):
    """Read every frame in a file or folder with a reader."""
    terms = Declarations(**{**vars(TOLD), "reader": reader})
    return [entry.read() for entry in list_frames([path], terms)]


def refusal(path, reader):
    """The one line that a file is refused with."""
    with pytest.raises(MpmgisError) as caught:
        read_all(path, reader)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def spoilt(path, old, new, count=1):
    """Put other bytes in the place of some that must be there."""
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, count))


def data_files(folder):
    """What a writer wrote, without settings and lists."""
    skipped = (".json", ".pvd", ".pvtu")
    return [path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix not in skipped]


@pytest.mark.parametrize("name", CODES)
def test_any_damage_is_answered_in_a_line_or_does_no_harm(name, tmp_path):
    """Cut, blanked, flipped, words for numbers: 40 times a code; what is read in spite of it is finite."""
    reader, write, _ = CODES[name]
    write(tmp_path)
    files, chance = data_files(tmp_path), random.Random(name)
    refused = 0
    for _ in range(40):
        path = chance.choice(files)
        sound = path.read_bytes()
        raw = bytearray(sound)
        at = chance.randrange(min(len(raw), chance.choice([300, 3000, len(raw)])))
        match chance.choice(["cut", "flip", "blank", "word", "count"]):
            case "cut":
                raw = raw[:at]
            case "flip":
                raw[at] ^= 1 << chance.randrange(8)
            case "blank":
                raw[at : at + 20] = bytes(20)
            case "word":
                raw[at : at + 4] = b"word"
            case "count":
                raw = bytearray(
                    re.sub(rb"\b6[0-9]\b", chance.choice([b"61", b"999999999999", b"-1", b"0"]), raw, count=1)
                )
        path.write_bytes(raw)
        try:
            for frame in read_all(path, reader):
                assert np.isfinite(frame.particles.position).all() and len(frame.particles) > 0
        except MpmgisError as error:
            refused += 1
            assert "\n" not in str(error) and len(str(error)) < 1000
        path.write_bytes(sound)
    assert refused >= 8  # most damage is seen


def test_frames_that_claim_more_than_the_machine_holds_take_no_memory(tmp_path):
    vtk_xml(tmp_path / "a_0.vtu", 0, "raw")
    spoilt(tmp_path / "a_0.vtu", b'NumberOfPoints="60"', b'NumberOfPoints="600000000000"')
    kratos_vtk(tmp_path / "b_0_1.vtk", 0)
    spoilt(tmp_path / "b_0_1.vtk", b"POINTS 60", b"POINTS 600000000000")
    (tmp_path / "c.dump").write_text(dump_step(0, 0).replace("ATOMS\n60", "ATOMS\n600000000000"))
    with h5py.File(tmp_path / "d.h5", "w") as file:  # stored nowhere: a fill value stands for all of it
        names = [f"{group}_{axis}" for group in ("coord", "velocity") for axis in "xyz"] + ["mass"]
        file.create_dataset("table", (10**12,), np.dtype([(name, "f8") for name in names]), chunks=True)
    tracemalloc.start()
    for path, reader in (("a_0.vtu", "vtk"), ("b_0_1.vtk", "kratos"), ("c.dump", "lammps"), ("d.h5", "cbgeo")):
        refusal(tmp_path / path, reader)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


# ------------------------------------------------------------------------------------------------------- one by one


def test_pieces_that_are_missing_are_named(tmp_path):
    cbgeo_table(tmp_path / "particles-0_3-0500.h5", 1, slice(0, 20))
    cbgeo_table(tmp_path / "particles-2_3-0500.h5", 1, slice(20, 60))
    assert "2 of 3 pieces of step 500 are there" in refusal(tmp_path, "cbgeo")
    assert "rank 1 is missing" in refusal(tmp_path, "cbgeo")
    kratos_vtk(tmp_path / "MPM_Material_1_40.vtk", 0)
    assert "0 is missing" in refusal(tmp_path / "MPM_Material_1_40.vtk", "kratos")
    (tmp_path / "dump.proc-1.50.LAMMPS").write_text(dump_step(0, 0))
    assert "rank 0 is missing" in refusal(tmp_path / "dump.proc-1.50.LAMMPS", "lammps")


def rename(file):
    """The table under another name."""
    file.move("table", "other")


def link(file):
    """The table in another file."""
    del file["table"]
    file["table"] = h5py.ExternalLink("other.h5", "/table")


def numbers(file):
    """Numbers instead of records."""
    del file["table"]
    file["table"] = np.zeros((3, 3))


def one_field(file):
    """Records of x alone."""
    del file["table"]
    file.create_dataset("table", (3,), np.dtype([("coord_x", "f8")]))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (rename, "no table of records"),
        (link, "no table of records"),
        (numbers, "no table of records"),
        (one_field, "lacks coord_y"),
    ],
)
def test_tables_that_are_none_are_refused(change, word, tmp_path):
    path = tmp_path / "particles0500.h5"
    cbgeo_table(path, 1)
    cbgeo_table(tmp_path / "other.h5", 1)
    with h5py.File(path, "r+") as file:
        change(file)
    assert word in refusal(path, "cbgeo")


def test_settings_beside_the_files_that_are_damaged_are_named(tmp_path):
    cbgeo_table(tmp_path / "particles0500.h5", 1)
    (tmp_path / "mpm.json").write_text("{")
    assert "mpm.json is not readable JSON" in refusal(tmp_path / "particles0500.h5", "cbgeo")


def test_files_of_a_pair_that_do_not_belong_together_are_refused(tmp_path):
    write_anura3d(tmp_path)
    small = tmp_path / "small"
    small.mkdir()
    write_anura3d(small)
    path = small / "slide_MPScalar_001.vtk"
    text = (tmp_path / "slide_MPScalar_001.vtk").read_text()
    path.write_text(text.replace("62", "61"))
    assert "small" in refusal(small / "slide_MPVector_001.vtk", "anura3d")
    (small / "slide.CPS_002").write_text("$$TOTAL_TIME\nsoon\n$$TIME_PER_LOADSTEP\n1\n")
    assert "TOTAL_TIME is not a number" in refusal(small / "slide_MPVector_002.vtk", "anura3d")


def test_a_load_step_that_has_several_files_asks_for_their_times(tmp_path):
    write_anura3d(tmp_path)
    for kind in ("Scalar", "Vector"):
        path = tmp_path / f"slide_MP{kind}_001.vtk"
        path.rename(tmp_path / f"slide_MP{kind}_001000010.vtk")
        (tmp_path / f"slide_MP{kind}_001000020.vtk").write_bytes(
            (tmp_path / f"slide_MP{kind}_001000010.vtk").read_bytes()
        )
    terms = {**vars(TOLD), "frame_step": None}
    with pytest.raises(MpmgisError, match="its time"):
        list_frames([tmp_path], Declarations(**terms))
    entries = list_frames([tmp_path], Declarations(**{**terms, "times": (0.0, 1.0, 2.0, 3.0)}))
    assert [entry.path.name[-13:-4] for entry in entries][1:3] == ["001000010", "001000020"]


def test_entities_are_not_expanded(tmp_path):
    vtk_xml(tmp_path / "a_0.vtu", 0, "ascii")
    bomb = b'<!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>\n<VTKFile'
    spoilt(tmp_path / "a_0.vtu", b"<VTKFile", bomb)
    assert "document type" in refusal(tmp_path / "a_0.vtu", "vtk")
    write_pieces(tmp_path)
    spoilt(tmp_path / "slide.pvd", b"<VTKFile", bomb)
    assert "document type" in refusal(tmp_path / "slide.pvd", "vtk")


@pytest.mark.parametrize(
    ("form", "old", "new", "word"),
    [
        ("ascii", b'type="Float32"', b'type="Float99"', "no points"),
        ("ascii", b" 30.0 ", b" high ", "something else than numbers"),
        ("ascii", b'NumberOfPoints="60"', b'NumberOfPoints="61"', "expected 183"),
        ("ascii", b'NumberOfPoints="60"', b'NumberOfPoints="many"', "an integer"),
        ("ascii", b"</Points>", b"</Dots>", "not readable XML"),
        ("ascii", b"UnstructuredGrid", b"ImageData       ", "expected PolyData"),
        ("raw", b'NumberOfPoints="60"', b'NumberOfPoints="61"', "expected 732"),
        ("raw", b'header_type="UInt32"', b'header_type="UInt99"', "header_type"),
        ("raw", b'byte_order="LittleEndian"', b'byte_order="MiddleEndian"', "byte_order"),
        ("raw", b'offset="0"', b'offset="9999999"', "truncated"),
        ("raw", b'header_type="UInt32"', b'compressor="vtkLZ4DataCompressor"', "vtkLZ4DataCompressor"),
        ("binary", b'format="binary"', b'format="secret"', "format 'secret'"),
    ],
)
def test_vtk_files_that_contradict_themselves_are_refused(form, old, new, word, tmp_path):
    path = tmp_path / "a_0.vtu"
    vtk_xml(path, 0, form)
    spoilt(path, old, new, -1)
    assert word in refusal(path, "vtk")


def test_archives_that_unpack_to_more_than_their_size_are_stopped(tmp_path):
    """A bomb of zeros: 60 points in the header, a gigabyte in the blocks."""
    path = tmp_path / "a_0.vtu"
    vtk_xml(path, 0, "binary", packed=True)
    packed = zlib.compress(bytes(50_000_000), 9)
    head = base64.b64encode(struct.pack("<4I", 1, 720, 0, len(packed)))
    text = path.read_bytes()
    begin = text.index(b'format="binary">') + len(b'format="binary">')
    path.write_bytes(text[:begin] + head + base64.b64encode(packed) + text[text.index(b"</DataArray>") :])
    tracemalloc.start()
    read_all(path, "vtk")  # zeros, but as many as it says
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()
    spoilt(path, head, base64.b64encode(struct.pack("<4I", 1, 1 << 31, 0, len(packed))))
    assert "decompresses to 2147483648 bytes, expected 720" in refusal(path, "vtk")


def test_a_list_names_what_is_not_there(tmp_path):
    write_pieces(tmp_path)
    (tmp_path / "slide_1_0.vtu").unlink()
    assert "slide_1.pvtu lists 1 missing files, the first slide_1_0.vtu" in refusal(tmp_path / "slide.pvd", "vtk")
    spoilt(tmp_path / "slide.pvd", b'timestep="0.5"', b'timestep="noon"')
    assert "'noon' is not a time" in refusal(tmp_path / "slide.pvd", "vtk")


def test_a_particle_file_without_ids_is_no_file_of_mpm_geomechanics(tmp_path):
    write_mpm_geomechanics(tmp_path)
    for path in tmp_path.glob("*.vtu"):
        spoilt(path, b"Particle Id", b"Particle No")
    assert "no 'Particle Id'" in refusal(tmp_path / "particles_1.vtu", "mpm-geomechanics")


class Trap:
    """Unpickled it would make a file."""

    def __reduce__(self):
        return (open, (str(Path("ran").absolute()), "w"))


def test_archives_are_never_unpickled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_npz(tmp_path)
    position = np.empty((60, 3), object)
    position[...] = Trap()
    np.savez(tmp_path / "trap.npz", position=position, velocity=cloud(0)[1], t_current=0.0, body_num=60)
    assert "lacks position" in refusal(tmp_path / "trap.npz", "geotaichi")
    (tmp_path / "raw.npz").write_bytes(pickle.dumps(Trap()))
    assert "not a readable .npz" in refusal(tmp_path / "raw.npz", "npz")
    assert main(["info", str(tmp_path / "trap.npz")]) in (0, 2)
    assert not (tmp_path / "ran").exists()


def test_archives_with_wrong_sizes_are_refused(tmp_path):
    write_geotaichi(tmp_path)
    path = tmp_path / "MPMParticle000001.npz"
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["position.npy"] = members["position.npy"].replace(b"(66, 3)", b"(9999999999, 3)")[:-7]
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    assert "position.npy" in refusal(path, "geotaichi")


def swap(old, new, count=1):
    """A damage of a text: other characters in the place of some that must be there."""

    def damage(text):
        assert old in text
        return text.replace(old, new, count)

    return damage


def in_row_20(change):
    """A damage of a table: of its 20th row alone."""
    return lambda text: "\n".join(change(row) if k == 20 else row for k, row in enumerate(text.splitlines()))


def head_and(count, change=str):
    """A damage of a table: its head, changed, and its first rows."""

    def damage(text):
        head, *rows = text.splitlines()
        return "\n".join([change(head), *rows[:count], ""])

    return damage


TEXTS = [  # reader, damage, what the line says
    ("csv", in_row_20(lambda row: row + ",7"), "Expected 9 columns, got 10"),
    ("csv", in_row_20(swap("3.0", "three")), "three"),
    ("csv", in_row_20(swap("3.0", "")), "NaN or infinite"),
    ("csv", head_and(1, swap("vx", "x")), "occurs twice"),
    ("csv", head_and(0), "Empty CSV file"),
    ("csv", head_and(1, swap("vx", "up")), "the columns of vx (--columns vx=COLUMN,..; it has id, time"),
    ("lammps", lambda text: "ITEM: UNITS\nlj\n" + text, "units 'lj'"),
    ("lammps", lambda text: text[:-200], "60"),
    ("lammps", lambda text: text + "more\n", "a.dump"),
    ("lammps", swap("id type mass", "id id mass"), "names of its columns"),
    ("kratos-gid", swap("MP_DISPLACEMENT", "MP_ACCELERATION", -1), "no MP_DISPLACEMENT at 0 s"),
    ("kratos-gid", swap("\n66 ", "\n666 "), "lack 1 of 60 points, the first 666"),
    ("kratos-gid", lambda text: text[: text.rindex("End Values")], "truncated"),
    ("kratos-gid", swap("2.0", "two"), "something else than numbers"),
]


@pytest.mark.parametrize(("reader", "damage", "word"), TEXTS)
def test_texts_with_wrong_words_numbers_or_rows_are_refused(reader, damage, word, tmp_path):
    path = tmp_path / {"csv": "slide.csv", "lammps": "a.dump", "kratos-gid": "slide.post.res"}[reader]
    if reader == "csv":
        columns = table(0)
        rows = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
        path.write_text("\n".join(rows))
    elif reader == "lammps":
        path.write_text(dump_step(0, 0))
    else:
        write_kratos_gid(tmp_path)
    path.write_text(damage(path.read_text()))
    assert word in refusal(path, reader)


def test_results_without_their_points_are_refused(tmp_path):
    write_kratos_gid(tmp_path)
    (tmp_path / "slide.post.msh").unlink()
    assert "slide.post.msh" in refusal(tmp_path / "slide.post.res", "kratos-gid")


def test_a_parquet_with_rows_missing_or_text_for_numbers_is_refused(tmp_path):
    import pyarrow
    import pyarrow.parquet

    write_parquet(tmp_path)
    path = tmp_path / "slide.parquet"
    path.write_bytes(path.read_bytes()[:-9])
    assert "not a readable Parquet" in refusal(path, "parquet")
    columns = table(0) | {"x": [str(value) for value in table(0)["x"]]}
    pyarrow.parquet.write_table(pyarrow.table(columns), path)
    assert "the columns of x " in refusal(path, "parquet")


def test_a_text_ply_with_too_few_rows_is_refused(tmp_path):
    write_ply(tmp_path)
    path = tmp_path / "slide_50.ply"
    spoilt(path, b"element vertex 60", b"element vertex 61")
    message = refusal(path, "ply")
    assert "its list of vertices has" in message and "it is truncated or damaged" in message


def test_all_readers_refuse_folders_and_files_that_are_not_there(tmp_path):
    for name in FOREIGN:
        assert "no frame" in refusal(tmp_path, name)
        refusal(tmp_path / "none.vtk", name)


def test_json_of_another_kind_is_no_sidecar(tmp_path, capsys):
    write_npz(tmp_path)
    (tmp_path / "georef.json").write_text(json.dumps({"crs": "EPSG:32632"}))
    assert "expected 'mpmgis-georeference'" in refusal(tmp_path, "npz")
