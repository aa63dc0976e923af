"""Open results in Python as xarray datasets, GeoPandas tables, and frames in memory.

The verbs are in `mpmgis.commands`. Messages go to the logger `mpmgis` (`logging.basicConfig(level="INFO")` shows
them); errors are `mpmgis.MpmgisError`, each with a message of one line.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from ..frames.particles import Frame
from ..maps.averaging.averaging_options import USUAL_DEPTH
from ..maps.export.export_options import FrameAveragingOptions
from ..system.errors import InputError
from ..system.option import options_of
from .export_raster import VERB as _EXPORT
from .verb_calls import complete, python_words

if TYPE_CHECKING:
    import geopandas
    import xarray
    from matplotlib.axes import Axes

    from ..maps.export.export_options import Export
    from ..terrain.elevation import Terrain


def open_results(
    folder: str | Path,
    dem: "str | Path | Terrain | xarray.DataArray | None" = None,
    **options: Unpack[FrameAveragingOptions],
) -> "xarray.Dataset":
    """Open a folder of results as a lazy xarray.Dataset (time, y, x) with its CRS.

    An exported folder contains the bands of the steps, `h_max` and the other maxima, `h_deposit`, `elevation`. Frames,
    of mpmgis or of another code, are averaged step by step when values are needed. Their dataset also contains the
    maxima of all steps that the solver stored (`maxima = true`): `h_max`, `t_max`, and `Ut_max`, `p_max`, `t_arrival`
    if `min_depth` is the solver's arrival thickness.

    Parameters
    ----------
    folder : path
    dem : path, Terrain or DataArray, optional
        For frames; default: the DTM named in them.
    **options
        For frames: `cell_size` [m], `time_step` [s], `products`, `extent` (default "dtm", because "flow" reads all
        frames first), ...

    Returns
    -------
    xarray.Dataset

    Examples
    --------
    >>> results = mpmgis.open_results("results_gis")  # doctest: +SKIP
    >>> results.to_netcdf("results.nc")  # doctest: +SKIP
    >>> results.h_max.rio.to_raster("h_max.tif", driver="COG")  # doctest: +SKIP
    """
    from ..maps.export.averaged_datasets import open_results as opened

    with python_words(_EXPORT):
        asked = _averaging(folder, options, "open_results")
        found: xarray.Dataset = opened(folder, asked, dem, tuple(options))
    return found


def depth_average(
    frame: str | Path | Frame,
    dem: "str | Path | Terrain | xarray.DataArray | None" = None,
    **options: Unpack[FrameAveragingOptions],
) -> "xarray.Dataset":
    """Average the depth of one frame of particles onto cells, with vertical projection (NHESS 25:3897, Eqs 2 to 14).

    Parameters
    ----------
    frame : path or Frame
        A file, or particles in memory: ``Frame(Particles(position, velocity, mass, volume), dimension=3, crs=...)``.
    dem : path, Terrain or DataArray, optional
        Default: the DTM named in the frame.
    **options
        As of `open_results`.

    Returns
    -------
    xarray.Dataset
        h, t [m], Un, Ut [m s-1], elevation [m] and the `products`, in memory.

    Examples
    --------
    >>> mpmgis.depth_average("results/frame_000010.h5", cell_size=2.0).h.plot()  # doctest: +SKIP
    """
    from ..maps.export.averaged_datasets import depth_average as averaged

    with python_words(_EXPORT):
        asked = _averaging("the frame" if isinstance(frame, Frame) else frame, options, "depth_average")
        found: xarray.Dataset = averaged(frame, asked, dem)
    return found


def _averaging(frames: str | Path, options: FrameAveragingOptions, where: str) -> "Export":
    """The options for averaging in memory; by default cells cover the DTM and are aligned with north."""
    if not isinstance(frames, (str, Path)):
        raise InputError(f"{where} got {frames!r}, expected one path: a file, or the folder that holds the frames")
    given: dict[str, Any] = {**options}
    known = options_of(FrameAveragingOptions)
    for name in given:
        if name not in known:
            raise InputError(f"{where}: there is no option {name!r}; it takes {', '.join(sorted(known))}")
    if "maxima" in given.get("products", ()):
        raise InputError(f"{where}: products='maxima' requires an exported folder; use .max('time') for frames")
    return complete(_EXPORT, {"extent": "dtm", "north_up": True, **given, "frames": (frames,)})


def plot(
    band: "xarray.DataArray",
    terrain: "str | Path | Terrain | xarray.DataArray | None" = None,
    *,
    title: str = "",
    release: str | Path | None = None,
    min_depth: float = USUAL_DEPTH,
    like: "xarray.DataArray | None" = None,
    axes: "Axes | None" = None,
    legend: bool = True,
) -> "Axes":
    """Draw a variable of results as a map, with the colours, classes and hillshade of reports and QGIS.

    Parameters
    ----------
    band : xarray.DataArray
        A variable of one time: ``results.h_max``, ``results.h.sel(time=10)``.
    terrain : path, Terrain or DataArray, optional
        For hillshade and contours: the DTM, or ``results.elevation``.
    title : str
    release : path, optional
        Polygons of the release, drawn as outlines.
    min_depth : float [m]
        Depths up to this are not drawn.
    like : xarray.DataArray, optional
        Variable whose values choose the view and the classes of the colours, for maps that are compared; default: the
        band itself.
    axes : matplotlib.axes.Axes, optional
        To draw in; default: a new figure.
    legend : bool
        With legend, right of the map; a new figure also has scale bar and north arrow there.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> mpmgis.plot(results.h_max, terrain="dtm.tif")  # doctest: +SKIP
    """
    from ..maps.export.band_plot import plot_band

    return plot_band(band, terrain, title, release, min_depth, like, axes, legend)


def read_frame(path: str | Path) -> Frame:
    """Read the frame, with its particles, in a file of mpmgis.

    Examples
    --------
    >>> mpmgis.read_frame("results/frame_000010.h5").particles.velocity  # doctest: +SKIP

    Parameters
    ----------
    path : path

    Returns
    -------
    Frame
    """
    from ..frames.frame_files import read_frame as read

    frame: Frame = read(path, with_state=False)
    return frame


def to_geodataframe(what: "Frame | xarray.Dataset", wet: str = "h") -> "geopandas.GeoDataFrame":
    """Return particles of a Frame as points, or cells of a Dataset of one time as squares.

    Examples
    --------
    >>> mpmgis.to_geodataframe(results.isel(time=-1)).to_file("deposit.gpkg")  # doctest: +SKIP

    Parameters
    ----------
    what : Frame or xarray.Dataset
    wet : str
        Variable of the Dataset; only cells with a value above 0 are returned.

    Returns
    -------
    GeoDataFrame

    Raises
    ------
    InputError
        Neither a Frame nor a Dataset.
    """
    from ..maps.export.xarray_datasets import cell_table, particle_table

    if isinstance(what, Frame):
        table: geopandas.GeoDataFrame = particle_table(what)
        return table
    if not hasattr(what, "data_vars"):
        raise InputError(f"got {type(what).__name__}, expected a Frame or an xarray.Dataset")
    cells: geopandas.GeoDataFrame = cell_table(what, wet)
    return cells
