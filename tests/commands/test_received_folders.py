"""Folders from other people: no link in them is followed, no input is replaced, each refusal is one line."""

import os
import shutil
import stat
from contextlib import suppress

import pytest
import rasterio
import shapely
from slope_site import SCENE, contents, write_shapes, write_site

from mpmgis.commands.shell.main import main
from mpmgis.simulation import scene_run as run_module

SHORT = SCENE.replace("end_time = 30", "end_time = 4").replace("frame_interval = 5", "frame_interval = 2")
VICTIM = "years of work"


def can_link(folder):
    try:
        (folder / "probe").symlink_to(folder)
    except (OSError, NotImplementedError):
        return False
    (folder / "probe").unlink()
    return True


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A site with a finished run and a finished ensemble."""
    folder = write_site(tmp_path_factory.mktemp("made"))
    if not can_link(folder):
        pytest.skip("no links can be made here")
    (folder / "scene.toml").write_text(SHORT)
    assert main(["run", str(folder / "scene.toml"), "-q"]) == 0
    return folder


@pytest.fixture
def site(made, tmp_path):
    folder = shutil.copytree(made, tmp_path / "site")
    (tmp_path / "victim.txt").write_text(VICTIM)
    (tmp_path / "victims").mkdir()
    (tmp_path / "victims" / "frame_000000.h5").write_text(VICTIM)
    return folder


def everything(folder):
    """Path -> what it is, of all below `folder`, links not followed; a file by its node, too."""
    found = {}
    for place, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = os.path.join(place, name)
            status = os.lstat(path)
            content = os.readlink(path) if stat.S_ISLNK(status.st_mode) else None
            if stat.S_ISREG(status.st_mode):
                with open(path, "rb") as file:
                    content = file.read()
            found[path] = stat.S_IFMT(status.st_mode), content, None if name == ".lock" else status.st_ino
    return found


def refused(words, tmp_path, capsys, *parts):
    """Whether a command is refused in one line that holds `parts`, and changes nothing at all."""
    before = everything(tmp_path)
    capsys.readouterr()
    quiet = ["-q"] if words[0] == "run" and "-q" not in words else []
    code = main([*map(str, words), *quiet])
    err = capsys.readouterr().err
    assert code == 2 and err.count("\n") == 1, err
    for part in parts:
        assert part in err
    assert everything(tmp_path) == before
    return True


TAKEN = [".lock", "run.json", "scene.toml", "terrain.tif", "frame_000001.h5", "frame_000009.h5", "barriers.csv"]


@pytest.mark.parametrize("name", [*TAKEN, ".run.part4711.json"])
def test_a_link_in_a_runs_folder_is_refused(site, tmp_path, capsys, name):
    for target in ("../../victim.txt", "../../nowhere", "../../victims"):
        (site / "results" / name).unlink(missing_ok=True)
        (site / "results" / name).symlink_to(target)
        for option in ("--resume", "--overwrite"):
            assert refused(["run", site / "scene.toml", "-q", option], tmp_path, capsys, f"{name} is a link")


@pytest.mark.parametrize("name", [".lock", ".frame_.part1"])
def test_a_link_in_an_empty_folder_is_refused(site, tmp_path, capsys, name):
    (site / "new").mkdir()
    (site / "new" / name).symlink_to("../../victim.txt")
    for option in (["--resume"], ["--overwrite"], []):
        assert refused(["run", site / "scene.toml", "-o", site / "new", *option], tmp_path, capsys, "is a link")


def test_a_folder_that_is_a_link_is_refused(site, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    for name, target in (("got", "victims"), ("dangling", "nowhere"), ("gis", "empty")):
        (site / name).symlink_to(tmp_path / target)
    commands = [["run", site / "scene.toml", "-o", site / name] for name in ("got", "dangling")]
    commands += [["export-raster", site / "results", "-o", site / "gis", "--no-qgis"]]
    for words in commands:
        for option in (["--resume"], ["--overwrite"], []):
            if words[0] == "run" or option != ["--resume"]:
                assert refused([*words, *option], tmp_path, capsys, f"{words[3].name} is a link")


def test_a_lock_that_is_another_name_of_a_file_is_refused(site, tmp_path, capsys):
    try:
        os.link(tmp_path / "victim.txt", site / "results" / ".lock")
    except OSError:
        pytest.skip("no hard links can be made here")
    assert refused(["run", site / "scene.toml", "--resume"], tmp_path, capsys, ".lock", "another name")


def test_a_foreign_file_in_place_of_the_lock_is_refused(site, tmp_path, capsys):
    (site / "results" / ".lock").write_text("notes of mine")
    assert refused(["run", site / "scene.toml", "--overwrite"], tmp_path, capsys, ".lock was not written by mpmgis")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names here")
@pytest.mark.parametrize("name", TAKEN)
def test_a_pipe_in_a_runs_folder_blocks_nothing(site, tmp_path, capsys, name):
    (site / "results" / name).unlink(missing_ok=True)
    os.mkfifo(site / "results" / name)
    assert refused(["run", site / "scene.toml", "--resume"], tmp_path, capsys, f"{name} is a pipe")


def test_links_of_other_names_stay(site, tmp_path):
    (site / "results" / "notes").symlink_to(tmp_path / "victims")
    assert main(["run", str(site / "scene.toml"), "-q", "--overwrite"]) == 0
    assert (site / "results" / "notes").is_symlink()
    assert (tmp_path / "victims" / "frame_000000.h5").read_text() == VICTIM


# ------------------------------------------------------------------------------------------------------------- inputs


@pytest.mark.parametrize("by", ["its name", "a link", "a hard link", "dots"])
@pytest.mark.parametrize("name", ["scene.toml", "terrain.tif", "barriers.csv", "frame_000001.h5"])
def test_inputs_are_never_replaced(site, tmp_path, capsys, monkeypatch, name, by):
    """An input that lies where the run would write: the scene, the DTM, a CSV, an earlier frame."""
    results = site / "results"
    scene = SHORT
    given = {"its name": f"results/{name}", "dots": f"results/../results/{name}"}.get(by, f"other_{name}")
    if name == "terrain.tif":
        scene = scene.replace("dtm.tif", given)
    elif name == "barriers.csv":
        head = '[hydrograph]\nfile = "' + given + '"\nsource = "release.geojson"\n'
        scene = scene.replace('[release]\nsource = "release.geojson"\nthickness = 2.0\ndensity = 1000\n', head)
        (results / name).write_text("time,thickness\n0,1\n2,0\n")
    elif name == "frame_000001.h5":
        scene = scene.replace('source = "release.geojson"\nthickness = 2.0\ndensity = 1000', f'particles = "{given}"')
    if name != "scene.toml":
        (site / "own.toml").write_text(scene)
    else:
        (results / name).write_text(scene.replace("dtm.tif", "../dtm.tif").replace("release.g", "../release.g"))
    if by == "a link":
        (site / given).symlink_to(results / name)
    elif by == "a hard link":
        os.link(results / name, site / given)
    if name == "scene.toml" and by in ("a link", "a hard link"):  # paths are relative to where the scene lies
        (site / given).resolve().write_text(scene)
    path = site / (given if name == "scene.toml" else "own.toml")
    words = ["run", path, "-o", results, "--overwrite", "-q"]
    assert refused(words, tmp_path, capsys, name, "is an input of the run")
    monkeypatch.chdir(results)
    assert refused(["run", path, "-o", ".", "--overwrite", "-q"], tmp_path, capsys, "is an input of the run")


def test_sources_of_a_virtual_raster_are_inputs(site, tmp_path, capsys):
    with rasterio.open(site / "results" / "terrain.tif") as source:
        t, (rows, columns), crs = source.transform, source.shape, source.crs.to_wkt()
    (site / "dtm.vrt").write_text(
        f'<VRTDataset rasterXSize="{columns}" rasterYSize="{rows}"><SRS>{crs.replace("<", "")}</SRS>'
        f"<GeoTransform>{t.c},{t.a},0,{t.f},0,{t.e}</GeoTransform>"
        '<VRTRasterBand dataType="Float64" band="1"><SimpleSource>'
        '<SourceFilename relativeToVRT="1">results/terrain.tif</SourceFilename></SimpleSource></VRTRasterBand>'
        "</VRTDataset>"
    )
    (site / "scene.toml").write_text(SHORT.replace("dtm.tif", "dtm.vrt"))
    words = ["run", site / "scene.toml", "--overwrite", "-q"]
    assert refused(words, tmp_path, capsys, "terrain.tif", "is an input of the run")


def test_overwrite_replaces_no_files_that_no_run_wrote(site, tmp_path, capsys, monkeypatch):
    """`-o .` where a project of the user's own has files of these names."""
    (site / "project").mkdir()
    for name in ("scene.toml", "terrain.tif", "barriers.csv", "frame_000000.h5"):
        (site / "project" / name).write_text(VICTIM)
    monkeypatch.chdir(site / "project")
    words = ["run", "../scene.toml", "-o", ".", "--overwrite"]
    assert refused(words, tmp_path, capsys, "but there is no run.json")
    (site / "project" / "run.json").write_text('{"format": "of another program"}')
    assert refused(words, tmp_path, capsys, "but run.json is not the record of a run")


def test_overwrite_mixes_no_run_into_an_export(site, tmp_path, capsys):
    """Later commands would read the rasters of the old run."""
    export = site / "results_gis"
    (export / "rasters").mkdir(parents=True)
    (export / ".mpmgis").touch()
    (export / "rasters" / "results_max.tif").write_text(VICTIM)
    words = ["run", site / "scene.toml", "-o", export, "--overwrite", "-q"]
    assert refused(words, tmp_path, capsys, "contains other results of mpmgis", "give another -o")
    assert sorted(path.name for path in export.iterdir()) == [".mpmgis", "rasters"]


# ------------------------------------------------------------------------------------- the old run and the new one


class Stop(BaseException):
    """Of a test."""


@pytest.mark.parametrize("stop", [KeyboardInterrupt, Stop])
@pytest.mark.parametrize("when", ["first step", "first frame"])
def test_the_old_run_stays_until_the_new_one_has_a_frame(site, monkeypatch, when, stop):
    before = everything(site)
    (site / "scene.toml").write_text(SHORT.replace("mu = 0.2", "mu = 0.3"))
    before |= {key: value for key, value in everything(site).items() if key.endswith("scene.toml")}

    def end(*given, **named):
        assert (site / "results" / ".lock").exists()
        raise stop

    if when == "first step":
        monkeypatch.setattr(run_module.StageSequence, "__iter__", end)
    else:
        monkeypatch.setattr("mpmgis.frames.run_folder.write_frame", end)
    with pytest.raises((stop, SystemExit)):
        assert main(["run", str(site / "scene.toml"), "-q", "--overwrite"]) == 130
        raise SystemExit  # the command has told of Ctrl+C
    assert everything(site) == before


def test_the_new_run_is_as_if_there_had_been_none(site, tmp_path, monkeypatch):
    """Shorter than the old one: none of its frames is left, and each step of the change leaves whole files."""
    shorter = SHORT.replace("end_time = 4", "end_time = 2")
    (site / "scene.toml").write_text(shorter)
    replace, seen = os.replace, []

    def watched(part, path):
        seen.append(sorted(p.name for p in (site / "results").iterdir() if p.name[0] != "."))
        replace(part, path)

    monkeypatch.setattr(os, "replace", watched)
    assert main(["run", str(site / "scene.toml"), "-q", "--overwrite"]) == 0
    monkeypatch.undo()
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(tmp_path / "fresh")]) == 0
    names = sorted(path.name for path in (tmp_path / "fresh").iterdir())
    assert sorted(path.name for path in (site / "results").iterdir()) == names
    assert contents(site / "results") == contents(tmp_path / "fresh")
    old = ["frame_000000.h5", "frame_000001.h5", "frame_000002.h5", "run.json", "scene.toml", "terrain.tif"]
    assert seen[:5] == [old] * 5  # record, scene, terrain, first frame; then the record takes its place


@pytest.mark.parametrize("same", [True, False])
@pytest.mark.parametrize("at", range(8))
def test_a_change_of_runs_that_is_cut_short_is_continued(site, tmp_path, monkeypatch, at, same):
    """Killed at any file that goes or takes its name: `--resume` or, while the record is the old one, once more."""
    if not same:
        (site / "scene.toml").write_text(SHORT.replace("mu = 0.2", "mu = 0.3"))
    count = []

    class Killed(BaseException):
        pass

    replace, unlink = os.replace, os.unlink
    take_over = run_module.RunFolder._take_over

    def begun(folder):
        monkeypatch.setattr(os, "replace", cut_after(replace))
        monkeypatch.setattr("pathlib.Path.unlink", cut_after(unlink))
        take_over(folder)

    def cut_after(usual):
        def step(*given, **named):
            count.append(usual)
            if len(count) == at + 1:
                raise Killed
            return usual(*given)

        return step

    monkeypatch.setattr(run_module.RunFolder, "_take_over", begun)
    monkeypatch.setattr(run_module.RunFolder, "_drop_stage", lambda folder: None)
    with suppress(Killed):
        main(["run", str(site / "scene.toml"), "-q", "--overwrite"])
    monkeypatch.undo()
    if main(["run", str(site / "scene.toml"), "-q", "--resume"]):
        assert not same and main(["run", str(site / "scene.toml"), "-q", "--overwrite"]) == 0
    assert main(["run", str(site / "scene.toml"), "-q", "-o", str(tmp_path / "fresh")]) == 0
    assert contents(site / "results") == contents(tmp_path / "fresh")
    assert sorted(p.name for p in (site / "results").iterdir()) == sorted(
        p.name for p in (tmp_path / "fresh").iterdir()
    )


# ------------------------------------------------------------------------------------------------- other commands


SEED = "seed --dem dtm.tif --release release.geojson --thickness 2 --density 1000 -o"


@pytest.mark.parametrize(
    "words",
    [f"{SEED} out.h5", f"{SEED} out.csv", "timeseries results --at 400200,5100200 -o out.csv", "report results -o out"],
)
def test_an_answer_onto_a_link_is_refused(site, tmp_path, capsys, monkeypatch, words):
    monkeypatch.chdir(site)
    for target in ("victim.txt", "nowhere"):
        path = site / words.split()[-1]
        path.unlink(missing_ok=True)
        path.symlink_to(tmp_path / target)
        for option in ([], ["--overwrite"]):
            assert refused([*words.split(), *option], tmp_path, capsys, "is a link")


ENSEMBLE = ("--vary", "friction.mu=0.2,0.3", "--workers", "1", "-q")


@pytest.fixture(scope="module")
def ensembles(made):
    assert main(["ensemble", str(made / "scene.toml"), *ENSEMBLE]) == 0
    return made / "ensemble"


def test_a_link_in_an_ensembles_folder_is_refused(ensembles, site, tmp_path, capsys):
    place = site / "ensemble"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(ensembles, place)
    (place / "members").rename(tmp_path / "victims" / "kept")
    (place / "members").symlink_to(tmp_path / "victims" / "kept")
    words = ["ensemble", site / "scene.toml", *ENSEMBLE, "--percentiles", "50", "--overwrite"]
    assert refused(words, tmp_path, capsys, "is a link")


def test_inputs_in_the_folder_of_many_runs_are_never_replaced(ensembles, site, tmp_path, capsys):
    shutil.rmtree(site / "ensemble", ignore_errors=True)
    shutil.copytree(ensembles, site / "ensemble")
    (site / "study").mkdir()
    (site / "study" / ".mpmgis").touch()
    ensemble, study = ["ensemble", site / "scene.toml", *ENSEMBLE], ["study", site / "scene.toml", "-q", "--yes"]
    for words, where in ((ensemble, "ensemble/members"), (ensemble, "ensemble/maps"), (study, "study")):
        shutil.copy(site / "dtm.tif", site / where / "dtm.tif")
        (site / "scene.toml").write_text(SHORT.replace("dtm.tif", f"{where}/dtm.tif"))
        assert refused([*words, "--overwrite"], tmp_path, capsys, "contains the input")


def test_a_release_beside_its_parts_is_an_input(site, tmp_path, capsys):
    """The parts of a shapefile have its stem."""
    write_shapes(site / "results" / "barriers.shp", [shapely.box(60, 150, 160, 250)])
    (site / "results" / "barriers.csv").write_text("kept beside it")
    (site / "scene.toml").write_text(SHORT.replace("release.geojson", "results/barriers.shp"))
    words = ["run", site / "scene.toml", "--overwrite", "-q"]
    assert refused(words, tmp_path, capsys, "barriers.csv", "is an input of the run")
