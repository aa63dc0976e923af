"""Open the two sides of a comparison: results or an outline, and their footprints on common cells."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from ..exchange.frame_list import third_party_files
from ..exchange.readers.reader_list import OWN, reader_of
from ..laws.quantities import Quantity
from ..maps.averaging.exported_steps import is_export
from ..maps.averaging.result_bands import UNNAMED, Result, names_rasters, open_result
from ..maps.qgis.outlines import mask_outline
from ..system.errors import GeoreferenceError, InputError
from ..system.messages import log
from ..system.option import PathLike, options_of
from ..system.option_values import defaults_of
from ..system.source_names import file_of
from ..terrain.elevation import Terrain
from ..terrain.georeference import name_of, same_place
from ..terrain.grid import Grid
from ..terrain.observations import cells_within, read_outline
from ..terrain.spatial_inputs import is_raster
from . import comparison, flow_line
from .answer_files import finite_or_none
from .flow_line import Runout, ends_along, heights_under
from .opened_results import peaks_of
from .question_options import QuestionOptions, ReadingOptions

Paths = tuple[PathLike, PathLike]
OUTLINE = "outline"  # kind of a side that is no result
HEIGHT_DIFFERENCE = "dz"  # the band of a difference of DEMs
DEPOSITED = ("h_deposit", "t_vol_deposit")  # bands that are compared with a difference of DEMs
PEAK_THICKNESS = ("pft", "h_max")  # bands whose highest cell is the start of a flow


@dataclass(frozen=True)
class Side:
    """One of the two results: `name`, `kind`, `band` of its footprint (None: an outline), `area` [m2].

    `farthest` (Runout or None) is measured from the start of the line. The runout is measured from `top` [m], the
    distance along the line of the highest point of the flow (NaN: unknown).
    """

    name: str
    kind: str
    band: str | None
    area: float
    farthest: Runout | None = None
    top: float = math.nan

    @property
    def farthest_along(self) -> float:
        """Distance [m] along the line from its start to the farthest point; NaN without one."""
        return math.nan if self.farthest is None else self.farthest.distance

    @property
    def runout(self) -> float:
        """Distance [m] along the line from the highest to the farthest point of the flow; NaN if unknown."""
        return self.farthest_along - self.top

    def facts(self) -> dict:
        """Return the side as plain numbers and strings."""
        place = None if self.farthest is None else [self.farthest.x, self.farthest.y]
        return {
            "name": self.name,
            "kind": self.kind,
            "band": self.band,
            "area_m2": self.area,
            "runout_m": finite_or_none(self.runout),
            "runout_at": place,
            "farthest_along_line_m": finite_or_none(self.farthest_along),
        }


@dataclass(frozen=True)
class Outline:
    """An observed outline that is not read yet; for a mask its cells with their Grid."""

    name: str
    path: Path
    kind: str = OUTLINE
    bands: tuple = ()
    terrain: None = None
    mask: tuple | None = None

    def read(self, grid: Grid) -> shapely.Geometry:
        """Return the polygons in the CRS of a grid.

        Parameters
        ----------
        grid : Grid

        Returns
        -------
        shapely geometry [m]

        Raises
        ------
        GeoreferenceError
            A mask in another CRS.
        """
        if self.mask is None:
            return read_outline(self.path, grid)
        values, own = self.mask
        if None not in (own.crs, grid.crs) and not same_place(own.crs, grid.crs):
            raise GeoreferenceError(
                f"{self.path} is in {name_of(own.crs)}, the other side in {name_of(grid.crs)}; reproject one of them"
            )
        return mask_outline(values, own.transform)


def _reader(path, declared):
    """Name of the code whose frames of particles are at `path`; None without frames."""
    path = Path(path)
    if path.is_file():
        reader = reader_of(path, None if is_raster(path) else declared)
        return reader if reader != OWN else None
    if not path.is_dir() or is_export(path) or names_rasters(path):
        return None
    if any(reader_of(frame) == OWN for frame in path.glob("*.h5")):
        return OWN
    reader, files = third_party_files(path, declared)
    return reader if files else None


def reading_of(asked: ReadingOptions) -> ReadingOptions:
    """Return the options of reading another code's frames among those of a verb.

    Parameters
    ----------
    asked : ReadingOptions
    """
    return {name: value for name, value in asked.items() if name in options_of(ReadingOptions)}  # type: ignore[return-value]


def require_useful_options(paths: Paths, reading: ReadingOptions) -> None:
    """Raise InputError if options for another code's frames are given and neither side has any.

    Parameters
    ----------
    paths : (path, path)
        Of both sides.
    reading : ReadingOptions

    Raises
    ------
    InputError
    """
    readers = [_reader(path, reading["reader"]) for path in paths]
    if reading != defaults_of(ReadingOptions) and not any(reader not in (None, OWN) for reader in readers):
        raise InputError(
            f"neither {paths[0]} nor {paths[1]} contains another code's particles; leave out the options for these"
        )


def open_side(path: PathLike, dem: PathLike | None, reading: ReadingOptions) -> Result | Outline:
    """Return the Result at a path (frames are averaged on their DTM), or the Outline.

    Parameters
    ----------
    path : path
    dem : path or None
        DTM of frames; None: the one that they name.
    reading : ReadingOptions

    Returns
    -------
    Result or Outline

    Raises
    ------
    InputError
        One frame of several, or elevations.
    """
    path, reader = Path(path), _reader(path, reading["reader"])
    if reader is not None:
        log.info(f"{path}: its frames are averaged on the cells of their DTM for this comparison")
        how = defaults_of(ReadingOptions) if reader == OWN else reading
        usual = defaults_of(QuestionOptions)
        return peaks_of({**usual, **how, "dem": dem, "frames": (path,), "output": None})
    plain = file_of(path)
    if plain.is_file() and plain.suffix.lower() == ".h5":
        raise InputError(f"{path} is one frame; give the folder of the run, so that maxima include all frames")
    if plain.suffix.lower() == ".gdb" or (plain.is_file() and not is_raster(path)):
        return Outline(plain.stem, path)
    return _classified(open_result(path), path)


def _classified(result, path):
    """A raster without a band description as a mask, a difference of DEMs or a thickness; elevations are refused."""
    if result.kind != "raster" or list(result.bands) != [UNNAMED]:
        return result
    values, grid = result.read(UNNAMED)
    kind = comparison.kind_of_raster(values)
    if kind == comparison.ELEVATION:
        raise InputError(
            f"{path} contains elevations ({np.nanmin(values):.6g} to {np.nanmax(values):.6g}), not a thickness; give "
            "the difference of two DEMs, after - before (QGIS' raster calculator), and the terrain with `dem`"
        )
    if kind == comparison.MASK:
        log.info(f"{path} is a mask; it is compared as an outline")
        return Outline(result.name, path, mask=(np.nan_to_num(values) != 0, grid))
    if kind == comparison.DIFFERENCE:
        fallen, area = values[np.isfinite(values) & (values < 0)], grid.cell_area
        log.info(
            f"{path} has negative and positive values ({np.nanmin(values):.3g} to {np.nanmax(values):.3g} m): taken as "
            f"a difference of DEMs, after - before. Positive cells are the deposit; negative ones "
            f"({fallen.size * area:.6g} m2, {-fallen.sum() * area:.6g} m3) are left out. The difference is vertical, "
            "h_deposit is normal to the slope"
        )
        bands = {HEIGHT_DIFFERENCE: replace(result.bands[UNNAMED], quantity=Quantity(HEIGHT_DIFFERENCE, "m", ""))}
        return replace(result, kind=kind, bands=bands)
    return result


def _footprint_band(band, sources):
    """The band whose footprint is compared: the given one, else the deposit for a difference of DEMs."""
    comparison.require_present_name(band)
    if band is not None or not any(source.kind == comparison.DIFFERENCE for source in sources):
        return band
    deposit = next((band for source in sources for band in DEPOSITED if band in source.bands), None)
    if deposit is None and not all(source.kind == comparison.DIFFERENCE for source in sources):
        other = next(source for source in sources if source.kind != comparison.DIFFERENCE)
        raise InputError(
            f"{other.name} has no h_deposit to compare with a difference of DEMs; expected an export or the folder of "
            "a run that came to rest, or give `band` (h_last is the last step of a flow that still moves)"
        )
    return deposit


def _distinct_names(paths, sources):
    """The names of both sides, with their folders if they are the same."""
    names = [source.name for source in sources]
    if names[0] == names[1]:
        names = [f"{Path(path).resolve().parent.name}/{Path(path).name}" for path in paths]
    return names if names[0] != names[1] else [str(path) for path in paths]


@dataclass(frozen=True)
class Footprint:
    """Footprint of one side: own cells (`mask` on `grid`), and on the common grid (`on_joint`) with values `weight`.

    `shape` is the polygon of an outline.
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

    def outline(self) -> shapely.Geometry:
        """Return the polygons of the outline, else of the cells.

        Returns
        -------
        shapely geometry [m]
        """
        if self.shape is not None:
            return self.shape
        return mask_outline(self.mask, self.grid.transform) or shapely.MultiPolygon()


def footprints_of(
    paths: Paths, sources: Sequence[Result | Outline], threshold: float, band: str | None
) -> tuple[Sequence[Footprint], list[tuple], Grid]:
    """Return the footprints of both sides, pairs of bands to compare, and the common grid.

    Parameters
    ----------
    paths : (path, path)
        Of both sides.
    sources : sequence of Result or Outline
        Both sides, from `open_side`.
    threshold : float [m, or the unit of the band]
        Cells above it belong to the footprint.
    band : str or None
        None: peak thickness, or what is compared with a difference of DEMs.

    Returns
    -------
    (list of Footprint, list of (str or None, str or None), Grid)

    Raises
    ------
    InputError, GeoreferenceError
        Two outlines, no band in common, or different CRSs.
    """
    if all(isinstance(source, Outline) for source in sources):
        raise InputError(f"{paths[0]} and {paths[1]} are both outlines; expected at least one result, for its cells")
    compared = not any(isinstance(source, Outline) for source in sources)
    pairs = comparison.matched_bands(*(tuple(source.bands) for source in sources))
    chosen = comparison.footprint_bands(pairs, _footprint_band(band, sources), compared)
    if chosen not in pairs:  # two names of one quantity, declared by the user
        pairs = [chosen, *(pair for pair in pairs if not set(pair) & set(chosen))]
    layers = _read_layers(paths, sources, chosen)
    joint = _joint_grid(threshold, layers)
    names = _distinct_names(paths, sources)
    units = [source.bands[band].quantity.unit if band else "" for source, band in zip(sources, chosen, strict=True)]
    footprints = [
        _outlined(name, layer, joint) if own is None else _flowed(name, source, own, unit, *layer, joint, threshold)
        for name, source, own, unit, layer in zip(names, sources, chosen, units, layers, strict=True)
    ]
    _log_outside_area(footprints, joint)
    return footprints, pairs, joint


def _read_layers(paths, sources, chosen):
    """(values, Grid) of each result's footprint band, the polygons of an outline; all in one CRS."""
    layers, known = [None, None], None
    for k, source in enumerate(sources):
        if not isinstance(source, Outline):
            layers[k] = source.read(chosen[k], known)
            log_if_empty(source, chosen[k], layers[k][0])
            known = known or layers[k][1]
    own = [layer[1].crs for layer in layers if layer is not None]
    crs = next((crs for crs in own if crs is not None), None)
    for k, source in enumerate(sources):
        if isinstance(source, Outline):
            layers[k] = source.read(replace(known, crs=crs))
        elif layers[k][1].crs is None and crs is not None:
            log.info(f"{source.name} has no CRS; {name_of(crs)} of the other side is assumed")
            layers[k] = (layers[k][0], replace(layers[k][1], crs=crs))
    _check_overlap(paths, [_bounds(layer) for layer in layers], None not in own)
    return layers


def log_if_empty(source: Result, band: str, values: np.ndarray) -> None:
    """Log that all cells of a band are nodata.

    Parameters
    ----------
    source : Result
    band : str
    values : float[rows, columns]
    """
    if not np.isfinite(values).any():
        log.info(f"{source.name}: every cell of {band} is nodata; taken as empty")


def _bounds(layer):
    return layer[1].bounds if isinstance(layer, tuple) else layer.bounds


def _check_overlap(paths, boxes, certain):
    """Log that the two do not overlap; an error unless both have a CRS."""
    (west, south, east, north), other = boxes
    if west < other[2] and east > other[0] and south < other[3] and north > other[1]:
        return
    apart = (
        f"{paths[0]} (E {west:.6g} to {east:.6g}, N {south:.6g} to {north:.6g}) and {paths[1]} (E "
        f"{other[0]:.6g} to {other[2]:.6g}, N {other[1]:.6g} to {other[3]:.6g}) do not overlap"
    )
    if not certain:
        raise GeoreferenceError(f"{apart}, and not both have a CRS; assign it (rio edit-info FILE --crs EPSG:n)")
    log.info(apart)


def _joint_grid(threshold, layers):
    """The common grid: cells of the finer one, over both footprints."""
    rasters = [layer for layer in layers if isinstance(layer, tuple)]
    corners = [comparison.mask_corners(comparison.footprint(values, threshold), grid) for values, grid in rasters]
    corners += [np.reshape(layer.bounds, (2, 2)) for layer in layers if not isinstance(layer, tuple)]
    corners = np.concatenate(corners)
    if len(corners) == 0:
        raise InputError(f"no cell of either is above `threshold={threshold:g}`; give a lower one")
    return comparison.joint_grid([grid for _, grid in rasters], corners)


def _flowed(name, source, band, unit, values, grid, joint, threshold):
    mask = comparison.footprint(values, threshold)
    area = float(np.count_nonzero(mask) * grid.cell_area)
    on_joint = comparison.nearest(mask, grid, joint, outside=False)
    weight = comparison.nearest(values, grid, joint)
    return Footprint(name, source.kind, band, unit, area, mask, grid, on_joint, weight)


def _outlined(name: str, shape: shapely.Geometry, joint: Grid) -> Footprint:
    mask = cells_within(shape, joint)
    if not mask.any():
        raise InputError(
            f"{name}: the outline contains no cell centre at a cell size of {joint.cell_size:g} m; export smaller cells"
        )
    return Footprint(name, OUTLINE, None, "", float(shape.area), mask, joint, mask, mask.astype(float), shape)


def _log_outside_area(footprints, joint):
    """Log the area of each footprint outside the other's raster, where it counts as not reached."""
    for footprint, other in (footprints, footprints[::-1]):
        if other.band is None:
            continue
        covered = comparison.nearest(np.ones(other.grid.shape, bool), other.grid, joint, outside=False)
        beyond = float(np.count_nonzero(footprint.on_joint & ~covered) * joint.cell_area)
        if beyond > 0:
            log.info(
                f"{beyond:.6g} m2 of {footprint.name} are outside the raster of {other.name} and count as not reached"
            )


def sides_of(
    footprints: Sequence[Footprint],
    sources: Sequence[Result | Outline],
    line: np.ndarray | None,
    terrain: Terrain | None,
    threshold: float,
) -> tuple[Side, ...]:
    """Return both Sides, with the runout from the highest point of each flow, as in `mpmgis runout`.

    The highest point is found in the largest thickness. For a side without it (an outline, a deposit, a difference of
    DEMs), which can be anywhere along the flow, runout starts at the highest point of the other side.

    Parameters
    ----------
    footprints : sequence of Footprint
    sources : sequence of Result or Outline
    line : float[n, 2] [m] or None
        Line along which the runout is measured.
    terrain : Terrain or None
    threshold : float [m]
        Thickness above which a cell belongs to a flow.

    Returns
    -------
    tuple of Side
    """
    if line is None:
        return tuple(Side(one.name, one.kind, one.band, one.area) for one in footprints)
    if terrain is None:
        log.info("no DTM beside the results: no runout from the highest point of the flow; give it with `dem`")
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


def _ends(mask: np.ndarray, grid: Grid, line: np.ndarray, terrain: Terrain) -> tuple:
    return ends_along(mask, heights_under(mask, grid, terrain), grid, line)


def _top(footprint, source, own, line, terrain, threshold):
    """Start of the flow of one side, whose footprint has its highest point at `own`; None if unknown."""
    peak = next((band for band in PEAK_THICKNESS if band in source.bands), None)
    if footprint.band is None or (peak is None and footprint.unit == "m"):
        return None
    if footprint.band == peak or footprint.unit != "m":
        return own
    values, grid = source.read(peak, footprint.grid)
    return _ends(comparison.footprint(values, threshold), grid, line, terrain)[0]
