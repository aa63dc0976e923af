"""Write outlines, release and thinned particles into one GeoPackage, from step data spooled to disk.

The GeoPackage and the mesh need all steps. With the spool, memory is that of one step, and rasters are not read again.
"""

import os
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from affine import Affine

from ...compiled import mask_rings
from ...frames.particles import Frame
from ...system.errors import OutputError, one_line
from ...system.optional_libraries import GEOPACKAGE, pyogrio
from ...terrain.grid import Grid
from ..averaging.exported_folder import ExportedRun, moved_corner
from .map_clock import BASE, Clock
from .smoothing import smooth_parts
from .vector_styles import (
    ENVELOPE,
    OUTLINE,
    RELEASE,
    outline_renderer,
    speed_renderer,
    vector_style_document,
    write_layer_styles,
)
from .xml_markup import reference_text

BANDS = ("h", "t", "Un", "Ut", "Ut_E", "Ut_N")  # of cells, that are stored
SHOWN = ("ids", "place", "velocity")  # of particles, that are stored
PARTICLES_SHOWN = 300  # [particles] per step, about
BATCH = 32_000_000  # [bytes] of geometry in memory
UTC = 100  # GDAL's code for UTC
LEAST_PART = 4  # [cells] smaller parts of the flow, and smaller holes in it, are not outlined
POINTS = 0  # geometry type of QGIS
POLYGONS = 2  # geometry type of QGIS


class StepOutline(NamedTuple):
    """Outline of the flow at one step.

    Parameters
    ----------
    wkb : bytes
    cells : int
        Number of cells inside.
    depth : float [m]
    speed : float [m s-1]
        The largest ones.
    """

    wkb: bytes
    cells: int
    depth: float
    speed: float


class StepSpool:
    """Temporary storage of steps in a folder.

    Parameters
    ----------
    folder : path
        Is created here and must be removed by the caller.
    """

    def __init__(self, folder: Path):
        self._folder, self.count = Path(folder), 0
        self._folder.mkdir()

    def add(
        self, index: np.ndarray, bands: dict, outline: StepOutline | None = None, shown: dict | None = None
    ) -> None:
        """Store one step.

        Parameters
        ----------
        index : int64[k]
            Flat index of its cells in the export grid, ascending.
        bands : dict of str to float32[k]
            Of BANDS; without `Ut_E` and `Ut_N` the mesh has no arrows.
        outline : StepOutline or None
        shown : dict or None
            The displayed particles: `ids` uint64[m], `place` float64[m, 3] [m], `velocity` float64[m, 3] [m s-1].
        """
        kept = {name: np.asarray(bands[name], np.float32) for name in BANDS if name in bands}
        with open(self._cells(self.count), "wb") as file:
            for array in (np.array(list(kept), "U8"), np.asarray(index, np.int64), *kept.values()):
                np.save(file, array)
        shapes = {}
        if outline is not None:
            shapes = {"wkb": np.frombuffer(outline.wkb, np.uint8), "facts": np.array(outline[1:], float)}
        np.savez(self._shapes(self.count), **shapes, **(shown or {}))
        self.count += 1

    def bands(self, step: int) -> tuple[np.ndarray, dict]:
        """Read the values of a step's cells.

        Parameters
        ----------
        step : int

        Returns
        -------
        (int64[k], dict of str to float32[k])
            Flat numbers of the cells, values by band.
        """
        with open(self._cells(step), "rb") as file:
            names, index = np.load(file), np.load(file)
            return index, {str(name): np.load(file) for name in names}

    def outline(self, step: int) -> StepOutline | None:
        """Read the outline of a step; None without one.

        Parameters
        ----------
        step : int
        """
        with np.load(self._shapes(step)) as kept:
            if "wkb" not in kept:
                return None
            cells, depth, speed = kept["facts"].tolist()
            return StepOutline(kept["wkb"].tobytes(), int(cells), depth, speed)

    def shown(self, step: int) -> dict | None:
        """Read the particles of a step that are shown, as in `add`; None without them.

        Parameters
        ----------
        step : int
        """
        with np.load(self._shapes(step)) as kept:
            return {name: kept[name] for name in SHOWN} if "ids" in kept else None

    def _cells(self, step):
        return self._folder / f"{step}.npy"

    def _shapes(self, step):
        return self._folder / f"{step}.npz"


def write_outlines(run: ExportedRun, steps: StepSpool, release: Sequence | None = None) -> None:
    """Write the GeoPackage of a run.

    Layers: `outline` (of the cells at least `run.min_depth` deep at each step, with depth, speed and the area of all of
    these cells; parts and holes of fewer than LEAST_PART cells are not outlined), `envelope` (of all steps together),
    `release`, `particles` (about 300 per step, the same in all steps) and `layer_styles`.
    Empty layers are omitted. Times are `t_s` (simulated seconds) and `t_qgis` to `t_qgis_end`
    (stretched, see `map_clock`).

    Parameters
    ----------
    run : ExportedRun
    steps : StepSpool
        Its outlines and displayed particles.
    release : sequence of shapely polygons, optional
        In the run's CRS. Default: the outline of a first step at time 0.

    Raises
    ------
    OutputError
        GDAL cannot write it.
    """
    clock = Clock.of(run.times)
    path = run.folder / run.outlines_file
    path.unlink(missing_ok=True)
    layers = {
        "outline": _outline_batches(run, clock, steps),
        "envelope": _envelope_layer(run),
        "release": _release_layer(run, steps, release),
        "particles": _particle_layer(run, clock, steps),
    }
    written = [name for name, batches in layers.items() if _write_layer(path, name, batches, run.grid.crs)]
    write_layer_styles(
        path, {name: vector_style_document(vector_renderer(name, run), geometry_type(name)[0]) for name in written}
    )


def layer_names(path: Path) -> tuple[str, ...]:
    """Read the names of the spatial layers of a GeoPackage; none without a file.

    Parameters
    ----------
    path : Path
    """
    if not os.path.exists(path):
        return ()
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute("SELECT table_name FROM gpkg_contents WHERE data_type = 'features'").fetchall()
    return tuple(name for (name,) in rows)


def vector_renderer(layer: str, run: ExportedRun) -> Element:
    """Return the element `renderer-v2` of a layer of the GeoPackage.

    Parameters
    ----------
    layer : str
    run : ExportedRun
    """
    if layer == "particles":
        return speed_renderer(run)
    return outline_renderer({"outline": OUTLINE, "envelope": ENVELOPE, "release": RELEASE}[layer])


def geometry_type(layer: str) -> tuple[int, str]:
    """Return the geometry type of a layer of the GeoPackage.

    Parameters
    ----------
    layer : str

    Returns
    -------
    (int, str)
        Number in QGIS, and name.
    """
    return (POINTS, "Point") if layer == "particles" else (POLYGONS, "Polygon")


def mask_outline(
    mask: np.ndarray, transform: Affine, smooth: bool = False, least: int = 0
) -> shapely.MultiPolygon | None:
    """Return the valid polygons around the True cells of a mask, with holes.

    Parameters
    ----------
    mask : bool[rows, columns]
    transform : Affine
        Of the mask.
    smooth : bool
        Without the stairs of the grid, with the same area (see `smoothing`).
    least : int
        Parts and holes of fewer cells are left out; if all parts are smaller, the largest one remains.

    Returns
    -------
    shapely.MultiPolygon or None
        None without True cells.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return None
    part = np.zeros((rows[-1] - rows[0] + 3, columns[-1] - columns[0] + 3), np.int32)
    part[1:-1, 1:-1] = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return _outline(part, moved_corner(transform, int(rows[0]), int(columns[0])), smooth, least)


def cells_outline(index: np.ndarray, grid: Grid, smooth: bool = False, least: int = 0) -> shapely.MultiPolygon | None:
    """Return the valid polygons around some cells of a grid; memory follows the extent of the flow.

    Parameters
    ----------
    index : int64[k]
        Flat numbers of the cells.
    grid : Grid
    smooth, least : bool, int
        As in `mask_outline`.

    Returns
    -------
    shapely.MultiPolygon or None
        None without cells.
    """
    if not len(index):
        return None
    row, column = np.divmod(index, grid.shape[1])
    first, left = int(row.min()), int(column.min())
    part = np.zeros((int(row.max()) - first + 3, int(column.max()) - left + 3), np.int32)
    part[row - first + 1, column - left + 1] = 1
    return _outline(part, moved_corner(grid.transform, first, left), smooth, least)


def _outline(part, transform, smooth, least):
    """MultiPolygon around the cells of int32[rows + 2, columns + 2] that are 1; `transform` is of the inner ones."""
    mask_rings.label_parts(part, np.empty(part.size // 2 + 2, np.int32))
    corners = np.empty((mask_rings.count_corners(part), 2))
    ends, parts, area = (np.empty(len(corners) // 4, np.int64) for _ in range(3))
    count = mask_rings.trace_rings(part, corners, ends, parts, area)
    of_ring = np.repeat(np.arange(count), np.diff(ends[:count], prepend=0))
    lines = shapely.linearrings(corners[:, ::-1], indices=of_ring)
    order = np.lexsort((area[:count] < 0, parts[:count]))  # shell of each part, then its holes
    order = _large_rings(order, parts, area, 2 * least) if least > 1 else order
    lines, owner = lines[order], np.unique(parts[order], return_inverse=True)[1]
    polygons = smooth_parts(lines, owner) if smooth else shapely.polygons(lines, indices=owner)
    outline = shapely.multipolygons(polygons)
    t = transform
    return shapely.transform(outline, lambda at: at @ np.array([[t.a, t.d], [t.b, t.e]]) + [t.c, t.f])


def _large_rings(order, parts, area, least):
    """Return the part of the `order` of rings whose `area` is at least `least`, without holes of parts left out."""
    shells = order[area[order] > 0]
    kept = shells[area[shells] >= least]
    kept = kept if kept.size else shells[[np.argmax(area[shells])]]
    large = (np.abs(area[order]) >= least) | np.isin(order, kept)
    return order[large & np.isin(parts[order], parts[kept])]


def step_outline(
    index: np.ndarray, depth: np.ndarray, speed: np.ndarray, grid: Grid, min_depth: float
) -> StepOutline | None:
    """Return the outline of one step.

    Parameters
    ----------
    index : int64[k]
        Flat index of its cells in `grid`, ascending.
    depth, speed : float[k] [m], [m s-1]
        NaN if unknown.
    grid : Grid
    min_depth : float [m]

    Returns
    -------
    StepOutline or None
        None without cells at least `min_depth` deep.
    """
    deep = is_deep(depth, min_depth)
    outline = cells_outline(index[deep], grid, smooth=True, least=LEAST_PART)
    if outline is None:
        return None
    return StepOutline(shapely.to_wkb(outline), np.count_nonzero(deep), float(depth[deep].max()), _largest(speed[deep]))


def is_deep(depth: np.ndarray, min_depth: float) -> np.ndarray:
    """Return whether cells are inside the outline, for each.

    Parameters
    ----------
    depth : float[k] [m]
    min_depth : float [m]

    Returns
    -------
    bool[k]
    """
    return (depth >= np.float32(min_depth)) & (depth > 0)


def _largest(values):
    """Largest finite value, or NaN."""
    return float(np.fmax.reduce(values, initial=np.nan))


def shown_particles(frame: Frame, total: int) -> dict:
    """Choose the particles of a frame that are shown, for `StepSpool.add`.

    Parameters
    ----------
    frame : Frame
    total : int
        Number of particles from which they are thinned.
    """
    particles = frame.particles
    ids = np.arange(len(particles), dtype=np.uint64) if particles.id is None else particles.id
    chosen = np.flatnonzero(thin(ids, total))
    place = particles.position[chosen] + np.asarray(frame.origin)
    return {"ids": ids[chosen], "place": place, "velocity": particles.velocity[chosen]}


def thin(ids: np.ndarray, total: int, wanted: int = PARTICLES_SHOWN) -> np.ndarray:
    """Choose particles by id, so that the selection is the same for all steps.

    Ids are hashed first (Knuth's multiplicative hash), because neighbours on the seeding lattice have nearby ids.

    Parameters
    ----------
    ids : uint64[n]
    total, wanted : int
        Number of particles, and about how many to choose.

    Returns
    -------
    bool[n]
    """
    if total <= wanted:
        return np.ones(len(ids), dtype=bool)
    scrambled = (np.asarray(ids, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)
    return scrambled < np.uint64(2**32 * wanted / total)


def _outline_batches(run, clock, steps):
    """Yield (WKB, columns) of outlines, in batches of BATCH bytes."""
    kept, size = [], 0
    for step in range(steps.count):
        outline = steps.outline(step)
        if outline is not None:
            kept.append((step, outline))
            size += len(outline.wkb)
        if kept and (size > BATCH or step == steps.count - 1):
            yield _outline_columns(run, clock, kept)
            kept, size = [], 0


def _outline_columns(run, clock, kept):
    step, outlines = np.array([step for step, _ in kept]), [outline for _, outline in kept]
    columns = {
        "step": step.astype(np.int32),
        "t_s": np.array(run.times, dtype=float)[step],
        **_spans(clock, step),
        "area_m2": np.array([outline.cells * run.grid.cell_area for outline in outlines]),
        "h_max_m": np.array([outline.depth for outline in outlines]),
        "Ut_max_m_s": np.array([outline.speed for outline in outlines]),
    }
    return np.array([outline.wkb for outline in outlines], dtype=object), columns


def _envelope_layer(run):
    """[(WKB, columns)] of the cells that were ever at least `min_depth` deep."""
    (depth,) = run.read(run.maxima_file, ("h_max",))
    mask = is_deep(depth, run.min_depth)
    outline = mask_outline(mask, run.flow_grid.transform, smooth=True, least=LEAST_PART)
    if outline is None:
        return []
    columns = {
        "area_m2": np.array([np.count_nonzero(mask) * run.grid.cell_area]),
        "h_max_m": np.array([float(depth[mask].max())]),
        "min_depth_m": np.array([float(run.min_depth)]),
    }
    return [(shapely.to_wkb(np.array([outline])), columns)]


def _release_layer(run, steps, release):
    """[(WKB, columns)] of the given release, else of the outline of a first step at time 0."""
    source = "release area"
    if release is None and run.times[0] == 0:
        outline = steps.outline(0)
        source = "cells of the flow at t = 0 s"
        release = [] if outline is None else [shapely.from_wkb(outline.wkb)]
    if not release:
        return []
    parts = [shapely.MultiPolygon(polygons(part)) for part in release]
    columns = {
        "part": np.arange(1, len(parts) + 1, dtype=np.int32),
        "area_m2": np.array([part.area for part in parts]),
        "source": np.array([source] * len(parts), dtype=object),
    }
    return [(shapely.to_wkb(np.array(parts, dtype=object)), columns)]


def polygons(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    """Return the polygons of any geometry, made valid.

    Parameters
    ----------
    geometry : shapely.Geometry [m]
    """
    pieces = shapely.get_parts(shapely.make_valid(geometry))
    return [polygon for piece in pieces for polygon in shapely.get_parts(piece) if polygon.geom_type == "Polygon"]


def _particle_layer(run, clock, steps):
    """[(WKB, columns)] of the displayed particles of all exported steps."""
    kept = {step: shown for step in range(steps.count) if (shown := steps.shown(step)) is not None}
    if not sum(len(shown["ids"]) for shown in kept.values()):
        return []
    ids, place, velocity = (
        np.concatenate([shown[name] for shown in kept.values()]) for name in ("ids", "place", "velocity")
    )
    step = np.repeat(list(kept), [len(shown["ids"]) for shown in kept.values()])
    velocity = velocity.astype(float)
    columns = {
        "id": ids.astype(np.int64),
        "step": step.astype(np.int32),
        "t_s": np.array(run.times, dtype=float)[step],
        **_spans(clock, step),
        "speed": np.linalg.norm(velocity, axis=1),
        "v_E": velocity[:, 0],
        "v_N": velocity[:, 1],
        "v_up": velocity[:, 2],
    }
    return [(shapely.to_wkb(shapely.points(place), output_dimension=3), columns)]


def _spans(clock, step):
    """Columns of the display times on the stretched clock, datetime64[ms]; `t_qgis_end` is 1 s before the next step."""
    base = np.datetime64(BASE.replace(tzinfo=None), "ms")
    seconds = {"t_qgis": np.array(clock.begins), "t_qgis_end": np.array(clock.ends) - 1}
    return {name: base + value.astype(np.int64)[step] * np.timedelta64(1000, "ms") for name, value in seconds.items()}


def _write_layer(path, name, batches, crs):
    """Write one layer in batches with pyogrio; returns True if there was at least one batch."""
    library = pyogrio()
    if library.get_gdal_config_option("CPL_LOG") is None:  # errors are raised; no GDAL text on stderr
        library.set_gdal_config_options({"CPL_LOG": os.devnull})
    from pyogrio.errors import DataLayerError, DataSourceError
    from pyogrio.raw import write

    begun = False
    try:
        for geometry, columns in batches:
            write(
                path,
                geometry,
                list(columns.values()),
                list(columns),
                layer=name,
                driver="GPKG",
                geometry_type="Point Z" if name == "particles" else "MultiPolygon",
                crs=reference_text(crs),
                append=begun,
                gdal_tz_offsets={key: np.full(len(geometry), UTC) for key in columns if key.startswith("t_qgis")},
                **({} if path.exists() else {"dataset_options": GEOPACKAGE}),
            )
            begun = True
    except (DataSourceError, DataLayerError) as error:
        raise OutputError(f"{path}: layer '{name}' cannot be written ({one_line(error)})") from error
    return begun
