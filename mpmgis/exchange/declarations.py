"""User declarations about third-party particle files: options, and the sidecar file that stores them.

The sidecar is JSON: `<name>.georef.json` next to `<name>.ply` etc. (for a series: without its number), or
`georef.json` for all files of a folder. Writers of local coordinates create it, readers look for it. docs/formats.md
has its keys.
"""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..system.errors import FormatError, InputError, one_line
from ..system.text_tables import decoded
from ..system.trusted_files import require_file
from ..system.whole_files import whole_file
from ..terrain.georeference import LOCAL, crs_of_text, parse_crs

EAST, NORTH, UP = np.eye(3)
DIRECTIONS = {"e": EAST, "n": NORTH, "u": UP, "w": -EAST, "s": -NORTH, "d": -UP}
NAMES = (  # quantities of mpmgis for --columns
    *("x", "y", "z", "vx", "vy", "vz", "mass", "volume", "density", "radius", "diameter", "id", "active", "time"),
)
VECTORS = {"position": ("x", "y", "z"), "velocity": ("vx", "vy", "vz")}  # for columns of three components
# smallest and largest value, unit; others are typing errors or other units
POSSIBLE = {"density": (0.1, 1e5, "kg m-3"), "particle volume": (1e-18, 1e9, "m3")}
COMPONENTS = ("x", "y", "z")
FORMAT, FORMAT_VERSION = "mpmgis-georeference", 1
SUFFIX = "georef.json"
KEYS = {  # key of the sidecar -> field of Declarations
    "crs": "crs",
    "origin": "origin",
    "axes": "axes",
    "dem": "dem",
    "density": "density",
    "particle_volume": "particle_volume",
    "columns": "columns",
    "times": "times",
    "dt": "frame_step",
    "fps": "frames_per_second",
}
OF_TIME = ("times", "dt", "fps")
LARGEST = 10_000_000  # [bytes] of a sidecar
_SERIES = re.compile(r"(.*?)[-_.]?f?\d+(\.\d+)?", re.DOTALL)


@dataclass(frozen=True)
class Declarations:
    """User declarations about the files of another code.

    Parameters
    ----------
    reader : str or None
        Name of the code; None to detect it from the files.
    crs : pyproj.CRS or None
        Of the particles; None where it is not declared, or for metres without a georeference.
    local : bool
        Declared as metres without a georeference.
    origin : tuple of 3 floats or None
        (E, N, H) [m] of the origin of the file's coordinates.
    axes : tuple of 3 str or None
        Directions of x, y and z of the file: e, n, u, w, s, d, or one of the first three with a minus.
    times : tuple of float or None
        Time [s] of each file, in the order of their numbers.
    frame_step, frames_per_second : float or None
        Time [s] between consecutive file numbers, or its inverse [s-1].
    columns : tuple of (str, str)
        Names of NAMES or VECTORS and the columns of the file.
    density : float or None
        [kg m-3]
    particle_volume : float or None
        [m3] of every particle.
    dem : str or None
        Path of the DTM, where the sidecar has it.
    sidecar : Path or None
        Path of the sidecar; None to look for it next to the files.
    """

    reader: str | None = None
    crs: object = None
    local: bool = False
    origin: tuple | None = None
    axes: tuple | None = None
    times: tuple | None = None
    frame_step: float | None = None
    frames_per_second: float | None = None
    columns: tuple = ()
    density: float | None = None
    particle_volume: float | None = None
    dem: str | None = None
    sidecar: Path | None = None

    def __post_init__(self):
        given = [option for option, value in self._of_time().items() if value is not None]
        if len(given) > 1:
            raise InputError(f"{' and '.join(given)} all set the time of the frames; give only one")
        if self.axes is not None:
            axis_matrix(self.axes)
        for name, value in (("density", self.density), ("particle volume", self.particle_volume)):
            low, high, unit = POSSIBLE[name]
            if value is not None and not low <= value <= high:
                raise InputError(f"{name} is {value:g} {unit}, expected {low:g} to {high:g}")
        for name, _ in self.columns:
            if name not in NAMES and name not in VECTORS:
                known = ", ".join((*NAMES, *VECTORS))
                raise InputError(f"--columns: unknown quantity {name!r}; choose from {known}")

    def _of_time(self):
        return {"--times": self.times, "--dt": self.frame_step, "--fps": self.frames_per_second}

    def column_pairs(self) -> Iterator[tuple[str, str]]:
        """Yield (name of NAMES, column) of all declared columns; the components of a vector `U` are U.x, U.y, U.z."""
        for name, column in self.columns:
            if name in VECTORS:
                yield from zip(VECTORS[name], (f"{column}.{letter}" for letter in COMPONENTS), strict=True)
            else:
                yield name, column

    def column_for(self, name: str) -> str | None:
        """Return the declared column for a name of NAMES.

        Parameters
        ----------
        name : str

        Returns
        -------
        str or None
            None where there is none.
        """
        return dict(self.column_pairs()).get(name)

    def only_for_third_party(self) -> list[str]:
        """Return the given options that do not apply to frames of mpmgis, which contain these values."""
        options = {
            "--origin": self.origin,
            "--axes": self.axes,
            **self._of_time(),
            "--columns": self.columns or None,
            "--particle-volume": self.particle_volume,
            "--sidecar": self.sidecar,
        }
        return [option for option, value in options.items() if value is not None]

    @classmethod
    def named(cls, values: Mapping[str, Any], crs: str | None = None) -> "Declarations":
        """Make the declarations from a mapping with further keys.

        Parameters
        ----------
        values : mapping of str to Any
            Keys that are no fields of Declarations are ignored.
        crs : str, optional
            ``EPSG:n``, WKT, or ``local``.
        """
        declared = {field.name: values[field.name] for field in fields(cls) if field.name in values}
        place = None if crs is None else parse_crs(crs)
        return cls(**declared | {"crs": place, "local": crs is not None and place is None})


def axis_matrix(axes: Sequence[str]) -> np.ndarray:
    """Return the map vectors of the axes of a file.

    Parameters
    ----------
    axes : sequence of 3 str
        Directions of x, y and z, as in Declarations.

    Returns
    -------
    float64[3, 3]
        Rows are the vectors (E, N, up) of the file's x, y and z.

    Raises
    ------
    InputError
        Not three orthogonal directions, or a mirror image.
    """
    rows = []
    for word in axes:
        sign, letter = (-1.0, word[1:]) if word[:1] == "-" else (1.0, word)
        if letter not in DIRECTIONS:
            raise InputError(f"--axes {','.join(axes)}: {word!r} is not a direction, expected e, n, u (or -e, -n, -u)")
        rows.append(sign * DIRECTIONS[letter])
    matrix = np.array(rows)
    if matrix.shape != (3, 3) or abs(np.linalg.det(matrix)) < 0.5:
        raise InputError(f"--axes {','.join(axes)}: expected three orthogonal directions, for example e,u,-n")
    if np.linalg.det(matrix) < 0:
        raise InputError(
            f"--axes {','.join(axes)} is left-handed (a mirror image of the terrain), expected right-handed axes, for "
            "example e,n,u or e,u,-n (y up)"
        )
    return matrix


def sidecar_path(path: str | Path) -> Path:
    """Return the path of the sidecar of a file: `<name>.georef.json` in the same folder.

    Parameters
    ----------
    path : str or Path
    """
    path = Path(path)
    return path.with_name(f"{path.stem}.{SUFFIX}")


def write_sidecar(path: Path, terms: Declarations) -> None:
    """Write declarations to a sidecar, atomically; None is omitted.

    Parameters
    ----------
    path : Path
        Of the sidecar.
    terms : Declarations
        `dem` is a path relative to the folder of the sidecar.
    """
    content = {"format": FORMAT, "format_version": FORMAT_VERSION}
    for key, name in KEYS.items():
        value = getattr(terms, name)
        if value is not None and value != ():
            content[key] = _plain(key, value)
    with whole_file(path) as part:
        part.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")


def _plain(key: str, value: Any) -> Any:
    if key == "crs":
        code = value.to_epsg()
        return f"EPSG:{code}" if code else value.to_wkt()
    if key == "columns":
        return dict(value)
    return [float(number) if key != "axes" else number for number in value] if isinstance(value, tuple) else value


def read_sidecar(path: str | Path) -> Declarations:
    """Read the declarations in a sidecar.

    Parameters
    ----------
    path : str or Path
        Of the sidecar.

    Returns
    -------
    Declarations
        `dem` is an absolute path.

    Raises
    ------
    FormatError, InputError
        Missing, no JSON, another format, an unknown key, an invalid value.
    """
    path = Path(path)
    return terms_in(path, _content(path))


def terms_in(path: Path, content: dict[str, Any]) -> Declarations:
    """Check a dict with the keys of a sidecar and return its declarations.

    Parameters
    ----------
    path : Path
        File that it is from.
    content : dict of str to Any

    Raises
    ------
    FormatError, InputError
        An unknown key, an invalid value.
    """
    unknown = [key for key in content if key not in KEYS and key not in ("format", "format_version")]
    if unknown:
        raise FormatError(f"{path} has no key {unknown[0][:40]!r}; it takes {', '.join(KEYS)}")
    declared = {KEYS[key]: _VALUES[key](path, key, value) for key, value in content.items() if key in KEYS}
    try:
        return Declarations(**declared)
    except InputError as error:  # names the options
        raise InputError(f"{path}: {error}") from error


def _content(path: Path) -> dict[str, Any]:
    require_file(path)
    try:
        if path.stat().st_size > LARGEST:
            raise FormatError(f"{path} has more than {LARGEST // 1_000_000} MB; it is not a sidecar")
        content = json.loads(decoded(path.read_bytes()))
    except OSError as error:
        raise FormatError(f"{path}: {one_line(error.strerror or error)}") from error
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path} is not readable JSON ({one_line(error)[:80]})") from error
    got = content.get("format") if isinstance(content, dict) else None
    if got != FORMAT:
        raise FormatError(f"{path}: format {str(got)[:40]!r}, expected {FORMAT!r}")
    version = content.get("format_version")
    if type(version) is not int or version > FORMAT_VERSION:
        raise FormatError(f"{path}: format_version {str(version)[:20]}, this mpmgis reads up to {FORMAT_VERSION}")
    return content


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _positive(path: Path, key: str, value: Any) -> float:
    if not _is_number(value) or value <= 0:
        raise FormatError(f"{path}: {key} is {str(value)[:40]}, expected a number above 0")
    return float(value)


def _numbers(path: Path, key: str, value: Any) -> tuple[float, ...]:
    if not isinstance(value, list) or not value or not all(map(_is_number, value)):
        raise FormatError(f"{path}: {key} is {str(value)[:40]}, expected a list of numbers")
    return tuple(map(float, value))


def _origin(path: Path, key: str, value: Any) -> tuple[float, ...]:
    numbers = _numbers(path, key, value)
    if len(numbers) != 3:
        raise FormatError(f"{path}: origin has {len(numbers)} numbers, expected three: E, N, H")
    return numbers


def _axes(path: Path, key: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or len(value) != 3 or not all(isinstance(word, str) for word in value):
        raise FormatError(f'{path}: axes is {str(value)[:40]}, expected three words, for example ["e", "u", "-n"]')
    return tuple(value)


def _columns(path: Path, key: str, value: Any) -> tuple[tuple[str, str], ...]:
    if not isinstance(value, dict) or not all(isinstance(column, str) for column in value.values()):
        raise FormatError(
            f'{path}: columns is {str(value)[:40]}, expected names and columns, for example {{"mass": "m"}}'
        )
    return tuple(value.items())


def _text(path: Path, key: str, value: Any) -> str:
    if not isinstance(value, str) or not value or "\0" in value:
        raise FormatError(f"{path}: {key} is {str(value)[:40]}, expected text")
    return value


def _crs(path: Path, key: str, value: Any) -> Any:
    text = _text(path, key, value)
    try:
        return None if text.strip().lower() == LOCAL else crs_of_text(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _dem(path: Path, key: str, value: Any) -> str:
    return str((path.parent / _text(path, key, value)).absolute())


_VALUES = {
    "crs": _crs,
    "origin": _origin,
    "axes": _axes,
    "dem": _dem,
    "density": _positive,
    "particle_volume": _positive,
    "columns": _columns,
    "times": _numbers,
    "dt": _positive,
    "fps": _positive,
}


def find_sidecar(path: str | Path) -> Path | None:
    """Find the sidecar of a file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Path or None
        None where there is none.
    """
    path = Path(path)
    names = [path.stem]
    while (shorter := Path(names[-1]).stem) != names[-1]:
        names.append(shorter)  # slide.post.res: slide.post, slide
    names += [series[1] for name in names[:1] if (series := _SERIES.fullmatch(name)) and series[1]]
    places = [path.with_name(f"{name}.{SUFFIX}") for name in names] + [path.with_name(SUFFIX)]
    return next((place for place in places if place.is_file()), None)


def with_sidecar(paths: Iterable[str | Path], terms: Declarations) -> Declarations:
    """Complete declarations by the sidecar of the files.

    Parameters
    ----------
    paths : iterable of str or Path
    terms : Declarations
        Of the user; they have priority.

    Raises
    ------
    FormatError, InputError
        The files have several sidecars, or a damaged one.
    """
    if terms.sidecar is not None:
        return merged(terms, read_sidecar(terms.sidecar))
    found = {find_sidecar(path) for path in paths}
    if len(found) > 1:
        some = sorted(str(place) for place in found if place is not None)[:2]
        raise InputError(
            f"the files have different sidecars ({', '.join(some)}); give one with --sidecar, or put one "
            f"{SUFFIX} into their folder"
        )
    (place,) = found or (None,)
    return terms if place is None else merged(terms, read_sidecar(place))


def merged(terms: Declarations, other: Declarations) -> Declarations:
    """Complete declarations by other ones.

    Parameters
    ----------
    terms, other : Declarations
        Values of `terms` have priority.
    """
    open_names = [name for name in KEYS.values() if getattr(terms, name) in (None, ())]
    if terms.local:
        open_names.remove("crs")
    of_time = [KEYS[key] for key in OF_TIME]
    if any(getattr(terms, name) is not None for name in of_time):
        open_names = [name for name in open_names if name not in of_time]
    values = {name: getattr(other, name) for name in open_names}
    values["columns"] = tuple((dict(other.columns) | dict(terms.columns)).items())
    return replace(terms, **values)
