"""Plot the loads on a barrier over time, and a section through it with the flow."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .barrier_loads import FORCE, OVERTOPPED, BarrierHistory
from .plot_style import COLOURS, GROUND_LINE, draw_ground, legend, plot_file, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def write_history_plot(path: Path, history: BarrierHistory) -> None:
    """Plot mean force, mean moment (3D only) and overtopped mass of a barrier over time.

    Parameters
    ----------
    path : Path
    history : BarrierHistory
    """
    moment, times = history.moment, history.times
    rows = 2 if moment is None else 3
    with plot_file(path, (9.0, 2.4 * rows), rows=rows) as axes:
        panels = list(axes[:, 0])
        _means(panels[0], times, history.columns[FORCE] / 1e3, "force [kN]", COLOURS[0])
        style_axes(panels[0], "force [kN]", title=f"{history.name}: means between frames")
        if moment is not None:
            _means(panels[1], times, moment / 1e3, "moment [kN m]", COLOURS[2])
        panels[-1].plot(times, history.columns[OVERTOPPED] / 1e3, color=COLOURS[3], linewidth=1.5)
        panels[-1].set_ylim(bottom=0)
        style_axes(panels[-1], "overtopped mass [t]", "time [s]")


def _means(axes: "Axes", times: np.ndarray, values: np.ndarray, label: str, colour: str) -> None:
    if len(times) > 1:
        axes.stairs(values[1:], times, color=colour, linewidth=1.5, fill=True, alpha=0.25)
        axes.stairs(values[1:], times, color=colour, linewidth=1.5)
    axes.set_ylim(bottom=0)
    style_axes(axes, label)


def write_section_plot(
    path: Path, name: str, along: np.ndarray, terrain: np.ndarray, surfaces: dict, wall: np.ndarray, crest: float
) -> None:
    """Plot a section through a barrier.

    Parameters
    ----------
    path : Path
    name : str
        Of the barrier.
    along, terrain : float64[n] [m]
        Distance along the section, in the direction of the force, 0 at the barrier; elevation.
    surfaces : dict of str to float64[n] [m]
        Words -> elevation of a free surface; NaN without flow.
    wall : bool[n]
        Where the barrier stands.
    crest : float [m]
        Elevation.
    """
    with plot_file(path, (9.0, 4.2)) as axes:
        (panel,) = axes[0]
        draw_ground(panel, along, terrain)
        for k, (words, surface) in enumerate(surfaces.items()):
            panel.plot(along, surface, color=COLOURS[(0, 4)[k % 2]], linewidth=1.6, label=words, zorder=4)
            panel.fill_between(along, terrain, surface, color=COLOURS[(0, 4)[k % 2]], alpha=0.18, linewidth=0, zorder=2)
        top = np.maximum(terrain, crest)
        panel.fill_between(along, terrain, top, where=wall, color="#444444", linewidth=0.5, zorder=5, label="barrier")
        panel.axhline(crest, color=GROUND_LINE, linewidth=0.8, linestyle=":", zorder=3, label="crest")
        shown = np.concatenate([terrain, [crest], *surfaces.values()])
        low, high = np.nanmin(shown), np.nanmax(shown)
        panel.set_ylim(low - 0.05 * (high - low), high + 0.12 * (high - low))
        panel.set_xlim(along[0], along[-1])
        title = f"{name}: section in the direction of the force (heights not to scale)"
        style_axes(panel, "elevation [m]", "distance from the barrier [m]", title)
        legend(panel, loc="upper right")
