"""The environment that the toolbox makes: paths and programs, of Windows too, Pythons and errors, without QGIS."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from mpmgis_qgis import own_environment, python_search
from mpmgis_qgis.own_environment import Source
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parents[2]
WHEEL = "mpmgis-1.2.0-py3-none-any.whl"


def made(home, number, command=True):
    """An environment, with a command in it or without."""
    program = own_environment.programs(str(home / number))[1]
    Path(program).parent.mkdir(parents=True)
    if command:
        Path(program).write_text("")
    return str(home / number)


def test_programs_stand_where_the_system_has_them():
    windows = own_environment.programs(r"C:\Users\A B\AppData\QGIS3\profiles\default\mpmgis\1", windows=True)
    assert windows[0] == r"C:\Users\A B\AppData\QGIS3\profiles\default\mpmgis\1\Scripts\python.exe"
    assert windows[1] == r"C:\Users\A B\AppData\QGIS3\profiles\default\mpmgis\1\Scripts\mpmgis.exe"
    assert own_environment.programs("/p/mpmgis/1", windows=False) == (
        "/p/mpmgis/1/bin/python",
        "/p/mpmgis/1/bin/mpmgis",
    )


def test_pip_of_python_installs_from_outside_on_windows():
    python, folder = r"C:\Program Files\QGIS 3.40\apps\Python312\python.exe", r"C:\profile\mpmgis\1"
    steps = own_environment.steps(python, True, folder, Source("1.2.0"), windows=True)
    assert [step.program for step in steps] == [python, python, rf"{folder}\Scripts\mpmgis.exe"]
    assert steps[0].arguments == ("-m", "venv", "--without-pip", folder)
    assert steps[1].arguments[:5] == ("-m", "pip", "--python", rf"{folder}\Scripts\python.exe", "install")
    assert steps[1].arguments[-1] == "mpmgis==1.2.0"
    assert [step.begin for step in steps] == [0.0, *(step.end for step in steps[:-1])] and steps[-1].end == 1.0


def test_without_pip_the_environment_gets_its_own():
    steps = own_environment.steps("/usr/bin/python3", False, "/p/1", Source("1.2.0"), windows=False)
    assert steps[0].arguments == ("-m", "venv", "/p/1")
    assert (steps[1].program, steps[1].arguments[:3]) == ("/p/1/bin/python", ("-m", "pip", "install"))


@pytest.mark.parametrize(
    ("source", "ends"),
    [
        (Source("1.2.0"), ("--no-compile", "mpmgis==1.2.0")),
        (Source("1.2.0", "a/" + WHEEL), ("--no-compile", "a/" + WHEEL)),
        (Source("1.2.0", "a/" + WHEEL, "libs"), ("--find-links=libs", "--no-index", "a/" + WHEEL)),
        (Source("1.2.0", "", "libs"), ("--find-links=libs", "--no-index", "mpmgis==1.2.0")),
        (Source("1.2.0", parts=("animation",)), ("--no-compile", "mpmgis[animation]==1.2.0")),
        (Source("1.2.0", "a/" + WHEEL, parts=("player",)), ("--no-compile", f"a/{WHEEL}[player]")),
        (
            Source("1.2.0", "a/" + WHEEL, "libs", ("animation", "player")),
            ("--no-index", f"a/{WHEEL}[animation,player]"),
        ),
    ],
)
def test_what_pip_is_told(source, ends):
    words = own_environment.pip_words(source)
    assert words[-len(ends) :] == ends and "--only-binary=:all:" in words and "--no-input" in words


def test_variables_that_redirect_pip_are_dropped():
    given = {"PATH": "p", "pip_target": "x", "PIP_PREFIX": "y", "PIP_INDEX_URL": "https://mirror", "PIP_USER": "1"}
    kept = own_environment.installing_environment(given, {"https_proxy": "http://proxy:1"})
    assert kept == {"PATH": "p", "PIP_INDEX_URL": "https://mirror", "PIP_USER": "0", "https_proxy": "http://proxy:1"}


def test_a_wheel_of_another_version_or_another_file_is_refused(tmp_path):
    for name in (WHEEL, "mpmgis-1.3.0-py3-none-any.whl", "numpy-2.0-cp311-cp311-win_amd64.whl"):
        (tmp_path / name).write_text("")
    assert own_environment.trouble_of(Source("1.2.0")) == ""
    assert own_environment.trouble_of(Source("1.2.0", str(tmp_path / WHEEL), str(tmp_path))) == ""
    other = own_environment.trouble_of(Source("1.2.0", str(tmp_path / "mpmgis-1.3.0-py3-none-any.whl")))
    assert "has version 1.3.0; this toolbox needs 1.2.0" in other
    assert "is not a wheel of mpmgis" in own_environment.trouble_of(
        Source("1.2.0", str(tmp_path / "numpy-2.0-cp311-cp311-win_amd64.whl"))
    )
    assert "does not exist" in own_environment.trouble_of(Source("1.2.0", str(tmp_path / "gone" / WHEEL)))
    assert "is not a folder" in own_environment.trouble_of(Source("1.2.0", "", str(tmp_path / "gone")))


def test_the_environment_in_use_is_the_one_of_the_record(tmp_path):
    home = str(tmp_path)
    assert own_environment.own_command(home) is None
    assert own_environment.next_environment(home) == str(tmp_path / "1")
    first = made(tmp_path, "1")
    assert own_environment.own_command(home) is None  # an installation that was killed has no record
    own_environment.write_record(home, first, "1.2.0", "/usr/bin/python3")
    assert own_environment.record_of(home) == {"folder": "1", "version": "1.2.0", "python": "/usr/bin/python3"}
    assert own_environment.next_environment(home) == str(tmp_path / "2")
    second = made(tmp_path, "2")
    own_environment.remove_unused(home)
    assert own_environment.own_command(home) == own_environment.programs(first)[1] and not os.path.exists(second)
    assert own_environment.remove_all(home) and not tmp_path.exists()


@pytest.mark.parametrize("text", ["", "[]", '{"folder": "../../etc"}', '{"folder": "1"}', "null", '{"folder": 1}'])
def test_a_damaged_record_is_none(tmp_path, text):
    (tmp_path / "installed.json").write_text(text)
    made(tmp_path, "1", command=False)
    assert own_environment.record_of(str(tmp_path)) == {}
    own_environment.remove_unused(str(tmp_path))
    assert json.dumps(sorted(os.listdir(tmp_path))) == '["installed.json"]'


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("/usr/bin/python3: No module named ensurepip", "sudo apt install python3-venv"),
        ("ERROR: Could not install: [Errno 28] No space left on device", "the disk is full"),
        (
            "WARNING: Retrying after 'ProxyError('Cannot connect to proxy.', OSError('407 Authentication",
            "the proxy refused",
        ),
        ("WARNING: Retrying after NewConnectionError('Temporary failure in name resolution')", "cannot be reached"),
        (
            "ERROR: No matching distribution found for numba<0.70,>=0.60",
            "libs has no numba<0.70,>=0.60 for this Python",
        ),
        ("ERROR: something else", "Installing: ERROR: something else"),
        ("last words", "Installing: last words"),
    ],
)
def test_errors_are_one_line_with_a_remedy(line, said):
    found = own_environment.failure("Installing", ["first", line], Source("1.2.0", "", "libs"))
    assert said in found and "\n" not in found


def test_a_python_that_makes_no_environment_is_to_be_replaced():
    assert own_environment.failure(own_environment.MAKING, ["Error: x"], Source("1.2.0")).endswith(
        "choose another Python"
    )


def test_progress_grows_with_the_packages():
    lines = [
        "Collecting numpy>=1.26",
        "  Downloading numpy (17 MB)",
        "Installing collected packages: a",
        "Successfully installed a",
    ]
    shares = [own_environment.pip_share(10, line) for line in lines]
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert [own_environment.is_about_package(line) for line in lines] == [True, False, False, False]


# ------------------------------------------------------------------------------------------------------------ Pythons


def test_versions_of_python_are_those_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    allowed = SpecifierSet(project["requires-python"])
    suited = [minor for minor in range(5, 30) if f"3.{minor}" in allowed]
    assert sorted(python_search.MINORS) == suited
    assert {own_environment.FILMS, own_environment.PLAYER} <= set(project["optional-dependencies"])


def test_python_of_qgis_on_windows_is_the_one_with_its_library():
    prefix = r"C:\Program Files\QGIS 3.40.4\apps\Python312"
    places = python_search.of_qgis(prefix, r"C:\Program Files\QGIS 3.40.4\bin\qgis-bin.exe", windows=True)
    assert places[0] == prefix + r"\python.exe" and not any(r"\bin" in place for place in places)


def test_python_of_qgis_on_macos_and_linux():
    inside = "/Applications/QGIS.app/Contents"
    places = python_search.of_qgis(f"{inside}/Frameworks", f"{inside}/MacOS/QGIS", windows=False)
    assert f"{inside}/MacOS/bin/python3" in places and f"{inside}/Frameworks/bin/python3" in places
    assert not any(place.endswith("QGIS") for place in places)
    assert "/usr/bin/python3" in python_search.of_qgis("/usr", "/usr/bin/python3", windows=False)


def test_other_pythons_of_windows():
    given = {
        "LOCALAPPDATA": r"C:\Users\me\AppData\Local",
        "PROGRAMFILES": r"D:\Programs",
        "PATH": r"C:\Windows;C:\Users\me\AppData\Local\Microsoft\WindowsApps;C:\conda",
    }
    places = python_search.elsewhere(given, windows=True)
    for place in (
        r"C:\Users\me\AppData\Local\Programs\Python\Python312\python.exe",
        r"C:\Users\me\AppData\Local\Python\pythoncore-3.14-64\python.exe",
        r"D:\Programs\Python311\python.exe",
        r"D:\Programs\QGIS *\apps\Python312\python.exe",
        r"C:\conda\python.exe",
    ):
        assert place in places
    assert not any("WindowsApps" in place for place in places)
    assert not any("Python39" in place or place.startswith("\\") for place in python_search.elsewhere({}, windows=True))


def test_other_pythons_of_linux_and_macos():
    places = python_search.elsewhere({"PATH": "/own/bin:/usr/bin"}, windows=False)
    assert places[0] == "/own/bin/python3.14" and "/opt/homebrew/bin/python3.12" in places
    assert "/Library/Frameworks/Python.framework/Versions/3.13/bin/python3.13" in places
    assert "/usr/bin/python3" in places


def test_a_place_with_a_star_and_a_link_are_resolved(tmp_path):
    for name in ("QGIS 3.34", "QGIS 3.40"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "python").write_text("")
    (tmp_path / "link").symlink_to(tmp_path / "QGIS 3.40" / "python")
    found = python_search.existing([str(tmp_path / "QGIS *" / "python"), str(tmp_path / "link"), str(tmp_path / "no")])
    assert found == [str(tmp_path / "QGIS 3.40" / "python"), str(tmp_path / "QGIS 3.34" / "python")]


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        ("PYTHON 3 12 64 24.0 True True\n", ((3, 12), True)),
        ("PYTHON 3 11 64 22.2.1 True True\n", ((3, 11), False)),
        ("PYTHON 3 11 64 0 True True\n", ((3, 11), False)),
        ("PYTHON 3 13 64 25.1.1rc1 True False\n", ((3, 13), True)),
        ("PYTHON 3 9 64 24.0 True True\n", "is Python 3.9; mpmgis needs 3.11 to 3.14"),
        ("PYTHON 3 12 32 24.0 True True\n", "32 bits"),
        ("PYTHON 3 11 64 0 True False\n", "neither pip nor ensurepip"),
        ("PYTHON 3 11 64 24.0 False False\n", "python3-venv"),
        ("Python was not found; run without arguments to install from the Store", "is not a Python that starts"),
    ],
)
def test_what_a_python_answers(answer, found):
    python = python_search.python_of("/usr/bin/python3", answer)
    if isinstance(found, str):
        assert found in python
    else:
        assert (python.version, python.has_pip) == found


def test_the_question_is_answered_by_this_python():
    done = subprocess.run(
        [sys.executable, "-I", "-c", python_search.QUESTION], capture_output=True, text=True, check=True
    )
    python = python_search.python_of(sys.executable, done.stdout, of_qgis=True)
    assert python.version == sys.version_info[:2]
    assert python.label == f"Python 3.{sys.version_info[1]} of QGIS: {sys.executable}"
