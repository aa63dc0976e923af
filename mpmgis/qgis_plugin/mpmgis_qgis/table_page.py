"""Write a list of records as an HTML page with one table, for the Results Viewer of QGIS."""

from __future__ import annotations

from html import escape

from .command import RECOMMENDS

STYLE = (
    "body{font-family:sans-serif;font-size:10pt}table{border-collapse:collapse}"
    "th,td{border:1px solid #bbb;padding:2px 6px;text-align:left;vertical-align:top}th{background:#e8e8e8}"
    "tr.first{font-weight:bold;background:#ffe8cc}"
)
DIGITS = 4  # significant ones of a number


def page_of(title: str, records: list[dict]) -> str:
    """Return the text of a page with a row for each record and a column for each key.

    Records that recommend something stand first, bold.

    Parameters
    ----------
    title : str
    records : list of dict

    Returns
    -------
    str
    """
    keys = list(dict.fromkeys(key for record in records for key in record))
    head = "".join(f"<th>{escape(key.replace('_', ' '))}</th>" for key in keys)
    ordered = sorted(records, key=_recommends, reverse=True)
    body = "\n".join(_row(record, keys) for record in ordered)
    return (
        '<!DOCTYPE html>\n<html><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body><h3>{escape(title)}</h3>\n<table>\n<tr>{head}</tr>\n{body}\n</table></body></html>\n"
    )


def _recommends(record):
    return any(RECOMMENDS in value for value in record.values() if isinstance(value, str))


def _row(record, keys):
    cells = "".join(f"<td>{escape(shown(record.get(key)))}</td>" for key in keys)
    return f'<tr class="first">{cells}</tr>' if _recommends(record) else f"<tr>{cells}</tr>"


def shown(value: object) -> str:
    """Return a value as text: numbers with four digits, a dictionary as key [value], nothing for None.

    Parameters
    ----------
    value : object

    Returns
    -------
    str
    """
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} [{shown(part)}]" for key, part in value.items())
    return str(value)
