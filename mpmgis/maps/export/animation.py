"""Film of an export: its flow depth over a hillshade, one picture for each step, as .mp4 or .gif."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from ...system.errors import InputError
from ...system.optional_libraries import needed_for
from ...system.whole_files import whole_file
from ...terrain.elevation import Terrain
from ..averaging.exported_folder import ExportedRun
from ..qgis.colours import colour_classes, look_of
from ..qgis.map_clock import Clock
from .run_picture import (
    INK,
    OPACITY,
    RELEASE_COLOUR,
    draw_image,
    draw_north_arrow,
    draw_outline,
    draw_scale_bar,
    draw_terrain,
    map_axes,
    map_view,
)

FORMATS = (".mp4", ".gif")
PICTURES_PER_SECOND = 8  # [s-1] as the project's temporal controller
DOTS_PER_INCH = 110  # [inch-1] about 1200 pixels across
BAND = "h"  # that is shown


def require_animation(path: Path) -> None:
    """Raise an error unless the name of a film ends in a format and this machine has the encoder.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
    """
    if Path(path).suffix.lower() not in FORMATS:
        raise InputError(f"--animation {path}: expected a name that ends in {' or '.join(FORMATS)}")
    with needed_for(f"--animation {path}", "animation"):
        import imageio.v2  # noqa: F401
        import imageio_ffmpeg  # noqa: F401


def write_animation(path: Path, run: ExportedRun, terrain: Terrain, release: Sequence = ()) -> int:
    """Write the film of a run; it appears whole or not at all.

    Steps are shown as long as they last: a step twice as long as the shortest one is shown twice.

    Parameters
    ----------
    path : Path
        .mp4 (H.264) or .gif.
    run : ExportedRun
        Its rasters are written.
    terrain : Terrain
        In the run's CRS, sampled at the film's own resolution.
    release : sequence of shapely polygons

    Returns
    -------
    int
        Number of pictures.
    """
    clock = Clock.of(run.times)
    shown = [max(1, round((end - begin) / clock.step)) for begin, end in zip(clock.begins, clock.ends, strict=True)]
    pictures = Pictures(run, terrain, list(release or ()), clock.decimals)
    with whole_file(path) as part, closing(_encoder(part)) as film:
        for step, times in enumerate(shown):
            picture = pictures.of(step)
            for _ in range(times):
                film.append_data(picture)
    return sum(shown)


def _encoder(path):
    import imageio.v2

    if path.suffix.lower() == ".gif":
        return imageio.v2.get_writer(path, mode="I", duration=1000 / PICTURES_PER_SECOND, loop=0)
    quiet = {"ffmpeg_log_level": "error", "macro_block_size": 2}
    return imageio.v2.get_writer(path, format="FFMPEG", fps=PICTURES_PER_SECOND, codec="libx264", quality=8, **quiet)


class Pictures:
    """The map of a run, drawn once; `of` a step changes only the flow and the time in the title.

    Parameters
    ----------
    run : ExportedRun
    terrain : Terrain
    release : list of shapely polygons
    decimals : int
        Of the times in the title.
    """

    def __init__(self, run: ExportedRun, terrain: Terrain, release: list, decimals: int):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._run, self._decimals = run, decimals
        look = look_of(next(quantity for quantity in run.step_bands if quantity.name == BAND), run.classes)
        self._classes = colour_classes(look, run.typical.get(BAND, 0.0), run.min_depth)
        (peak,) = run.read(run.maxima_file, ("h_max",))
        view = map_view(terrain, run.flow_grid, peak >= run.min_depth, release)
        self._figure = Figure(figsize=(1, 1), dpi=DOTS_PER_INCH, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._axes = map_axes(self._figure, view)
        draw_terrain(self._axes, terrain, view)
        draw_image(self._axes, run.flow_grid, self._colours(0))
        self._flow = self._axes.images[-1]
        draw_outline(self._axes, release, RELEASE_COLOUR)
        draw_scale_bar(self._axes, view)
        draw_north_arrow(self._axes)
        self._draw_legend(look, bool(release))

    def of(self, step: int) -> np.ndarray:
        """Draw the picture of a step.

        Parameters
        ----------
        step : int

        Returns
        -------
        uint8[rows, columns, 3]
            Rows and columns are even, as H.264 requires.
        """
        self._flow.set_data(self._colours(step))
        time = f"{self._run.times[step]:.{self._decimals}f}"
        self._axes.set_title(f"{self._run.name}   t = {time} s", loc="left", fontsize=12, fontweight="bold", pad=10)
        self._canvas.draw()
        picture = np.asarray(self._canvas.buffer_rgba())[..., :3]
        rows, columns = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
        return np.ascontiguousarray(picture[:rows, :columns])

    def _colours(self, step):
        """float[rows, columns, 4]: colours of the depth at a step, transparent where it is not drawn."""
        from matplotlib.colors import to_rgba

        (depth,) = self._run.read(self._run.step_files[step], (BAND,))
        number = np.searchsorted([entry.upper for entry in self._classes], np.nan_to_num(depth))
        colours = [to_rgba(entry.colour, OPACITY) if entry.colour else (0.0, 0.0, 0.0, 0.0) for entry in self._classes]
        return np.array(colours)[number]

    def _draw_legend(self, look, has_release):
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        entries = [
            Patch(facecolor=e.colour, edgecolor=INK, linewidth=0.4, label=e.label) for e in self._classes if e.colour
        ]
        if has_release:
            entries.append(Line2D([], [], color=RELEASE_COLOUR, linewidth=1.6, label="release area"))
        place = {"loc": "upper left", "borderaxespad": 0.0, "frameon": False, "alignment": "left", "fontsize": 8.5}
        legend = self._axes.legend(handles=entries, title="Flow depth", bbox_to_anchor=(1.03, 1.0), **place)
        legend.get_title().set(fontsize=9.5, fontweight="bold")
