"""Write a report as one HTML file: sections of tables, pictures and lines."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from ...system.whole_files import whole_file
from .flow_player import Player
from .printed_numbers import printed, printed_unit

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 62em; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.7em; margin-bottom: 0.1em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #bbb; }
.under { color: #555; margin-top: 0; } figure { margin: 1em 0; break-inside: avoid; }
img { max-width: 100%; height: auto; } figcaption { color: #555; font-size: 0.9em; }
table { border-collapse: collapse; margin: 0.8em 0; font-size: 0.92em; }
th, td { text-align: left; vertical-align: top; padding: 0.2em 0.9em 0.2em 0; border-bottom: 1px solid #e2e2e2; }
th { border-bottom: 1px solid #888; } tr { break-inside: avoid; }
pre { background: #f4f2ee; padding: 0.8em; font-size: 0.85em; white-space: pre-wrap; overflow-wrap: anywhere; }
td, li { overflow-wrap: anywhere; }
.player button { font: inherit; width: 5em; } .player input[type=range] { width: 40%; vertical-align: middle; }
.player output { display: inline-block; width: 7em; } .player label { margin-right: 0.8em; }
.player .square { display: inline-block; width: 1.1em; height: 0.8em; margin: 0 0.3em 0 0.6em; border: 1px solid #777; }
.player .entry { white-space: nowrap; }
#player-map { overflow-x: auto; } .player p { margin: 0.5em 0; } #player-value { font-weight: bold; }
@page { size: A4; margin: 16mm; }
@media print {
  .player, h2.played { display: none; }
  h2.page { break-before: page; }
  body { font-size: 10.5pt; margin: 0; max-width: none; } h2 { break-after: avoid; } img { max-height: 200mm; }
}
"""


class Table(NamedTuple):
    """Rows of texts under `headings`; the first column is the row label."""

    headings: tuple
    rows: tuple


class Picture(NamedTuple):
    """A PNG as bytes, with a `caption`."""

    png: bytes
    caption: str


class Lines(NamedTuple):
    """Lines of text, as a bullet list."""

    texts: tuple


class Source(NamedTuple):
    """Preformatted text."""

    text: str


class Section(NamedTuple):
    """A `title` and its blocks: Table, Picture, Lines, Source or Player; a `page` of its own in print."""

    title: str
    blocks: tuple
    page: bool = False


def section(title: str, *blocks: Any, page: bool = False) -> Section:
    """Return a Section of the blocks that are not empty.

    Parameters
    ----------
    title : str
    *blocks : Table, Picture, Lines, Source, Player or None
    page : bool
        Whether the section begins a page in print.
    """
    return Section(title, tuple(block for block in blocks if block is not None and any(block)), page)


def figure_rows(facts: Iterable[tuple]) -> tuple:
    """Return table rows of names and printed values with units; rows without a value are omitted.

    Parameters
    ----------
    facts : iterable of (str, float or str, str)
        Name, value, unit.

    Returns
    -------
    tuple of (str, str)
    """
    return tuple(
        (what, f"{value if isinstance(value, str) else printed(value)} {printed_unit(unit)}".strip())
        for what, value, unit in facts
        if value == value and value is not None
    )


def write_report(
    path: Path, title: str, under: Sequence[str], sections: Iterable[Section], language: str = "en"
) -> None:
    """Write the report (atomically).

    Parameters
    ----------
    path : Path
    title : str
        The heading.
    under : sequence of str
        Lines below it.
    sections : sequence of Section
    language : str
    """
    parts = [
        f'<!DOCTYPE html>\n<html lang="{language}">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>",
        *(f'<p class="under">{escape(line)}</p>' for line in under),
    ]
    for section in sections:
        if section.blocks:
            kind = "played" if isinstance(section.blocks[0], Player) else "page" if section.page else ""
            own = f' class="{kind}"' if kind else ""
            parts += [f"<h2{own}>{escape(section.title)}</h2>", *map(_block, section.blocks)]
    with whole_file(path) as part:
        part.write_text("\n".join([*parts, "</body>\n</html>\n"]), encoding="utf-8", newline="\n")


def _block(block):
    return _FORMS[type(block)](block)


def _table(block):
    heads = "".join(f"<th>{escape(text)}</th>" for text in block.headings)
    rows = "\n".join("<tr>" + "".join(f"<td>{escape(str(text))}</td>" for text in row) + "</tr>" for row in block.rows)
    return f"<table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"


def _picture(block):
    data, caption = base64.b64encode(block.png).decode("ascii"), escape(block.caption)
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">\n<figcaption>{caption}</figcaption></figure>'
    )


def _lines(block):
    return "<ul>\n" + "\n".join(f"<li>{escape(text)}</li>" for text in block.texts) + "\n</ul>"


def _source(block):
    return f"<pre>{escape(block.text)}</pre>"


def _player(block):
    return block.markup


_FORMS = {Table: _table, Picture: _picture, Lines: _lines, Source: _source, Player: _player}
