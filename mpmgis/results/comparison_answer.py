"""Answer `mpmgis compare`: two results, or a result and an observed outline, in numbers and on a map."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..frames.run_terrain import terrain_of_rasters
from ..laws.quantities import Quantity
from ..system.errors import InputError
from ..system.messages import log
from ..system.option import PathLike
from ..system.option_values import defaults_of
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from . import comparison, flow_line
from .answer_files import checked_output, write_answer
from .comparison_files import MapSide, write_classes, write_classes_style, write_comparison_map, write_table
from .comparison_sides import footprints_of, log_if_empty, open_side, reading_of, require_useful_options, sides_of
from .comparison_values import BandFacts, Comparison
from .outline_distance import outline_distances
from .question_options import ReadingOptions
from .runout_answer import given_line

FILES = ("map.png", "table.csv", "classes.tif", "classes.qml")


def compare(
    first: PathLike,
    second: PathLike,
    reading: ReadingOptions | None = None,
    *,
    threshold: float = 0.1,
    band: str | None = None,
    line: PathLike | None = None,
    dem: PathLike | None = None,
    to_crs: str | None = None,
    output: PathLike | None = None,
    overwrite: bool = False,
) -> Comparison:
    """Compare two results, or a result and an observed outline; write map and table to `output`, if any.

    Area, runout and peaks of each side are computed on its own cells. Overlap and differences are computed on the cells
    of the finer side, extended over both footprints, with the other side's value at the cell centre.

    Parameters
    ----------
    first, second : path
    reading : ReadingOptions, optional
        Of another code's files; it may have further keys.
    threshold : float [m, or the unit of the band]
        Cells above it belong to the footprint.
    band : str, optional
        Band whose footprint is compared.
    line : path, optional
        File with the line along which runout is measured.
    dem : path, optional
        DTM, in `to_crs`.
    to_crs : str, optional
    output : path, optional
    overwrite : bool

    Returns
    -------
    Comparison

    Raises
    ------
    MpmgisError
        An input cannot be read or does not match, or the output exists; nothing is written then.
    """
    if not (math.isfinite(threshold) and threshold >= 0):
        raise InputError(f"`threshold` is {threshold:g}, expected a number of 0 or more")
    paths, how = (first, second), reading_of(reading or defaults_of(ReadingOptions))
    if output is not None:
        read = [path for path in (*paths, line, dem) if path is not None]
        output = checked_output(output, FILES, overwrite, read)
    require_useful_options(paths, how)
    sources = [open_side(path, dem, how) for path in paths]
    footprints, pairs, joint = footprints_of(paths, sources, threshold, band)
    bands = tuple(_band_facts(pair, sources, footprints, joint) for pair in pairs)
    terrain = _terrain(dem, to_crs, sources, joint)
    vertices, line_source = _line(line, footprints, terrain, joint)
    sides = sides_of(footprints, sources, vertices, terrain, threshold)
    masks = [footprint.on_joint for footprint in footprints]
    found = Comparison(
        sides=sides,
        threshold=threshold,
        unit=next(footprint.unit for footprint in footprints if footprint.band is not None),
        cell_size=joint.cell_size,
        overlap=comparison.overlap(*masks, joint.cell_area),
        line=vertices,
        line_source=line_source,
        bands=bands,
        distances=outline_distances(*(footprint.outline() for footprint in footprints), 0.5 * joint.cell_size),
    )
    if vertices is not None:
        _log_line_end(found)
    if output is None:
        return found
    return replace(found, files=write_answer(output, overwrite, _writers(found, footprints, joint, terrain)))


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


def _terrain(dem, to_crs, sources, joint):
    """The given DTM, else of the first result with one; None without."""
    path = dem or next((source.terrain for source in sources if source.terrain is not None), None)
    if path is None or isinstance(path, Terrain):
        return path
    return terrain_of_rasters(path, joint.crs, to_crs=to_crs)


def _line(path, footprints, terrain, joint):
    """(vertices, description) of the line along which runout is measured; (None, reason) without `line` and DTM."""
    flowed = footprints[0].on_joint | footprints[1].on_joint
    if path is not None:
        return given_line(path, flowed, joint, terrain), str(path)
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


def _writers(found, footprints, joint, terrain):
    """File name -> function of the path to write."""
    values = [None if footprint.band is None else footprint.weight for footprint in footprints]
    name = next(footprint.band for footprint in footprints if footprint.band is not None)
    band, masks = Quantity(name, found.unit, ""), [footprint.on_joint for footprint in footprints]
    writers = (
        lambda path: _write_map(path, found, footprints, joint, terrain),
        lambda path: write_table(path, found),
        lambda path: write_classes(path, joint, *masks, values, band),
        write_classes_style,
    )
    return dict(zip(FILES, writers, strict=True))


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
