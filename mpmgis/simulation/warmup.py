"""Compile all kernels of a run before its start: a few particles pass all its stages."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..compiled.compilation import complete
from ..scene.tables import CPU
from ..system.errors import MpmgisError

if TYPE_CHECKING:
    from ..conversion.solver_switch import Switched
    from ..frames.particles import Frame
    from ..terrain.elevation import Terrain
    from .preparation import Prepared
    from .stage import Stage

FEW = 16  # particles that pass the stages


def warm_up(prepared: "Prepared", first: int = 0) -> "list[Frame]":
    """Compile the kernels of a run, or load them from the disk cache, by a step in each stage.

    The run is not changed. An error at a switch ends the warm-up; the run will raise it again.

    Parameters
    ----------
    prepared : Prepared
    first : int
        Number, from 0, of the first stage whose kernels are compiled.

    Returns
    -------
    list of Frame
        The last frame of each stage.
    """
    frames, stages = [], prepared.stages
    frame, vertical_stress, gradient = sample_of(prepared, FEW)
    for number, stage in enumerate(stages):
        if number:
            try:
                switched = switched_sample(stage, stages[number - 1], frame, prepared.terrain)
            except MpmgisError:
                break
            frame, vertical_stress, gradient = switched.frame, switched.vertical_stress, switched.gradient
        solver = stage.solver(prepared.terrain, frame, vertical_stress, gradient)
        if number >= first:
            if stage.device == CPU:
                complete(solver.kernel.advance, solver.step_arguments())
            solver.advance(np.inf, max_steps=1)  # a frame after a step needs more kernels than one before
            solver.balances()  # sums over the particles have kernels too
        frame = replace(solver.frame(), maxima={})
        following = stages[number + 1] if number + 1 < len(stages) else None
        end = stage.end(prepared.terrain, following)
        if number >= first and end.unsettled is not None:
            end.unsettled(frame)
        frames.append(frame)
    return frames


def switched_sample(stage: "Stage", before: "Stage", frame: "Frame", terrain: "Terrain") -> "Switched":
    """Convert a frame of stage `before` for `stage`, without its window.

    Parameters
    ----------
    stage, before : Stage
    frame : Frame
    terrain : Terrain
    """
    return replace(stage, window=None).switched_from(before, frame, terrain)


def sample_of(prepared: "Prepared", most: int) -> "tuple[Frame, np.ndarray | None, np.ndarray | None]":
    """Return a few particles in the middle of the start of a run.

    They are taken from the start of the first stage, or from later releases if it starts empty.

    Parameters
    ----------
    prepared : Prepared
    most : int
        Largest number of particles.

    Returns
    -------
    frame : Frame
    vertical_stress : float64[n] [Pa] or None
        Of points.
    gradient : float64[n, 3, 3] [s-1] or None
        Velocity gradient of points.
    """
    frame = prepared.frame if len(prepared.frame.particles) else prepared.seen
    few = _in_the_middle(frame, most)
    stress, affine = ((None if of is None else of[few]) for of in (prepared.vertical_stress, prepared.affine))
    return replace(frame, particles=frame.particles.take(few), state={}, maxima={}), stress, affine


def middle_of(frame: "Frame", most: int) -> "Frame":
    """Return a frame of the particles in its middle.

    Parameters
    ----------
    frame : Frame
    most : int
        Largest number of particles.
    """
    return replace(frame, particles=frame.particles.take(_in_the_middle(frame, most)), state={}, maxima={})


def _in_the_middle(frame, most):
    """Return int[k]: the particles nearest to the median position, in their order."""
    distance = np.abs(np.subtract(frame.map_xy(), np.median(frame.map_xy(), axis=1)[:, None])).max(axis=0)
    return np.sort(np.argsort(distance, kind="stable")[:most])
