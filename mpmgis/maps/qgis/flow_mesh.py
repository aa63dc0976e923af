"""Write the flow as a UGRID mesh in NetCDF, for velocity arrows in QGIS and for xarray.

Only cells that the flow ever reached are faces, so a narrow flow on a wide terrain gives a small file.
Conventions: UGRID 1.0 and CF-1.11, in the subset that QGIS (MDAL) reads: the corners of a face run counter-clockwise,
the CRS is ASCII WKT 1 in the variable named by `grid_mapping`, and the two components of a vector have the same long
name up to ", x-component" and ", y-component". Time is packed (CF 8.1): readers of CF multiply it by `scale_factor` and
get simulated seconds; MDAL does not, and gets the whole seconds of the project's clock.
"""

import warnings
from collections import deque
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pyproj.exceptions import CRSError

from ... import __version__
from ...compiled.jit import jit
from ...laws.quantities import NODATA
from ...system.errors import OutputError, one_line
from ..averaging.exported_folder import ExportedRun
from .chunk_packing import LEVEL, packed_chunk
from .colours import look_of
from .map_clock import Clock
from .xml_markup import LOCAL_FRAME

if TYPE_CHECKING:
    from .outlines import StepSpool


MESH_BANDS = ("h", "t", "Un", "Ut")  # scalars
VELOCITY = "velocity along the slope (m/s)"
BED = "Bed Elevation"  # name of node heights in QGIS
REFERENCE_SYSTEM = "projected_coordinate_system"  # the name that MDAL looks for
COMPONENTS = {"Ut_E": "x-component", "Ut_N": "y-component"}  # of the vector
LIGHT = {"zlib": True, "complevel": LEVEL, "shuffle": True}  # compression


def write_mesh(run: ExportedRun, steps: "StepSpool", threads: Executor | None = None) -> None:
    """Write the mesh of a run: h, t, Un, Ut and the velocity vector of each step, on cells that were ever wet.

    Without wet cells no mesh is written.

    Parameters
    ----------
    run : ExportedRun
    steps : StepSpool
        Values of the steps; without `Ut_E` and `Ut_N` there are no arrows.
    threads : Executor, optional
        For the compression of values, a few steps at a time.

    Raises
    ------
    OutputError
        NetCDF or HDF5 cannot write it.
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
    """The variables of the mesh: scalars of the steps, and velocity components if known."""
    scalars = [quantity.name for quantity in run.step_bands if quantity.name in MESH_BANDS]
    return scalars + [name for name in COMPONENTS if steps.count and name in steps.bands(0)[1]]


def _title_and_unit(run, name):
    if name in COMPONENTS:
        return f"{VELOCITY}, {COMPONENTS[name]}", "m s-1"
    return dataset_title(run, name), "m s-1" if name[0] == "U" else "m"


def dataset_title(run: ExportedRun, name: str) -> str:
    """Return the long name of a scalar of the mesh, which is the name of its group in QGIS.

    Parameters
    ----------
    run : ExportedRun
    name : str
        Of the band.
    """
    return look_of(next(q for q in run.step_bands if q.name == name)).title(name)


def _faces(run, wet):
    """int64[faces]: flat index of the faces in the run's full grid, ascending."""
    rows, columns = run.flow_window
    row, column = np.nonzero(wet)
    return (row + rows.start) * run.grid.shape[1] + column + columns.start


def _chunks(steps, faces, names, threads):
    """Yield the packed values of each step and variable; only a few steps are in memory at a time."""
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


def step_chunks(steps: "StepSpool", step: int, faces: np.ndarray, names: list[str]) -> list[bytes]:
    """Pack the values of a step, each variable as a chunk of the file.

    Parameters
    ----------
    steps : StepSpool
    step : int
    faces : int64[f]
        Flat numbers of the faces in the run's grid, ascending.
    names : list of str
        Of the variables.

    Returns
    -------
    list of bytes
    """
    index, values = steps.bands(step)
    dry = _dry({name: values[name] for name in names if name in MESH_BANDS})
    nowhere, face_values = np.zeros(len(index), bool), np.empty(len(faces), "<f4")
    chunks = []
    for name in names:
        fill_faces(faces, index, values[name], dry if name in MESH_BANDS else nowhere, np.float32(NODATA), face_values)
        chunks.append(packed_chunk(face_values, NODATA))
    return chunks


@jit
def fill_faces(
    faces: np.ndarray, index: np.ndarray, values: np.ndarray, gone: np.ndarray, nodata: float, filled: np.ndarray
) -> None:
    """Give each face the value of its cell.

    Parameters
    ----------
    faces : int64[f]
        Flat numbers of the faces in the run's grid, ascending.
    index : int64[k]
        Flat numbers of the cells with values, ascending; some are not faces.
    values : float32[k]
    gone : bool[k]
        Cells whose value is not shown.
    nodata : float32
        Value of faces without a finite value.
    filled : float32[f], out
    """
    c = 0
    for f in range(faces.shape[0]):
        while c < index.shape[0] and index[c] < faces[f]:
            c += 1
        known = c < index.shape[0] and index[c] == faces[f] and not gone[c] and np.isfinite(values[c])
        filled[f] = values[c] if known else nodata


def _dry(values):
    """bool[k]: cells without depth, thickness and velocity at this step."""
    return np.logical_and.reduce(
        [~np.isfinite(band) if name in ("Un", "Ut") else ~(band > 0) for name, band in values.items()]
    )


def _write_values(path, names, steps):
    """Write the packed chunks of each step directly into the file, one per variable of `names`."""
    import h5py

    try:
        with h5py.File(path, "r+") as file:
            for step, chunks in enumerate(steps):
                for name, chunk in zip(names, chunks, strict=True):
                    file[name].resize(step + 1, axis=0)
                    file[name].id.write_direct_chunk((step, 0), chunk)
    except (OSError, RuntimeError) as error:
        raise OutputError(f"{path}: cannot be written ({one_line(error)}); is the disk full?") from error


def group_names(path: Path) -> list[str]:
    """Read the dataset groups of a mesh written here, in the order of QGIS.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of str
        Empty without a file.
    """
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
    """A new NetCDF file; library errors (for example a full disk) become an OutputError."""
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
    """The lattice nodes of wet cells, bool[rows + 1, columns + 1], and the nodes of each face, int32[faces, 4].

    Nodes are numbered in lattice order. Faces run counter-clockwise, also in a `mirrored` grid (positive determinant
    of its matrix).
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
    """float64[rows + 1, columns + 1] [m]: mean of the valid cells (up to four) around each lattice node."""
    padded = np.pad(elevation.astype(float), 1, constant_values=np.nan)
    around = [padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]]
    count = sum(np.isfinite(part) for part in around)
    total = sum(np.where(np.isfinite(part), part, 0.0) for part in around)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)


def _write_reference_system(file, crs):
    """The CRS in ASCII: with other characters netCDF4 writes a string type that QGIS does not read.

    A local frame has no grid mapping of CF; QGIS finds its CRS by the name of the variable.
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
            "comment": f"packed: QGIS plays it as {clock.label}",
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
    """Declare a variable with one chunk per step (required by `_write_values`)."""
    faces = len(file.dimensions["face"])
    variable = file.createVariable(
        name, "f4", ("time", "face"), chunksizes=(1, faces), fill_value=np.float32(NODATA), endian="little", **LIGHT
    )
    variable.setncatts({"long_name": title, "units": units, "mesh": "mesh", "location": "face"} | _grid_mapping(file))
