"""Outlines, release and thinned particles in one GeoPackage, from step data that is spooled to disk.

Both can be written only when all steps are known. Kept like this, memory is that of one step however many there are,
and no raster is packed out again.
"""

import os
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from ..errors import OutputError, one_line
from ..io.exported import moved_corner
from ..io.libraries import pyogrio
from ..kernels import rings
from .clock import BASE, Clock
from .markup import reference_text
from .symbols import (
    ENVELOPE,
    OUTLINE,
    RELEASE,
    outline_renderer,
    speed_renderer,
    vector_style_document,
    write_layer_styles,
)

BANDS = ("h", "t", "Un", "Ut", "Ut_E", "Ut_N")
SHOWN = ("ids", "place", "velocity")


class StepOutline(NamedTuple):
    """Outline of the flow at one step: its WKB, its number of `cells`, largest `depth` [m] and `speed` [m s-1]."""

    wkb: bytes
    cells: int
    depth: float
    speed: float


class StepSpool:
    """Steps one after the other into a folder, and from there one at a time.

    Parameters
    ----------
    folder : path
        Is made; whoever made the spool removes it.
    """

    def __init__(self, folder):
        self._folder, self.count = Path(folder), 0
        self._folder.mkdir()

    def add(self, index, bands, outline=None, shown=None):
        """Keep one step.

        Parameters
        ----------
        index : int64[k]
            Flat index of its cells in the export grid, ascending.
        bands : dict of str to float32[k]
            Of BANDS; without `Ut_E` and `Ut_N` the mesh has no arrows.
        outline : StepOutline or None
        shown : dict or None
            The particles to show: `ids` uint64[m], `place` float64[m, 3] [m], `velocity` float64[m, 3] [m s-1].
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

    def bands(self, step):
        """(Flat index int64[k], dict of str to float32[k]) of a step's cells."""
        with open(self._cells(step), "rb") as file:
            names, index = np.load(file), np.load(file)
            return index, {str(name): np.load(file) for name in names}

    def outline(self, step):
        """The StepOutline of a step, None where it has none."""
        with np.load(self._shapes(step)) as kept:
            if "wkb" not in kept:
                return None
            cells, depth, speed = kept["facts"].tolist()
            return StepOutline(kept["wkb"].tobytes(), int(cells), depth, speed)

    def shown(self, step):
        """The particles to show of a step as `add` got them, None where it has none."""
        with np.load(self._shapes(step)) as kept:
            return {name: kept[name] for name in SHOWN} if "ids" in kept else None

    def _cells(self, step):
        return self._folder / f"{step}.npy"

    def _shapes(self, step):
        return self._folder / f"{step}.npz"


PARTICLES_SHOWN = 300  # per step, about
BATCH = 32_000_000  # bytes of geometry that are in memory at a time
UTC = 100  # GDAL's mark of a time in UTC
POINTS, POLYGONS = 0, 2  # QGIS' numbers of geometry types


def write_outlines(run, steps, release=None):
    """Write the GeoPackage of a run.

    Layers: `outline` (of the cells at least `run.min_depth` deep at each step, with depth, speed and area), `envelope`
    (of all steps together), `release`, `particles` (about 300 a step, the same ones throughout) and `layer_styles`.
    A layer with nothing in it is left out. Times are `t_s` (simulated seconds) and `t_qgis` to `t_qgis_end`
    (stretched, see `clock`).

    Parameters
    ----------
    run : ExportedRun
    steps : StepSpool
        Its outlines and the particles to show.
    release : sequence of shapely polygons, optional
        In the run's CRS. Without it the outline of a first step at time 0 is taken.

    Raises
    ------
    OutputError
        Where GDAL cannot write it.
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


def layer_names(path):
    """Tuple of str: the spatial layers of a GeoPackage, empty where there is none."""
    if not os.path.exists(path):
        return ()
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute("SELECT table_name FROM gpkg_contents WHERE data_type = 'features'").fetchall()
    return tuple(name for (name,) in rows)


def vector_renderer(layer, run):
    """`renderer-v2` of one of the GeoPackage's layers."""
    if layer == "particles":
        return speed_renderer(run)
    return outline_renderer({"outline": OUTLINE, "envelope": ENVELOPE, "release": RELEASE}[layer])


def geometry_type(layer):
    """QGIS' number and word for the geometry of one of the GeoPackage's layers."""
    return (POINTS, "Point") if layer == "particles" else (POLYGONS, "Polygon")


def mask_outline(mask, transform):
    """Valid MultiPolygon around the True cells of bool[rows, columns], holes kept; None where no cell is True."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return None
    part = np.zeros((rows[-1] - rows[0] + 3, columns[-1] - columns[0] + 3), np.int32)
    part[1:-1, 1:-1] = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return _outline(part, moved_corner(transform, int(rows[0]), int(columns[0])))


def cells_outline(index, grid):
    """As `mask_outline` for the cells of `grid` with the flat `index` int64[k], in memory that follows the flow."""
    if not len(index):
        return None
    row, column = np.divmod(index, grid.shape[1])
    first, left = int(row.min()), int(column.min())
    part = np.zeros((int(row.max()) - first + 3, int(column.max()) - left + 3), np.int32)
    part[row - first + 1, column - left + 1] = 1
    return _outline(part, moved_corner(grid.transform, first, left))


def _outline(part, transform):
    """MultiPolygon around the cells of int32[rows + 2, columns + 2] that are 1; `transform` is of the inner ones."""
    rings.label_parts(part, np.empty(part.size // 2 + 2, np.int32))
    corners = np.empty((rings.count_corners(part), 2))
    ends, parts, area = (np.empty(len(corners) // 4, np.int64) for _ in range(3))
    count = rings.trace_rings(part, corners, ends, parts, area)
    row, column = corners.T
    t = transform
    places = np.stack([t.c + t.a * column + t.b * row, t.f + t.d * column + t.e * row], axis=1)
    lines = shapely.linearrings(places, indices=np.repeat(np.arange(count), np.diff(ends[:count], prepend=0)))
    order = np.lexsort((area[:count] < 0, parts[:count]))  # each part's shell, then its holes
    return shapely.multipolygons(shapely.polygons(lines[order], indices=parts[order] - 1))


def step_outline(index, depth, speed, grid, min_depth):
    """The StepOutline of one step; None where it is nowhere `min_depth` [m] deep.

    Parameters
    ----------
    index : int64[k]
        Flat index of its cells in `grid`, ascending.
    depth, speed : float[k] [m], [m s-1]
        NaN where unknown.
    grid : Grid
    min_depth : float [m]
    """
    deep = is_deep(depth, min_depth)
    outline = cells_outline(index[deep], grid)
    if outline is None:
        return None
    return StepOutline(shapely.to_wkb(outline), np.count_nonzero(deep), float(depth[deep].max()), _largest(speed[deep]))


def is_deep(depth, min_depth):
    """Bool: the cells that outlines enclose."""
    return (depth >= np.float32(min_depth)) & (depth > 0)


def _largest(values):
    """Largest finite value; NaN where there is none."""
    return float(np.fmax.reduce(values, initial=np.nan))


def shown_particles(frame, total):
    """The particles of `frame` to show, as `StepSpool.add` takes them, thinned as if from `total`."""
    particles = frame.particles
    ids = np.arange(len(particles), dtype=np.uint64) if particles.id is None else particles.id
    chosen = np.flatnonzero(thin(ids, total))
    place = particles.position[chosen] + np.asarray(frame.origin)
    return {"ids": ids[chosen], "place": place, "velocity": particles.velocity[chosen]}


def thin(ids, total, wanted=PARTICLES_SHOWN):
    """bool[n]: about `wanted` of `total` particles, chosen by their ids alone, so that a choice holds for all steps.

    Ids are scrambled first (Knuth's multiplicative hash), since neighbours on the seeding lattice have nearby ids.
    """
    if total <= wanted:
        return np.ones(len(ids), dtype=bool)
    scrambled = (np.asarray(ids, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)
    return scrambled < np.uint64(2**32 * wanted / total)


def _outline_batches(run, clock, steps):
    """Yield (WKB, columns) of the outlines of some steps at a time, a few megabytes each."""
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
    outline = mask_outline(mask, run.flow_grid.transform)
    if outline is None:
        return []
    columns = {
        "area_m2": np.array([np.count_nonzero(mask) * run.grid.cell_area]),
        "h_max_m": np.array([float(depth[mask].max())]),
        "min_depth_m": np.array([float(run.min_depth)]),
    }
    return [(shapely.to_wkb(np.array([outline])), columns)]


def _release_layer(run, steps, release):
    """[(WKB, columns)] of the release: as given, else the outline of a first step at time 0."""
    source = "release area"
    if release is None and run.times[0] == 0:
        outline = steps.outline(0)
        source = "cells of the flow at t = 0 s"
        release = [] if outline is None else [shapely.from_wkb(outline.wkb)]
    if not release:
        return []
    parts = [shapely.MultiPolygon(_polygons(part)) for part in release]
    columns = {
        "part": np.arange(1, len(parts) + 1, dtype=np.int32),
        "area_m2": np.array([part.area for part in parts]),
        "source": np.array([source] * len(parts), dtype=object),
    }
    return [(shapely.to_wkb(np.array(parts, dtype=object)), columns)]


def _polygons(geometry):
    """List of the polygons in a valid form of any geometry."""
    pieces = shapely.get_parts(shapely.make_valid(geometry))
    return [polygon for piece in pieces for polygon in shapely.get_parts(piece) if polygon.geom_type == "Polygon"]


def _particle_layer(run, clock, steps):
    """[(WKB, columns)] of the particles to show at the exported steps."""
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
    """Columns of when steps show on the stretched clock, datetime64[ms]; `t_qgis_end` is a second before the next."""
    base = np.datetime64(BASE.replace(tzinfo=None), "ms")
    seconds = {"t_qgis": np.array(clock.begins), "t_qgis_end": np.array(clock.ends) - 1}
    return {name: base + value.astype(np.int64)[step] * np.timedelta64(1000, "ms") for name, value in seconds.items()}


def _write_layer(path, name, batches, crs):
    """Write one layer, batch by batch, with pyogrio, which makes the file with the first; answers whether any came."""
    library = pyogrio()
    if library.get_gdal_config_option("CPL_LOG") is None:  # what fails is raised; on stderr it is another's words
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
                **({} if path.exists() else {"dataset_options": {"VERSION": "1.2"}}),
            )
            begun = True
    except (DataSourceError, DataLayerError) as error:
        raise OutputError(f"{path}: layer '{name}' cannot be written ({one_line(error)})") from error
    return begun
