"""The toolbox's forms without any QGIS: the options they pass are the command's own, the scenes they write sound."""

import argparse
import ast
import functools
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from mpmgis_qgis import command, forms, restored_files, scene_form, table_page
from mpmgis_qgis import command as plugin_command

from mpmgis.commands.plugin_forms import plugin_forms
from mpmgis.commands.shell.main import main
from mpmgis.commands.shell.parser import add_arguments
from mpmgis.commands.verb import verb_names, verb_of
from mpmgis.laws import friction
from mpmgis.maps.averaging.band_products import PRODUCTS, choose_products
from mpmgis.results.hazard.guideline_files import read_guidelines
from mpmgis.results.hazard.hazard_files import read_matrices
from mpmgis.scene import read_scene

NAMES = tuple(read_guidelines()), tuple(read_matrices())
DATA = json.loads(json.dumps(plugin_forms(*NAMES)))  # as the plugin has it from its zip
ROWS = tuple(map(forms.verb_of, DATA["forms"]))
SCENE_FIELDS = scene_form.fields(DATA["scene"])
PLUGIN = Path(forms.__file__).parent
VALUES = {
    forms.RASTER: "dtm.tif",
    forms.POLYGONS: "area.gpkg|layername=area",
    forms.LINES: "line.shp",
    forms.POINTS: "points.shp",
    forms.FILE: "a file.h5",
    forms.FOLDER: "results",
    forms.NEW_FILE: "out.h5",
    forms.NEW_FOLDER: "out",
    forms.NUMBER: 1.5,
    forms.INTEGER: 4,
    forms.TEXT: "1",
    forms.SWITCH: True,
    forms.CRS: "EPSG:32632",
    forms.FILES: ["a.h5", "b.h5"],
    forms.TEXTS: ["friction.mu=0.1:0.2", "release.density=300,400"],
    forms.PLACE: "place.geojson",
    forms.EXTENT: "1,2,3,4.5",
    forms.COLUMN: "frequency",
    forms.ANY_COLUMN: "years",
    forms.SCENARIOS: ["30=results_30", "100=results_100"],
}
TYPED = {
    "VELOCITY": "-1,2",
    "ORIGIN": "600000,5170000,0",
    "AXES": "e,u,-n",
    "COLUMNS": "mass=m",
    "TIMES": "0,1",
    "LAYERS": "0,1,2",
    "AT_TIMES": "2,4",
    "TOLERATE": 0.2,
    "WINDOW": "1,2,3,4.5",
    "TO_CRS": "auto",
}
NAMED_BY_THE_PIPELINE = {  # the parser takes any text there, and the pipeline knows which
    ("intensity", "GUIDELINE"): tuple(read_guidelines()),
    ("report", "MAP"): tuple(read_matrices()),
}
# to SPACING of `seed` and to DEPTH of `path`, of which the commands take one
ALTERNATIVES = {"PER_CELL", "COUNT", "PRESSURE", "SPEED"}


def parser_of(row):
    return parser_of_verb(row.verb)


@functools.cache
def parser_of_verb(verb):
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_arguments(parser, verb_of(verb))
    return parser


def example(field):
    """A value of the field that is not its default."""
    if field.kind == forms.CHOICE:
        return next(choice for choice in field.choices if choice != field.default)
    if field.kind == forms.CHOICES:
        return list(field.choices[:2])
    return TYPED.get(field.name, VALUES[field.kind])


def form_of(identifier):
    return next(row for row in ROWS if row.identifier == identifier)


def option_of(parser, field):
    return next(action for action in parser._actions if field.option in action.option_strings)


CASES = [
    pytest.param(row, field, id=f"{row.identifier}-{field.name}")
    for row in ROWS
    for field in row.fields
    if field.option
]


@pytest.mark.parametrize(("row", "field"), CASES)
def test_each_option_is_the_commands_own(row, field):
    action = option_of(parser_of(row), field)
    if field.kind == forms.SWITCH:
        assert action.nargs == 0 and field.default is False
        return
    assert action.nargs is None
    if field.kind in forms.SEVERAL:
        assert isinstance(action, argparse._AppendAction)
    if field.kind == forms.CHOICE:
        assert set(field.choices) == set(action.choices or NAMED_BY_THE_PIPELINE[row.verb, field.name])


@pytest.mark.parametrize(("row", "field"), CASES)
def test_a_default_in_the_form_is_the_commands_default(row, field):
    action = option_of(parser_of(row), field)
    if field.default is None or (row.verb, field.name) == ("seed", "DENSITY"):  # None there: the verb says it aloud
        usual_name = field.kind == forms.NEW_FOLDER and not field.optional  # in the folder of a terminal
        assert not action.default or usual_name
        return
    if field.kind == forms.SWITCH:
        assert action.default is not action.const
        return
    assert (action.type or str)(forms.text(field.default)) == action.default


def test_every_verb_is_there_or_left_out_for_a_reason():
    left_out = DATA["left_out_verbs"]
    assert {row.verb for row in ROWS}.isdisjoint(left_out)
    assert {row.verb for row in ROWS} | set(left_out) == set(verb_names())
    assert all(left_out.values())


@pytest.mark.parametrize("verb", sorted({row.verb for row in ROWS}))
def test_every_option_is_there_or_left_out_for_a_reason(verb):
    asked = {field.option for row in ROWS for field in row.fields if row.verb == verb}
    left_out = {option: why for of_verb, option, why in DATA["left_out_options"] if of_verb == verb}
    (row, *_) = [row for row in ROWS if row.verb == verb]
    options = [action.option_strings for action in parser_of(row)._actions if action.option_strings]
    not_asked = [names[-1] for names in options if names[-1] != "--help" and not asked & set(names)]
    assert set(not_asked) == set(left_out) and not asked & set(left_out)
    assert all(left_out.values())


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.identifier)
def test_the_parser_takes_a_form_that_is_filled_in(row):
    left_out = {*ALTERNATIVES, *row.one_of[1:]}
    values = {field.name: example(field) for field in row.fields if field.option != "" and field.name not in left_out}
    given = forms.arguments(row.fields, values)
    named = [word.split("=")[0] for word in given if word.startswith("--")]
    given_as = [
        field.option
        for field in row.fields
        if field.option and field.name in values
        for _ in range(2 if field.kind in forms.SEVERAL else 1)
    ]
    assert named == given_as
    parser_of(row).parse_args(given)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.identifier)
def test_the_parser_takes_a_form_with_only_what_must_be_given(row):
    needed = {field.name: example(field) for field in row.fields if field.option != "" and not field.optional}
    needed = {name: value for name, value in needed.items() if value is not True}
    needed |= {name: example(field) for field in row.fields for name in row.one_of[:1] if field.name == name}
    parser_of(row).parse_args(forms.arguments(row.fields, needed))


def test_what_is_not_given_or_as_it_is_anyway_is_not_passed():
    export = form_of("exportraster")
    values = {field.name: field.default for field in export.fields} | {"FRAMES": "a b", "CELL": "", "COG": True}
    assert forms.arguments(export.fields, values) == ["a b", "--cog"]


@pytest.mark.parametrize(
    "form", [row.fields for row in ROWS] + [SCENE_FIELDS], ids=[r.identifier for r in ROWS] + ["form"]
)
def test_forms_are_sound(form):
    names = [field.name for field in form]
    assert len(set(names)) == len(names)
    for field in form:
        assert field.kind in forms.KINDS
        assert field.name == field.name.upper() and field.label[0] == field.label[0].strip()
        assert bool(field.choices) == (field.kind in (forms.CHOICE, forms.CHOICES))
        assert field.default is None or field.kind != forms.CHOICE or field.default in field.choices
        assert field.optional or not field.advanced


@pytest.mark.parametrize(
    "form", [row.fields for row in ROWS] + [SCENE_FIELDS], ids=[r.identifier for r in ROWS] + ["form"]
)
def test_every_field_has_help_and_every_number_has_a_unit(form):
    for field in form:
        assert len(field.help) > 8 and field.help.endswith("."), f"{field.name}: {field.help!r}"
        if field.kind == forms.NUMBER:
            assert re.search(r"\[[^\]]+\]|[Mm]etres|[Ss]econds|%|[Nn]umber", f"{field.label} {field.help}"), field.name


def test_titles_are_short_and_their_own():
    titles = [row.title for row in ROWS] + [scene_form.TITLE]
    assert len(set(titles)) == len(titles)
    assert all(len(title) <= 45 and " " in title for title in titles)
    assert all(len(row.help) > len(row.title) for row in ROWS)


def test_algorithms_have_names_of_their_own():
    names = [row.identifier for row in ROWS] + [scene_form.IDENTIFIER]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch("[a-z]+", name) for name in names)


def filled(**more):
    return {field.name: field.default for field in SCENE_FIELDS} | {"DEM": "dtm.tif", "RELEASE": "r.gpkg"} | more


def test_the_form_writes_the_scene_that_was_meant(tmp_path):
    path = tmp_path / "scene.toml"
    name = 'C:\\maps\\Gro\u00dfes "Tal".tif'
    path.write_text(scene_form.scene_text(filled(DEM=name, THICKNESS=" 1.5 ", CELL_SIZE=4.0)), encoding="utf-8")
    scene = read_scene(path)
    assert str(scene.terrain.dem).endswith(name)
    assert scene.release.thickness == 1.5 and scene.release.density == 1000
    assert scene.numerics.cell_size == 4
    assert (scene.output.end_time, scene.output.frame_interval, scene.output.maxima) == (300, 2, True)


def test_the_form_has_the_limits_of_the_scene():
    limits = {field.name: (field.least, field.most) for field in SCENE_FIELDS if field.kind == forms.NUMBER}
    laws = friction.LAWS["Voellmy"][1]
    assert limits.pop("MU") == (laws["mu"].smallest, laws["mu"].largest)
    assert limits.pop("XI") == (laws["xi"].smallest, laws["xi"].largest)
    assert limits == {"DENSITY": (1, 30000), "CELL_SIZE": (0, None), "END_TIME": (0, None), "FRAME_INTERVAL": (0, None)}
    density = next(field for field in SCENE_FIELDS if field.name == "DENSITY")
    assert (density.label, density.default) == ("Density [kg m-3]", 1000)
    seeded = next(field for field in form_of("seed").fields if field.name == "DENSITY")
    assert seeded.help == density.help + " Empty: 1000."
    words = scene_form.help_text(DATA["scene"])
    assert "snow avalanche mu 0.15 to 0.4, xi 1000 to 3000 m s-2; debris flow mu 0.05 to 0.2, xi 100 to 500" in words


def test_what_is_left_empty_is_left_to_the_command(tmp_path):
    assert 'law = "Voellmy"' in scene_form.scene_text(filled(XI=0.0))  # which the command refuses
    text = scene_form.scene_text(filled(THICKNESS="", XI=None))
    assert "thickness" not in text and "cell_size" not in text and 'law = "Coulomb"' in text
    assert 'thickness = "d0"' in scene_form.scene_text(filled(THICKNESS="d0"))
    assert 'thickness = "d0"' in scene_form.scene_text(filled(THICKNESS_COLUMN="d0"))
    for name, (mu, xi) in scene_form.PRESETS.items():
        text_of_preset = scene_form.scene_text(filled(PRESET=name, MU=0.9, XI=None))
        assert f"mu {forms.text(mu)} and xi {forms.text(xi)} (" in name and f"# Friction: {name}\n" in text_of_preset
        assert tomllib.loads(text_of_preset)["friction"] == {"law": "Voellmy", "mu": mu, "xi": xi}
    path = tmp_path / "scene.toml"
    path.write_text(text)
    read_scene(path)


def test_the_scene_of_the_form_is_decided_by_the_command(tmp_path, capsys):
    rows, columns = np.indices((30, 40))
    with rasterio.open(
        tmp_path / "dtm.tif",
        "w",
        driver="GTiff",
        height=30,
        width=40,
        count=1,
        dtype="float32",
        crs="EPSG:32632",
        transform=Affine(10, 0, 500_000, 0, -10, 5_200_300),
    ) as dtm:
        dtm.write((800 - 5.0 * columns + 0.0 * rows).astype("float32"), 1)
    (tmp_path / "r.geojson").write_text(
        '{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": '
        "[[[9.0008, 46.956], [9.0015, 46.956], [9.0015, 46.9552], [9.0008, 46.9552], [9.0008, 46.956]]]}}"
    )
    path = tmp_path / "scene.toml"
    path.write_text(scene_form.scene_text(filled(RELEASE="r.geojson", THICKNESS="2")))
    assert main(["effects", str(path)]) == 0
    assert "Voellmy: mu = 0.2, xi = 1000" in capsys.readouterr().out


def test_lines_come_whole_whatever_the_pieces():
    lines = plugin_command.Lines()
    assert lines.add(b"t = 1.0 of") == []
    assert lines.add(b" 4 s\r\nnext\rframe 1") == ["t = 1.0 of 4 s", "next"]
    assert lines.end() == ["frame 1"]


def test_letters_cut_in_two_are_put_together():
    lines, data = plugin_command.Lines(), "Stra\u00dfe\n".encode()
    assert lines.add(data[:5]) == []
    assert lines.add(data[5:]) == ["Stra\u00dfe"]


def test_progress_is_read_from_what_the_command_reports():
    assert plugin_command.progress("t = 1.5 of 6 s, fastest 3.0 m/s", "run") == 0.25
    assert plugin_command.progress("frame 3 of 4", "export-raster") == 0.75
    assert plugin_command.progress("t = 5 s: stage 2, of points, begins: t = 5 s", "run") is None
    assert plugin_command.progress("wall time 5 s", "run") is None


def test_progress_of_many_runs_counts_runs():
    assert plugin_command.progress("3 of 12: cell_size 5 m", "study") == 2 / 12
    assert plugin_command.progress("t = 1.5 of 6 s, fastest 3.0 m/s", "study") is None
    assert plugin_command.progress("run 8 of 32, 1 left out", "ensemble") == 0.25
    assert plugin_command.progress("t = 60.0 of 60 s, fastest 3.0 m/s", "demo") == 0.7
    assert plugin_command.progress("frame 5 of 10", "demo") == 0.85


def test_what_may_be_given_several_times_is():
    form = form_of("ensemble").fields
    values = {"SCENE": "scene.toml", "VARY": ["friction.mu=0.1:0.2", "release.density=300,400"], "MIN_DEPTH": 0.05}
    assert forms.arguments(form, values) == [
        "scene.toml",
        "--vary=friction.mu=0.1:0.2",
        "--vary=release.density=300,400",
    ]


def test_names_are_chosen_from_a_list():
    bands = next(field for field in form_of("exportraster").fields if field.name == "PRODUCTS")
    assert bands.kind == forms.CHOICES and choose_products(bands.choices) == tuple(PRODUCTS)
    assert forms.arguments((bands,), {"PRODUCTS": ["p", "maxima"]}) == ["--products=p,maxima"]
    events = next(field for field in form_of("calibrate").fields if field.name == "EVENT")
    assert events.kind == forms.FILES


def test_a_scene_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"before")

    def broken(part, target):
        assert Path(part).read_bytes() == b"after" and target == str(path)
        raise OSError("no more space")

    monkeypatch.setattr(command.os, "replace", broken)
    with pytest.raises(OSError, match="no more space"):
        restored_files.write_whole(str(path), b"after")
    assert path.read_bytes() == b"before" and list(tmp_path.iterdir()) == [path]


def test_a_refused_scene_leaves_everything_as_it_was(tmp_path):
    folder, elsewhere = tmp_path / "new", tmp_path / "earlier"
    elsewhere.mkdir()
    (elsewhere / "scene.toml").write_bytes(b"before")
    for place in (folder, elsewhere):
        files = [str(place / name) for name in ("scene.toml", "release.gpkg")]
        with (
            pytest.raises(LookupError),
            restored_files.kept_unless(files, lambda error: isinstance(error, LookupError)),
        ):
            restored_files.write_whole(files[0], b"after")
            restored_files.copy_whole(files[0], files[1])
            assert sorted(place.iterdir()) == sorted(map(Path, files))
            raise LookupError("refused")
    assert not folder.exists()
    assert [(file.name, file.read_bytes()) for file in elsewhere.iterdir()] == [("scene.toml", b"before")]


def test_a_scene_that_ran_stays(tmp_path):
    files = [str(tmp_path / "new" / "scene.toml")]
    with pytest.raises(KeyError), restored_files.kept_unless(files, lambda error: isinstance(error, ValueError)):
        restored_files.write_whole(files[0], b"after")
        raise KeyError("cancelled")
    assert Path(files[0]).read_bytes() == b"after"


def test_the_commands_own_line_is_the_error():
    said = ["1100 columns", "mpmgis run: scene.toml has no table [release]", "python: leaked 1 thing"]
    assert plugin_command.error_line(said, "run", 2) == said[1]
    assert plugin_command.error_line(said[:1], "run", 2) == "1100 columns"
    assert plugin_command.error_line([], "run", -9) == "mpmgis run: ended with exit code -9 without a message"


def test_the_command_is_found_in_the_settings_or_on_path(tmp_path, monkeypatch):
    command = tmp_path / "mpmgis"
    command.write_text("#!/bin/sh\n")
    command.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert (
        plugin_command.find_command("")
        == plugin_command.find_command(None)
        == plugin_command.find_command(f' "{command}" ')
        == str(command)
    )
    with pytest.raises(plugin_command.CommandMissing, match=r"is not at .*nowhere; correct its path in Settings"):
        plugin_command.find_command(str(tmp_path / "nowhere"))
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(
        plugin_command.CommandMissing, match=r"open Plugins > mpmgis > Install mpmgis \(.*never in QGIS' Python"
    ):
        plugin_command.find_command("")
    (tmp_path / ".local").mkdir()
    (tmp_path / ".local" / "bin").symlink_to(tmp_path)
    assert plugin_command.find_command("").endswith("bin/mpmgis")
    assert plugin_command.find_command("", "/profile/bin/mpmgis") == "/profile/bin/mpmgis"
    assert plugin_command.find_command(str(command), "/profile/bin/mpmgis") == str(command)


def test_variables_of_the_qgis_python_are_removed():
    kept = plugin_command.environment({"PYTHONHOME": "x", "PROJ_LIB": "y", "PATH": "z"})
    assert kept["PATH"] == "z" and not {"PYTHONHOME", "PROJ_LIB"} & set(kept)


@pytest.mark.parametrize("path", sorted(PLUGIN.glob("*.py")), ids=lambda path: path.name)
def test_the_plugin_keeps_to_what_qgis_has(path):
    tree = ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 9))
    imported = {
        node.module.split(".")[0] if isinstance(node, ast.ImportFrom) else alias.name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom) and not getattr(node, "level", 0)
        for alias in node.names
    }
    standard = {
        *("__future__", "collections", "configparser", "contextlib", "dataclasses", "glob", "html", "json", "ntpath"),
        *("os", "posixpath", "re", "shutil", "sys", "threading", "time", "urllib", "zipfile"),
    }
    assert imported <= standard | {"processing", "qgis"}


def test_records_become_a_table():
    records = [{"effect": "a<b", "indicator": 0.123456, "why": None}, {"effect": "c", "units": {"mu": "1"}, "stage": 2}]
    page = table_page.page_of("Effects", records)
    assert page.count("<tr>") == 3 and page.count("<th>") == 5
    assert "<td>a&lt;b</td><td>0.1235</td><td></td><td></td><td></td>" in page
    assert "<td>c</td><td></td><td></td><td>mu [1]</td><td>2</td>" in page


def test_what_is_recommended_stands_first_and_bold():
    records = [{"effect": "friction", "reason": "on"}, {"effect": "flight_3d", "reason": "a 3D run is recommended"}]
    page = table_page.page_of("Effects", records)
    assert page.index('<tr class="first"><td>flight_3d</td>') < page.index("<tr><td>friction</td>")
    assert "tr.first{font-weight:bold" in page


def test_columns_of_an_answer_keep_their_blanks():
    line, recommends = plugin_command.shown_answer("flight_3d    off  a 3D run is recommended")
    assert line == "flight_3d \u00a0\u00a0\u00a0off \u00a0a 3D run is recommended" and recommends
    assert plugin_command.shown_answer("friction on") == ("friction on", False)


def test_the_command_ends_with_qgis():
    from mpmgis.system.parent_process import VARIABLE

    assert plugin_command.environment({})[VARIABLE].isdigit()


def test_what_must_be_given_stands_first():
    for identifier, first in (
        ("seed", ("DEM", "RELEASE")),
        ("hazard", ("SCENARIO",)),
        ("region", ("SCENE", "RELEASE")),
    ):
        assert tuple(field.name for field in form_of(identifier).fields)[: len(first)] == first
