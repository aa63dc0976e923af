"""Completion of the command in shells."""

import shutil
import subprocess

import pytest

from mpmgis.commands.shell.main import main
from mpmgis.commands.verb import all_verbs


def script(shell, capsys):
    assert main(["completion", shell]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_verb_and_option_is_in_the_script(shell, capsys):
    text = script(shell, capsys)
    for verb in all_verbs():
        assert verb.name in text
        for option in verb.named().values():
            assert all(flag.lstrip("-") in text for flag in option.flags)


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (["exp"], {"export-raster", "exposure"}),
        (["export-raster", "--cs"], {"--cs-e"}),
        (["completion", "z"], {"zsh"}),
        (["export-raster", "--bed", "pl"], {"plane"}),
    ],
)
def test_bash_completes(words, completed, capsys, tmp_path):
    (tmp_path / "c.bash").write_text(script("bash", capsys))
    line = " ".join(words)
    call = f"COMP_WORDS=(mpmgis {line}); COMP_CWORD={len(words)}; _shtab_mpmgis"
    code = f"source {tmp_path}/c.bash; {call}; echo ${{COMPREPLY[@]}}"
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert set(done.stdout.split()) == completed, done.stderr


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_the_shell_itself_reads_it(shell, capsys, tmp_path):
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell}")
    (tmp_path / "c").write_text(script(shell, capsys))
    subprocess.run([shell, "-n", str(tmp_path / "c")], check=True, timeout=60)


def test_another_shell_is_refused_in_one_line(capsys):
    with pytest.raises(SystemExit) as end:
        main(["completion", "cmd"])
    assert end.value.code == 2 and "bash" in capsys.readouterr().err
