"""Scenes from TOML files and from plain dictionaries.

Checks on several keys or tables of a scene together.

Material parameters from a scene, or from a file with little more than a material.
"""

import codecs
import re
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

from ..laws import friction
from ..laws.own_law import NO_OWN_LAWS
from ..system.errors import SceneError, one_line
from .scene import Scene, friction_laws
from .stage_checks import check_points, check_solver, check_stages
from .table_values import checked_value, is_finite, is_number, listed, made_table, meant, range_of, refuse_both, shown
from .tables import FASTEST, LISTED, TABLES, MaterialTable
from .terrain_effects import check_forest


def check_together(scene, where):
    """Checks that involve several keys."""
    numerics, output = scene.numerics, scene.output
    _check_sources(scene, where)
    _check_window(scene.terrain.window, where)
    check_stages(scene, where)
    if "points" in scene.solvers:
        check_points(scene, where)
    elif numerics.precision != "float64":
        raise SceneError(
            f"{where} [numerics]: precision = {numerics.precision!r} requires solver = 'points'; columns are "
            "computed in float64 (float32 would save 5 % of the time): remove it"
        )
    _check_material(scene, where)
    _check_zones(scene, where)
    _check_places(scene, where)
    check_forest(scene, where)
    if 0.0 < numerics.clamp < 1.0:
        raise SceneError(f"{where} [numerics]: clamp = {numerics.clamp:g} allows no thickness; use at least 1, or 0")
    if output.frame_interval > output.end_time:
        raise SceneError(
            f"{where} [output]: frame_interval = {output.frame_interval:g} is longer than end_time = "
            f"{output.end_time:g}; take a shorter one"
        )
    if output.end_time / output.frame_interval > 1e6:
        raise SceneError(
            f"{where} [output]: end_time = {output.end_time:g} and frame_interval = {output.frame_interval:g} give "
            "more than a million frames; take an earlier end_time or a longer frame_interval"
        )
    if output.arrival_thickness is not None and not output.maxima:
        raise SceneError(f"{where} [output]: arrival_thickness is kept only with maxima = true; add it, or take it out")
    for key in ("raster_cell_size", "raster_min_depth", "raster_products"):
        if getattr(output, key) is not None and not output.rasters:
            raise SceneError(f"{where} [output]: {key} is used only with rasters = true; add it, or take it out")
    if numerics.form == "swe" and scene.curvature is not None and scene.curvature.use not in ("auto", "off"):
        use = scene.curvature.use
        raise SceneError(f"{where} [curvature]: use = {use!r} requires form = 'slope'; remove the table")
    if numerics.form != "swe" and scene.still_water is not None and scene.still_water.use != "off":
        raise SceneError(f"{where} [still_water]: a lake at rest needs [numerics] form = 'swe'")


def _check_sources(scene, where):
    """What starts to move: from an area, from particles, through an inlet, or several of these with one density."""
    release, inflow = scene.release, scene.hydrograph
    if release is None and (inflow is None or inflow.use == "off"):
        raise SceneError(
            f"{where}: the table [release] is missing, and there is no [hydrograph] with inflow; "
            "`mpmgis run --template` shows both"
        )
    if release is None:
        return
    if (release.source is None) == (release.particles is None):
        got = "both" if release.source else "none"
        raise SceneError(f"{where} [release]: expected either source or particles, got {got}")
    if release.particles is not None:
        _refuse_unused(release, ("source", "particles", "window"), f"{where} [release]")
    elif release.window is not None:
        raise SceneError(
            f"{where} [release]: window applies to particles only, not to a source with an outline; remove window"
        )
    if len(release.velocity) != 2 or not all(is_number(v) and abs(v) <= FASTEST for v in release.velocity):
        raise SceneError(
            f"{where} [release]: velocity = {shown(list(release.velocity))}, expected two numbers [east, north] of "
            f"at most {FASTEST:g} m/s"
        )
    if release.speed is not None and any(release.velocity):
        raise SceneError(f"{where} [release]: speed and velocity exclude each other; take one of them out")


def _check_window(window, where):
    """Four numbers in their order."""
    if window is None:
        return
    if len(window) != 4 or not all(is_finite(v) for v in window):
        raise SceneError(
            f"{where} [terrain]: window = {shown(list(window))}, expected four numbers [west, south, east, north]"
        )
    if not (window[0] < window[2] and window[1] < window[3]):
        raise SceneError(
            f"{where} [terrain]: window = {shown(list(window))}, expected west below east and south below north, in "
            "this order"
        )


def _check_material(scene, where):
    """Values of resistance that contradict each other."""
    table = scene.earth_pressure
    if table is not None and table.use != "off" and scene.bed_friction_angle() > table.friction_angle:
        of_mu = "" if table.bed_friction_angle is not None else " (atan of the friction coefficient)"
        raise SceneError(
            f"{where} [earth_pressure]: the bed's friction angle, {scene.bed_friction_angle():.4g} degrees{of_mu}, is "
            f"above friction_angle = {table.friction_angle:g}; give bed_friction_angle, at most that"
        )
    table = scene.viscosity
    if table is not None and table.viscosity == 0.0 and table.yield_stress == 0.0:
        raise SceneError(f"{where} [viscosity]: viscosity and yield_stress are both 0; give one, or take the table out")


def _check_zones(scene, where):
    """Zones give parameters of the law that [friction] names: numbers in their range, columns or rasters."""
    if not scene.zones:
        return
    if scene.friction is None:
        raise SceneError(f"{where} [[zones]]: zones need [friction] with its law; write it before the zones")
    law = scene.friction.law
    instead = friction.given_instead(law)
    wanted = scene.laws[law][1] | {name: parameter for name, (_, parameter) in instead.items()}
    for number, zone in enumerate(scene.zones, 1):
        here = f"{where} [[zones]] number {number}"
        if not zone.parameters:
            raise SceneError(f"{here}: it has no parameter of {law}; expected {listed(wanted)}")
        for name, value in zone.parameters.items():
            if name not in wanted:
                raise SceneError(
                    f"{here}: {law} has no parameter {shown(name)}{meant(name, wanted)}; it takes {listed(wanted)}"
                )
            zone.parameters[name] = checked_value(range_of(wanted[name], (float, str)), value, f"{here}: {name}")
            if name in instead:
                refuse_both(name, instead[name][0], zone.parameters, here)
        if zone.source is None and all(not isinstance(value, str) for value in zone.parameters.values()):
            raise SceneError(
                f"{here}: without source, numbers would apply everywhere; give source (polygons), "
                f"or put them in [friction]"
            )


def _check_places(scene, where):
    """What barriers and lakes need together."""
    for number, barrier in enumerate(scene.barrier, 1):
        if (barrier.height is None) == (barrier.crest is None):
            got = "none" if barrier.height is None else "both"
            raise SceneError(f"{where} [[barrier]] number {number}: expected either height or crest, got {got}")
    lake = scene.still_water
    if lake is not None and isinstance(lake.level, str) and lake.source is None:
        raise SceneError(
            f"{where} [still_water]: level = {lake.level!r} is a column, but there is no source with columns; give "
            "source, or level a number of metres"
        )


def _refuse_unused(release, used, where):
    """Particles from a file bring all else with them: a key that would not be used is an error."""
    for f in fields(release):
        if f.name not in used and getattr(release, f.name) != f.default:
            raise SceneError(f"{where}: particles have a {f.name}; remove {f.name}")


MOST_DOTS = 100  # in a key
REQUIRED = ("terrain", "output")
SOLVERS = ("columns", "points")


def read_scene(path, own_laws=NO_OWN_LAWS):
    """Read and check `scene.toml` at `path`, with user-defined laws; raises SceneError in one line."""
    path = Path(path)
    return scene_from_tables(read_toml(path), path.parent, path.name, own_laws)


def read_toml(path):
    """The dictionary in a TOML file as any editor saves it; raises SceneError in one line."""
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise SceneError(f"{path} is a pipe or a device, expected a file; write the scene into one")
    try:
        text = _decoded(path.read_bytes())
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file") from error
    except IsADirectoryError as error:
        raise SceneError(f"{path} is a folder, expected a text file; name the file in it") from error
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path} is not a readable text file ({one_line(error)[:80]})") from error
    _require_short_keys(path, text)
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: of TOML, and for integers with thousands of digits
        raise SceneError(f"{path} is not valid TOML: {one_line(error)[:120]}{_hint(text, error)}") from error
    return tables


_MAY_BE_KEY = re.compile(r"[\w\s.\[\"'-]+")


def _require_short_keys(path, text):
    """Refuse dotted keys of many parts: the parser's memory and time grow with the square of their number."""
    for number, line in enumerate(text.splitlines(), 1):
        runs = _MAY_BE_KEY.finditer(line)  # a key is at the start of a line and before each = of an inline table
        dots = max((run[0].count(".") for run in runs if run.start() == 0 or line[run.end() : run.end() + 1] == "="),
                   default=0)  # fmt: skip
        if dots > MOST_DOTS:
            raise SceneError(f"{path}, line {number}: a key of {dots + 1} parts; a scene's keys have one or two")


def _decoded(raw):
    """Text of a file as editors on any system save it: UTF-8, with or without a byte order mark, or UTF-16 with one."""
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16")
    return raw.decode("utf-8-sig")


def _hint(text, error):
    """What a line that TOML cannot read most likely means."""
    number = re.search(r"at line (\d+)", str(error))
    lines = text.splitlines()
    line = lines[int(number[1]) - 1] if number and int(number[1]) <= len(lines) else ""
    if re.search(r"=\s*-?\d+,\d", line):
        return "; numbers take a point, not a comma"
    if "\\" in line:
        return "; write paths with / or in 'single quotes'"
    if re.search(r"=\s*(?!(?:true|false|inf|nan)\b)[A-Za-z]", line):
        return '; put words in "quotes"'
    return ""


def scene_from_tables(tables, folder=".", where="scene", own_laws=NO_OWN_LAWS):
    """Check a plain dictionary and make the Scene of it; raises SceneError with table, key, value and fix."""
    tables = dict(tables)
    solver = tables.pop("solver", None)
    if solver not in (None, *SOLVERS):
        raise SceneError(f"{where}: solver = {shown(solver)}, this version has {listed(SOLVERS)}")
    for name, value in tables.items():
        if name not in TABLES and not isinstance(value, (dict, list)):
            near = meant(name, ("solver", *TABLES))
            raise SceneError(
                f"{where}: unknown key {shown(name)}{near}; before the first table there is only the key solver"
            )
        if name not in TABLES:
            raise SceneError(f"{where}: unknown table [{name}]{meant(name, TABLES)}; it takes {listed(TABLES)}")
        if name in LISTED:
            if not (isinstance(tables[name], list) and all(isinstance(entry, dict) for entry in tables[name])):
                raise SceneError(f"{where}: there can be several {name}; write [[{name}]] on a separate line")
        elif not isinstance(tables[name], dict):
            raise SceneError(f"{where}: {name} is not a table; write [{name}] on a separate line")
    for name in REQUIRED:
        if name not in tables:
            raise SceneError(f"{where}: the table [{name}] is missing; `mpmgis run --template` shows one")
    stages = _made("stage", tables.pop("stage", ()), where, own_laws, (), None)
    solver = _first_solver(solver, stages, where)
    solvers = {stage.solver for stage in stages} or {solver}
    check_solver(tables, solvers, TABLES, where)
    by_place = {key for zone in tables.get("zones", ()) if zone.get("use") != "off" for key in zone}
    law = tables.get("friction", {}).get("law")
    instead = friction.given_instead(law) if isinstance(law, str) else {}
    by_place |= {parameter for name, (parameter, _) in instead.items() if name in by_place}
    contacts = friction_laws(solvers, NO_OWN_LAWS) if "points" in solvers else None
    made = {name: _made(name, values, where, own_laws, by_place, contacts) for name, values in tables.items()}
    scene = Scene(**made, stage=stages, solver=solver, folder=str(folder), own_laws=own_laws)
    if own_laws.laws and (scene.friction is None or scene.friction.law not in own_laws.laws):
        raise SceneError(f"{where}: --law {own_laws.path} was given, but [friction] does not name it; leave --law out")
    check_together(scene, where)
    return scene


def _first_solver(solver, stages, where):
    """The solver that a run begins with: that of the first stage, or `solver` of the scene (None: not given)."""
    if not stages:
        return solver or "columns"
    if solver not in (None, stages[0].solver):
        raise SceneError(
            f"{where}: solver = {solver!r}, but the first [[stage]] has {stages[0].solver!r}; remove this line, the "
            "stages define it"
        )
    return stages[0].solver


def _made(name, values, where, own_laws, by_place, contacts):
    """The table `name`, or the tuple of all tables of that name, from TOML."""
    if name == "friction":
        return made_table(TABLES[name], values, f"{where} [{name}]", own_laws, by_place, contacts)
    if name not in LISTED:
        return made_table(TABLES[name], values, f"{where} [{name}]")
    return tuple(made_table(TABLES[name], v, f"{where} [[{name}]] number {k}") for k, v in enumerate(values, 1))


MATERIAL_TABLES = ("material", "softening", "friction", "output")
# required in a scene but not in a material file; not used
_REST = {
    "terrain": {"dem": "dtm.tif"}, "release": {"source": "release.shp", "thickness": 1.0, "density": 1000.0},
    "numerics": {"cell_size": 1.0}, "output": {},
}  # fmt: skip
EXAMPLE = 'law = "DruckerPrager", bulk_modulus, shear_modulus [Pa], friction_angle [degrees], cohesion [Pa]'


class GivenMaterial(NamedTuple):
    """A MaterialTable; if present in the file, tan of the friction angle on the bed [1], the law that it is of, when
    to end [s]; `lost`, tables of the file that other solvers do not get."""

    table: MaterialTable
    bed_friction: float | None
    bed_law: str
    end_time: float | None
    lost: tuple


def read_material(path):
    """The GivenMaterial in a scene, or in a TOML file with [material] and maybe [friction] and [output].

    Raises
    ------
    SceneError
        No such file, no material in it, impossible values.
    """
    path = Path(path)
    tables = read_toml(path)
    if "material" not in tables:
        raise SceneError(f"{path} has no table [material]; write one: {EXAMPLE}")
    whole = "terrain" in tables
    alien = [name for name in tables if name not in (*MATERIAL_TABLES, "solver")]
    if not whole and alien:
        raise SceneError(
            f"{path}: [{alien[0]}] is in a file without [terrain], which is not a scene; "
            f"expected one of {', '.join(MATERIAL_TABLES)}"
        )
    filled = tables if whole else _filled(tables)
    scene = scene_from_tables(filled, path.parent, path.name)
    friction = scene.friction.parameters.get("mu") if scene.friction is not None else None
    lost = tuple(name for name in ("softening", "zones", "barrier") if tables.get(name))
    law = scene.friction.law if scene.friction is not None else ""
    end = scene.output.end_time if "end_time" in tables.get("output", ()) else None
    return GivenMaterial(scene.material, friction, law, end, lost)


def _filled(tables):
    """The tables of a material file with the required tables of a scene; some keys of [output] are allowed."""
    filled = {"solver": "points"} | _REST | tables
    own = filled["output"]
    if isinstance(own, dict):  # a frame at the end: whatever the one is, the other is possible with it
        end, interval = own.get("frame_interval", 1.0), own.get("end_time", 1.0)
        filled["output"] = {"end_time": end, "frame_interval": interval} | own
    return filled
