"""Compose pages of a report: barriers (loads over time, run-up, overtopping, section), places of the largest values."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from ...frames.flow_end import FlowEnd
from ...frames.load_table import read_barrier_table
from ...frames.run_folder import BARRIER_FILE, SCENE_FILE, STAGE_BARRIER_FILE
from ...maps.averaging.frame_values import cells_of
from ...maps.export.band_map import write_band_map
from ...scene.scene_reading import read_scene
from ...simulation.run_summary import extremes
from ...simulation.scene_files import scene_walls
from ...solvers.features.walls import Wall, half_thickness
from ...system.errors import MpmgisError
from ...system.file_references import require_local
from ...system.messages import log, muted
from ...terrain.grid import Grid
from ..barrier_loads import BarrierHistory, RunUp, history_rows, load_verdict, missed_crest
from ..load_plots import write_history_plot, write_section_plot
from ..opened_results import ExportFlow, FrameFlow, RasterFlow
from ..profile_answer import free_surface
from ..runout_answer import RunoutFound
from .html_page import Lines, Picture, Section, Table, figure_rows, section
from .printed_numbers import grouped, printed

NEAR_CELLS = 3.0  # [cells] of solver or map around a wall in which its run-up is looked for
SECTION_CELLS = 8.0  # [cells] of the map, at least, before a wall in its section; half as many behind it
SECTION_HEIGHTS = 6.0  # [heights of the wall] at least before a wall in its section; half as many behind it
MOST_PLACES = 2000  # sample points of a section
JOINED_SHARE = 0.04  # [1] of the longer side of the map: places nearer to each other have one label
LEAST_SHARE = 1e-5  # [1] of the mass; a place where less of it left is not listed
HEADINGS = ("number", "what", "value", "E [m]", "N [m]", "time [s]")
PEAKS = (  # band, words, unit, factor
    ("h_max", "largest depth in the maps", "m", 1.0),
    ("Ut_max", "largest speed in the maps", "m/s", 1.0),
    ("p_max", "largest pressure in the maps", "kPa", 1e-3),
)
STEPS = (("thickness", "largest vertical thickness of any step", "m"), ("speed", "largest speed of any step", "m/s"))
LEFT = {"hole": "into a hole of the DTM", "collar": "into the nodata around the DTM", "elsewhere": "at smaller places"}


@dataclass(frozen=True)
class Gathered:
    """What a report is made from.

    Parameters
    ----------
    flow : FrameFlow, ExportFlow or RasterFlow
    peaks : dict of str to float[rows, columns]
        Largest values of the cells by band.
    grid : Grid
        Of the peaks.
    record : dict
        run.json of the run; {} for results of other codes.
    scene : str
        Text of the scene; "" if unknown.
    runout : RunoutFound or None
    notes : tuple of str
        Messages while the results were read.
    release : list of shapely polygons or None
        Of a run, if its file is known and there.
    end : FlowEnd or None
        State of the flow in its last step, where it is known.
    """

    flow: FrameFlow | ExportFlow | RasterFlow
    peaks: dict
    grid: Grid
    record: dict
    scene: str
    runout: RunoutFound | None
    notes: tuple
    release: list | None
    end: FlowEnd | None = None


def barrier_sections(gathered: Gathered, folder: Path) -> Iterator[Section]:
    """Yield sections of the barriers of the run beside the frames; none where it has no barriers.

    Parameters
    ----------
    gathered : Gathered
        What the report is made from.
    folder : Path
        For pictures.

    Yields
    ------
    Section
    """
    flow = gathered.flow
    if not flow.entries:
        return
    histories = _histories(flow.entries[0].path.parent, gathered.record)
    walls = _walls(flow) if histories else {}
    for number, history in enumerate(histories):
        wall = walls.get(history.name)
        run_up = None if wall is None else _run_up(flow, wall, history)
        verdict = load_verdict(history, run_up) if wall is not None else "its polygons are not there: no verdict"
        rows = figure_rows(history_rows(history, run_up, flow.density))
        lines = tuple(filter(None, (verdict, missed_crest(history, run_up))))
        blocks = [Lines(lines), Table(("figure", "value"), rows)]
        path = folder / f"barrier_{number}.png"
        write_history_plot(path, history)
        blocks.append(Picture(path.read_bytes(), "Means between frames; overtopped mass so far"))
        if run_up is not None:
            blocks += [_plan(gathered, wall, run_up, path), _section(gathered, wall, history, run_up, path)]
        yield section(f"Barrier {history.name}{_of_stage(history, histories)}", *blocks, page=True)


def _of_stage(history, histories):
    return f" ({history.solver})" if sum(one.name == history.name for one in histories) > 1 else ""


def _histories(folder, record):
    """A BarrierHistory for each barrier and stage."""
    scene = record.get("scene") or {}
    stages = record.get("stages") or [record | {"solver": scene.get("solver", "columns")}]
    usual = (scene.get("numerics") or {}).get("cell_size")
    found = []
    for number, stage in enumerate(stages, start=1):
        path = folder / (STAGE_BARRIER_FILE.format(number) if record.get("stages") else BARRIER_FILE)
        cell = (stage.get("resolution") or {}).get("cell_size") or usual
        if not path.is_file() or not isinstance(cell, int | float):
            continue
        kept = bool((stage.get("volume") or {}).get("kept", True))
        tables = read_barrier_table(path)
        found += [
            BarrierHistory(name, str(stage.get("solver")), columns, float(cell), kept)
            for name, columns in tables.items()
        ]
    return found


def _walls(flow):
    """Name -> Wall of the scene beside the frames; {} where it or its files are gone."""
    path = flow.entries[0].path.parent / SCENE_FILE
    try:
        with muted():
            scene = read_scene(path)
            for table in scene.barrier:
                require_local(scene.path(table.source), path)
            return {wall.name: wall for wall in scene_walls(scene, flow.terrain)}
    except (MpmgisError, OSError) as error:
        log.info(f"no drawings of barriers: {error}")
        return {}


def _run_up(flow: FrameFlow, wall: Wall, history: BarrierHistory) -> RunUp | None:
    """The RunUp in the cells near a Wall, on the side that the flow comes from; None where it never loaded the wall."""
    if history.direction is None:
        return None
    reach = NEAR_CELLS * max(history.cell_size, flow.grid.cell_size)
    cells, x, y = _near(flow.grid, wall.footprint, reach)
    before = _towards(wall.footprint, x, y) @ history.direction > 0
    cells, x, y = cells[before], x[before], y[before]
    if not len(cells):
        return None
    depth = np.nan_to_num(flow.at_cells(cells, ("h",), range(len(flow.times)))["h"])
    wet = depth >= max(flow.min_depth, np.nextafter(0, 1))
    if not wet.any():
        return None
    step, k = np.unravel_index(np.argmax(depth), depth.shape)
    step, k = int(step), int(k)
    surface = free_surface(flow.terrain, x[k : k + 1], y[k : k + 1], depth[step : step + 1, k : k + 1])[0, 0]
    means = [row[of_row].mean() for row, of_row in zip(depth, wet, strict=True) if of_row.any()]
    foot = _nearest(wall, x[k], y[k])
    crest = _crest(flow.terrain, wall, foot)
    there, at_wall = flow.terrain.sample(np.array([x[k], foot[0]]), np.array([y[k], foot[1]]))
    places = float(x[k]), float(y[k]), float(flow.times[step])
    return RunUp(
        float(depth[step, k]),
        *places,
        step,
        float(surface),
        crest,
        float(np.median(means)),
        float(there - at_wall),
        float(crest - at_wall),
    )


def _towards(footprint: shapely.Geometry, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """float64[n, 2] [m]: from map points to the nearest points of a footprint."""
    lines = shapely.shortest_line(shapely.points(x, y), footprint)
    ends = shapely.get_coordinates(lines).reshape(-1, 2, 2)
    return ends[:, 1] - ends[:, 0]


def _near(grid: Grid, footprint: shapely.Geometry, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(flat cells, x, y) of the cells of `grid` within `reach` [m] of a footprint, but not in it."""
    low, high = np.reshape(footprint.buffer(reach).bounds, (2, 2))
    count = np.maximum(np.ceil((high - low) / (0.5 * grid.cell_size)).astype(int) + 1, 2)
    x, y = np.meshgrid(*(np.linspace(a, b, n) for a, b, n in zip(low, high, count, strict=True)))
    cells = np.unique(cells_of(grid, x.ravel(), y.ravel()))
    cells = cells[cells >= 0]
    x, y = grid.xy(*np.divmod(cells, grid.shape[1]))
    away = shapely.distance(footprint, shapely.points(x, y))
    near = (away > 0) & (away <= reach)
    return cells[near], np.asarray(x)[near], np.asarray(y)[near]


def _nearest(wall: Wall, x: float, y: float) -> np.ndarray:
    """float64[2]: point of the footprint nearest to a place."""
    line = shapely.shortest_line(wall.footprint, shapely.Point(x, y))
    return np.asarray(line.coords)[0]


def _crest(terrain, wall, place):
    """Elevation [m] of the crest at a point of the footprint."""
    if wall.crest is not None:
        return float(wall.crest)
    return float(terrain.sample(place[:1], place[1:])[0]) + float(wall.height)


def _plan(gathered: Gathered, wall: Wall, run_up: RunUp, path: Path) -> Picture:
    """The map of the largest depth around the barrier."""
    west, south, east, north = shapely.union(wall.footprint, shapely.Point(run_up.x, run_up.y)).bounds
    margin = max(0.5 * max(east - west, north - south), 10 * gathered.grid.cell_size)
    limits = gathered.flow.terrain.grid.bounds
    view = (
        max(west - margin, limits[0]),
        max(south - margin, limits[1]),
        min(east + margin, limits[2]),
        min(north + margin, limits[3]),
    )
    write_band_map(
        path,
        gathered.flow.terrain,
        gathered.grid,
        gathered.peaks["h_max"],
        "h_max",
        f"{wall.name}: plan",
        min_depth=gathered.flow.min_depth,
        view=view,
        walls=[wall.footprint],
        marks=[(run_up.x, run_up.y, "largest depth at the wall")],
    )
    return Picture(path.read_bytes(), "Plan: largest flow depth, normal to the slope")


def _section(gathered: Gathered, wall: Wall, history: BarrierHistory, run_up: RunUp, path: Path) -> Picture:
    """The section through the barrier nearest to the largest depth, in the direction of the force."""
    flow, foot = gathered.flow, _nearest(wall, run_up.x, run_up.y)
    direction = history.direction
    length = max(SECTION_CELLS * gathered.grid.cell_size, SECTION_HEIGHTS * run_up.wall)
    fine = min(0.1 * gathered.grid.cell_size, 0.1 * half_thickness(wall.footprint))
    spacing = max(fine, 1.5 * length / MOST_PLACES)
    along = np.arange(-length, 0.5 * length, spacing)
    x, y = (foot[:, None] + direction[:, None] * along).tolist()
    x, y = np.array(x), np.array(y)
    ground = flow.terrain.sample(x, y)
    inside = np.isfinite(ground)
    along, x, y, ground = along[inside], x[inside], y[inside], ground[inside]
    now = flow.at_cells(cells_of(flow.grid, x, y), ("h",), [run_up.step])["h"]
    cells = cells_of(gathered.grid, x, y)
    peak = np.where(cells >= 0, gathered.peaks["h_max"].ravel()[cells], np.nan)[None]
    surfaces = {
        words: np.where(depth[0] >= flow.min_depth, free_surface(flow.terrain, x, y, depth)[0], np.nan)
        for words, depth in (("largest depth", peak), (f"surface at t = {run_up.time:.4g} s", now))
    }
    in_wall = shapely.contains_xy(wall.footprint, x, y)
    write_section_plot(path, wall.name, along, ground, surfaces, in_wall, run_up.crest)
    return Picture(path.read_bytes(), "Section through the place of the largest depth at the wall")


def places_section(gathered: Gathered, folder: Path) -> Section | None:
    """Return a section with a numbered table and map of places; None where none is known.

    Parameters
    ----------
    gathered : Gathered
        What the report is made from.
    folder : Path
        For pictures.

    Returns
    -------
    Section or None
    """
    rows = [*_of_maps(gathered), *_of_record(gathered.record)]
    if not rows:
        return None
    cells = [
        (str(k), what, value, grouped(x, 1), grouped(y, 1), time)
        for k, (what, value, x, y, time) in enumerate(rows, start=1)
    ]
    blocks = [Table(HEADINGS, tuple(cells))]
    depth = gathered.peaks.get("h_max")
    if depth is not None and np.isfinite(depth).any():
        path = folder / "places.png"
        marks = [(x, y, str(k)) for k, (_, _, x, y, _) in enumerate(rows, start=1)]
        flow = gathered.flow
        view = _view(flow.terrain, gathered.grid, depth > flow.min_depth, marks)
        write_band_map(
            path,
            flow.terrain,
            gathered.grid,
            depth,
            "h_max",
            "Places of the table",
            min_depth=flow.min_depth,
            view=view,
            marks=_labelled(marks, JOINED_SHARE * max(view[2] - view[0], view[3] - view[1])),
        )
        blocks.append(Picture(path.read_bytes(), "Places of the table over the largest depth"))
    return section("Places", *blocks, page=True)


def _of_maps(gathered):
    for band, words, unit, factor in PEAKS:
        values = gathered.peaks.get(band)
        if values is not None and np.isfinite(values).any():
            place = np.unravel_index(np.nanargmax(values), values.shape)
            x, y = gathered.grid.xy(*place)
            yield words, f"{printed(float(values[place]) * factor)} {unit}", float(x), float(y), ""


def _of_record(record):
    """Rows of run.json: extremes of every step with their times, and where mass left."""
    stages = record.get("stages") or [record]
    balances = [stage["balances"] for stage in stages if stage.get("balances")] or (
        [record["balances"]] if record.get("balances") else []
    )
    found = record.get("extremes") or extremes(balances)
    for name, words, unit in STEPS:
        if name in found:
            one = found[name]
            yield words, f"{printed(one['value'])} {unit}", *map(float, one["at"]), f"{one['time']:.1f}"
    mass = record.get("mass") or {}
    left = mass.get("left_places") or [place for one in balances for place in one.get("left_places") or ()]
    total = max((one.get("mass_start") or 0.0 for one in balances), default=0.0)
    for place in left:
        if place["mass"] > LEAST_SHARE * total:
            words = LEFT.get(place["where"], f"over the {place['where']} edge of the DTM")
            share = f" ({100 * place['mass'] / total:.3g} %)" if total > 0 else ""
            yield f"mass left {words}", f"{printed(place['mass'])} kg{share}", place["east"], place["north"], ""


def _labelled(marks, distance):
    """All marks, with the numbers of those within `distance` [m] together at the first of them."""
    labels = []
    for x, y, text in marks:
        near = next((one for one in labels if np.hypot(one[0] - x, one[1] - y) <= distance), None)
        if near is None:
            labels.append([x, y, text])
        else:
            near[2] += f", {text}"
    return [*((x, y, "") for x, y, _ in marks), *map(tuple, labels)]


def _view(terrain, grid, flow, marks):
    """(west, south, east, north) [m] around flow and marks, within the terrain."""
    row, column = np.nonzero(flow)
    x, y = grid.xy(row, column)
    x, y = np.r_[x, [mark[0] for mark in marks]], np.r_[y, [mark[1] for mark in marks]]
    margin = 0.12 * max(np.ptp(x), np.ptp(y), 10 * grid.cell_size)
    west, south, east, north = terrain.grid.bounds
    return (
        float(max(x.min() - margin, west)),
        float(max(y.min() - margin, south)),
        float(min(x.max() + margin, east)),
        float(min(y.max() + margin, north)),
    )
