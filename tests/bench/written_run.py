"""A run that is integrated and written like `mpmgis run`, with only the solver, NumPy and h5py."""

import time
from pathlib import Path
from typing import NamedTuple

from mpmgis.frames.frame_digest import result_after
from mpmgis.frames.frame_files import FRAMES_WITH_STATE, drop_state, write_frame
from mpmgis.simulation.time_integration import TimeIntegration


class WrittenRun(NamedTuple):
    """Time and bytes of a run."""

    seconds: float  # wall time from the first frame to the last on the disk
    beside_steps: float  # [s] of it
    frames: int
    size: int  # [bytes] of all frames as they were written


def write_run(solver, end, interval, folder):
    """Advance `solver` to `end` [s] with a frame in `folder` every `interval` [s]; returns the WrittenRun."""
    began, paths, digest, size = time.perf_counter(), [], "", 0
    integration = TimeIntegration(solver, end, interval)
    for frame in integration:
        paths.append(Path(folder) / f"frame_{len(paths):04d}.h5")
        digest = result_after(digest, write_frame(paths[-1], frame, digest))
        size += paths[-1].stat().st_size
        if len(paths) > FRAMES_WITH_STATE:
            drop_state(paths[-1 - FRAMES_WITH_STATE])
    seconds = time.perf_counter() - began
    return WrittenRun(seconds, seconds - integration.step_seconds, len(paths), size)
