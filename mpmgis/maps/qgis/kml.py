"""Write outlines and maxima as KMZ for Google Earth and other viewers of the globe, in WGS 84."""

import zipfile
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pyproj
import shapely

from ...system.errors import GeoreferenceError, OutputError, one_line
from ...system.optional_libraries import pyogrio
from ..averaging.exported_folder import ExportedRun
from .colours import colour_classes, look_of
from .map_clock import Clock, stamp
from .outlines import mask_outline

DRIVER = "LIBKML"
# Styles of OGR: fill and line, colours as #rrggbbaa.
FLOW_STYLE = "BRUSH(fc:#3b6fd266);PEN(c:#1f4eaaff,w:2px)"
RELEASE_STYLE = "BRUSH(fc:#00000000);PEN(c:#0a4fd0ff,w:3px)"


def require_kml(crs: pyproj.CRS | None) -> None:
    """Raise an error unless the run has a place on the globe and GDAL has its KMZ driver, before any work.

    Parameters
    ----------
    crs : pyproj.CRS or None
        None: a local frame.

    Raises
    ------
    GeoreferenceError, OutputError
    """
    if crs is None:
        raise GeoreferenceError("--kml needs a CRS; the DTM lies in a local frame without a place on the globe")
    if "w" not in pyogrio().list_drivers().get(DRIVER, ""):
        raise OutputError(f"--kml needs GDAL with the driver {DRIVER}, which this one has not; install mpmgis by pip")


def write_kml(run: ExportedRun, release: Sequence | None = None) -> None:
    """Write `<name>.kmz`: layers `release`, `maxima` (a polygon for each class of h_max) and `outline` (each step).

    The outlines have the times of the project's clock, so that the time slider of Google Earth plays them.

    Parameters
    ----------
    run : ExportedRun
        Its rasters are written.
    release : sequence of shapely polygons, optional
    """
    plain = run.folder / f".{run.name}.kml"  # in a .kmz GDAL replaces the layers that are there
    layers = {"release": _release(release), "maxima": _maxima(run), "outline": _outlines(run)}
    for name, features in layers.items():
        if features:
            _write_layer(plain, name, features, run.grid.crs)
    with zipfile.ZipFile(run.folder / f"{run.name}.kmz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", plain.read_bytes())
    plain.unlink()


def _release(release):
    return [("release area", "", shape, RELEASE_STYLE, None, None) for shape in release or ()]


def _maxima(run):
    """(name, description, polygon, style, begin, end) of each class of the largest depth that occurs."""
    quantity = next(quantity for quantity in run.maxima_bands if quantity.name == "h_max")
    (peak,) = run.read(run.maxima_file, ("h_max",))
    classes = colour_classes(look_of(quantity, run.classes), run.typical.get("h_max", 0.0), run.min_depth)
    features = []
    for below, entry in pairwise(classes):
        shape = mask_outline((peak > below.upper) & (peak <= entry.upper), run.flow_grid.transform)
        if shape is not None:
            style = f"BRUSH(fc:{entry.colour}b4);PEN(c:{entry.colour}ff,w:1px)"
            text = f"{quantity.long_name}; {run.name}"
            features.append((f"largest flow depth {entry.label}", text, shape, style, None, None))
    return features


def _outlines(run):
    """As `_maxima`: the cells at least `min_depth` deep at each step."""
    clock, features = Clock.of(run.times), []
    for step, file in enumerate(run.step_files):
        (depth,) = run.read(file, ("h",))
        shape = mask_outline(depth >= max(run.min_depth, np.nextafter(0, 1)), run.flow_grid.transform)
        if shape is not None:
            name = f"t = {run.times[step]:.{clock.decimals}f} s"
            text = f"outline of the flow, {clock.label}"
            features.append((name, text, shape, FLOW_STYLE, stamp(clock.begins[step]), stamp(clock.ends[step])))
    return features


def _write_layer(path, name, features, crs):
    names, texts, shapes, styles, begins, ends = zip(*features, strict=True)
    to_globe = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    places = shapely.transform(
        np.array(shapes, dtype=object), lambda xy: np.column_stack(to_globe.transform(*xy.T)), include_z=False
    )
    columns = {"Name": names, "description": texts, "OGR_STYLE": styles}
    arrays = [np.array(column, dtype=object) for column in columns.values()]
    if begins[0] is not None:
        columns |= {"begin": begins, "end": ends}
        arrays += [np.array([time.removesuffix("Z") for time in column], "datetime64[ms]") for column in (begins, ends)]
    from pyogrio.raw import write

    try:
        write(
            path,
            shapely.to_wkb(places),
            arrays,
            list(columns),
            driver=DRIVER,
            layer=name,
            crs="EPSG:4326",
            geometry_type="MultiPolygon",
            promote_to_multi=True,
            append=path.exists(),
            gdal_tz_offsets={key: np.full(len(names), 100) for key in ("begin", "end") if key in columns},
        )
    except Exception as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)})") from error
