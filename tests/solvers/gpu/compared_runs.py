"""Runs of a solver on a device and on the processor, compared: their frames, and restarts of one by the other.

A runner has `make(kind)`, a solver of a kind, and `values(solver)`, arrays of its frame by name.
"""

import numpy as np

NEVER = 1e9


def after(solver, *times):
    """The solver, advanced through `times` of frames."""
    for until, following in zip(times, (*times[1:], NEVER), strict=True):
        solver.advance(until, following)
    return solver


def difference(one, other):
    """Largest difference of `values`, over the largest value of each."""
    return max(
        float(np.abs(np.asarray(a, float) - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), 1e-300))
        for a, b in ((one[name], other[name]) for name in one)
        if np.asarray(a).dtype.kind == "f" and np.isfinite(b).all()
    )


def same(one, other):
    """Whether two `values` have the same bits."""
    return all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


def continued(make, values, kinds, first, end):
    """(largest differences by name, same bits after resuming) of runs in one part, or from the frame at `first` [s].

    `kinds` are the solver of the processor and that of the device.
    """

    def frame_of(kind):
        solver = make(kind)
        solver.advance(first, end)
        return solver.frame()

    def resumed(kind, frame):
        solver = make(kind)
        solver.restore(frame)
        return values(after(solver, end))

    processor, device = kinds
    on_processor, on_device = (values(after(make(kind), first, end)) for kind in kinds)
    frames = {kind: frame_of(kind) for kind in kinds}
    found = {
        "as_on_the_processor": difference(on_device, on_processor),
        "from_processor_to_device": difference(resumed(device, frames[processor]), on_processor),
        "from_device_to_processor": difference(resumed(processor, frames[device]), on_processor),
    }
    return found, same(resumed(device, frames[device]), on_device)
