"""The flow as a UGRID mesh in NetCDF: what QGIS draws as moving arrows, and what xarray opens.

Only the cells that the flow ever reached are faces, so that a thin flow on a wide terrain stays small.
Conventions: UGRID 1.0 and CF-1.11, in the part of them that QGIS (MDAL) reads: a face's corners run counter-clockwise,
the CRS is ASCII WKT 1 in the variable that the node heights name, and the two components of a vector share a long name
up to ", x-component" and ", y-component". Time is packed (CF 8.1): readers of CF multiply it by `scale_factor` and
get simulated seconds; MDAL does not, and gets the whole seconds of the project's clock.
"""

import warnings
import zlib
from collections import deque
from contextlib import contextmanager

import numpy as np
from pyproj.exceptions import CRSError

from .. import __version__
from ..errors import OutputError, one_line
from ..fields import NODATA
from .clock import Clock
from .markup import LOCAL_FRAME
from .styles import look_of

MESH_BANDS = ("h", "t", "Un", "Ut")
VELOCITY = "velocity along the slope (m/s)"
BED = "Bed Elevation"  # QGIS' own name for node heights
REFERENCE_SYSTEM = "projected_coordinate_system"  # the name that MDAL looks for
COMPONENTS = {"Ut_E": "x-component", "Ut_N": "y-component"}
LEAST_REPEATED = 0.25  # share of bytes like the one before, below which deflating costs more than it gains
LIGHT = {"zlib": True, "complevel": 1, "shuffle": True}  # compression


def write_mesh(run, steps, threads=None):
    """Write the mesh of a run: h, t, Un, Ut and the velocity vector on the ever-wet cells, step by step.

    A run in which no cell was ever wet has no mesh.

    Parameters
    ----------
    run : ExportedRun
    steps : StepSpool
        Values of the steps; without `Ut_E` and `Ut_N` there are no arrows.
    threads : Executor, optional
        Values are compressed there, a few steps at a time.

    Raises
    ------
    OutputError
        Where NetCDF or HDF5 cannot write it.
    """
    (peak,) = run.read(run.maxima_file, ("h_max",))
    wet = np.isfinite(peak)
    if not wet.any():
        return
    path, names = run.folder / run.mesh_file, _names(run, steps)
    with _open_new(path) as file:
        _write_places(file, run, wet)
        _write_times(file, run)
        for name in names:
            _add_face_variable(file, name, *_title_and_unit(run, name))
    _write_values(path, names, _chunks(steps, _faces(run, wet), names, threads))


def _names(run, steps):
    """The variables that the mesh gets: those of the steps that it shows, arrows where their parts are known."""
    scalars = [quantity.name for quantity in run.step_bands if quantity.name in MESH_BANDS]
    return scalars + [name for name in COMPONENTS if steps.count and name in steps.bands(0)[1]]


def _title_and_unit(run, name):
    if name in COMPONENTS:
        return f"{VELOCITY}, {COMPONENTS[name]}", "m s-1"
    return look_of(next(q for q in run.step_bands if q.name == name)).title(name), "m s-1" if name[0] == "U" else "m"


def _faces(run, wet):
    """int64[faces]: flat index in the run's whole grid of the cells that are faces, ascending."""
    rows, columns = run.flow_window
    row, column = np.nonzero(wet)
    return (row + rows.start) * run.grid.shape[1] + column + columns.start


def _chunks(steps, faces, names, threads):
    """Yield each step's values of each variable as `_packed` makes them; only a few steps are ever waiting."""
    waiting = deque()
    for step in range(steps.count):
        if threads is None:
            yield step_chunks(steps, step, faces, names)
            continue
        waiting.append(threads.submit(step_chunks, steps, step, faces, names))
        if len(waiting) > 4:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def step_chunks(steps, step, faces, names):
    """List of bytes: a step's values of the variables `names` on `faces`, each packed as its chunk of the file."""
    index, values = steps.bands(step)
    place = np.searchsorted(faces, index)
    on = faces[np.minimum(place, len(faces) - 1)] == index  # depth is not known everywhere
    dry = _dry({name: values[name] for name in names if name in MESH_BANDS})
    chunks = []
    for name in names:
        gone = ~np.isfinite(values[name]) | (dry if name in MESH_BANDS else False)
        face_values = np.full(len(faces), NODATA, "<f4")
        face_values[place[on]] = np.where(gone, np.float32(NODATA), values[name])[on]
        chunks.append(_packed(face_values))
    return chunks


def _dry(values):
    """bool[faces]: nothing there at this step: no depth, no thickness, no velocity."""
    return np.logical_and.reduce(
        [~np.isfinite(band) if name in ("Un", "Ut") else ~(band > 0) for name, band in values.items()]
    )


def _packed(values):
    """float32[faces] as HDF5 stores a chunk of LIGHT: bytes of equal weight together, then deflated.

    Run lengths alone are looked for: the digits of a flow do not repeat, and looking for it costs twice the time and
    makes the file larger (measured). Bytes that hardly ever repeat, the last digits of a flow, are stored as they are:
    a deflated stream may be put together of parts.
    """
    planes = np.ascontiguousarray(values.view(np.uint8).reshape(-1, 4).T)
    parts = [b"\x78\x01"]  # zlib's header of a window of 32 kB
    for k, plane in enumerate(planes):
        level = LIGHT["complevel"] if np.count_nonzero(plane[1:] == plane[:-1]) > LEAST_REPEATED * plane.size else 0
        packer = zlib.compressobj(level, zlib.DEFLATED, -15, 9, zlib.Z_RLE)
        end = zlib.Z_FINISH if k == len(planes) - 1 else zlib.Z_FULL_FLUSH
        parts += [packer.compress(plane), packer.flush(end)]
    return b"".join(parts) + zlib.adler32(planes).to_bytes(4, "big")


def _write_values(path, names, steps):
    """Put the chunks of each step, one a variable of `names`, straight into the file: they are packed already."""
    import h5py

    try:
        with h5py.File(path, "r+") as file:
            for step, chunks in enumerate(steps):
                for name, chunk in zip(names, chunks, strict=True):
                    file[name].resize(step + 1, axis=0)
                    file[name].id.write_direct_chunk((step, 0), chunk)
    except (OSError, RuntimeError) as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)}); is the disk full?") from error


def group_names(path):
    """List of the dataset groups that QGIS shows of a mesh written here, in its order; empty where there is no file."""
    import netCDF4

    if not path.exists():
        return []
    with netCDF4.Dataset(path) as file:
        titles = {
            variable.long_name.removesuffix(", x-component").removesuffix(", y-component")
            for variable in file.variables.values()
            if getattr(variable, "location", "") == "face"
        }
    return [BED, *sorted(titles)]


@contextmanager
def _open_new(path):
    """A NetCDF file to write to; what the library says when a disk is full becomes an OutputError."""
    import netCDF4

    try:
        with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
            yield file
    except RuntimeError as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)}); is the disk full?") from error


def _write_places(file, run, wet):
    """The mesh's nodes, faces and CRS."""
    nodes, corners = _corners(wet, mirrored=np.linalg.det(run.flow_grid.matrix) > 0)
    x, y = _node_places(run.flow_grid, nodes)
    file.createDimension("node", len(x))
    file.createDimension("face", len(corners))
    file.createDimension("corner", 4)
    file.setncatts(_global_attributes(run))
    _write_reference_system(file, run.grid.crs)
    mesh = file.createVariable("mesh", "i4")
    mesh.setncatts(
        {
            "cf_role": "mesh_topology",
            "topology_dimension": np.int32(2),
            "node_coordinates": "node_x node_y",
            "face_node_connectivity": "face_nodes",
            "face_dimension": "face",
        }
    )
    faces = file.createVariable("face_nodes", "i4", ("face", "corner"), fill_value=-1, **LIGHT)
    faces.setncatts({"cf_role": "face_node_connectivity", "start_index": np.int32(0)})
    faces[:] = corners
    _write_node_variable(file, "node_x", x, {"standard_name": "projection_x_coordinate"})
    _write_node_variable(file, "node_y", y, {"standard_name": "projection_y_coordinate"})
    bed = {"standard_name": "altitude", "long_name": "bed elevation", "positive": "up"} | _grid_mapping(file)
    _write_node_variable(file, "node_z", _node_heights(run.read_terrain())[nodes], bed)


def _global_attributes(run):
    return {
        "Conventions": "CF-1.11 UGRID-1.0",
        "title": f"{run.name}: flow on the cells that it reached",
        "source": f"mpmgis {__version__}, Material Point Method",
        "history": f"mpmgis {__version__} export-raster: {len(run.times)} steps averaged on cells of a grid",
        "references": "https://doi.org/10.5194/nhess-25-3897-2025",
        "comment": f"velocities where the flow is at least {run.min_depth:g} m deep",
        "min_depth": float(run.min_depth),
    }


def _write_node_variable(file, name, values, attributes):
    variable = file.createVariable(name, "f8", ("node",), fill_value=NODATA, **LIGHT)
    variable.setncatts(attributes | {"units": "m", "mesh": "mesh", "location": "node"})
    variable[:] = np.where(np.isfinite(values), values, NODATA)


def _corners(wet, mirrored=False):
    """The lattice nodes that wet cells use, bool[rows + 1, columns + 1], and each face's nodes, int32[faces, 4].

    Nodes are numbered in the lattice's order; a face runs counter-clockwise from its south-western corner, also where
    the grid is `mirrored`, so that its rows lie to the left of its columns.
    """
    used = np.zeros((wet.shape[0] + 1, wet.shape[1] + 1), dtype=bool)
    row, column = np.nonzero(wet)
    around = ((row + 1, column), (row + 1, column + 1), (row, column + 1), (row, column))
    for corner in around:
        used[corner] = True
    around = around[::-1] if mirrored else around
    number = np.cumsum(used.ravel(), dtype=np.int32).reshape(used.shape) - 1
    return used, np.stack([number[corner] for corner in around], axis=1)


def _node_places(grid, used):
    row, column = np.nonzero(used)
    return grid.xy(row - 0.5, column - 0.5)


def _node_heights(elevation):
    """float64[rows + 1, columns + 1] [m]: mean of the up to four valid cells around each lattice node."""
    padded = np.pad(elevation.astype(float), 1, constant_values=np.nan)
    around = [padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]]
    count = sum(np.isfinite(part) for part in around)
    total = sum(np.where(np.isfinite(part), part, 0.0) for part in around)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)


def _write_reference_system(file, crs):
    """The CRS in plain ASCII: with any other sign netCDF4 writes a kind of text that QGIS does not see.

    A local frame has no grid mapping of CF; QGIS finds its CRS by the variable's name.
    """
    variable = file.createVariable(REFERENCE_SYSTEM, "i4")
    try:
        text = LOCAL_FRAME if crs is None else crs.to_wkt("WKT1_GDAL")
    except CRSError:
        text = crs.to_wkt()
    text = _ascii(text)
    variable.setncatts({"wkt": text, "crs_wkt": text})
    if crs is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a parameter that CF does not know stays in the WKT
            cf = crs.to_cf()
        variable.setncatts({key: _ascii(value) for key, value in cf.items() if key != "crs_wkt"})
    if crs is not None and crs.to_epsg():
        variable.setncatts({"epsg": np.int32(crs.to_epsg()), "EPSG_code": f"EPSG:{crs.to_epsg()}"})


def _ascii(value):
    return value.encode("ascii", "ignore").decode() if isinstance(value, str) else value


def _grid_mapping(file):
    """Attribute of the variables on the mesh: the CRS, where CF knows its projection."""
    known = hasattr(file[REFERENCE_SYSTEM], "grid_mapping_name")
    return {"grid_mapping": REFERENCE_SYSTEM} if known else {}


def _write_times(file, run):
    """Simulated time, packed as the seconds that QGIS plays; `t_s` is the same without rounding."""
    clock = Clock.of(run.times)
    file.createDimension("time", None)
    time = file.createVariable("time", "f8", ("time",))  # MDAL reads no integers; CF 8.1: of the type of scale_factor
    time.setncatts(
        {
            "standard_name": "time",
            "long_name": "simulated time",
            "comment": f"packed: QGIS plays it as {clock.says}",
            "axis": "T",
            "units": "seconds since 2000-01-01 00:00:00",
            "calendar": "standard",
            "units_metadata": "leap_seconds: none",
            "scale_factor": 1.0 / clock.stretch,
        }
    )
    time.set_auto_scale(False)
    time[:] = np.array(clock.begins, dtype=float)
    true = file.createVariable("t_s", "f8", ("time",))
    true.setncatts({"long_name": "simulated time", "units": "s"})
    true[:] = np.array(run.times, dtype=float)


def _add_face_variable(file, name, title, units):
    """Declare a variable of which every step is one chunk (`_write_values` counts on it)."""
    faces = len(file.dimensions["face"])
    variable = file.createVariable(
        name, "f4", ("time", "face"), chunksizes=(1, faces), fill_value=np.float32(NODATA), endian="little", **LIGHT
    )
    variable.setncatts(
        {
            "long_name": title,
            "units": units,
            "mesh": "mesh",
            "location": "face",
        }
        | _grid_mapping(file)
    )
