"""Unusual names, encodings and numbers: one line of error, whatever they are."""

import os
import subprocess
import sys

import pytest

from mpmgis.commands.shell import terminal
from mpmgis.commands.shell.main import main
from mpmgis.scene.scene_reading import read_toml
from mpmgis.system.errors import OutputError, SceneError
from mpmgis.system.whole_files import whole_folder


def lines(capsys):
    """What the last command wrote on stderr."""
    return capsys.readouterr().err.splitlines()


@pytest.mark.parametrize(("word", "meant"), [("exprot-raster", "export-raster"), ("rn", "run"), ("seeed", "seed")])
def test_a_misspelt_verb_is_answered_with_the_one_that_was_meant(word, meant, capsys):
    with pytest.raises(SystemExit):
        main([word])
    (line,) = lines(capsys)
    assert f"unknown command {word!r}; did you mean {meant}?" in line


def test_a_verb_that_resembles_none_is_only_unknown(capsys):
    with pytest.raises(SystemExit):
        main(["zzzz"])
    (line,) = lines(capsys)
    assert "unknown command 'zzzz'; see mpmgis --help" in line


@pytest.mark.parametrize("code", [*range(1, 9), *range(11, 32), 0x7F, 0x9B])
def test_control_characters_of_names_do_not_reach_the_terminal(code, capsys):
    terminal.print_error(f"a{chr(code)}b")
    assert capsys.readouterr().err == f"a\\x{code:02x}b\n"
    assert terminal.escaped("näme\tof\na file") == "näme\tof\na file"


def test_a_terminal_of_ascii_ends_no_program(tmp_path):
    """The path that is printed has a letter that ASCII lacks."""
    code = (
        "from mpmgis.commands.shell import terminal as t; "
        "t.escape_missing_characters(); print('erg\u00f6bnis'); t.note('\u00f6')"
    )
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment, cwd=tmp_path)
    assert (done.returncode, done.stdout.strip(), done.stderr.strip()) == (0, rb"erg\xf6bnis", rb"\xf6")


@pytest.mark.parametrize(
    "text", [".".join("a" * 20_000) + " = 1", "[" + " . ".join("a" * 20_000) + "]", ".".join(['"a"'] * 20_000) + " = 1"]
)
def test_keys_of_thousands_of_parts_are_refused(text, tmp_path):
    (tmp_path / "scene.toml").write_text("# ...\n" + text)
    with pytest.raises(SceneError, match=r"scene\.toml, line 2: a key of 20000 parts"):
        read_toml(tmp_path / "scene.toml")


@pytest.mark.parametrize("head", ["", "[", "t = {", "t = {b = 1, ", "t = [{a = 1}, {"])
def test_keys_of_many_parts_are_refused_wherever_they_stand(head, tmp_path):
    (tmp_path / "scene.toml").write_text("b = 1\n" + head + "a." * 100_000 + "a = 1}")
    with pytest.raises(SceneError, match=r"line 2: a key of 100001 parts"):
        read_toml(tmp_path / "scene.toml")


def test_long_lists_and_dotted_text_are_no_long_keys(tmp_path):
    (tmp_path / "scene.toml").write_text(
        "[release]\ntimes = [\n" + ", ".join(["1.5"] * 500) + "\n]\nnote = '" + "." * 300 + "'\n"
    )
    assert len(read_toml(tmp_path / "scene.toml")["release"]["times"]) == 500


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[31mb", "a\x7fb", "a\udcffb"])
def test_folders_that_no_project_file_can_name_are_refused(name, tmp_path):
    with pytest.raises(OutputError, match="contains control characters"), whole_folder(tmp_path / name):
        pass
    assert not any(tmp_path.iterdir())
