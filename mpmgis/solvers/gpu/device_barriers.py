"""Rigid barriers on the device: smooth faces, what stands on node columns, openings, and the loads on all of them.

What happens at a face or a node column is the code of the CPU's kernels. A face is the work of one thread, and so is a
node column that a barrier stands on, with all its blocks. Each of them books what it takes up in a row of its own, so
that the loads, sums of these rows, always have one order.
"""

import numpy as np
from numba import cuda, float64, int32

from ...compiled.block_order import CHUNKS
from ..points import point_barriers as entry
from ..points.point_barriers import (
    COLUMN_FLOW,
    FLOW_MASS,
    FLOW_X,
    FLOW_Y,
    POINT_BARRIER_ENTRIES,
    POINT_BARRIER_SUMS,
    SHARE,
    collect_point_barrier,
    column_flow,
)
from ..points.point_crests import press_at_crest
from ..points.point_faces import (
    COLUMNS,
    FACE_BARRIER,
    FACE_FIRST,
    FACE_LOWEST,
    LINE_ENTRIES,
    book_face,
    keep_before_face,
    settle_face,
    share_row,
    top_of,
    weigh_column,
    weigh_rows,
)
from ..points.point_nodes import hold_column
from ..points.point_records import ColumnSums, ContactLaws, FaceArrays, Site
from ..points.point_rows import BLOCK, Settings
from ..points.point_time_step import ROWS, STEP
from .device_functions import Kernel, capped, in_double
from .device_point_nodes import nodes_now, window_now
from .device_records import TouchedBlocks
from .launch import DEPTH, DT, HEIGHT, SOUTH_NOW, STATUS, TOUCHED, WEST_NOW, WIDTH


@Kernel
def weigh_flow(run: np.ndarray, nodes: np.ndarray, flows: np.ndarray) -> None:
    """Compute mass and momentum in each block's node columns.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    nodes : real[touched, BLOCK_SIZE]
    flows : real[touched, BLOCK_FLOW]
        Is set.
    """
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), BLOCK * BLOCK * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // (BLOCK * BLOCK), e % (BLOCK * BLOCK)
        mass, east, north = column_flow(nodes[t], column)
        n = column * COLUMN_FLOW
        flows[t, n + FLOW_MASS], flows[t, n + FLOW_X], flows[t, n + FLOW_Y] = mass, east, north


@Kernel
def share_face_rows(run: np.ndarray, blocks: TouchedBlocks, faces: FaceArrays, settings: Settings) -> None:
    """Weigh and share the rows of smooth faces (see `point_faces`), a thread for each row.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    blocks : TouchedBlocks
    faces : FaceArrays
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    grid, window, values = nodes_now(run, blocks), window_now(run, blocks), faces.values
    levels = faces.lines.shape[1] - COLUMNS - 1
    for e in range(cuda.grid(1), levels * values.shape[0], cuda.gridsize(1)):
        f = e // levels
        k = e % levels + int(values[f, FACE_FIRST])
        if values[f, FACE_BARRIER] > 0.0 and k >= int(values[f, FACE_LOWEST]) and k <= top_of(values[f], settings.dx):
            share_row(f, k, grid, window, faces)


@Kernel
def weigh_face_rows(
    run: np.ndarray,
    now: np.ndarray,
    counts: np.ndarray,
    blocks: TouchedBlocks,
    site: Site,
    faces: FaceArrays,
    settings: Settings,
) -> None:
    """Find the rows in contact with smooth faces (see `point_faces`), a thread for each face.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    counts : int64[COUNTS]
    blocks : TouchedBlocks
    site : Site
    faces : FaceArrays
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    grid, window, values = nodes_now(run, blocks), window_now(run, blocks), faces.values
    for f in range(cuda.grid(1), values.shape[0], cuda.gridsize(1)):
        if values[f, FACE_BARRIER] > 0.0:
            weigh_rows(f, grid, window, site, faces, counts[STEP] + 1, now[DT], settings)


@Kernel
def weigh_face_columns(
    run: np.ndarray,
    now: np.ndarray,
    counts: np.ndarray,
    blocks: TouchedBlocks,
    site: Site,
    faces: FaceArrays,
    yields: np.ndarray,
    settings: Settings,
) -> None:
    """Weigh the node columns of smooth faces at the ground (see `point_faces`), a thread for each node column.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    counts : int64[COUNTS]
    blocks : TouchedBlocks
    site : Site
    faces : FaceArrays
    yields : real[2, rows, columns, YIELD_ENTRIES]
        Of the ground.
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    grid, window, values = nodes_now(run, blocks), window_now(run, blocks), faces.values
    for e in range(cuda.grid(1), COLUMNS * values.shape[0], cuda.gridsize(1)):
        f, n = e // COLUMNS, e % COLUMNS
        if values[f, FACE_BARRIER] > 0.0:
            weigh_column(f, n, grid, window, site, faces, yields, counts[STEP] + 1, now[DT], settings)


@Kernel
def settle_faces(
    run: np.ndarray,
    now: np.ndarray,
    blocks: TouchedBlocks,
    site: Site,
    faces: FaceArrays,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Apply the contact with smooth faces, and with the ground beside them (see `point_faces`), a thread for each face.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    blocks : TouchedBlocks
    site : Site
    faces : FaceArrays
    settings : Settings
    laws : ContactLaws
    """
    if run[STATUS] != 0:
        return
    grid, window, values = nodes_now(run, blocks), window_now(run, blocks), faces.values
    for f in range(cuda.grid(1), values.shape[0], cuda.gridsize(1)):
        if values[f, FACE_BARRIER] > 0.0:
            settle_face(f, grid, window, site, faces, now[DT], settings, laws)


@Kernel
def keep_before_faces(
    run: np.ndarray,
    counts: np.ndarray,
    rows: np.ndarray,
    keys: np.ndarray,
    lowest: np.ndarray,
    inside: np.ndarray,
    faces: np.ndarray,
    barriers: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
) -> None:
    """Move points back to smooth faces that they have passed (see `point_faces`), a thread for each point.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    rows : real[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
        Block of each point.
    lowest : int32[block rows, block columns, 2]
        See `point_blocks.lowest_blocks`.
    inside : uint8[cells_y, cells_x]
        1 where the terrain has an elevation.
    faces : real[faces, FACE_ENTRIES]
    barriers : real[rows, columns, POINT_BARRIER_ENTRIES]
    reports : float64[threads, POINT_REPORT]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        keep_before_face(p, rows, keys, lowest, inside, faces, barriers, settings.dx, reports[cuda.grid(1)])


@Kernel
def book_faces(
    run: np.ndarray,
    counts: np.ndarray,
    blocks: TouchedBlocks,
    site: Site,
    faces: FaceArrays,
    yields: np.ndarray,
    booked: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
) -> None:
    """Compute the loads on smooth faces, and store how far they yielded, a thread for each face.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    counts : int64[COUNTS]
    blocks : TouchedBlocks
    site : Site
    faces : FaceArrays
    yields : real[2, rows, columns, YIELD_ENTRIES]
        Of the ground.
    booked : real[rows of loads, POINT_BARRIER_SUMS]
        The row of each face is set.
    reports : real[threads, NODE_REPORT]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    grid, window, values = nodes_now(run, blocks), window_now(run, blocks), faces.values
    for f in range(cuda.grid(1), values.shape[0], cuda.gridsize(1)):
        if values[f, FACE_BARRIER] > 0.0:
            for k in range(POINT_BARRIER_SUMS):
                booked[int(values[f, FACE_BARRIER]) - 1, k] = 0.0
            mine = reports[cuda.grid(1)]
            book_face(f, grid, window, site, faces, yields, counts[STEP] + 1, mine, booked, settings)


@capped(double=112)
def press_on_crests(
    run: np.ndarray,
    columns: np.ndarray,
    blocks: TouchedBlocks,
    barriers: np.ndarray,
    booked: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
) -> None:
    """Apply the contact with crests in the node columns that barriers stand on (see `point_crests`).

    It sets the loads of these columns to zero and is the first to book them; a thread for each column.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    columns : int32[n, 2]
        Row and column of these node columns.
    blocks : TouchedBlocks
    barriers : real[rows, columns, POINT_BARRIER_ENTRIES]
    booked : real[rows of loads, POINT_BARRIER_SUMS]
    reports : real[threads, NODE_REPORT]
    settings : Settings
    """
    if run[STATUS] != 0:
        return
    grid, window, slots = nodes_now(run, blocks), window_now(run, blocks), blocks.slots
    for e in range(int32(cuda.grid(1)), int32(columns.shape[0]), int32(cuda.gridsize(1))):
        j, i = columns[e, 0], columns[e, 1]
        for k in range(POINT_BARRIER_SUMS):
            booked[int(barriers[j, i, entry.BARRIER]) - 1, k] = 0.0
        north, east = j // BLOCK - run[SOUTH_NOW], i // BLOCK - run[WEST_NOW]
        if north < 0 or east < 0 or north >= run[HEIGHT] or east >= run[WIDTH]:
            continue
        column = (j % BLOCK) * BLOCK + i % BLOCK
        first = int32((north * run[WIDTH] + east) * run[DEPTH])
        for place in range(first, first + int32(run[DEPTH])):
            if slots[place] >= 0:
                press_at_crest(slots[place], column, grid, window, barriers, reports[cuda.grid(1)], booked, settings)


@capped(double=104)
def hold_at_barriers(
    run: np.ndarray,
    now: np.ndarray,
    columns: np.ndarray,
    blocks: TouchedBlocks,
    site: Site,
    sums: ColumnSums,
    booked: np.ndarray,
    reports: np.ndarray,
    settings: Settings,
    laws: ContactLaws,
) -> None:
    """Apply the contact node by node in the node columns that barriers stand on, from the lowest block upwards.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    now : real[NOW_ENTRIES] [s]
    columns : int32[n, 2]
        Row and column of these node columns.
    blocks : TouchedBlocks
    site : Site
    sums : ColumnSums
    booked : real[rows of loads, POINT_BARRIER_SUMS]
    reports : real[threads, NODE_REPORT]
    settings : Settings
    laws : ContactLaws
    """
    if run[STATUS] != 0:
        return
    grid, slots = nodes_now(run, blocks), blocks.slots
    for e in range(int32(cuda.grid(1)), int32(columns.shape[0]), int32(cuda.gridsize(1))):
        north, east = columns[e, 0] // BLOCK - run[SOUTH_NOW], columns[e, 1] // BLOCK - run[WEST_NOW]
        if north < 0 or east < 0 or north >= run[HEIGHT] or east >= run[WIDTH]:
            continue
        first = int32((north * run[WIDTH] + east) * run[DEPTH])
        for place in range(first, first + int32(run[DEPTH])):
            t = slots[place]
            if t >= 0:
                hold_column(
                    t,
                    columns[e, 0] % BLOCK,
                    columns[e, 1] % BLOCK,
                    grid,
                    site,
                    sums,
                    reports[cuda.grid(1)],
                    booked,
                    now[DT],
                    settings,
                    laws,
                )


@in_double
def sum_booked(run: np.ndarray, booked: np.ndarray, start: np.ndarray, sums: np.ndarray) -> None:
    """Sum the rows of loads of each barrier, a thread for each number.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    booked : real[rows of loads, POINT_BARRIER_SUMS]
    start : int64[barriers + 1]
        First row of each barrier.
    sums : float64[CHUNKS, barriers, POINT_BARRIER_SUMS]
        Is set.
    """
    if run[STATUS] != 0:
        return
    barriers, entries = sums.shape[1], sums.shape[2]
    for e in range(cuda.grid(1), CHUNKS * barriers * entries, cuda.gridsize(1)):
        c, b, k = e // (barriers * entries), e // entries % barriers, e % entries
        first, count = start[b], start[b + 1] - start[b]
        total = float64(0.0)
        for r in range(first + c * count // CHUNKS, first + (c + 1) * count // CHUNKS):
            total += booked[r, k]
        sums[c, b, k] = total


@in_double
def collect_barriers(run: np.ndarray, stage: np.ndarray, report: np.ndarray, sums: np.ndarray) -> None:
    """Add the loads of a step to those of the run, a thread for each barrier.

    Parameters
    ----------
    run : int64[RUN_ENTRIES]
    stage : float64[STAGE_ENTRIES] [s]
    report : float64[CHUNKS, barriers, POINT_BARRIER_SUMS]
    sums : float64[barriers, POINT_BARRIER_SUMS + 1]
        Is added to.
    """
    if run[STATUS] != 0:
        return
    for b in range(cuda.grid(1), sums.shape[0], cuda.gridsize(1)):
        collect_point_barrier(b, report, sums, stage[DT])


class DeviceBarriers:
    """The barriers of a run on the device.

    Parameters
    ----------
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    faces : float64[faces, FACE_ENTRIES]
    sums : float64[barriers, POINT_BARRIER_SUMS + 1]
    face_yields : float64[2, faces + 2, levels + 2, YIELD_ENTRIES]
    real : type
        Precision of the points, in which all but sums are kept.
    """

    def __init__(
        self, barriers: np.ndarray, faces: np.ndarray, sums: np.ndarray, face_yields: np.ndarray, real: type
    ) -> None:
        if not len(sums):
            barriers = np.zeros((1, 1, POINT_BARRIER_ENTRIES))
        columns, barriers, faces, start = own_rows(barriers, faces, len(sums))
        self.opens = bool((barriers[..., SHARE] > 0.0).any())  # is any node column partly open?
        self.columns, self.start = cuda.to_device(columns), cuda.to_device(start)
        self.values = cuda.to_device(barriers.astype(real))
        lines = cuda.device_array((len(faces), COLUMNS + face_yields.shape[2] - 1, LINE_ENTRIES), real)
        yields = cuda.to_device(np.ascontiguousarray(face_yields, real))
        self.faces = FaceArrays(cuda.to_device(faces.astype(real)), lines, yields)
        self.booked = cuda.to_device(np.zeros((int(start[-1]), POINT_BARRIER_SUMS), real))
        self.report = cuda.device_array((CHUNKS, len(sums), POINT_BARRIER_SUMS), np.float64)
        self.sums = cuda.to_device(np.ascontiguousarray(sums))
        rows, width = barriers.shape[:2] if self.opens else (1, 1)
        self.flow = cuda.to_device(np.zeros((rows, width, COLUMN_FLOW), real))


def own_rows(
    barriers: np.ndarray, faces: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Give each node column and face of a barrier a row of its own for its loads.

    In copies of the arrays the number of the barrier becomes 1 + the row in which the node column or the face books
    what it takes up; the rows of a barrier follow each other.

    Parameters
    ----------
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    faces : float64[faces, FACE_ENTRIES]
    count : int
        Number of barriers.

    Returns
    -------
    columns : int32[n, 2]
        Row and column of the node columns with a barrier.
    barriers, faces : float64
        The copies.
    start : int64[count + 1]
        First row of each barrier.
    """
    columns, standing = np.argwhere(barriers[..., entry.BARRIER] > 0.0), faces[:, FACE_BARRIER] > 0.0
    barriers, faces = np.array(barriers, order="C"), np.array(faces, order="C")
    at = tuple(columns.T)
    number = np.concatenate([barriers[at][:, entry.BARRIER], faces[standing, FACE_BARRIER]]).astype(np.int64)
    row = np.empty(len(number), np.int64)
    row[np.argsort(number, kind="stable")] = np.arange(len(number))
    barriers[(*at, entry.BARRIER)] = 1 + row[: len(columns)]
    faces[standing, FACE_BARRIER] = 1 + row[len(columns) :]
    start = np.searchsorted(np.sort(number), np.arange(1, count + 2))
    return columns.astype(np.int32), barriers, faces, start.astype(np.int64)
