"""`mpmgis compare`: two results, or a result and an observed outline, in numbers and on a map."""

import math
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from ..analysis import comparison, flow_line
from ..analysis.comparison import outline_distances
from ..analysis.comparison_report import BandFacts, Comparison, Side
from ..analysis.runout import ends_along, heights_under
from ..errors import GeoreferenceError, InputError
from ..fields import Quantity
from ..gis.outlines import mask_outline
from ..interop.frame_list import third_party_files
from ..interop.readers.registry import OWN, reader_of
from ..io.exported import is_export
from ..io.observed import cells_within, read_outline
from ..io.reprojection import is_raster
from ..io.results import UNNAMED, names_rasters, open_result
from ..messages import log
from ..reports.comparison import MapSide, write_classes, write_classes_style, write_comparison_map, write_table
from ..terrain.georeference import name_of, same_place
from ..terrain.grid import Grid
from .answer_files import checked_output, write_answer
from .export import ExportRequest
from .export_inputs import terrain_of_rasters
from .opened_results import exported_peaks
from .runout import given_line

FILES = ("map.png", "table.csv", "classes.tif", "classes.qml")
OUTLINE = "outline"
HEIGHT_DIFFERENCE = "dz"  # the band of a difference of DEMs
DEPOSITED = ("h_deposit", "t_vol_deposit")
PEAK_THICKNESS = ("pft", "h_max")  # bands by whose highest cell a flow begins
PLAIN = ExportRequest(())  # frames that say all themselves


@dataclass(frozen=True)
class CompareRequest:
    """What was asked for: the command's options by name, its help tells more; `reading`: of other codes."""

    first: Path
    second: Path
    threshold: float = 0.1  # [m], or the unit of `band`
    band: str | None = None
    line: Path | None = None
    dem: Path | None = None
    reading: ExportRequest = PLAIN
    output: Path | None = None
    overwrite: bool = False


def compare(request):
    """Compare two results, or a result and an observed outline; write map and table where `request.output` asks so.

    Each side's area, runout and peaks are taken on its own cells. Overlap and differences are taken on the cells of the
    finer side, continued over both footprints; the other side has there the value of its cell under the centre.

    Returns
    -------
    Comparison

    Raises
    ------
    MpmgisError
        What cannot be read, does not match or exists already; nothing is written then.
    """
    if not (math.isfinite(request.threshold) and request.threshold >= 0):
        raise InputError(f"--threshold is {request.threshold:g}, wanted a number of 0 or more")
    output = _output(request)
    with ExitStack() as stack:  # runs are exported to a folder that is gone at its end
        _refuse_idle(request)
        sources = [_source(path, request, stack) for path in (request.first, request.second)]
        footprints, pairs, joint = _footprints(request, sources)
        bands = tuple(_band_facts(pair, sources, footprints, joint) for pair in pairs)
        terrain = _terrain(request, sources, joint)
        line, line_source = _line(request, footprints, terrain, joint)
        sides = _sides(footprints, sources, line, terrain, request.threshold)
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
        _tell_of_overrun(found)
    return replace(found, files=_write(output, request, found, footprints, joint, terrain))


# ------------------------------------------------------------------------------------------------------------- sources


@dataclass(frozen=True)
class _Outline:
    """An observed outline that is not read yet; of a mask that is one, its cells with their Grid."""

    name: str
    path: Path
    kind: str = OUTLINE
    bands: tuple = ()
    terrain: None = None
    mask: tuple | None = None

    def read(self, grid):
        """The polygons in the CRS of `grid`."""
        if self.mask is None:
            return read_outline(self.path, grid)
        values, own = self.mask
        if None not in (own.crs, grid.crs) and not same_place(own.crs, grid.crs):
            raise GeoreferenceError(
                f"{self.path} is in {name_of(own.crs)}, the other side in {name_of(grid.crs)}; reproject one of them"
            )
        return mask_outline(values, own.transform)


def _reader(path, asked):
    """Name of the code whose frames of particles are at `path`; None where there are none."""
    path = Path(path)
    if path.is_file():
        reader = reader_of(path, None if is_raster(path) else asked)
        return reader if reader != OWN else None
    if not path.is_dir() or is_export(path) or names_rasters(path):
        return None
    if any(reader_of(frame) == OWN for frame in path.glob("*.h5")):
        return OWN
    reader, files = third_party_files(path, asked)
    return reader if files else None


def _refuse_idle(request):
    """Refuse options for another code's frames where neither side has any."""
    reading = request.reading
    readers = [_reader(path, reading.reader) for path in (request.first, request.second)]
    if reading != PLAIN and not any(reader not in (None, OWN) for reader in readers):
        raise InputError(
            f"neither {request.first} nor {request.second} holds another code's particles, for which these options "
            "are; leave them out"
        )


def _source(path, request, stack):
    """The Result at `path` (frames are exported first, on the DTM that was asked for), or the outline."""
    path, reader = Path(path), _reader(path, request.reading.reader)
    if reader is not None:
        log.info(f"{path}: its frames are exported for this comparison, on the cells of their DTM")
        how = PLAIN if reader == OWN else request.reading
        return exported_peaks(replace(how, frames=(path,), dem=request.dem), stack)
    plain = Path(str(path).partition("|")[0])
    if plain.is_file() and plain.suffix.lower() == ".h5":
        raise InputError(f"{path} is one frame; give the folder of the run, so that the maxima are those of all frames")
    if plain.suffix.lower() == ".gdb" or (plain.is_file() and not is_raster(path)):
        return _Outline(plain.stem, path)
    return _told_apart(open_result(path), path)


def _told_apart(result, path):
    """A raster that does not say what it holds as what it most likely is; elevations are refused."""
    if result.kind != "raster" or list(result.bands) != [UNNAMED]:
        return result
    values, grid = result.read(UNNAMED)
    kind = comparison.kind_of_raster(values)
    if kind == comparison.ELEVATION:
        raise InputError(
            f"{path} holds elevations ({np.nanmin(values):.6g} to {np.nanmax(values):.6g}), not a thickness; give the "
            "difference of two DEMs, after - before (QGIS' raster calculator), and the terrain with --dem"
        )
    if kind == comparison.MASK:
        log.info(f"{path} is a mask; it is compared as an outline")
        return _Outline(result.name, path, mask=(np.nan_to_num(values) != 0, grid))
    if kind == comparison.DIFFERENCE:
        fallen, area = values[np.isfinite(values) & (values < 0)], grid.cell_area
        log.info(
            f"{path} falls and rises ({np.nanmin(values):.3g} to {np.nanmax(values):.3g} m): taken for a difference of "
            f"DEMs, after - before. What rises is the deposit; where it falls, {fallen.size * area:.6g} m2 and "
            f"{-fallen.sum() * area:.6g} m3, is left out. It is vertical, h_deposit normal to the slope"
        )
        bands = {HEIGHT_DIFFERENCE: replace(result.bands[UNNAMED], quantity=Quantity(HEIGHT_DIFFERENCE, "m", ""))}
        return replace(result, kind=kind, bands=bands)
    return result


def _band_asked(request, sources):
    """The band whose footprint is compared; beside a difference of DEMs, where none is asked for, the deposit's."""
    comparison.require_present_name(request.band)
    if request.band is not None or not any(source.kind == comparison.DIFFERENCE for source in sources):
        return request.band
    deposit = next((band for source in sources for band in DEPOSITED if band in source.bands), None)
    if deposit is None and not all(source.kind == comparison.DIFFERENCE for source in sources):
        other = next(source for source in sources if source.kind != comparison.DIFFERENCE)
        raise InputError(
            f"{other.name} has no h_deposit to compare with a difference of DEMs; wanted an export or the folder of a "
            "run, or give --band"
        )
    return deposit


def _named_apart(request, sources):
    """The names of the two, with their folders where they would be the same."""
    names = [source.name for source in sources]
    if names[0] == names[1]:
        names = [f"{Path(path).resolve().parent.name}/{Path(path).name}" for path in (request.first, request.second)]
    return names if names[0] != names[1] else [str(request.first), str(request.second)]


# ---------------------------------------------------------------------------------------------------------- footprints


@dataclass(frozen=True)
class _Footprint:
    """Where one side flowed: cells of its own (`mask` on `grid`), and on the common grid with their `weight` there.

    `shape` is the outline itself where it is one.
    """

    name: str
    kind: str
    band: str | None
    unit: str
    area: float
    mask: np.ndarray
    grid: Grid
    on_joint: np.ndarray
    weight: np.ndarray
    shape: object = None

    def outline(self):
        """Shapely geometry: the polygons of an outline, else those around the cells of its own."""
        if self.shape is not None:
            return self.shape
        return mask_outline(self.mask, self.grid.transform) or shapely.MultiPolygon()


def _footprints(request, sources):
    """(the two _Footprint, pairs of bands to tell about, the common Grid)."""
    if all(isinstance(source, _Outline) for source in sources):
        raise InputError(
            f"{request.first} and {request.second} are both outlines; wanted at least one result, which gives the cells"
        )
    compared = not any(isinstance(source, _Outline) for source in sources)
    pairs = comparison.matched_bands(*(tuple(source.bands) for source in sources))
    chosen = comparison.footprint_bands(pairs, _band_asked(request, sources), compared)
    if chosen not in pairs:  # two names that only the user knows to be one quantity
        pairs = [chosen, *(pair for pair in pairs if not set(pair) & set(chosen))]
    layers = _read_layers(request, sources, chosen)
    joint = _joint_grid(request, layers)
    names = _named_apart(request, sources)
    units = [source.bands[band].quantity.unit if band else "" for source, band in zip(sources, chosen, strict=True)]
    footprints = [
        _outlined(name, layer, joint) if band is None else _flowed(name, source, band, unit, *layer, joint, request)
        for name, source, band, unit, layer in zip(names, sources, chosen, units, layers, strict=True)
    ]
    _tell_of_edges(footprints, joint)
    return footprints, pairs, joint


def _read_layers(request, sources, chosen):
    """(values, Grid) of each result's footprint band, the polygons of an outline; all in one CRS."""
    layers, known = [None, None], None
    for k, source in enumerate(sources):
        if not isinstance(source, _Outline):
            layers[k] = source.read(chosen[k], known)
            _tell_if_empty(source, chosen[k], layers[k][0])
            known = known or layers[k][1]
    own = [layer[1].crs for layer in layers if layer is not None]
    crs = next((crs for crs in own if crs is not None), None)
    for k, source in enumerate(sources):
        if isinstance(source, _Outline):
            layers[k] = source.read(replace(known, crs=crs))
        elif layers[k][1].crs is None and crs is not None:
            log.info(f"{source.name} carries no CRS; {name_of(crs)} is assumed, the other side's")
            layers[k] = (layers[k][0], replace(layers[k][1], crs=crs))
    _require_meeting(request, [_bounds(layer) for layer in layers], None not in own)
    return layers


def _tell_if_empty(source, band, values):
    if not np.isfinite(values).any():
        log.info(f"{source.name}: every cell of {band} is nodata; taken as empty")


def _bounds(layer):
    return layer[1].bounds if isinstance(layer, tuple) else layer.bounds


def _require_meeting(request, boxes, certain):
    """Two that lie apart: said where each side has its own CRS, else refused, because the frames must differ."""
    (west, south, east, north), other = boxes
    if west < other[2] and east > other[0] and south < other[3] and north > other[1]:
        return
    apart = (
        f"{request.first} (E {west:.6g} to {east:.6g}, N {south:.6g} to {north:.6g}) and {request.second} (E "
        f"{other[0]:.6g} to {other[2]:.6g}, N {other[1]:.6g} to {other[3]:.6g}) do not meet"
    )
    if not certain:
        raise GeoreferenceError(f"{apart}, and not both carry a CRS; assign it (rio edit-info FILE --crs EPSG:n)")
    log.info(apart)


def _joint_grid(request, layers):
    """The common grid: the finer one's cells, over both footprints."""
    rasters = [layer for layer in layers if isinstance(layer, tuple)]
    corners = [
        comparison.mask_corners(comparison.footprint(values, request.threshold), grid) for values, grid in rasters
    ]
    corners += [np.reshape(layer.bounds, (2, 2)) for layer in layers if not isinstance(layer, tuple)]
    corners = np.concatenate(corners)
    if len(corners) == 0:
        raise InputError(f"no cell of either is above --threshold {request.threshold:g}; give a lower one")
    return comparison.joint_grid([grid for _, grid in rasters], corners)


def _flowed(name, source, band, unit, values, grid, joint, request):
    mask = comparison.footprint(values, request.threshold)
    area = float(np.count_nonzero(mask) * grid.cell_area)
    on_joint = comparison.nearest(mask, grid, joint, outside=False)
    weight = comparison.nearest(values, grid, joint)
    return _Footprint(name, source.kind, band, unit, area, mask, grid, on_joint, weight)


def _outlined(name, shape, joint):
    mask = cells_within(shape, joint)
    if not mask.any():
        raise InputError(
            f"{name}: the outline holds no centre of a cell of {joint.cell_size:g} m; export smaller cells"
        )
    return _Footprint(name, OUTLINE, None, "", float(shape.area), mask, joint, mask, mask.astype(float), shape)


def _tell_of_edges(footprints, joint):
    """Say how much of one footprint lies beyond the other's raster, where it counts as not reached."""
    for footprint, other in (footprints, footprints[::-1]):
        if other.band is None:
            continue
        covered = comparison.nearest(np.ones(other.grid.shape, bool), other.grid, joint, outside=False)
        beyond = float(np.count_nonzero(footprint.on_joint & ~covered) * joint.cell_area)
        if beyond > 0:
            log.info(
                f"{beyond:.6g} m2 of {footprint.name} lie beyond the raster of {other.name} and count as not reached"
            )


def _sides(footprints, sources, line, terrain, threshold):
    """Both Sides. Runout is counted from the highest place of each flow, as `mpmgis runout` counts it.

    That is of its largest thickness. A side that holds none (an outline, what lies at the end, a difference of DEMs)
    counts from the other's, since it may lie anywhere along the flow.
    """
    if line is None:
        return tuple(Side(one.name, one.kind, one.band, one.area) for one in footprints)
    if terrain is None:
        log.info("no DTM beside the results: no runout from the highest place of the flow; give it with --dem")
        return tuple(
            Side(one.name, one.kind, one.band, one.area, flow_line.runout(one.mask, one.grid, line))
            for one in footprints
        )
    ends = [_ends(one.mask, one.grid, line, terrain) for one in footprints]
    tops = [
        _top(one, source, own, line, terrain, threshold)
        for one, source, (own, _) in zip(footprints, sources, ends, strict=True)
    ]
    found = []
    for k, (one, (own, toe)) in enumerate(zip(footprints, ends, strict=True)):
        top = tops[k] or tops[1 - k] or own
        farthest = flow_line.runout(one.mask, one.grid, line) if toe is None else flow_line.Runout(*toe[:3])
        found.append(Side(one.name, one.kind, one.band, one.area, farthest, math.nan if top is None else top.along))
    return tuple(found)


def _ends(mask, grid, line, terrain):
    return ends_along(mask, heights_under(mask, grid, terrain), grid, line)


def _top(footprint, source, own, line, terrain, threshold):
    """Place where the flow of one side begins, whose footprint has its highest at `own`; None where not known."""
    peak = next((band for band in PEAK_THICKNESS if band in source.bands), None)
    if footprint.band is None or (peak is None and footprint.unit == "m"):
        return None
    if footprint.band == peak or footprint.unit != "m":
        return own
    values, grid = source.read(peak, footprint.grid)
    return _ends(comparison.footprint(values, threshold), grid, line, terrain)[0]


# --------------------------------------------------------------------------------------------------------------- bands


def _band_facts(pair, sources, footprints, joint):
    """Peaks of one quantity on each side's own cells, the difference where both flowed."""
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
        if name != footprint.band:  # of that it was said
            _tell_if_empty(source, name, own)
        peaks.append(comparison.peak(own, name))
        percentiles.append(comparison.high_percentile(own, name))
        values.append(comparison.nearest(own, grid, joint) if None not in pair else None)
    both = footprints[0].on_joint & footprints[1].on_joint
    gap = comparison.Difference(math.nan, math.nan) if None in pair else comparison.difference(*values, both)
    return BandFacts(pair, next((unit for unit in units if unit), ""), tuple(peaks), tuple(percentiles), gap)


# ---------------------------------------------------------------------------------------------------- terrain and line


def _terrain(request, sources, joint):
    """The DTM that was asked for, else the first that lies beside a result; None where there is none."""
    path = request.dem or next((source.terrain for source in sources if source.terrain is not None), None)
    if path is None:
        return None
    return terrain_of_rasters(path, joint.crs)


def _line(request, footprints, terrain, joint):
    """(vertices, where from) of the line that runout is read along; (None, why not) without --line and DTM."""
    flowed = footprints[0].on_joint | footprints[1].on_joint
    if request.line is not None:
        return given_line(request.line, flowed, joint, terrain), str(request.line)
    if terrain is None:
        log.info("no DTM beside the results: runout wants --line, or --dem to find the way of the flow")
        return None, "none: no --line, no DTM"
    elevation = np.full(joint.shape, np.nan)
    elevation[flowed] = terrain.sample(*joint.xy(*np.nonzero(flowed)))
    masks, weights = ([getattr(f, key) for f in footprints] for key in ("on_joint", "weight"))
    line = flow_line.centre_line(masks, weights, elevation, joint)
    if line is None:
        log.info(f"{terrain.path} has no heights under the flow, or the flow is one cell: no runout; give --line")
        return None, "none: no heights under the flow"
    return line, "centre line of both flows"


def _tell_of_overrun(found):
    length = float(np.hypot(*np.diff(found.line, axis=0).T).sum())
    beyond = max((side.farthest_along - length for side in found.sides if side.farthest is not None), default=0.0)
    if beyond > found.cell_size and found.line_source != "centre line of both flows":
        log.info(f"{found.line_source} ends {beyond:.0f} m before the flow does; it is continued straight")


# -------------------------------------------------------------------------------------------------------------- output


def _output(request):
    """The path to write to, checked before any work; None where nothing is to be written."""
    if request.output is None:
        return None
    read = [path for path in (request.first, request.second, request.line, request.dem) if path is not None]
    return checked_output(request.output, FILES, request.overwrite, read)


def _write(output, request, found, footprints, joint, terrain):
    """Write what `output` names; answers the files."""
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


def _write_map(path, found, footprints, joint, terrain):
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
