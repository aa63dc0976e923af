"""The folder of an ensemble or a region: what is continued, refused, kept and never replaced."""

import pytest

from mpmgis.frames.many_runs_folder import ENSEMBLE, REGION, ManyRunsFolder, RunFiles, read_folder_record
from mpmgis.system.errors import FormatError, OutputError
from mpmgis.system.folder_lock import LOCK_FILE

KINDS = pytest.mark.parametrize("kind", [ENSEMBLE, REGION], ids=["ensemble", "region"])
OTHER = {
    ENSEMBLE: "holds an ensemble of another plan or scene; give another -o, or --overwrite to replace it (members that "
    "are in both are kept)",
    REGION: "holds a region of another scene, DTM or other areas; give another -o, or --overwrite (runs that are in "
    "both are kept)",
}


def begun(kind, path, digest="a", *runs):
    """A folder with a record, and results of runs."""
    folder = ManyRunsFolder(kind, path, digest)
    with folder.held():
        folder.write_record(state="running")
        for run in runs:
            files = RunFiles(folder.runs, run)
            files.write({"digest": run, "status": "finished"})
            files.maxima.touch()
    return folder


@KINDS
def test_a_folder_of_the_same_runs_is_continued_and_of_others_only_with_overwrite(tmp_path, kind):
    begun(kind, tmp_path / "out")
    assert read_folder_record(kind, tmp_path / "out")["state"] == "running"
    ManyRunsFolder(kind, tmp_path / "out", "a")
    with pytest.raises(OutputError) as refusal:
        ManyRunsFolder(kind, tmp_path / "out", "b")
    assert str(refusal.value) == f"{tmp_path / 'out'} {OTHER[kind]}"
    with ManyRunsFolder(kind, tmp_path / "out", "b", overwrite=True).held():
        pass


@KINDS
def test_only_runs_of_the_plan_are_kept_with_all_their_files(tmp_path, kind):
    folder = begun(kind, tmp_path / "out", "a", "11", "22")
    (folder.runs / "11").mkdir()
    for name in ("11_max.tif.aux.xml", "22_deposit.tif", ".33.json.part1"):
        (folder.runs / name).touch()
    folder.keep_runs(["11"])
    assert {path.name for path in folder.runs.iterdir()} == {"11", "11.json", "11_max.tif", "11_max.tif.aux.xml"}


@KINDS
@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_with_something_else_is_refused(tmp_path, kind, overwrite):
    (tmp_path / "thesis.txt").write_text("mine")
    for path, words in ((tmp_path, f"is not the folder of {kind.what}"), (tmp_path / "thesis.txt", "is a file")):
        with pytest.raises(OutputError, match=words):
            ManyRunsFolder(kind, path, "a", overwrite)
    (tmp_path / "locked").mkdir()
    (tmp_path / "locked" / LOCK_FILE).touch()
    ManyRunsFolder(kind, tmp_path / "locked", "a")


@KINDS
def test_a_record_that_cannot_be_read_is_refused(tmp_path, kind):
    for text in ("{", "[" * 100_000 + "]" * 100_000, "\0"):
        (tmp_path / kind.record).write_text(text)
        with pytest.raises(FormatError, match=f"{kind.record} cannot be read"):
            ManyRunsFolder(kind, tmp_path, "a")
    (tmp_path / kind.record).write_text("[]")
    with pytest.raises(OutputError, match="holds"):
        ManyRunsFolder(kind, tmp_path, "a")


@KINDS
@pytest.mark.parametrize("overwrite", [False, True])
def test_links_are_refused_under_every_name_that_is_used(tmp_path, kind, overwrite):
    (tmp_path / "victim.txt").write_text("mine")
    names = (LOCK_FILE, kind.record, *kind.tables, kind.runs, "maps", f"{kind.runs}/x")
    for number, name in enumerate(names):
        place = tmp_path / str(number)
        folder = begun(kind, place)
        if name == kind.runs:
            folder.runs.rmdir()
        (place / name).unlink(missing_ok=True)
        (place / name).symlink_to(tmp_path / "victim.txt")
        with pytest.raises(OutputError, match="is a link"):
            ManyRunsFolder(kind, place, "a", overwrite)
    (tmp_path / "whole").symlink_to(tmp_path / "0")
    with pytest.raises(OutputError, match="is a link"):
        ManyRunsFolder(kind, tmp_path / "whole", "a", overwrite)


@KINDS
def test_a_folder_with_an_input_under_a_name_that_is_used_is_refused(tmp_path, kind):
    folder = begun(kind, tmp_path / "out", "a", "11")
    folder.maps.mkdir()
    own = folder.path / "notes.txt"
    for path in (RunFiles(folder.runs, "11").maxima, folder.maps / "dtm.tif", folder.path / kind.tables[0], own):
        path.touch()
        if path == own:
            folder.refuse_inputs([path])
            continue
        with pytest.raises(OutputError, match="contains the input"):
            folder.refuse_inputs([tmp_path / "scene.toml", path])
