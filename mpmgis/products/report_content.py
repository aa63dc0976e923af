"""What a report is made of: sections of tables, pictures and lines, whatever it is written as."""

from typing import NamedTuple


class Table(NamedTuple):
    """Rows of texts under `headings`; the first column says what a row is of."""

    headings: tuple
    rows: tuple


class Picture(NamedTuple):
    """A PNG as bytes, with a `caption`."""

    png: bytes
    caption: str


class Lines(NamedTuple):
    """Lines of text, each a point of its own."""

    texts: tuple


class Source(NamedTuple):
    """Text that is shown as it is, as in a file."""

    text: str


class Section(NamedTuple):
    """A `title` and its blocks: Table, Picture, Lines or Source."""

    title: str
    blocks: tuple


def section(title, *blocks):
    """A Section of the blocks that hold anything."""
    return Section(title, tuple(block for block in blocks if block is not None and any(block)))


def figure_rows(facts):
    """Table rows of (what, value, unit) with numbers in five digits; those without a number are left out."""
    return tuple((what, _text(value), unit) for what, value, unit in facts if value == value and value is not None)


def _text(value):
    return value if isinstance(value, str) else f"{value:.5g}"
