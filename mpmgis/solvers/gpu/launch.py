"""Sizes of launches, and entries of the run on the device."""

from typing import NamedTuple

from numba import cuda

from .device_functions import SIMULATED

# int64 entries of a run on the device
(
    STATUS,  # reason to stop; 0: none
    SIZE,  # [blocks] places of the window
    WIDTH,  # [blocks] its columns
    HEIGHT,  # [blocks] its rows
    DEPTH,  # [blocks] its levels
    WEST_NOW,  # [blocks] its first column
    SOUTH_NOW,  # [blocks] its first row
    ACTIVE,  # number of blocks with points
    SORTED,  # number of points in them
    TOUCHED,  # number of touched blocks of nodes
    REORDER,  # 1 if the rows are put in order in this step
    ROOM_PLACES,  # largest number of places of the window that the arrays hold
    ROOM_ACTIVE,  # largest number of blocks with points that they hold
    ROOM_TOUCHED,  # largest number of touched blocks that they hold
    ROOM_DEPTH,  # largest number of levels of a column that they hold
    RUN_ENTRIES,  # number of entries
) = range(16)
NEEDS_ROOM = 100  # status in addition to the kernel's reasons: the host enlarges arrays and repeats the step
# float64 entries of a stage of the run; kernels of nodes read the first NOW_ENTRIES in the precision of the points
(
    DT,  # [s] length of this step
    END,  # [s] time at its end
    UNTIL,  # [s] time of the request
    AFTER,  # [s] time of the next request
    STAGE_ENTRIES,  # number of entries
) = range(5)
NOW_ENTRIES = 2  # DT and END
WIDEST = 128  # largest width, which the shared arrays of kernels have room for
MOST_GROUPS = 4  # largest number of groups, which they have room for
WORKERS_PER_MULTIPROCESSOR = 5  # thread blocks of 128 threads with 96 registers each


class Launch(NamedTuple):
    """Sizes of launches, and their stream.

    Sums of reports depend on the sizes in the last bits, the motion of points does not.

    Parameters
    ----------
    workers : int
        Thread blocks of loops over points, nodes and blocks.
    width : int
        Threads of each of them, a power of two from 8 to WIDEST.
    groups : int
        Groups of threads of `points_to_grid` that share the points of a block, at most MOST_GROUPS.
    scanners : int
        Thread blocks of loops over the places of the window, each thread of which has a piece of it.
    couplers : int
        Threads that solve for the layers of node columns; each has a work array.
    batch : int
        Steps between two looks at the reason to stop.
    room : int
        Blocks with points for which there is room at the start; arrays grow with the flow.
    stream : numba.cuda stream or 0
        0: the default stream.
    """

    workers: int = 512
    width: int = 128
    groups: int = 4
    scanners: int = 64
    couplers: int = 4096
    batch: int = 20
    room: int = 64
    stream: object = 0


SMALL = Launch(2, 8, 1, 2, 4, 4)  # for the simulator, where each thread of the device is one of the host


def default_launch() -> Launch:
    """Return the sizes for the device of this machine: the same for all devices of one type."""
    if SIMULATED:
        return SMALL
    return Launch(workers=WORKERS_PER_MULTIPROCESSOR * cuda.get_current_device().MULTIPROCESSOR_COUNT)


def checked(launch: Launch) -> Launch:
    """Return `launch` if kernels can be launched with it.

    Parameters
    ----------
    launch : Launch

    Raises
    ------
    ValueError
        Its width or number of groups is none that the kernels divide their work by.
    """
    if launch.width not in (8, 16, 32, 64, WIDEST):
        raise ValueError(f"Launch.width got {launch.width}; expected a power of two from 8 to {WIDEST}")
    if not 1 <= launch.groups <= MOST_GROUPS:
        raise ValueError(f"Launch.groups got {launch.groups}; expected 1 to {MOST_GROUPS}")
    return launch
