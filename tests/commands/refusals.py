"""The line with which a command refuses what it is given."""

from mpmgis.commands.shell.main import main


def refusal(captured, *words):
    """The only line that `mpmgis words` prints, on stderr; it must end with exit code 2.

    `captured` is capsys, or capfd, which sees what C libraries write, too.
    """
    captured.readouterr()
    assert main([*map(str, words), "-q"]) == 2
    out, err = captured.readouterr()
    assert out == "" and err.count("\n") == 1 and err.startswith("mpmgis "), err
    return err
