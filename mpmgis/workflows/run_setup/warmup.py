"""A few particles taken through all stages of a run before it begins: what has to be compiled is compiled then."""

import threading
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ...errors import MpmgisError

FEW = 16  # particles that go through the stages
TELL_SECONDS = 3.0  # of getting a stage ready, above which it is said why: loading takes less


def rehearse(prepared, first=0):
    """Compile, or load from the disk cache, the kernels of the stages from number `first` on, by a step in each.

    Nothing of the run is touched. A flow that cannot be handed on ends the rehearsal: what that means the run says
    when it comes to it.

    Returns
    -------
    list of Frame
        What each stage came to.
    """
    frames, stages = [], prepared.stages
    frame, vertical_stress, gradient = some_of(prepared, FEW)
    for number, stage in enumerate(stages):
        with _telling(_words(stage, number, len(stages)) if number >= first else ""):
            if number:
                try:
                    switched = handed_on(stage, stages[number - 1], frame, prepared.terrain)
                except MpmgisError:
                    break
                frame, vertical_stress, gradient = switched.frame, switched.vertical_stress, switched.gradient
            solver = stage.solver(prepared.terrain, frame, vertical_stress, gradient)
            if number >= first:
                solver.advance(np.inf, max_steps=1)  # a frame after a step calls more than one before
            frame = replace(solver.frame(), maxima={})
            following = stages[number + 1] if number + 1 < len(stages) else None
            end = stage.end(prepared.terrain, following)
            if number >= first and end.unsettled is not None:
                end.unsettled(frame)
        frames.append(frame)
    return frames


def handed_on(stage, before, frame, terrain):
    """Some of a flow, the `frame` of stage `before`, as `stage` goes on with it wherever its window is: a Switched."""
    return replace(stage, window=None).switched_from(before, frame, terrain)


def some_of(prepared, most):
    """(Frame, vertical stress, velocity gradient) of what the first stage starts with, or else of what is to come.

    Of that as many particles as `most`, those in the middle.
    """
    frame = prepared.frame if len(prepared.frame.particles) else prepared.seen
    middle = np.abs(np.subtract(frame.map_xy(), np.median(frame.map_xy(), axis=1)[:, None])).max(axis=0)
    few = np.sort(np.argsort(middle, kind="stable")[:most])
    stress, affine = ((None if of is None else of[few]) for of in (prepared.vertical_stress, prepared.affine))
    return replace(frame, particles=frame.particles.take(few), state={}, maxima={}), stress, affine


def _words(stage, number, stages):
    which = f"stage {number + 1} of {stages}, of {stage.scene.solver}," if stages > 1 else stage.scene.solver
    return f"getting {which} ready: a first run of its kind is compiled, half a minute or more, once"


@contextmanager
def _telling(words):
    """Within this block `words` are said, if there are any, once it has taken TELL_SECONDS."""
    waiting = threading.Timer(TELL_SECONDS, (words,))
    waiting.daemon = True
    if words:
        waiting.start()
    try:
        yield
    finally:
        waiting.cancel()
