"""A hydrograph through a section as table and plot."""

import numpy as np

from ..products.section_flux import COLUMNS
from .csv_table import column_name, write_records
from .plots import COLOURS, dress, legend, plot_file


def write_hydrograph_table(path, found):
    """The rows of a HydrographFound as CSV."""
    write_records(path, [column_name(*column) for column in COLUMNS], found.rows())


def write_hydrograph_plot(path, found):
    """Discharge as steps between the frames, with the cells' flux at them, above the volume so far."""
    with plot_file(path, (9.0, 6.0), rows=2, heights=(1.4, 1)) as axes:
        rate, total = axes[:, 0]
        steps = found.volume / np.diff(found.times)
        word = (
            "particles"
            if found.by_particles.all()
            else "particles, else cells"
            if found.by_particles.any()
            else "cells"
        )
        rate.stairs(
            steps, found.times, color=COLOURS[0], linewidth=1.5, fill=False, label=f"mean between frames, by {word}"
        )
        rate.plot(found.times, found.cells[:, 0], ".", color=COLOURS[1], markersize=4, label="flux of the cells")
        rate.axhline(0, color="#999999", linewidth=0.6)
        title = f"{found.name}: discharge towards {found.azimuth:.0f}° from north"
        dress(rate, "discharge [m³/s]", title=title)
        legend(rate, loc="best")
        total.plot(
            found.times, np.r_[0.0, np.cumsum(found.volume)], color=COLOURS[0], linewidth=1.5, label=f"by {word}"
        )
        total.plot(
            found.times, found.cells_totals()[:, 0], "--", color=COLOURS[1], linewidth=1.2, label="flux of the cells"
        )
        dress(total, "volume so far [m³]", "time [s]")
        legend(total, loc="best")
