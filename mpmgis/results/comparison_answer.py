"""Answer `mpmgis compare`: two results, or a result and an observed outline, in numbers and on a map."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..frames.run_terrain import terrain_of_rasters
from ..laws.quantities import Quantity
from ..system.errors import InputError
from ..system.messages import log
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from . import comparison, flow_line
from .answer_files import checked_output, write_answer
from .comparison_files import MapSide, write_classes, write_classes_style, write_comparison_map, write_table
from .comparison_sides import PLAIN, Reading, footprints_of, log_if_empty, open_side, require_useful_options, sides_of
from .comparison_values import BandFacts, Comparison
from .outline_distance import outline_distances
from .runout_answer import given_line

FILES = ("map.png", "table.csv", "classes.tif", "classes.qml")


@dataclass(frozen=True, kw_only=True)
class CompareRequest:
    """A comparison; `compare` describes its options."""

    first: Path
    second: Path
    threshold: float = 0.1  # [m], or the unit of `band`
    band: str | None = None
    line: Path | None = None
    dem: Path | None = None
    to_crs: str | None = None
    reading: Reading = PLAIN
    output: Path | None = None
    overwrite: bool = False


def compare(request: CompareRequest, progress: Callable[[int, int], None] = lambda done, total: None) -> Comparison:
    """Compare two results, or a result and an observed outline; write map and table to `request.output`, if any.

    Area, runout and peaks of each side are computed on its own cells. Overlap and differences are computed on the cells
    of the finer side, extended over both footprints, with the other side's value at the cell centre.

    Parameters
    ----------
    request : CompareRequest
    progress : callable
        Called with (steps done, steps in all).

    Returns
    -------
    Comparison

    Raises
    ------
    MpmgisError
        An input cannot be read or does not match, or the output exists; nothing is written then.
    """
    if not (math.isfinite(request.threshold) and request.threshold >= 0):
        raise InputError(f"`threshold` is {request.threshold:g}, expected a number of 0 or more")
    output = _output(request)
    require_useful_options(request)
    sources = [open_side(path, request) for path in (request.first, request.second)]
    footprints, pairs, joint = footprints_of(request, sources)
    bands = tuple(_band_facts(pair, sources, footprints, joint) for pair in pairs)
    terrain = _terrain(request, sources, joint)
    line, line_source = _line(request, footprints, terrain, joint)
    sides = sides_of(footprints, sources, line, terrain, request.threshold)
    masks = [footprint.on_joint for footprint in footprints]
    found = Comparison(
        sides=sides,
        threshold=request.threshold,
        unit=next(footprint.unit for footprint in footprints if footprint.band is not None),
        cell_size=joint.cell_size,
        overlap=comparison.overlap(*masks, joint.cell_area),
        line=line,
        line_source=line_source,
        bands=bands,
        distances=outline_distances(*(footprint.outline() for footprint in footprints), 0.5 * joint.cell_size),
    )
    if line is not None:
        _log_line_end(found)
    return replace(found, files=_write(output, request, found, footprints, joint, terrain))


def _band_facts(pair, sources, footprints, joint):
    """Peaks of one quantity on each side's own cells, and the difference where both flowed."""
    units = [source.bands[name].quantity.unit for source, name in zip(sources, pair, strict=True) if name]
    if len(set(units) - {""}) > 1:
        raise InputError(
            f"{pair[0]} is in {units[0]} in {footprints[0].name}, {pair[1]} in {units[1]} in {footprints[1].name}; "
            "convert one of them (rio calc, or QGIS' raster calculator)"
        )
    peaks, percentiles, values = [], [], []
    for source, name, footprint in zip(sources, pair, footprints, strict=True):
        if name is None:
            peaks.append(math.nan)
            percentiles.append(math.nan)
            continue
        own, grid = source.read(name, joint)
        if name != footprint.band:  # logged before
            log_if_empty(source, name, own)
        peaks.append(comparison.peak(own, name))
        percentiles.append(comparison.high_percentile(own, name))
        values.append(comparison.nearest(own, grid, joint) if None not in pair else None)
    both = footprints[0].on_joint & footprints[1].on_joint
    gap = comparison.Difference(math.nan, math.nan) if None in pair else comparison.difference(*values, both)
    return BandFacts(pair, next((unit for unit in units if unit), ""), tuple(peaks), tuple(percentiles), gap)


def _terrain(request, sources, joint):
    """The DTM of the request, else of the first result with one; None without."""
    path = request.dem or next((source.terrain for source in sources if source.terrain is not None), None)
    if path is None or isinstance(path, Terrain):
        return path
    return terrain_of_rasters(path, joint.crs, to_crs=request.to_crs)


def _line(request, footprints, terrain, joint):
    """(vertices, description) of the line along which runout is measured; (None, reason) without `line` and DTM."""
    flowed = footprints[0].on_joint | footprints[1].on_joint
    if request.line is not None:
        return given_line(request.line, flowed, joint, terrain), str(request.line)
    if terrain is None:
        log.info("no DTM beside the results: runout needs `line`, or `dem` to find the path of the flow")
        return None, "none: no --line, no DTM"
    elevation = np.full(joint.shape, np.nan)
    elevation[flowed] = terrain.sample(*joint.xy(*np.nonzero(flowed)))
    masks, weights = ([getattr(f, key) for f in footprints] for key in ("on_joint", "weight"))
    line = flow_line.centre_line(masks, weights, elevation, joint)
    if line is None:
        log.info(f"{terrain.path} has no elevations under the flow, or the flow is one cell: no runout; give `line`")
        return None, "none: no heights under the flow"
    return line, "centre line of both flows"


def _log_line_end(found):
    length = float(np.hypot(*np.diff(found.line, axis=0).T).sum())
    beyond = max((side.farthest_along - length for side in found.sides if side.farthest is not None), default=0.0)
    if beyond > found.cell_size and found.line_source != "centre line of both flows":
        log.info(f"{found.line_source} ends {beyond:.0f} m before the flow does; it is extended straight")


def _output(request):
    """The output path, checked before any work; None if nothing is to be written."""
    if request.output is None:
        return None
    read = [path for path in (request.first, request.second, request.line, request.dem) if path is not None]
    return checked_output(request.output, FILES, request.overwrite, read)


def _write(output, request, found, footprints, joint, terrain):
    """Write to `output`; the files written."""
    if output is None:
        return ()
    values = [None if footprint.band is None else footprint.weight for footprint in footprints]
    name = next(footprint.band for footprint in footprints if footprint.band is not None)
    band, masks = Quantity(name, found.unit, ""), [footprint.on_joint for footprint in footprints]
    writers = (
        lambda path: _write_map(path, found, footprints, joint, terrain),
        lambda path: write_table(path, found),
        lambda path: write_classes(path, joint, *masks, values, band),
        write_classes_style,
    )
    return write_answer(request, output, dict(zip(FILES, writers, strict=True)))


def _write_map(path: Path, found: Comparison, footprints: tuple, joint: Grid, terrain: Terrain | None) -> None:
    threshold = f"{found.threshold:g} {found.unit}".strip()
    sides = [
        MapSide(side.name, footprint.on_joint, area, side.farthest, side.runout)
        for side, footprint, area in zip(
            found.sides, footprints, (found.overlap.only_first, found.overlap.only_second), strict=True
        )
    ]
    band = next(footprint.band for footprint in footprints if footprint.band is not None)
    title = f"Overlap (IoU) {found.overlap.iou:.3f}: {band} above {threshold}"
    write_comparison_map(path, terrain, joint, sides, found.overlap.both, found.line, title)
