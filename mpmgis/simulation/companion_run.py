"""State the numerical error of a run: the same run on cells twice as large, and how far its numbers are away.

Over terrain the error is about proportional to the cell size, so that the difference between the two is about the error
of the finer one (Roache 1994, J. Fluids Eng. 116:405). `tests/bench/companion.py` compares the stated errors with those
against runs on cells four times smaller.
"""

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ..frames.headline_numbers import error_lines
from ..system.errors import one_line
from ..system.messages import muted
from .cost_prediction import duration_words
from .numerical_parameters import cost_power
from .preparation import on_larger_cells
from .run_summary import stood_still
from .stage import WET_SHARE
from .stage_sequence import StageSequence

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..scene import Scene

LARGER = 2.0  # [1] size of the cells over that of the run
SAFETY = 1.25  # [1] stated error over the difference to the run on larger cells; 1 is exact for errors of first order
LEAST_CELLS = 0.5  # [cells] least error of a length: it ends at nodes
LEAST_SHARE = 0.01  # [1] least error of other numbers that are no sums
LEAST_OF_SUM = 0.001  # [1] least error of a volume
WANTED = 0.1  # [1] share of a number that its error must not exceed; beyond, smaller cells are named


def has_companion(scene: "Scene") -> bool:
    """Return whether a run is followed by its companion.

    Parameters
    ----------
    scene : Scene
    """
    given = scene.numerics.companion
    return scene.solvers == {"columns"} and not scene.stage if given is None else given


def centre_of(frame: "Frame") -> tuple[float, float]:
    """Return the centre of mass of a frame on the map.

    Parameters
    ----------
    frame : Frame

    Returns
    -------
    (float, float) [m]
        E and N.
    """
    x, y = frame.map_xy()
    mass = frame.particles.mass
    return float(np.average(x, weights=mass)), float(np.average(y, weights=mass))


def farthest(start: tuple[float, float], x: np.ndarray, y: np.ndarray) -> tuple[float, int]:
    """Return the distance on the map from a place to the farthest of several, and the index of that one.

    Parameters
    ----------
    start : (float, float) [m]
        E and N.
    x, y : float64[n] [m]

    Returns
    -------
    (float [m], int)
    """
    away = np.hypot(x - start[0], y - start[1])
    index = int(np.argmax(away))
    return float(away[index]), index


def headline_numbers(sequence: StageSequence) -> dict[str, float]:
    """Return the headline numbers of a run of one stage that has ended.

    Nodes count as reached where the flow was thicker than WET_SHARE of the mean thickness of the release.

    Parameters
    ----------
    sequence : StageSequence

    Returns
    -------
    dict of str to float
        `runout` [m]: straight on the map, from the centre of mass of the release to the farthest node that was
        reached; `footprint_area` [m2] reached; `thickness_p99` [m]: 99th percentile over the reached nodes of the
        largest thickness, vertical; `speed_max` [m s-1]; `volume_at_end` [m3] on the terrain and stopped in forest.
        Empty if the solver keeps no largest thickness, or nothing was reached.
    """
    prepared, solver = sequence.prepared, sequence.solver
    lattice = solver.thickest()
    if not lattice:
        return {}
    thickness, (size, _, west, _, _, south) = lattice["thickness"], lattice["transform"]
    row, column = np.nonzero(thickness > WET_SHARE * prepared.facts.release_thickness)
    if not len(row):
        return {}
    runout, _ = farthest(centre_of(prepared.seen), west + (column + 0.5) * size, south + (row + 0.5) * size)
    balances = solver.balances()
    mass = balances["mass_now"] + balances.get("mass_detrained", 0.0)
    return {
        "runout": runout,
        "footprint_area": float(balances.get("footprint_area", len(row) * size**2)),
        "thickness_p99": float(np.percentile(thickness[row, column], 99.0)),
        "speed_max": float(balances["speed_max"]),
        "volume_at_end": float(mass / prepared.numerics.density),
    }


def companion_run(
    sequence: StageSequence,
    numbers: dict[str, float],
    observe: Callable = lambda solver, end_time: None,
    clock: Callable[[], float] = perf_counter,
) -> dict:
    """Run a scene again on cells LARGER times as large; state the numerical error of its headline numbers.

    Nothing is written. Whatever fails is returned in words: the run itself is complete.

    Parameters
    ----------
    sequence : StageSequence
        The run, of one stage, at its end.
    numbers : dict of str to float
        Its `headline_numbers`.
    observe : callable
        Called with (solver, end time [s]) a few times a second.
    clock : callable
        Returns the wall time [s].

    Returns
    -------
    dict
        Entry `companion` of run.json: `cell_size` [m], `wall_seconds` [s]; `numbers`: for each `value`, `larger_cells`
        (the value there) and `error`; `largest_share` [1], the largest error over its value; `smaller`: the
        `cell_size` [m] for which that is WANTED, and the `seconds` of its steps, or None where it is. Or `failed`: the
        reason.
    """
    began, size = clock(), sequence.prepared.numerics.cell_size
    if stood_still(sequence.balances()):
        return {"cell_size": LARGER * size, "failed": "there was no flow"}
    try:
        other, seconds = _on_larger_cells(sequence.prepared, observe)
    except Exception as error:  # of any kind: a finished run never fails for its companion
        return {"cell_size": LARGER * size, "failed": one_line(error) or type(error).__name__}
    if not (numbers and other):
        return {"cell_size": LARGER * size, "failed": "the flow reached no node"}
    found = {
        name: {"value": value, "larger_cells": other[name], "error": stated_error(name, value, other[name], size)}
        for name, value in numbers.items()
    }
    share = max(one["error"] / abs(one["value"]) if one["value"] else 0.0 for one in found.values())
    if sequence.stepped[2] >= sequence.steps:  # all steps of the run were taken now
        seconds = sequence.stepped[0]
    return {
        "cell_size": LARGER * size,
        "wall_seconds": clock() - began,
        "numbers": found,
        "largest_share": share,
        "smaller": None if share <= WANTED else _smaller_cells(sequence.prepared, share, seconds),
    }


@muted()
def _on_larger_cells(prepared, observe):
    """Return (the headline numbers of a run on larger cells, wall time [s] of the steps of the run, estimated)."""
    larger = on_larger_cells(prepared, LARGER)
    if larger.scene.solver == "columns":  # which look for rest in every step: frames are of no use
        output = replace(larger.scene.output, frame_interval=larger.scene.output.end_time)
        larger = replace(larger, scene=replace(larger.scene, output=output))
    run = StageSequence(larger, observe)
    for _ in run:
        pass
    return headline_numbers(run), run.stepped[0] * LARGER ** cost_power(prepared.scene)


def stated_error(name: str, value: float, larger: float, cell_size: float) -> float:
    """Return the stated numerical error of a headline number.

    Parameters
    ----------
    name : str
        Of the number.
    value : float
        On the cells of the run.
    larger : float
        On cells LARGER times as large.
    cell_size : float [m]
        Of the run.

    Returns
    -------
    float
        In the unit of the number.
    """
    least = {"runout": LEAST_CELLS * cell_size, "volume_at_end": LEAST_OF_SUM * abs(value)}
    return max(SAFETY * abs(larger - value), least.get(name, LEAST_SHARE * abs(value)))


def _smaller_cells(prepared, share, seconds):
    """Return the cell size [m] with errors of WANTED, and the wall time [s] of its steps; `seconds` are the run's."""
    size = float(f"{prepared.numerics.cell_size * WANTED / share:.2g}")
    more = (prepared.numerics.cell_size / size) ** cost_power(prepared.scene)
    return {"cell_size": size, "seconds": seconds * more}


def companion_lines(companion: dict | None) -> list[str]:
    """Return lines of text about the numerical errors of a run, and the cells that it needs for smaller ones.

    Parameters
    ----------
    companion : dict or None
        Of `companion_run`.
    """
    lines = error_lines(companion)
    smaller = (companion or {}).get("smaller")
    if smaller and "numbers" in companion:
        lines.append(
            f"numerical errors of up to {100 * companion['largest_share']:.0f} %: for {100 * WANTED:.0f} % cells of "
            f"about {smaller['cell_size']:g} m are needed, {duration_words(smaller['seconds'])} of steps; `mpmgis "
            "study` measures it"
        )
    return lines
