"""README and the pages of the documentation: short enough, links that resolve, commands that parse."""

import argparse
import re
import shlex
from pathlib import Path

import nbformat
import pytest

from mpmgis.commands.shell import main
from mpmgis.commands.verb import verb_names

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "mpmgis" / "docs"
README = ROOT / "README.md"
MOST_LINES = 150
PAGES = (
    *(README, ROOT / "CHANGELOG.md", ROOT / "mpmgis" / "ARCHITECTURE.md", *sorted(DOCS.rglob("*.md"))),
    *sorted((ROOT / "tests").rglob("README.md")),
    *sorted((ROOT / "sample_data").rglob("README.md")),
)
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^)\s]+)\)")
MADE_BY_THE_SITE = {"notebooks/index", "cases/index", "architecture", "changelog"}  # in the table of contents only


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def prose(text):
    """A page without its code."""
    return re.sub(r"`[^`\n]*`", "", FENCE.sub("", text))


def anchors(path):
    """Anchors of the headings of a page, as GitHub and MyST make them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", FENCE.sub("", path.read_text(encoding="utf-8")), re.MULTILINE):
        words = re.sub(r"[^\w\- ]", "", heading.lower()).strip()
        found.add(words.replace(" ", "-"))
    return found


def commands(text):
    """Commands of mpmgis in the shell blocks of a page, as lists of words."""
    for language, block in FENCE.findall(text):
        if language in ("sh", "console"):
            for line in block.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True)
                if words[:1] == ["mpmgis"]:
                    yield words[1 : words.index(">") if ">" in words else None]


def parsed(words, monkeypatch):
    """The arguments of a command, which is not executed."""
    caught = []
    monkeypatch.setattr(main, "_guarded", lambda arguments: caught.append(arguments) or 0)
    try:
        assert main.main(words) == 0
    except SystemExit as end:  # --help and --version end the parser
        assert end.code == 0 and {"--help", "--version"} & set(words), words
        return argparse.Namespace()
    return caught[0]


def test_readme_is_a_landing_page():
    assert len(README.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_links_lead_to_files_and_headings(path):
    for target in LINK.findall(prose(path.read_text(encoding="utf-8"))):
        if re.match(r"\w+:", target):
            continue
        place, _, anchor = target.partition("#")
        file = (path.parent / place).resolve() if place else path
        assert file.exists(), f"{name_of(path)}: {target} does not exist"
        assert not anchor or anchor in anchors(file), f"{name_of(path)}: {target} has no such heading"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=name_of)
def test_links_of_notebooks_lead_to_files(path):
    cells = nbformat.read(path, as_version=4).cells
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    for target in LINK.findall(prose(text)):
        assert re.match(r"\w+:", target) or (path.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("path", sorted(DOCS.rglob("*.md")), ids=name_of)
def test_every_page_is_in_a_table_of_contents(path):
    listed = {
        (page.parent / line.strip()).resolve()
        for page in DOCS.rglob("*.md")
        for block in TOCTREE.findall(page.read_text(encoding="utf-8"))
        for line in block.splitlines()
        if line and not line.startswith(":") and line not in MADE_BY_THE_SITE
    }
    assert path == DOCS / "index.md" or path.with_suffix("") in listed
    assert all(entry.with_suffix(".md").exists() for entry in listed)


GUIDE = [README, *sorted(DOCS.rglob("*.md"))]


@pytest.mark.parametrize("path", GUIDE, ids=name_of)
def test_commands_parse(path, monkeypatch):
    for words in commands(path.read_text(encoding="utf-8")):
        parsed(words, monkeypatch)


def test_the_guide_shows_every_verb():
    shown = {words[0] for path in GUIDE for words in commands(path.read_text(encoding="utf-8"))}
    assert shown - {"--version"} == set(verb_names())


def test_a_command_with_a_wrong_option_would_be_noticed(monkeypatch):
    with pytest.raises(AssertionError):
        parsed(["run", "scene.toml", "--no-such-option"], monkeypatch)
