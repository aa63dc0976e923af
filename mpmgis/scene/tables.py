"""A scene: what is asked. One set of tables is the TOML form, the Python form, its checks and its documentation.

A table that is present is an effect in the scene; unknown tables and keys are errors.
"""

import codecs
import difflib
import hashlib
import json
import math
import re
import tomllib
from dataclasses import MISSING, asdict, dataclass, field, fields
from pathlib import Path

from ..effects import friction, metric
from ..errors import SceneError, one_line

USE = ("auto", "on", "off")
KIND_WORDS = {float: "a number", int: "a whole number", str: "text", bool: "true or false", list: "a list of numbers"}


def _key(doc, default=MISSING, kind=float, low=None, high=None, choices=None, above=False, example=None):
    """One key of a table: its words in the template and the checks on its value.

    `low` is the smallest value (`above`: not reached), `high` the largest; `kind` a type or tuple of types.
    """
    metadata = {
        "doc": doc, "kind": kind, "low": low, "high": high, "choices": choices, "above": above, "example": example,
    }  # fmt: skip
    return field(default=default, metadata=metadata) if default is not MISSING else field(metadata=metadata)


@dataclass(frozen=True)
class TerrainTable:
    """Where."""

    dem: str = _key("digital terrain model: any raster that GDAL reads, metres", kind=str, example="dtm.tif")
    crs: str | None = _key("for a DTM that carries no CRS: EPSG:n, or local", None, kind=str, example="EPSG:32632")
    band: int | None = _key("band with the elevation, where the DTM has several", None, kind=int, low=1, example=1)


@dataclass(frozen=True)
class ReleaseTable:
    """What starts to move."""

    source: str | None = _key("release areas: any vector file, or a raster", None, kind=str, example="release.shp")
    particles: str | None = _key("instead of source: columns that `mpmgis seed` wrote", None, kind=str, example="a.h5")
    thickness: float | str | None = _key(
        "number [m], column name, or raster; without it the column thickness, d0 or relth",
        None,
        kind=(float, str),
        low=0.0,
        above=True,
        example=1.5,
    )
    thickness_mode: str = _key("thickness measured normal to the slope, or vertical", "normal", str,
                               choices=("normal", "vertical"))  # fmt: skip
    surface: str | None = _key("instead of thickness: raster of the surface before release", None, kind=str,
                               example="surface.tif")  # fmt: skip
    density: float = _key("bulk density [kg m-3]", 1000.0, low=1.0, high=30000.0)
    velocity: tuple = _key("initial velocity (east, north) [m s-1]", (0.0, 0.0), kind=list)
    points: str = _key("point set", "lattice", str, choices=("lattice", "jittered", "halton", "random"))
    seed: int = _key("seed of the random point sets", 0, kind=int, low=0)


@dataclass(frozen=True)
class FrictionTable:
    """Resistance of the bed; without this table there is none."""

    law: str = _key("law of basal resistance", kind=str, choices=tuple(friction.LAWS), example="Voellmy")
    use: str = _key("auto and on: used; off: left out", "auto", str, choices=USE)
    parameters: dict = field(default_factory=dict, metadata={"parameters_of": friction.LAWS})


@dataclass(frozen=True)
class CurvatureTable:
    """Curvature of the bed (form slope): tangent transport and centrifugal load."""

    use: str = _key("auto: on where it changes more than 5 % of the load", "auto", str, choices=USE)


@dataclass(frozen=True)
class StillWaterTable:
    """A lake at rest as reference (form swe)."""

    level: float = _key("elevation of the still surface [m]", example=1500.0)
    use: str = _key("auto and on: used; off: left out", "auto", str, choices=USE)


@dataclass(frozen=True)
class NumericsTable:
    """How it is computed; none of this is physics."""

    cell_size: float | None = _key("solver cell [m]; without it the DTM's own", None, low=0.0, above=True, example=5.0)
    particles_per_cell: int = _key("columns a cell: 4, 9, 16, 25...", 16, kind=int, low=1, high=400)
    precision: str = _key("columns are computed in float64 (float32 would save 5 %)", "float64", str,
                          choices=("float64",))  # fmt: skip
    form: str = _key("slope: mass flows on steep ground; swe: water, gentle beds", "slope", str,
                     choices=tuple(metric.FORMS))  # fmt: skip
    edges: str = _key("edges of the terrain: open (outflow is booked) or wall", "open", str, choices=("open", "wall"))
    cfl: float = _key("Courant number; above 0.9 the scheme is unstable", 0.3, low=0.0, high=0.9, above=True)
    clamp: float = _key("keep columns within this factor of the grid's thickness; 0: off", 0.0, low=0.0)


@dataclass(frozen=True)
class OutputTable:
    """What is kept, and when it ends."""

    end_time: float = _key("longest simulated time [s]", low=0.0, above=True, example=120.0)
    frame_interval: float = _key("time between frames [s]", low=0.0, above=True, example=2.0)
    maxima: bool = _key("keep running peaks of every step in the frames", False, kind=bool)
    stop_at_rest: bool | None = _key("end early when the flow has come to rest; default: in slope, not in swe", None,
                                     kind=bool, example=True)  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """A whole scene. Paths are as written, `folder` is what they are relative to."""

    terrain: TerrainTable
    release: ReleaseTable
    output: OutputTable
    numerics: NumericsTable = NumericsTable()
    friction: FrictionTable | None = None
    curvature: CurvatureTable | None = None
    still_water: StillWaterTable | None = None
    solver: str = "columns"
    folder: str = "."

    def path(self, name):
        """The path that `name` in this scene means."""
        return Path(self.folder) / Path(name).expanduser()

    def as_tables(self):
        """The scene as the plain dictionary that TOML and JSON hold; absent tables and unset keys are left out."""
        tables = {"solver": self.solver}
        for name in TABLES:
            table = getattr(self, name)
            if table is None:
                continue
            values = {k: v for k, v in asdict(table).items() if v is not None and k != "parameters"}
            values.update(getattr(table, "parameters", {}))
            tables[name] = {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
        return tables

    def digest(self, *inputs):
        """Hex digest of the scene and of what else decides its result (digests of the input files)."""
        text = json.dumps([self.as_tables(), list(inputs)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


TABLES = {
    "terrain": TerrainTable,
    "release": ReleaseTable,
    "friction": FrictionTable,
    "curvature": CurvatureTable,
    "still_water": StillWaterTable,
    "numerics": NumericsTable,
    "output": OutputTable,
}
REQUIRED = ("terrain", "release", "output")
SOLVERS = ("columns",)


def read_scene(path):
    """Read and check `scene.toml` at `path`; raises SceneError in one line."""
    path = Path(path)
    try:
        text = _decoded(path.read_bytes())
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path} is no readable text file ({one_line(error)[:80]})") from error
    try:
        tables = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SceneError(f"{path} is no valid TOML: {one_line(error)[:120]}{_cure(text, error)}") from error
    return scene_from_tables(tables, path.parent, path.name)


def _decoded(raw):
    """Text of a file as editors on any system save it: UTF-8, with or without a byte order mark, or UTF-16 with one."""
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16")
    return raw.decode("utf-8-sig")


def _cure(text, error):
    """What a line that TOML cannot read most likely means."""
    number = re.search(r"at line (\d+)", str(error))
    lines = text.splitlines()
    line = lines[int(number[1]) - 1] if number and int(number[1]) <= len(lines) else ""
    if re.search(r"=\s*-?\d+,\d", line):
        return "; numbers take a point, not a comma"
    if "\\" in line:
        return "; write paths with / or in 'single quotes'"
    return ""


def scene_from_tables(tables, folder=".", where="scene"):
    """Check a plain dictionary and make the Scene of it; raises SceneError naming table, key, value and cure."""
    tables = dict(tables)
    solver = tables.pop("solver", "columns")
    if solver not in SOLVERS:
        raise SceneError(f"{where}: solver = {solver!r}, this version has {_listed(SOLVERS)}")
    for name in tables:
        if name not in TABLES:
            raise SceneError(f"{where}: unknown table [{name}]{_meant(name, TABLES)}; it takes {_listed(TABLES)}")
        if not isinstance(tables[name], dict):
            raise SceneError(f"{where}: {name} is no table; write [{name}] on a line of its own")
    for name in REQUIRED:
        if name not in tables:
            raise SceneError(f"{where}: the table [{name}] is missing; `mpmgis run --template` shows one")
    made = {name: _table(TABLES[name], values, f"{where} [{name}]") for name, values in tables.items()}
    scene = Scene(**made, solver=solver, folder=str(folder))
    _check_together(scene, where)
    return scene


def _check_together(scene, where):
    """What no single key can tell."""
    release, numerics, output = scene.release, scene.numerics, scene.output
    if (release.source is None) == (release.particles is None):
        got = "both" if release.source else "none"
        raise SceneError(f"{where} [release]: wanted either source or particles, got {got}")
    if release.particles is not None:
        _refuse_unused(release, ("source", "particles"), f"{where} [release]")
    if len(release.velocity) != 2 or not all(_is_number(v) and math.isfinite(v) for v in release.velocity):
        raise SceneError(f"{where} [release]: velocity = {list(release.velocity)}, wanted two numbers [east, north]")
    if output.frame_interval > output.end_time:
        raise SceneError(
            f"{where} [output]: frame_interval = {output.frame_interval:g} is longer than end_time = "
            f"{output.end_time:g}; take a shorter one"
        )
    if output.end_time / output.frame_interval > 1e6:
        raise SceneError(f"{where} [output]: more than a million frames; take a longer frame_interval")
    if numerics.form == "swe" and scene.curvature is not None and scene.curvature.use == "on":
        raise SceneError(f"{where} [curvature]: use = 'on' belongs to form = 'slope'; take the table out")
    if numerics.form != "swe" and scene.still_water is not None and scene.still_water.use != "off":
        raise SceneError(f"{where} [still_water]: a lake at rest needs [numerics] form = 'swe'")


def _refuse_unused(release, used, where):
    """Particles from a file bring all else with them: a key that would not be used is an error."""
    for f in fields(release):
        if f.name not in used and getattr(release, f.name) != f.default:
            raise SceneError(f"{where}: particles bring their own {f.name}; take {f.name} out")


def _table(kind, values, where):
    """One table from its dictionary."""
    known = {f.name: f for f in fields(kind) if "kind" in f.metadata}
    laws = next((f.metadata["parameters_of"] for f in fields(kind) if "parameters_of" in f.metadata), None)
    made, extra = {}, {}
    for name, value in values.items():
        if name in known:
            made[name] = _value(known[name].metadata, value, f"{where}: {name}")
        elif laws is None:
            raise SceneError(f"{where}: unknown key {name!r}{_meant(name, known)}; it takes {_listed(known)}")
        else:
            extra[name] = value
    for name, f in known.items():
        if f.default is MISSING and name not in made:
            raise SceneError(f"{where}: {name} is missing ({f.metadata['doc']})")
    if laws is not None:
        made["parameters"] = _parameters(laws, made["law"], extra, where)
    return kind(**made)


def _parameters(laws, law, values, where):
    """The parameters of `law`, all present, none unknown, each in its range."""
    wanted = laws[law][1]
    takes = ", ".join(f"{name} [{unit}]" for name, (unit, *_) in wanted.items())
    for name in values:
        if name not in wanted:
            raise SceneError(f"{where}: {law} has no parameter {name!r}{_meant(name, wanted)}; it takes {takes}")
    made = {}
    for name, (unit, doc, low, high) in wanted.items():
        if name not in values:
            raise SceneError(f"{where}: {law} needs {name} [{unit}] ({doc})")
        checks = {"kind": float, "low": low, "high": high, "choices": None, "above": False}
        made[name] = _value(checks, values[name], f"{where}: {name}")
    return made


def _value(checks, value, where):
    """`value` after its checks."""
    kinds = checks["kind"] if isinstance(checks["kind"], tuple) else (checks["kind"],)
    if float in kinds and _is_number(value):
        value = float(value)
        if not math.isfinite(value):
            raise SceneError(f"{where} = {value}, wanted a finite number")
    elif not (isinstance(value, kinds) and isinstance(value, bool) == (bool in kinds)):
        raise SceneError(f"{where} = {value!r}, wanted {' or '.join(KIND_WORDS[k] for k in kinds)}")
    if checks["choices"] and value not in checks["choices"]:
        raise SceneError(f"{where} = {value!r}{_meant(value, checks['choices'])}; wanted {_listed(checks['choices'])}")
    if _is_number(value):
        low, high = checks["low"], checks["high"]
        if low is not None and (value < low or (checks["above"] and value <= low)):
            raise SceneError(f"{where} = {value:g}, wanted {'above' if checks['above'] else 'at least'} {low:g}")
        if high is not None and value > high:
            raise SceneError(f"{where} = {value:g}, wanted at most {high:g}")
    return tuple(value) if isinstance(value, list) else value


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _listed(names):
    return ", ".join(map(str, names))


def _meant(name, known):
    close = difflib.get_close_matches(str(name), list(map(str, known)), 1)
    return f"; did you mean {close[0]!r}?" if close else ""
