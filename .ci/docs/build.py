#!/usr/bin/env python3
"""build.py FOLDER [OPTION...]: the website of mpmgis in FOLDER; OPTIONs go to Sphinx.

Collects the pages of mpmgis/docs, the notebooks, the pages of the test scenes and the generated pages in a temporary
folder and calls Sphinx there. Every warning is an error. Notebooks are shown with their stored results, which
`run_notebooks.py` writes.
"""

import json
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
DOCS = ROOT / "mpmgis" / "docs"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!\w+:)([^)#\s]*)(#[^)\s]*)?\)")
FENCE = re.compile(r"^ *```.*?^ *```$", re.MULTILINE | re.DOTALL)


def sources():
    """File of the repository -> its place on the website."""
    places = {path: path.relative_to(DOCS) for path in sorted(DOCS.rglob("*.md"))}
    places[ROOT / "mpmgis" / "ARCHITECTURE.md"] = Path("architecture.md")
    places[ROOT / "CHANGELOG.md"] = Path("changelog.md")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        places[path] = Path("notebooks", path.name)
    for path in sorted((ROOT / "tests" / "scenes").rglob("README.md")):
        places[path] = Path("cases", *path.relative_to(ROOT / "tests" / "scenes").parent.parts, "index.md")
    places[ROOT / "tests" / "stability" / "README.md"] = Path("cases", "stability.md")
    return places


def relinked(text, source, places, stage):
    """`text` of a page with links that are right on the website; links to files that are not on it become text."""

    def replaced(found):
        picture, words, target, anchor = found[1], found[2], found[3], found[4] or ""
        if not target:
            return found[0]
        file = (source.parent / target).resolve()
        here = places[source].parent
        if file in places:
            return f"[{words}]({os.path.relpath(places[file], here)}{anchor})"
        if picture:
            place = Path("pictures", file.relative_to(ROOT).as_posix().replace("/", "_"))
            (stage / place).parent.mkdir(exist_ok=True)
            shutil.copy(file, stage / place)
            return f"![{words}]({os.path.relpath(place, here)})"
        return words

    parts, end = [], 0
    for fence in FENCE.finditer(text):  # code is left as it is
        parts += [LINK.sub(replaced, text[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, LINK.sub(replaced, text[end:])])


def relinked_cells(text, source, places, stage):
    """The JSON of a notebook whose cells of text have links that are right on the website."""
    book = json.loads(text)
    for cell in book["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = relinked("".join(cell["source"]), source, places, stage)
    return json.dumps(book)


def collect(stage):
    """Put all pages into the folder `stage`."""
    places = sources()
    os.environ["NUMBA_DISABLE_JIT"] = "1"  # kernels are documented as the plain functions that they are
    import pages

    made = pages.generated()
    for source, place in places.items():
        change = relinked_cells if source.suffix == ".ipynb" else relinked
        text = change(source.read_text(encoding="utf-8"), source, places, stage)
        name = place.with_suffix("").as_posix()
        write(stage / place, pages.with_part(text, made.pop(name)) if name in made else text)
    for name, text in made.items():
        write(stage / f"{name}.md", text + "\n")
    title = "# Notebooks\n\nFrom the folder `notebooks` of the repository.\n"
    write(stage / "notebooks" / "index.md", title + list_of_pages("notebooks", places))
    cases = stage / "cases" / "index.md"
    write(cases, cases.read_text(encoding="utf-8") + list_of_pages("cases", places))


def list_of_pages(folder, places):
    """A table of contents of the pages of a folder."""
    inside = [place.relative_to(folder) for place in places.values() if place.parts[0] == folder]
    listed = [place.with_suffix("").as_posix() for place in inside if place.name != "index.md" or place.parts[1:]]
    return "\n```{toctree}\n:maxdepth: 1\n\n" + "\n".join(listed) + "\n```\n"


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def main():
    folder, *more = sys.argv[1:] or sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as stage:
        collect(Path(stage))
        from sphinx.cmd.build import main as build

        return build(["-W", "--keep-going", "-q", "-b", "html", "-c", str(HERE), *more, stage, folder])


if __name__ == "__main__":
    raise SystemExit(main())
