"""The tutorial, word by word: its files are saved, its commands typed in order, its answers found in what they say."""

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mpmgis

PAGE = (Path(__file__).resolve().parents[1] / "mpmgis" / "docs" / "tutorial.md").read_text(encoding="utf-8")
LONGER = "## Accuracy"  # from here on many runs, and 3D: `make validate`
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SAVED = re.compile(r"[Ss]ave this as\s+`([^`]+)`:\s*$")
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def steps():
    """(heading, language, text, name of the file to save or None) of each block of the page."""
    heading, end = "", 0
    for found in FENCE.finditer(PAGE):
        before = PAGE[end : found.start()]
        heading = [heading, *re.findall(r"^## .*$", before, re.MULTILINE)][-1]
        named = SAVED.search(before)
        yield heading, found[1], found[2], named[1] if named else None
        end = found.end()


def alike(wanted, line):
    """Is `line` the `wanted` one, its numbers within 5 %? After "..." or "(...)" it may continue as it likes."""
    wanted, shown = (" ".join(text.split()) for text in (wanted, line))
    if "..." in wanted:
        wanted = wanted[: wanted.index("...")].rstrip(" (")
        return shown.startswith(wanted)
    if NUMBER.sub("#", wanted) != NUMBER.sub("#", shown):
        return False
    pairs = zip(NUMBER.findall(wanted), NUMBER.findall(shown), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=0.05, abs_tol=1e-9) for a, b in pairs)


def machine(folder):
    """The environment of a terminal in which `python`, `mpmgis` and `rio` are those of this Python."""
    programs = {
        "python": '"$@"',
        "mpmgis": '-m mpmgis "$@"',
        "rio": "-c 'from rasterio.rio.main import main_group; main_group()' \"$@\"",
    }
    folder.mkdir()
    for name, rest in programs.items():
        (folder / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {rest}\n')
        (folder / name).chmod(0o755)
    root = str(Path(mpmgis.__file__).parents[1])
    python_path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    return os.environ | {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": python_path}


def type_all(blocks, tmp_path):
    """Do what `blocks` say, in `tmp_path`; answers how many commands that were."""
    environment, commands = machine(tmp_path / "bin"), 0
    folder = tmp_path / "hour"
    folder.mkdir()
    for (_, language, text, name), after in zip(blocks, [*blocks[1:], ("", "", "", None)], strict=True):
        if name:
            (folder / name).write_text(text)
        if language != "sh":
            continue
        answer = after[2].splitlines() if after[1] == "text" else []
        refused = bool(answer) and re.match(r"mpmgis \w+: ", answer[0]) is not None
        said = ""
        for command in text.splitlines():
            done = subprocess.run(
                command, shell=True, cwd=folder, env=environment, capture_output=True, text=True, timeout=1500
            )
            assert done.returncode == (2 if refused else 0), f"{command}\n{done.stdout}{done.stderr}"
            said += done.stdout + done.stderr
            commands += 1
        for line in answer:
            found = any(alike(line, shown) for shown in said.splitlines())
            assert line.strip() == "..." or found, f"{text}should say\n{line}\nand said\n{said}"
    return commands


def parts():
    """The blocks before LONGER, and all of them."""
    blocks = list(steps())
    headings = [heading for heading, *_ in blocks]
    return blocks[: headings.index(LONGER)], blocks


@pytest.mark.thorough
@pytest.mark.skipif(os.name == "nt", reason="the page is typed into a POSIX shell")
def test_the_first_half_works_as_it_stands(tmp_path):
    assert type_all(parts()[0], tmp_path) >= 11


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="the page is typed into a POSIX shell")
def test_the_whole_hour_works_as_it_stands(tmp_path):
    assert type_all(parts()[1], tmp_path) >= 15


def test_the_fix_that_is_printed_is_the_command_that_follows():
    printed = re.search(r"reproject it: (rio warp .*)$", PAGE, re.MULTILINE)[1]
    assert f"\n```sh\n{printed}\n" in PAGE


def test_only_the_installation_is_not_run():
    for heading, language, _, name in steps():
        assert language in ("sh", "text") or name or heading == "## Install"


def test_numbers_of_answers_are_compared():
    assert alike("drop 484.0 m", "drop  490.0   m") and not alike("drop 484.0 m", "drop 300.0 m")
    assert alike("a.tif: raster (...)", "a.tif: raster (3 kB)") and not alike("b.tif ...", "a.tif 3")
