"""Every code's files, as an independent writer makes them, come in as the particles that they hold."""

import json
import pickle

import numpy as np
import pytest
from third_party_writers import CODES, COUNT, DENSITY, MASS, TIMES, VOLUME, cloud, write_anura3d, write_geotaichi

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations
from mpmgis.exchange.frame_list import list_frames
from mpmgis.exchange.readers.reader_list import OWN, reader_of

EAST, NORTH = 600000.0, 5170000.0


def terms_of(options, **more):
    """Declarations for options of the command line."""
    names = {"--density": "density", "--dt": "frame_step", "--particle-volume": "particle_volume"}
    said = {names[option]: float(value) for option, value in zip(options[::2], options[1::2], strict=True)}
    return Declarations(**{"axes": ("e", "n", "u"), "origin": (EAST, NORTH, 0.0), **said, **more})


@pytest.mark.parametrize("name", CODES)
def test_frames_are_what_was_written(name, tmp_path):
    reader, write, options = CODES[name]
    entries = list_frames(write(tmp_path), terms_of(options))
    assert [entry.time for entry in entries] == pytest.approx(TIMES)
    assert {entry.reader for entry in entries} == {reader}
    for k, entry in enumerate(entries):
        frame = entry.read()
        order = np.argsort(frame.particles.id)
        place, velocity = cloud(k)
        np.testing.assert_allclose(frame.particles.position[order], place, rtol=1e-4 if reader[:5] == "mpm-g" else 1e-6)
        np.testing.assert_allclose(frame.particles.velocity[order], velocity, rtol=1e-4, atol=1e-6)
        np.testing.assert_array_equal(frame.particles.id[order], np.arange(COUNT) + 7)
        mass = DENSITY * VOLUME if name in ("liggghts", "mpm-geomechanics") else MASS
        np.testing.assert_allclose(frame.particles.mass, mass, rtol=1e-6)
        np.testing.assert_allclose(frame.particles.volume, mass / DENSITY, rtol=1e-6)
        assert frame.origin == (EAST, NORTH, 0.0) and frame.header["density"] == DENSITY


@pytest.mark.parametrize("name", CODES)
def test_the_reader_is_found_by_content_and_info_lists_missing_quantities(name, tmp_path, capsys):
    reader, write, options = CODES[name]
    (path,) = write(tmp_path)
    assert main(["info", "--json", str(path)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["reader"], facts["n"], facts["frames"]) == (reader, COUNT, 3)
    assert [row["n"] for row in facts["series"]] == [COUNT] * 3
    asked = " ".join(facts["to_be_told"])
    assert "--axes" in asked and "--origin" in asked
    for option in ("--density", "--particle-volume"):
        assert (option in asked) == (option in options)
    assert ("--dt" in asked) == ("--dt" in options)
    assert facts["mass"] is None or facts["mass"] == pytest.approx(COUNT * MASS)


def test_no_reader_takes_what_is_not_its_own(tmp_path):
    """Each writer's files are known by one reader alone, and by no other even where that is asked first."""
    for name, (reader, write, _) in CODES.items():
        folder = tmp_path / name.replace(",", "").replace(" ", "_")
        folder.mkdir()
        write(folder)
        found = {reader_of(path) for path in folder.rglob("*") if path.is_file()}
        assert reader in found
        assert found <= {reader, OWN, "vtk"}, (name, found)


@pytest.mark.parametrize("name", CODES)
def test_frames_can_be_sent_to_another_process_and_read_there(name, tmp_path):
    _, write, options = CODES[name]
    entry = list_frames(write(tmp_path), terms_of(options))[1]
    sent = pickle.dumps(entry)
    assert len(sent) < 20_000
    np.testing.assert_array_equal(pickle.loads(sent).read().particles.position, entry.read().particles.position)


@pytest.mark.parametrize(
    "code", ["cbgeo", "kratos", "geotaichi", "anura3d", "lammps", "npz", "hdf5", "parquet", "vtk", "ply"]
)
def test_a_file_of_another_kind_is_refused_by_each_reader_in_a_line(code, tmp_path, capsys):
    for name, content in (("text.txt", b"nothing of this\n" * 50), ("bytes.bin", bytes(range(256)) * 20)):
        (tmp_path / name).write_bytes(content)
        assert main(["info", str(tmp_path / name), "--reader", code]) == 2
        line = capsys.readouterr().err
        assert line.count("\n") == 1 and name in line


def test_quasi_static_runs_of_anura3d_number_their_time_steps(tmp_path):
    write_anura3d(tmp_path)
    for path in tmp_path.glob("*.vtk"):
        path.rename(path.with_name(f"{path.stem[:-3]}000{path.stem[-3:]}.vtk"))
    entries = list_frames([tmp_path], terms_of(("--density", f"{DENSITY}", "--dt", "0.5")))
    assert [(entry.source.number, entry.time, entry.count) for entry in entries] == [
        (k, TIMES[k], COUNT + 2) for k in range(3)
    ]


def test_geotaichi_before_it_had_ids_counts_rows(tmp_path):
    write_geotaichi(tmp_path)
    for path in tmp_path.glob("*.npz"):
        with np.load(path, allow_pickle=True) as archive:
            members = {name: archive[name] for name in archive.files if name != "particleID"}
        np.savez(path, **members)
    entry = list_frames([tmp_path], terms_of(("--density", f"{DENSITY}")))[1]
    assert entry.reader == "geotaichi"
    np.testing.assert_array_equal(entry.read().particles.id, np.arange(COUNT))
    np.testing.assert_allclose(entry.read().particles.position, cloud(1)[0])
