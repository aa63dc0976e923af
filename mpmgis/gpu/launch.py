"""Sizes of launches, entries of the run on the device, and loops that all kernels share."""

from typing import NamedTuple

# int64 entries of a run on the device: reason to stop (0: none); window of blocks; numbers of blocks with points, of
# points in them and of touched blocks of nodes; 1 if the rows are put in order in this step; then the room of arrays:
# places of the window, blocks with points, touched blocks, levels of a column
(
    STATUS, SIZE, WIDTH, HEIGHT, DEPTH, WEST_NOW, SOUTH_NOW, ACTIVE, SORTED, TOUCHED, REORDER,
    ROOM_PLACES, ROOM_ACTIVE, ROOM_TOUCHED, ROOM_DEPTH, RUN_ENTRIES,
) = range(16)  # fmt: skip
NEEDS_ROOM = 100  # status in addition to the kernel's reasons: the host enlarges arrays and repeats the step
# float64 entries: length of this step and time at its end [s]; time of the request and the one after it [s]. Kernels of
# nodes read the first two in the precision of the points, from an array `now` of NOW_ENTRIES
DT, END, UNTIL, AFTER, STAGE_ENTRIES = range(5)
NOW_ENTRIES = 2


class Launch(NamedTuple):
    """Sizes of launches, and their stream.

    Sums of reports depend on the sizes in the last bits, the motion of points does not.

    Parameters
    ----------
    workers : int
        Thread blocks of loops over points, nodes and blocks.
    width : int
        Threads of each of them, a power of two.
    shares : int
        Shares of the points of a block that are summed to its nodes at the same time; 36 threads each.
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
    shares: int = 7
    couplers: int = 4096
    batch: int = 20
    room: int = 64
    stream: object = 0


SMALL = Launch(2, 4, 1, 4, 4)  # for the simulator, where each thread of the device is one of the host
