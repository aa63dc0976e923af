"""Results opened for questions: frames of any code or an exported folder, cells averaged as in an export."""

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from ..analysis.cells import Bed
from ..analysis.frame_values import Averaging, cells_of, frame_at_cells
from ..analysis.quantities import PRODUCTS
from ..analysis.sampling import export_grid
from ..errors import InputError
from ..interop.frame_list import list_frames
from ..io.exported import ExportedSteps, is_export, open_steps
from ..io.results import names_rasters, open_result
from ..messages import log
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from .export import ExportRequest, export_raster
from .export_inputs import release_density, run_terrain, tell_of_columns, terrain_of_rasters
from .parallel import frame_pool

EXPORTED_FOLDER = "gis"


@dataclass(frozen=True)
class FrameFlow:
    """A flow as frames on disk: `entries` by time, the `terrain` under them, how their cells are averaged."""

    name: str
    entries: tuple
    terrain: Terrain
    averaging: Averaging

    @property
    def times(self):
        """float64[frames] [s]."""
        return np.array([entry.time for entry in self.entries])

    @property
    def grid(self):
        """Grid of the cells."""
        return self.averaging.grid

    @property
    def density(self):
        """Of the release [kg m-3]."""
        return self.averaging.density

    @property
    def min_depth(self):
        """Depth [m] from which there are velocities."""
        return self.averaging.min_depth

    def at_cells(self, cells, names, steps, progress=lambda done, total: None):
        """Values of the flat `cells` of the grid at the numbered `steps`.

        Returns
        -------
        dict of str to float64[steps, cells]
            Of the products `names`; NaN off the grid, and velocities where the flow is too shallow.
        """
        wanted = tuple(name for name in PRODUCTS if name in names or name == "h")
        averaging = replace(self.averaging, names=wanted)
        found = []
        with frame_pool() as pool:
            entries = [self.entries[step] for step in steps]
            for values in pool.map(_entry_at_cells, entries, averaging, cells):
                found.append(values)
                progress(len(found), len(entries))
        return {name: np.array([values[name] for values in found]) for name in names}


def _entry_at_cells(entry, averaging, cells):
    return frame_at_cells(entry.read(averaging.density), averaging, cells)


@dataclass(frozen=True)
class ExportFlow:
    """A flow as the exported `steps`, with its `terrain`."""

    name: str
    steps: ExportedSteps
    terrain: Terrain
    entries = ()

    @property
    def times(self):
        """float64[steps] [s]."""
        return np.array(self.steps.times)

    @property
    def grid(self):
        """Grid of the cells."""
        return self.steps.grid

    @property
    def density(self):
        """Of the release [kg m-3]; None where the export does not say it."""
        return self._said("density")

    @property
    def min_depth(self):
        """Depth [m] from which there are velocities."""
        return self._said("min_depth") or 0.0

    def _said(self, tag):
        try:
            return float(self.steps.tags.get(tag))
        except (TypeError, ValueError):
            return None

    def at_cells(self, cells, names, steps, progress=lambda done, total: None):
        """As `FrameFlow.at_cells`, from the rasters."""
        missing = [name for name in names if name not in self.steps.bands]
        if missing:
            raise InputError(
                f"{self.name}: the exported steps have no {', '.join(missing)}; name the frames instead, or export "
                f"them with --products {','.join(missing)}"
            )
        found = []
        for step in steps:
            found.append(self.steps.read(step, names, cells))
            progress(len(found), len(steps))
        return {name: np.array([values[name] for values in found]) for name in names}


@dataclass(frozen=True)
class RasterFlow:
    """A flow of which only rasters of its largest values are known, as other codes leave them, on a `terrain`."""

    name: str
    terrain: Terrain
    grid: Grid
    density: float | None
    min_depth: float
    entries = ()
    times = np.empty(0)


def open_flow(request, output, peaks_do=False, used=()):
    """The flow that `request` (ExportRequest) names: frames, one exported folder, or rasters of its largest values.

    `output` is where the answers go: a DTM in there is refused. `peaks_do`: largest values are enough.
    `used`: options of frames that the question has a use for with rasters of these, too.

    Returns
    -------
    FrameFlow, ExportFlow or RasterFlow

    Raises
    ------
    MpmgisError
    """
    if any(is_export(path) for path in request.frames):
        return _open_export(request)
    if any(names_rasters(path) for path in request.frames):
        return _open_rasters(request, peaks_do, used)
    return open_frames(request, output)


def open_frames(request, output, why=""):
    """As `open_flow`, of frames only; `why` rasters will not do is said in their refusal."""
    for path in request.frames:
        if is_export(path):
            raise InputError(f"{path} is an export; {why}; give the folder of the frames it was made from")
        if names_rasters(path):
            raise InputError(f"{path} names rasters; {why}; give the code's frames of particles")
    entries = list_frames(request.frames, request.terms())
    terrain = run_terrain(request, entries, output)
    density = release_density(request, entries)
    tell_of_columns(request, entries)
    averaging = Averaging(
        bed=Bed.of(terrain, request.bed, request.standoff),
        grid=export_grid(terrain.grid, request.cell_size),
        density=density,
        names=(),
        percentile=request.percentile,
        min_depth=request.min_depth,
    )
    return FrameFlow(result_name(request), entries, terrain, averaging)


def result_name(request):
    """Name of a result: that of the folder of its frames or of the export, or how its rasters' names begin."""
    path = Path(str(request.frames[0])).absolute()
    if not path.is_dir() and names_rasters(path):
        return path.stem
    folder = path if path.is_dir() else path.parent
    return folder.resolve().name or "frames"


def _open_export(request):
    _require_alone(request)
    _refuse_options_of_frames(request)
    steps = open_steps(request.frames[0])
    path = request.dem or steps.terrain
    return ExportFlow(steps.name, steps, terrain_of_rasters(path, steps.grid.crs, request.dem_band))


def _open_rasters(request, peaks_do, used):
    """The RasterFlow of rasters named for what they hold."""
    path = request.frames[0]
    if not peaks_do:
        raise InputError(f"{path} names largest values, which tell nothing over time; give frames, or an export")
    _require_alone(request)
    _refuse_options_of_frames(request, used)
    result = open_result(path)
    dem = request.dem or result.terrain
    if dem is None:
        raise InputError(f"{path}: no DTM lies beside these rasters; give it with --dem")
    _, grid = next(iter(result.bands.values())).read()
    terrain = terrain_of_rasters(dem, grid.crs, request.dem_band)
    return RasterFlow(result_name(request), terrain, grid, request.density, request.min_depth)


def _require_alone(request):
    if len(request.frames) > 1:
        raise InputError(
            f"{request.frames[0]} and {request.frames[1]}: of exports and rasters give one at a time, and no frames "
            "beside it"
        )


def _refuse_options_of_frames(request, used=()):
    """A raster's cells are made: options that say how frames are read and averaged would change nothing.

    `used` are those that the question itself has a use for.
    """
    told = [
        field.name
        for field in fields(ExportRequest)
        if field.name not in ("frames", "dem", "dem_band", "output", "overwrite", *used)
        and getattr(request, field.name) != field.default
    ]
    if told:
        raise InputError(
            f"{request.frames[0]} holds rasters, whose cells are averaged already; the option for "
            f"{', '.join(name.replace('_', ' ') for name in told)} is for frames"
        )


def exported_peaks(request, stack, progress=lambda done, total: None, used=(), used_of_rasters=()):
    """The Result (maxima, deposit, terrain) of an export or other rasters, or of frames, which are exported for it.

    `stack` (an ExitStack) keeps the temporary folder of that export; it goes with it. `used` are names of options of
    frames that the question has a use for with an export, too, `used_of_rasters` with other rasters.
    """
    import tempfile

    exported = any(is_export(path) for path in request.frames)
    if exported or any(names_rasters(path) for path in request.frames):
        _require_alone(request)
        _refuse_options_of_frames(request, used if exported else (*used, *used_of_rasters))
        return replace(open_result(request.frames[0]).with_our_names(), name=result_name(request))
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mpmgis-peaks-"))) / EXPORTED_FOLDER
    asked = replace(request, output=folder, overwrite=False, time_step=math.inf, qgis=False)  # maxima, no steps
    export_raster(asked, progress)
    return replace(open_result(folder), name=result_name(request), kind="run")


def read_peaks(result, names, density=None):
    """(Band -> float[rows, columns] of those of `names` that a Result has, their Grid).

    A pressure that it lacks is made of its largest speed and the `density` [kg m-3].
    """
    bands, grid = {}, None
    for name in names:
        if name in result.bands:
            bands[name], grid = result.read(name, grid)
    if density is None or result.kind in ("export", "run") or "p_max" not in names:
        return bands, grid
    if "p_max" in bands:
        log.info(f"{result.name} holds the pressure itself; --density {density:g} is not used")
    elif "Ut_max" in result.bands:
        speed, grid = result.read("Ut_max", grid)
        bands["p_max"] = density * speed**2
    return bands, grid


def require_on_grid(flow, x, y, names, what):
    """Flat cells of map points [m]; InputError names the first that lies off the raster."""
    cells = cells_of(flow.grid, x, y)
    off = np.flatnonzero(cells < 0)
    if off.size:
        west, south, east, north = flow.grid.bounds
        k = int(off[0])
        raise InputError(
            f"{what} {str(names[k])!r} (E {x[k]:.1f}, N {y[k]:.1f}) lies off {flow.terrain.path} (E {west:.0f} to "
            f"{east:.0f}, N {south:.0f} to {north:.0f}); move it, or check its CRS"
        )
    return cells
