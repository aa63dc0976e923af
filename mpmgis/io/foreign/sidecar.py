"""The file beside particles that tells what their own format cannot: where they lie on the map, and what they are.

JSON, `<name>.georef.json` beside `<name>.ply` and its like (of a series: without its number), or `georef.json` for all
files of a folder. Writers of local coordinates put it there, readers look for it. README tells its keys.
"""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

from ...errors import FormatError, InputError, one_line
from ...geo.georeference import LOCAL, crs_of_text
from ..atomic import whole_file
from ..plain_file import require_file
from .terms import ForeignTerms

FORMAT, FORMAT_VERSION = "mpmgis-georeference", 1
SUFFIX = "georef.json"
KEYS = {  # of the file: of the terms, which the commands' options have too
    "crs": "crs", "origin": "origin", "axes": "axes", "dem": "dem", "density": "density",
    "particle_volume": "particle_volume", "columns": "columns", "times": "times", "dt": "time_step",
    "fps": "frames_per_second",
}  # fmt: skip
OF_TIME = ("times", "dt", "fps")
LARGEST = 10_000_000  # [bytes]
_SERIES = re.compile(r"(.*?)[-_.]?f?\d+(\.\d+)?", re.DOTALL)


def sidecar_path(path):
    """Where the sidecar of the file at `path` is written: `<name>.georef.json` beside it."""
    path = Path(path)
    return path.with_name(f"{path.stem}.{SUFFIX}")


def write_sidecar(path, terms):
    """Write what ForeignTerms `terms` say to the sidecar at `path`, whole or not at all; what they do not say is left
    out. `dem` is a path from the sidecar's folder."""
    content = {"format": FORMAT, "format_version": FORMAT_VERSION}
    for key, name in KEYS.items():
        value = getattr(terms, name)
        if value is not None and value != ():
            content[key] = _plain(key, value)
    with whole_file(path) as part:
        part.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")


def _plain(key, value):
    if key == "crs":
        code = value.to_epsg()
        return f"EPSG:{code}" if code else value.to_wkt()
    if key == "columns":
        return dict(value)
    return [float(number) if key != "axes" else number for number in value] if isinstance(value, tuple) else value


def read_sidecar(path):
    """ForeignTerms that the sidecar at `path` says; `dem` is a path that opens from here.

    Raises
    ------
    FormatError, InputError
        Not there, no JSON, another format, an unknown key, a value that is none.
    """
    path = Path(path)
    return terms_in(path, _content(path))


def terms_in(path, content):
    """ForeignTerms of a dict with a sidecar's keys that was found in the file at `path`.

    Raises
    ------
    FormatError, InputError
        An unknown key, a value that is none.
    """
    unknown = [key for key in content if key not in KEYS and key not in ("format", "format_version")]
    if unknown:
        raise FormatError(f"{path} has no key {unknown[0][:40]!r}; it takes {', '.join(KEYS)}")
    said = {KEYS[key]: _VALUES[key](path, key, value) for key, value in content.items() if key in KEYS}
    try:
        return ForeignTerms(**said)
    except InputError as error:  # told as of the options of the same names
        raise InputError(f"{path}: {error}") from error


def _content(path):
    require_file(path)
    try:
        if path.stat().st_size > LARGEST:
            raise FormatError(f"{path} has more than {LARGEST // 1_000_000} MB; it is no sidecar")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FormatError(f"{path}: {one_line(error.strerror or error)}") from error
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path} is no readable JSON ({one_line(error)[:80]})") from error
    got = content.get("format") if isinstance(content, dict) else None
    if got != FORMAT:
        raise FormatError(f"{path}: format {str(got)[:40]!r}, wanted {FORMAT!r}")
    version = content.get("format_version")
    if type(version) is not int or version > FORMAT_VERSION:
        raise FormatError(f"{path}: format_version {str(version)[:20]}, this mpmgis reads up to {FORMAT_VERSION}")
    return content


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _positive(path, key, value):
    if not _is_number(value) or value <= 0:
        raise FormatError(f"{path}: {key} is {str(value)[:40]}, wanted a number above 0")
    return float(value)


def _numbers(path, key, value):
    if not isinstance(value, list) or not value or not all(map(_is_number, value)):
        raise FormatError(f"{path}: {key} is {str(value)[:40]}, wanted a list of numbers")
    return tuple(map(float, value))


def _origin(path, key, value):
    numbers = _numbers(path, key, value)
    if len(numbers) != 3:
        raise FormatError(f"{path}: origin has {len(numbers)} numbers, wanted three: E, N, H")
    return numbers


def _axes(path, key, value):
    if not isinstance(value, list) or len(value) != 3 or not all(isinstance(word, str) for word in value):
        raise FormatError(f'{path}: axes is {str(value)[:40]}, wanted three words, for example ["e", "u", "-n"]')
    return tuple(value)


def _columns(path, key, value):
    if not isinstance(value, dict) or not all(isinstance(column, str) for column in value.values()):
        raise FormatError(
            f'{path}: columns is {str(value)[:40]}, wanted names and columns, for example {{"mass": "m"}}'
        )
    return tuple(value.items())


def _text(path, key, value):
    if not isinstance(value, str) or not value or "\0" in value:
        raise FormatError(f"{path}: {key} is {str(value)[:40]}, wanted text")
    return value


def _crs(path, key, value):
    text = _text(path, key, value)
    try:
        return None if text.strip().lower() == LOCAL else crs_of_text(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _dem(path, key, value):
    return str((path.parent / _text(path, key, value)).absolute())


_VALUES = {
    "crs": _crs, "origin": _origin, "axes": _axes, "dem": _dem, "density": _positive, "particle_volume": _positive,
    "columns": _columns, "times": _numbers, "dt": _positive, "fps": _positive,
}  # fmt: skip


def find_sidecar(path):
    """The sidecar of the file at `path`; None where there is none."""
    path = Path(path)
    names = [path.stem]
    while (shorter := Path(names[-1]).stem) != names[-1]:
        names.append(shorter)  # of slide.post.res: slide.post, slide
    names += [series[1] for name in names[:1] if (series := _SERIES.fullmatch(name)) and series[1]]
    places = [path.with_name(f"{name}.{SUFFIX}") for name in names] + [path.with_name(SUFFIX)]
    return next((place for place in places if place.is_file()), None)


def with_sidecar(paths, terms):
    """`terms` and, where these leave a thing open, what the sidecar of the files says.

    Raises
    ------
    FormatError, InputError
        The files have several sidecars, or one that is damaged.
    """
    if terms.sidecar is not None:
        return merged(terms, read_sidecar(terms.sidecar))
    found = {find_sidecar(path) for path in paths}
    if len(found) > 1:
        some = sorted(str(place) for place in found if place is not None)[:2]
        raise InputError(
            f"the files have not all the same sidecar ({', '.join(some)}); name one with --sidecar, or put one "
            f"{SUFFIX} into their folder"
        )
    (place,) = found or (None,)
    return terms if place is None else merged(terms, read_sidecar(place))


def merged(terms, said):
    """ForeignTerms `terms`, and of those that a sidecar `said` all that they leave open."""
    open_names = [name for name in KEYS.values() if getattr(terms, name) in (None, ())]
    if terms.local:
        open_names.remove("crs")
    of_time = [KEYS[key] for key in OF_TIME]
    if any(getattr(terms, name) is not None for name in of_time):
        open_names = [name for name in open_names if name not in of_time]
    values = {name: getattr(said, name) for name in open_names}
    values["columns"] = tuple((dict(said.columns) | dict(terms.columns)).items())
    return replace(terms, **values)
