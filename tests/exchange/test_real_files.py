"""Files that other codes wrote themselves, in small runs of ours (real_files/, each with the input that made it), say
what those codes printed while they ran."""

import gzip
import shutil
from pathlib import Path

import numpy as np
import pytest

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations
from mpmgis.exchange.frame_list import list_frames
from mpmgis.system.errors import MpmgisError

REAL = Path(__file__).parent / "real_files"
LAMMPS = (  # its thermo lines: time [s], grains, mass [kg], centre [m], mean of vx and vz [m s-1]
    (0.0, 24, 150.7964474, (601.0420694, 5170.538196, 100.58922), (4.0, 0.0)),
    (0.15, 24, 150.7964474, (601.673775, 5170.538196, 100.4835257), (4.418547917, -1.400872385)),
    (0.3, 24, 150.7964474, (602.3380792, 5170.53964, 100.2311928), (4.316489606, -1.663772228)),
)
LIGGGHTS = (  # the same of its own; nothing is poured yet at 0
    (0.2, 12, 10.597639, (0.69356999, 0.54609742, 0.8135513)),
    (0.4, 21, 17.907078, (0.75449723, 0.52780243, 0.50351115)),
    (0.6, 26, 22.535691, (0.75844343, 0.50406269, 0.4541144)),
    (0.8, 28, 24.514895, (0.76211735, 0.49740679, 0.40723673)),
)
KRATOS = {  # kratos_slide.py, of Kratos' own points: time [s] -> centre [m], mean velocity [m s-1]
    0.0042: ((9.010756135, 11.0, 6.968640760), (3.0, 0.0, -0.935172562)),
    0.1008: ((9.220080337, 11.0, 6.927019258), (2.295791394, 0.0, -0.211846264)),
    0.2016: ((9.404656117, 11.0, 6.876938458), (2.261570871, 0.0, -0.962015916)),
}
KRATOS_MASS, KRATOS_DENSITY = 7517.020686, 1800.0


def frames_of(*names, **said):
    """The FrameEntries of some real files."""
    terms = {"axes": ("e", "n", "u"), "origin": (0.0, 0.0, 0.0)} | said
    return list_frames([REAL / name for name in names], Declarations(**terms))


def facts_of(entry):
    """(time, number, mass, centre, mean velocity) of a frame."""
    particles = entry.read().particles
    mass = particles.mass
    means = (mass @ values / mass.sum() for values in (particles.position, particles.velocity))
    return entry.time, entry.count, mass.sum(), *means


@pytest.mark.parametrize("name", ["unwrapped.dump", "shares.dump", "packed.dump.gz"])
def test_lammps_dumps_hold_what_its_thermo_printed(name):
    """Places as they are, as shares of a sheared box, and packed by LAMMPS itself."""
    step = {"frame_step": 1e-4} if name.startswith("packed") else {}
    entries = frames_of(f"lammps/{name}", **step)
    assert len(entries) == len(LAMMPS)
    for entry, (time, count, mass, centre, speed) in zip(entries, LAMMPS, strict=True):
        found = facts_of(entry)
        assert found[:2] == (pytest.approx(time), count)
        assert found[2] == pytest.approx(mass, rel=1e-8)
        np.testing.assert_allclose(found[3], centre, rtol=0, atol=2e-6)
        np.testing.assert_allclose(found[4][[0, 2]], speed, rtol=1e-7, atol=1e-9)


def test_grains_in_a_periodic_box_lie_where_the_dump_puts_them():
    """x y z are wrapped: whole edges of the sheared box apart from the unwrapped places, and nothing else."""
    wrapped, free = (
        entries[-1].read().particles for entries in (frames_of("lammps/box.dump"), frames_of("lammps/unwrapped.dump"))
    )
    moved = free.position[np.argsort(free.id)] - wrapped.position[np.argsort(wrapped.id)]
    edges = np.array([[2.0, 0.0, 0.0], [0.25, 1.0, 0.0], [0.0, 0.0, 2.0]])
    times = moved @ np.linalg.inv(edges)
    np.testing.assert_allclose(times, np.round(times), atol=1e-5)
    assert np.abs(np.round(times)).max() >= 1


def test_pieces_of_two_processes_are_one_frame_even_if_one_is_named(tmp_path):
    both, one = (frames_of(f"lammps/piece.{some}.3000.dump", frame_step=1e-4) for some in ("*", "1"))
    whole = frames_of("lammps/box.dump")[-1].read().particles
    for entries in (both, one):
        (entry,) = entries
        found = entry.read().particles
        order = np.argsort(found.id)
        np.testing.assert_allclose(found.position[order], whole.position[np.argsort(whole.id)], atol=1e-9)
        assert entry.time == pytest.approx(0.3)
    shutil.copy(REAL / "lammps" / "piece.1.3000.dump", tmp_path / "piece.2.3000.dump")
    shutil.copy(REAL / "lammps" / "piece.0.3000.dump", tmp_path)
    with pytest.raises(MpmgisError, match="the piece of rank 1 is missing"):
        frames_of(tmp_path, frame_step=1e-4)


def test_two_runs_side_by_side_are_no_pieces(tmp_path):
    for run in (1, 2):
        shutil.copy(REAL / "lammps" / "unwrapped.dump", tmp_path / f"run{run}.dump")
    changed = tmp_path / "run2.dump"
    changed.write_text(changed.read_text().replace(" 6.28318531 ", " 7.28318531 "))
    (entry, *_) = frames_of(tmp_path / "run1.dump")
    assert entry.count == 24
    (tmp_path / "run3.dump").write_text(changed.read_text()[:3000])  # which is being written
    assert len(frames_of(tmp_path / "run1.dump")) == 3
    (tmp_path / "run3.dump").unlink()
    with pytest.raises(MpmgisError, match="have the same time"):
        frames_of(tmp_path)


def test_a_step_that_a_restart_wrote_again_counts_once(tmp_path):
    text = (REAL / "lammps" / "unwrapped.dump").read_text()
    steps = ["ITEM: TIME\n" + part for part in text.split("ITEM: TIME\n")[1:]]
    path = tmp_path / "appended.dump"
    path.write_text("".join([steps[0], steps[1], "ITEM: UNITS\nsi\n", steps[1], steps[2]]))
    assert [entry.time for entry in frames_of(path)] == pytest.approx([0.0, 0.15, 0.3])
    (tmp_path / "first.dump").write_text(steps[0] + steps[1])
    (tmp_path / "second.dump").write_text(steps[1] + steps[2])
    entries = frames_of(tmp_path / "first.dump", tmp_path / "second.dump")
    assert [entry.time for entry in entries] == pytest.approx([0.0, 0.15, 0.3])


def test_steps_may_stand_in_any_order(tmp_path):
    text = (REAL / "lammps" / "unwrapped.dump").read_text()
    steps = ["ITEM: TIME\n" + part for part in text.split("ITEM: TIME\n")[1:]]
    path = tmp_path / "mixed.dump"
    path.write_text(steps[2] + steps[0] + steps[1])
    for entry, (time, _, _, centre, _) in zip(frames_of(path), LAMMPS, strict=True):
        assert entry.time == pytest.approx(time)
        np.testing.assert_allclose(facts_of(entry)[3], centre, rtol=0, atol=2e-6)


@pytest.mark.parametrize("cut", [7, 300, 1900])
def test_a_truncated_dump_names_the_way_to_its_complete_frames(cut, tmp_path):
    """Within the last number, within the rows, within the head of the last step."""
    whole = (REAL / "lammps" / "unwrapped.dump").read_bytes()
    path = tmp_path / "cut.dump"
    path.write_bytes(whole[:-cut])
    with pytest.raises(MpmgisError, match="truncated") as answer:
        frames_of(path)
    size = int(str(answer.value).split("head -c ")[1].split()[0])
    path.write_bytes(whole[:size])
    assert [entry.time for entry in frames_of(path)] == pytest.approx([0.0, 0.15])


def test_a_packed_dump_that_is_damaged_is_refused_in_a_line(tmp_path):
    packed = (REAL / "lammps" / "packed.dump.gz").read_bytes()
    path = tmp_path / "packed.dump.gz"
    for content, word in (
        (packed[:-200], "truncated"),
        (packed[:700] + bytes(200) + packed[900:], "cannot be decompressed"),
        (gzip.compress(gzip.decompress(packed)[:-40]), "gzip -dc packed.dump.gz . head -c"),
    ):
        path.write_bytes(content)
        with pytest.raises(MpmgisError, match=word):
            frames_of(path, frame_step=1e-4)
    path.write_bytes(packed + packed)  # as a run that appends packs it: one behind the other
    assert len(frames_of(path, frame_step=1e-4)) == 3


def test_binary_dumps_and_those_without_velocities_are_answered(capsys):
    assert main(["info", str(REAL / "lammps" / "binary.bin")]) == 2
    assert "binary2txt" in capsys.readouterr().err
    assert main(["info", str(REAL / "lammps" / "atom.dump")]) == 0
    out = capsys.readouterr().out
    assert "the columns of vx, vy, vz" in out
    assert "5170.1, 5170.9" in out and "100.03, 100.56" in out  # shares of the box, as metres


@pytest.mark.parametrize("form", ["dump", "vtk"])
def test_liggghts_pours_grains_that_come_and_go(form):
    """Both of its forms; the first step holds none."""
    names = ["liggghts/all.dump"] if form == "dump" else [f"liggghts/{step}.vtk" for step in (0, 1000, 4000)]
    entries = frames_of(*names, frame_step=2e-4)
    wanted = LIGGGHTS if form == "dump" else (LIGGGHTS[0], LIGGGHTS[3])
    assert len(entries) == len(wanted)
    for entry, (time, count, mass, centre) in zip(entries, wanted, strict=True):
        found = facts_of(entry)
        assert found[:2] == (pytest.approx(time), count)
        assert found[2] == pytest.approx(mass, rel=2e-6)
        np.testing.assert_allclose(found[3], centre, rtol=0, atol=2e-6)
        density = found[2] / entry.read().particles.volume.sum()
        assert density == pytest.approx(2500, rel=1e-5)


def test_a_folder_of_liggghts_holds_grains_and_no_boxes(tmp_path):
    for path in (REAL / "liggghts").glob("*.vtk"):
        shutil.copy(path, tmp_path)
    assert [entry.path.name for entry in frames_of(tmp_path, frame_step=2e-4)] == ["1000.vtk", "4000.vtk"]
    with pytest.raises(MpmgisError, match=r"boundingBox_4000.vtk: 'DATASET RECTILINEAR_GRID'.*omit this file"):
        frames_of(tmp_path / "*.vtk", frame_step=2e-4)


def test_steps_without_any_grain_are_refused_where_there_were_some(tmp_path):
    text = (REAL / "liggghts" / "all.dump").read_text()
    empty = text[: text.index("ITEM: TIMESTEP", 5)]
    path = tmp_path / "left.dump"
    path.write_text(empty)
    with pytest.raises(MpmgisError, match="contains no particle"):
        frames_of(path, frame_step=2e-4)
    path.write_text(text + empty.replace("TIMESTEP\n0\n", "TIMESTEP\n5000\n"))
    with pytest.raises(MpmgisError, match="at 5000, but earlier frames do"):
        frames_of(path, frame_step=2e-4)


def test_kratos_gid_files_have_the_values_of_their_points():
    entries = list_frames([REAL / "kratos" / "slide.post.res"])
    assert [entry.time for entry in entries] == pytest.approx([0.0042, 0.2016])
    for entry in entries:
        _, count, mass, centre, speed = facts_of(entry)
        assert (count, entry.header.header["density"]) == (128, KRATOS_DENSITY)
        assert mass == pytest.approx(KRATOS_MASS, rel=1e-9)
        np.testing.assert_allclose(centre, KRATOS[entry.time][0], rtol=1e-9)
        np.testing.assert_allclose(speed, KRATOS[entry.time][1], rtol=1e-8, atol=1e-9)


def test_kratos_vtk_files_hold_the_same_in_float32_and_begin_as_they_were_given():
    entries = list_frames(sorted((REAL / "kratos").glob("*.vtk")))
    assert [entry.time for entry in entries] == pytest.approx([0.0, 0.1008, 0.2016])
    np.testing.assert_allclose(facts_of(entries[0])[4], (3.0, 0.0, -0.9), rtol=1e-6)  # along a plane that falls 0.3
    for entry in entries[1:]:
        _, count, mass, centre, speed = facts_of(entry)
        assert count == 128 and mass == pytest.approx(KRATOS_MASS, rel=1e-6)
        np.testing.assert_allclose(centre, KRATOS[round(entry.time, 7)][0], rtol=1e-6)
        np.testing.assert_allclose(speed, KRATOS[round(entry.time, 7)][1], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("kind", "share"), [("res", 0.4), ("res", 0.99), ("msh", 0.4)])
def test_kratos_gid_files_cut_short_are_refused_by_name(kind, share, tmp_path):
    for path in (REAL / "kratos").glob("slide.post.*"):
        shutil.copy(path, tmp_path)
    path = tmp_path / f"slide.post.{kind}"
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    terms = Declarations(axes=("e", "n", "u"), origin=(0.0, 0.0, 0.0), density=KRATOS_DENSITY)
    with pytest.raises(MpmgisError) as answer:
        for entry in list_frames([tmp_path / "slide.post.res"], terms):
            entry.read()
    assert path.name in str(answer.value) and "\n" not in str(answer.value)
