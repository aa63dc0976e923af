"""The Python face: what `import mpmgis` offers. Everything here does what the command of its name does.

What a command would say on stderr goes to the logger `mpmgis` (`logging.basicConfig(level="INFO")` shows it); errors
are `mpmgis.MpmgisError`, each with a message of one line.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from .errors import InputError, MpmgisError
from .io.trust import trusting
from .particles import Frame, Particles
from .workflows.python_options import AveragingOptions, ExportOptions, SeedingOptions, require_known

if TYPE_CHECKING:
    import geopandas
    import xarray

    from .terrain.elevation import Terrain
    from .workflows.run import RunSummary
    from .workflows.seed import Seeded

__all__ = [
    "Frame", "MpmgisError", "Particles", "depth_average", "export_raster", "open_results", "read_frame", "run", "seed",
    "to_geodataframe",
]  # fmt: skip


def seed(
    dem: str | Path, release: str | Path, output: str | Path | None = None, **options: Unpack[SeedingOptions]
) -> "Seeded":
    """Columns from a DTM and release areas (MOX report 15/2025, Algorithm 1), as `mpmgis seed`.

    Parameters
    ----------
    dem, release : path
    output : path, optional
        Its suffix picks the format; default ``<release name>_particles.h5`` in the current folder.
    **options
        As of the command: thickness [m, a column's name or a raster], density [kg m-3], count, spacing [m], ...

    Returns
    -------
    Seeded
        With `path`, `count` and `record`.

    Examples
    --------
    >>> mpmgis.seed("dtm.tif", "release.shp", "particles.h5", thickness=1.5, count=20_000)  # doctest: +SKIP
    """
    from .workflows.seed import seed_file

    require_known(options, SeedingOptions, "seed")
    return seed_file(dem, release, output, **options)


def run(
    scene: str | Path | Mapping,
    output: str | Path | None = None,
    *,
    overwrite: bool = False,
    resume: bool = False,
    threads: int | None = None,
    laws: str | Path | None = None,
    trust: bool = False,
    confirm: Callable[[str], bool] = lambda question: True,
) -> "RunSummary":
    """Simulate a scene into a folder of frames, as `mpmgis run`.

    Parameters
    ----------
    scene : path or mapping
        A scene.toml, or its tables as a dictionary, with paths relative to the current folder.
    output : path, optional
        Folder; default ``results`` beside the scene.
    overwrite, resume, threads, laws, trust : as of the command
    confirm : callable
        Asked in words before a run of hours or of most of the memory; False refuses it.

    Returns
    -------
    RunSummary
        With `folder`, `frames`, `time` [s], `reason`, `balances`, ...

    Examples
    --------
    >>> summary = mpmgis.run("scene.toml", "results")  # doctest: +SKIP
    """
    from .workflows.run import run as run_scene

    if not isinstance(scene, (str, Path, Mapping)):
        raise InputError(f"scene is {scene!r}, wanted a path or a mapping of its tables")
    with trusting(trust):
        return run_scene(scene, output, overwrite=overwrite, resume=resume, threads=threads, laws=laws, confirm=confirm)


def export_raster(
    frames: str | Path | list | tuple,
    output: str | Path | None = None,
    *,
    trust: bool = False,
    **options: Unpack[ExportOptions],
) -> list[Path]:
    """Frames to GeoTIFF bands and a QGIS project (NHESS 25:3897, Eqs 2 to 17), as `mpmgis export-raster`.

    Parameters
    ----------
    frames : path or several
        Frames or the folder that holds them, of mpmgis or of another code.
    output : path, optional
        Folder; default ``<name>_gis`` beside the frames' folder.
    trust : as of the command
    **options
        As of the command; `cell_size` is --cs-e [m], `time_step` --dt-e [s].

    Returns
    -------
    list of Path
        Every file written, the QGIS project first.

    Examples
    --------
    >>> mpmgis.export_raster("results", cell_size=1, time_step=0.2)  # doctest: +SKIP
    """
    from .workflows.export import ExportRequest
    from .workflows.export import export_raster as export

    require_known(options, ExportOptions, "export_raster")
    given = tuple(frames) if isinstance(frames, (list, tuple)) else (frames,)
    with trusting(trust):
        return export(ExportRequest(frames=given, output=None if output is None else Path(output), **options))


def open_results(
    folder: str | Path,
    dem: "str | Path | Terrain | xarray.DataArray | None" = None,
    **options: Unpack[AveragingOptions],
) -> "xarray.Dataset":
    """A folder of results as a lazy xarray.Dataset (time, y, x) with its CRS.

    An exported folder is opened as it is: the steps' bands, `h_max` and the other maxima, `h_deposit`, `elevation`. A
    folder of frames, of mpmgis or of another code, is averaged step by step where values are asked for. Where the
    solver kept maxima of every step (`maxima = true`), they are there too: `h_max`, `t_max`, and `Ut_max`, `p_max`,
    `t_arrival` where `min_depth` is the solver's arrival thickness.

    Parameters
    ----------
    folder : path
    dem : path, Terrain or DataArray, optional
        For frames; default: the DTM that they name.
    **options
        For frames, as of `mpmgis export-raster`: cell_size [m], time_step [s], products, extent (default "dtm"), ...

    Returns
    -------
    xarray.Dataset

    Examples
    --------
    >>> results = mpmgis.open_results("results_gis")  # doctest: +SKIP
    >>> results.to_netcdf("results.nc")  # doctest: +SKIP
    >>> results.h_max.rio.to_raster("h_max.tif", driver="COG")  # doctest: +SKIP
    """
    from .workflows.datasets import open_results as opened

    return opened(folder, dem, **options)


def depth_average(
    frame: str | Path | Frame,
    dem: "str | Path | Terrain | xarray.DataArray | None" = None,
    **options: Unpack[AveragingOptions],
) -> "xarray.Dataset":
    """One frame of particles depth-averaged onto cells with vertical projection (NHESS 25:3897, Eqs 2 to 14).

    Parameters
    ----------
    frame : path or Frame
        A file, or particles of your own: ``Frame(Particles(position, velocity, mass, volume), dimension=3, crs=...)``.
    dem : path, Terrain or DataArray, optional
        Default: the DTM that the frame names.
    **options
        As of `open_results`.

    Returns
    -------
    xarray.Dataset
        h, t [m], Un, Ut [m s-1], elevation [m] and the `products` asked for, in memory.

    Examples
    --------
    >>> mpmgis.depth_average("results/frame_000010.h5", cell_size=2.0).h.plot()  # doctest: +SKIP
    """
    from .workflows.datasets import depth_average as averaged

    return averaged(frame, dem, **options)


def read_frame(path: str | Path) -> Frame:
    """The frame in a file of mpmgis, with its particles.

    Examples
    --------
    >>> mpmgis.read_frame("results/frame_000010.h5").particles.velocity  # doctest: +SKIP
    """
    from .io.frames import read_frame as read

    return read(path, with_state=False)


def to_geodataframe(what: "Frame | xarray.Dataset", wet: str = "h") -> "geopandas.GeoDataFrame":
    """Particles of a Frame as points, or the cells of a Dataset of one time, where `wet` is above 0, as squares.

    Examples
    --------
    >>> mpmgis.to_geodataframe(results.isel(time=-1)).to_file("deposit.gpkg")  # doctest: +SKIP
    """
    from .io.datasets import cell_table, particle_table

    if isinstance(what, Frame):
        return particle_table(what)
    if not hasattr(what, "data_vars"):
        raise InputError(f"got {type(what).__name__}, wanted a Frame or an xarray.Dataset")
    return cell_table(what, wet)
