"""Text of files as any editor and spreadsheet saves it, and the one form of all tables of numbers that are read.

Text is UTF-8, with or without a byte order mark, or UTF-16 with one. Tables have a header, cells separated by comma,
semicolon, tab or blanks, and numbers with a decimal point; with another separator than the comma also with a decimal
comma. A first line `sep=;` and lines that begin with # are skipped.
"""

import codecs
import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from .errors import FormatError, one_line
from .trusted_files import require_file

BLANK = " "  # delimiter for any number of blanks and tabs
DELIMITERS = (",", ";", "\t")
LARGEST = 100_000_000  # [bytes] of a table that is read whole as text
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_SEPARATOR = re.compile(r"\s*\"?sep=(.)\"?\s*", re.IGNORECASE)


def decoded(raw: bytes) -> str:
    """Return the text of a file: UTF-8, with or without a byte order mark, or UTF-16 with one.

    Parameters
    ----------
    raw : bytes

    Raises
    ------
    UnicodeDecodeError
    """
    return raw.decode("utf-16" if raw.startswith(UTF16) else "utf-8-sig")


def decoded_start(head: bytes) -> bytes:
    """Return the first bytes of a text in UTF-16 as UTF-8; bytes that are no text are left out.

    Parameters
    ----------
    head : bytes
    """
    return head.decode("utf-16", "ignore").encode("utf-8", "ignore")


def file_text(path: str | Path, expected: str, largest: int = LARGEST) -> str:
    """Read the text of a file.

    Parameters
    ----------
    path : str or Path
    expected : str
        Content, for messages.
    largest : int [bytes]

    Raises
    ------
    FormatError
        Missing, too large, no text, or in another encoding, which the message names.
    """
    path = Path(path)
    require_file(path)
    try:
        size = path.stat().st_size
        if size > largest:
            raise FormatError(f"{path} has {size / 1e6:.0f} MB, expected {expected} below {largest / 1e6:.0f} MB")
        raw = path.read_bytes()
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file, expected {expected}") from error
    except OSError as error:
        raise FormatError(f"{path} is not readable, expected {expected}") from error
    try:
        text = decoded(raw)
    except UnicodeDecodeError as error:
        raise FormatError(
            f"{path} is not readable text in UTF-8 or UTF-16 (byte {raw[error.start]:#04x} at {error.start}), expected "
            f"{expected}; save it as UTF-8"
        ) from error
    if "\0" in text:
        raise FormatError(
            f"{path} is not readable text: it has zero bytes, or is UTF-16 without a mark; save it as UTF-8"
        )
    return text


def separator_line(line: str) -> str | None:
    """Return the delimiter that the first line of a spreadsheet names (`sep=;`); None for other lines.

    Parameters
    ----------
    line : str
    """
    found = _SEPARATOR.fullmatch(line.rstrip("\r\n"))
    return found[1] if found else None


def delimiter_of(line: str) -> str:
    """Return the delimiter of the header of a table.

    Parameters
    ----------
    line : str
    """
    return max(DELIMITERS, key=line.count) if any(sign in line for sign in DELIMITERS) else BLANK


def cells_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without blanks and quotes around them.

    Parameters
    ----------
    line : str
    delimiter : str
    """
    if delimiter == BLANK:
        return [cell.strip('"') for cell in line.split()]
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [""])
    except csv.Error:  # a cell of more than 128 KB
        return [line]
    return [cell.strip() for cell in cells]


def header_cells(line: str, delimiter: str) -> list[str]:
    """Return the names of the columns: without the empty cells with which spreadsheets end lines, none without a name.

    Parameters
    ----------
    line : str
    delimiter : str
    """
    cells = cells_of(line, delimiter)
    while len(cells) > 1 and cells[-1] == "":
        cells.pop()
    return [cell or f"column {number}" for number, cell in enumerate(cells, 1)]


class TextTable(NamedTuple):
    """A table of cells.

    Attributes
    ----------
    names : list of str
        Of the columns.
    delimiter : str
    rows : list of (int, list of str)
        Number of the line, and its cells, as many as columns.
    """

    names: list
    delimiter: str
    rows: list


def read_cells(path: str | Path, expected: str, largest: int = LARGEST) -> TextTable:
    """Read the cells of a table; empty lines and comments are left out.

    Parameters
    ----------
    path : str or Path
    expected : str
        Content, for messages.
    largest : int [bytes]

    Raises
    ------
    FormatError
        As `file_text`; no header; a row with another number of cells.
    """
    lines = io.StringIO(file_text(path, expected, largest), newline=None).readlines()
    first = next((k for k, line in enumerate(lines) if not _is_left_out(line, k == 0)), None)
    if first is None:
        raise FormatError(f"{path} is empty, expected {expected}")
    delimiter = delimiter_of(lines[first])
    names, rows = header_cells(lines[first], delimiter), []
    for number, cells in _rows(path, lines[first + 1 :], delimiter):
        while len(cells) > len(names) and cells[-1] == "":  # spreadsheets end lines with empty cells
            cells.pop()
        if len(cells) != len(names):
            raise FormatError(f"{path} line {first + 1 + number}: {wrong_count(len(cells), len(names), delimiter)}")
        rows.append((first + 1 + number, cells))
    return TextTable(names, delimiter, rows)


def _is_left_out(line: str, is_first: bool) -> bool:
    """Return whether a line has no cells: it is empty, a comment, or names the delimiter."""
    return not line.strip(" ,;\t\n") or line.lstrip().startswith("#") or (is_first and separator_line(line) is not None)


def _rows(path: str | Path, lines: list[str], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number of the last line and cells of each row; a quoted cell may have several lines."""
    if delimiter == BLANK:
        yield from ((k, cells_of(line, delimiter)) for k, line in enumerate(lines, 1) if not _is_left_out(line, False))
        return
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells) and not cells[0].startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        raise FormatError(f"{path} is no table: {one_line(error)[:80]}, near row {reader.line_num}") from error


def with_point(cell: str, delimiter: str) -> str:
    """Return a number with a decimal point for one with a decimal comma.

    With a comma as the delimiter nothing is changed: a quoted `1,500` may be a thousand and more.

    Parameters
    ----------
    cell : str
    delimiter : str
        Of the table.
    """
    return cell.replace(",", ".") if delimiter != "," and cell.count(",") == 1 and "." not in cell else cell


def is_number(text: str) -> bool:
    """Return whether a text is a number with a decimal point.

    Parameters
    ----------
    text : str
    """
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def wrong_count(cells: int, columns: int, delimiter: str) -> str:
    """Return the words about a row with another number of cells than the header.

    Parameters
    ----------
    cells, columns : int
        Numbers in the row and in the header.
    delimiter : str
    """
    twice = delimiter == "," and cells == 2 * columns
    fix = "; use decimal points, or semicolons between the columns" if twice else ""
    return f"{cells} values for {columns} columns{fix}"
