"""What the time loops of both solvers on a device have in common: launches of kernels, and batches of steps."""

from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
from numba import cuda

from . import device_point_sort
from .launch import NEEDS_ROOM, STATUS, Launch, checked, default_launch
from .launch_graph import Repeated

GROUP = 16  # reports of which a thread, or a thread block, makes one sum


class Launches:
    """Launches of kernels on one stream, for particles of one precision.

    Parameters
    ----------
    sizes : Launch
    real : NumPy type
        Precision of the particles.
    """

    def __init__(self, sizes: Launch, real: type) -> None:
        self.sizes, self.real = sizes, real
        self._pieces = cuda.to_device(np.zeros((sizes.scanners * sizes.width, 2), np.int64))

    def all(self, kernel: Any, *arguments: Any) -> None:
        """Launch a kernel whose threads share the work.

        Parameters
        ----------
        kernel : Kernel
        *arguments
        """
        self.blocks(kernel, self.sizes.workers, self.sizes.width, *arguments)

    def pieces(self, kernel: Any, run: Any, values: Any, *arguments: Any) -> None:
        """Launch a kernel each of whose threads has a piece of the window.

        Parameters
        ----------
        kernel : Kernel
        run : int64[RUN_ENTRIES]
        values : int32[places]
        *arguments
            After the array of the pieces.
        """
        self.blocks(kernel, self.sizes.scanners, self.sizes.width, run, values, self._pieces, *arguments)

    def scan(self, run: Any, values: Any, particles: bool) -> None:
        """Sum values at the places of the window before each piece of it.

        Parameters
        ----------
        run : int64[RUN_ENTRIES]
        values : int32[places]
        particles : bool
            They are numbers of particles.
        """
        self.pieces(device_point_sort.sum_pieces, run, values)
        scanners = min(device_point_sort.SCANNERS, len(self._pieces))
        self.blocks(device_point_sort.scan_pieces, 1, scanners, run, self._pieces, particles)

    def reorder(
        self, run: Any, counts: Any, rows: Any, ids: Any, keys: Any, order: Any, strip: Any, names: Any
    ) -> None:
        """Put the rows of particles in the order of blocks, in some of the steps.

        Parameters
        ----------
        run : int64[RUN_ENTRIES]
        counts : int64[COUNTS]
        rows : real[n, numbers]
        ids : uint64[n]
        keys : int32[n] or int64[n]
        order : int32[n]
            Particles in the order of blocks.
        strip : real[n, STRIP]
        names : int64[n, 2]
        """
        self.one(device_point_sort.decide_order, run, counts)
        for first in range(0, rows.shape[1], device_point_sort.STRIP):
            self.all(device_point_sort.take_strip, run, rows, ids, keys, order, strip, names, first)
            self.all(device_point_sort.give_strip, run, rows, ids, keys, strip, names, first)
        self.all(device_point_sort.note_order, run, counts, order)

    def one(self, kernel: Any, *arguments: Any) -> None:
        """Launch a kernel of one thread.

        Parameters
        ----------
        kernel : Kernel
        *arguments
        """
        self.blocks(kernel, 1, 1, *arguments)

    def add_up(self, kernel: Any, run: Any, sums: list) -> None:
        """Sum the reports of all threads, from one array to the next.

        Parameters
        ----------
        kernel : Kernel
        run : int64[RUN_ENTRIES]
        sums : list of float64[reports, entries]
        """
        for many, few in pairwise(sums):
            self.blocks(kernel, few.shape[0], few.shape[1], run, many, few)

    def blocks(self, kernel: Any, count: int, width: int, *arguments: Any) -> None:
        """Launch a kernel of some thread blocks.

        Parameters
        ----------
        kernel : Kernel
        count, width : int
            Number of thread blocks, and of the threads of each.
        *arguments
        """
        kernel.of(self.real)[count, width, self.sizes.stream](*arguments)

    def report_counts(self) -> list[int]:
        """Return the numbers of reports, from those of all threads down to one."""
        counts = [self.sizes.workers * self.sizes.width]
        while counts[-1] > 1:
            counts.append(-(-counts[-1] // GROUP))
        return counts


class DeviceRun:
    """A run on the device, in batches of steps.

    Its classes have `_step`, which launches the kernels of one step, `_grow`, which makes arrays in which a step fits,
    and on the device `_clock`, `_counts` and `_d_stage`.

    Parameters
    ----------
    state : ColumnArrays or PointArrays
        Of the host.
    entry : module
        Of the entries of clock and counts.
    real : NumPy type
        Precision of the particles.
    launch : Launch, optional
        Sizes of launches; by default those for a GPU, in the simulator small ones.
    stage : int
        Number of entries of the stage.
    """

    def __init__(self, state: Any, entry: ModuleType, real: type, launch: Launch | None, stage: int) -> None:
        self.state, self._entry = state, entry
        self._steps = Repeated(self._step)
        self._launches = Launches(checked(launch or default_launch())._replace(stream=self._steps.stream), real)
        self._stage = np.zeros(stage)
        self._d_stage = cuda.to_device(self._stage)

    def _take_batches(self, until, max_steps, host, run):
        """Take steps up to the time `until` [s] and return the reason to stop; `run` is on the device, `host` here."""
        state, entry = self.state, self._entry
        first = int(state.counts[entry.STEP])
        self._clock.copy_to_device(state.clock)
        self._counts.copy_to_device(state.counts)
        self._d_stage.copy_to_device(self._stage)
        host[STATUS] = 0
        run.copy_to_device(host)
        while state.counts[entry.STEP] - first < max_steps:
            self._before_batch()
            self._steps(min(self._launches.sizes.batch, int(max_steps - (state.counts[entry.STEP] - first))))
            run.copy_to_host(host)
            self._after_batch()
            self._counts.copy_to_host(state.counts)
            if host[STATUS] == NEEDS_ROOM:
                self._grow()
                self._steps.forget()
            elif host[STATUS] != 0:
                break
        self._clock.copy_to_host(state.clock)
        if host[STATUS] != 0:
            return int(host[STATUS])
        return entry.REACHED_TIME if state.clock[entry.TIME] >= until else entry.RUNNING

    def _before_batch(self):
        """Check that the steps of a batch can be taken."""

    def _after_batch(self):
        """Finish a step that needed more room after particles had moved."""
