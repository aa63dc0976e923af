"""Time of an export against cs_e and dt_e, and the loss of maxima by coarser frames.

The job is that of `avalanche_frames`: 900 000 points, 150 s. Times are those of the whole command with the QGIS folder,
measured on some frames of the event and extrapolated to all frames that dt_e requires. A dt_e larger than the frame
interval reduces the number of rasters, but not the maxima, which are taken over all frames. The loss here is that of a
run with a frame interval of dt_e against frames 0.1 s apart, weighted by volume.
"""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from avalanche_frames import DENSITY, END_TIME, Avalanche, terrain, write_frames
from bench_export import POINTS, command

from mpmgis.maps.averaging.export_resolution import export_grid
from mpmgis.maps.averaging.frame_values import Averaging, average_frame
from mpmgis.maps.averaging.maxima import Peak, RunningMaxima
from mpmgis.maps.averaging.placement import Bed

CELL_SIZES = (0.5, 1.0, 2.0, 4.0)  # [m]
TIME_STEPS = (0.2, 0.4, 0.8, 1.6)  # [s]
FRAMES = 25  # frames that are measured, distributed over the event
REFERENCE, BEGIN, END = 0.1, 30.0, 36.4  # [s]: interval of the reference frames for losses, and their time span
PEAKS = {"Ut_max": Peak("Ut", True), "h_max": Peak("h", True), "volume": Peak("t_vol", True)}


def costs():
    """cs_e -> (start-up time [s], time per frame [s], size per frame [MB]) of the command."""
    found = {}
    with tempfile.TemporaryDirectory() as place:
        frames = write_frames(Path(place) / "avalanche", np.linspace(0.0, END_TIME, FRAMES), POINTS)
        gis = Path(place) / "gis"
        command(frames[0], "-o", gis)  # compiles
        for cell in CELL_SIZES:
            options = ("--cs-e", cell, "--extent", "dtm", "-o", gis)
            first = min(command(frames[0], *options)[0] for _ in range(2))
            seconds = min(command(*frames, *options)[0] for _ in range(2))
            size = sum(path.stat().st_size for path in gis.rglob("*") if path.is_file()) / 1e6
            found[cell] = first, (seconds - first) / (FRAMES - 1), size / FRAMES
    return found


def losses():
    """(cs_e, dt_e) -> shares of Ut_max and h_max that are lost with frames dt_e apart."""
    ground, event, found = terrain(), Avalanche(POINTS), {}
    averagings = {
        cell: Averaging(Bed.of(ground), export_grid(ground.grid, cell), DENSITY, ("h", "Ut", "t_vol"))
        for cell in CELL_SIZES
    }
    steps = (REFERENCE, *TIME_STEPS)
    stores = {
        (cell, step): RunningMaxima(np.prod(averaging.grid.shape), averaging.min_depth, PEAKS)
        for cell, averaging in averagings.items()
        for step in steps
    }
    for k in range(round((END - BEGIN) / REFERENCE) + 1):
        frame = event.frame(BEGIN + k * REFERENCE)
        for cell, averaging in averagings.items():
            values = average_frame(frame, averaging)
            for step in steps:
                if k % round(step / REFERENCE) == 0:
                    stores[cell, step].absorb(values.index, values.values, values.time)
    for cell in CELL_SIZES:
        whole = stores[cell, REFERENCE]
        for step in TIME_STEPS:
            found[cell, step] = _loss(whole, stores[cell, step], "Ut_max"), _loss(whole, stores[cell, step], "h_max")
    return found


def _loss(whole, part, name):
    """Lost share of a peak; weight of a cell: its largest volume; cells that are wet in no frame lose all."""
    weight, wanted = (np.where(whole.seen[n], whole.values[n], 0.0).astype(float) for n in ("volume", name))
    seen = np.where(part.seen[name], part.values[name], 0.0)
    return float((weight * (wanted - seen)).sum() / (weight * wanted).sum())


@cache
def measured():
    """(costs, losses), computed once for rows and summary."""
    return costs(), losses()


def rows():
    """(case, value, unit, reference, ratio): time of the whole job for each cell and step."""
    cost, lost = measured()
    for cell, (first, each, size) in cost.items():
        yield f"export of {POINTS} points, cs_e {cell:g} m", each * 1e3, "ms/frame", f"{size:.2f} MB a frame", None
        for step in TIME_STEPS:
            speed, depth = lost[cell, step]
            what = f"  {END_TIME:g} s, dt_e {step:g} s: {round(END_TIME / step)} frames"
            note = f"{100 * speed:.2g} % of Ut_max lost, {100 * depth:.2g} % of h_max"
            yield what, first + each * (round(END_TIME / step) - 1), "s", note, None


def summary():
    """The table of performance.md: a row for each cs_e, a column for each dt_e."""
    cost, lost = measured()
    headings = ["cs_e", *(f"dt_e {step:g} s ({round(END_TIME / step)} frames)" for step in TIME_STEPS), "a frame"]
    lines = []
    for cell, (first, each, size) in cost.items():
        cells = []
        for step in TIME_STEPS:
            speed, depth = lost[cell, step]
            seconds = first + each * (round(END_TIME / step) - 1)
            cells.append(f"{seconds:.0f} s; {100 * speed:.2g} %, {100 * depth:.2g} %")
        lines.append([f"{cell:g} m", *cells, f"{1e3 * each:.0f} ms, {size:.1f} MB"])
    return headings, lines
