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
from ..points.point_clock import ROWS, STEP
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
from ..points.point_ground import Ground
from ..points.point_nodes import hold_column
from ..points.point_rows import BLOCK, NodeBlocks
from .device_functions import Kernel, capped, in_double
from .device_point_nodes import window_now
from .launch import DEPTH, DT, HEIGHT, SOUTH_NOW, STATUS, TOUCHED, WEST_NOW, WIDTH


@Kernel
def weigh_flow(run, nodes, flows):
    """Mass and momentum in each block's node columns, into `flows` real[blocks, BLOCK_FLOW]."""
    if run[STATUS] != 0:
        return
    for e in range(cuda.grid(1), BLOCK * BLOCK * run[TOUCHED], cuda.gridsize(1)):
        t, column = e // (BLOCK * BLOCK), e % (BLOCK * BLOCK)
        mass, east, north = column_flow(nodes[t], column)
        n = column * COLUMN_FLOW
        flows[t, n + FLOW_MASS], flows[t, n + FLOW_X], flows[t, n + FLOW_Y] = mass, east, north


@Kernel
def share_face_rows(run, nodes, touched, slots, lowest, faces, lines, settings):
    """Weigh and share the rows of smooth faces (see `point_faces`); a thread per row."""
    if run[STATUS] != 0:
        return
    grid, window = NodeBlocks(nodes, touched, run[TOUCHED]), window_now(run, slots, lowest)
    levels = lines.shape[1] - COLUMNS - 1
    for e in range(cuda.grid(1), levels * faces.shape[0], cuda.gridsize(1)):
        f = e // levels
        k = e % levels + int(faces[f, FACE_FIRST])
        if faces[f, FACE_BARRIER] > 0.0 and k >= int(faces[f, FACE_LOWEST]) and k <= top_of(faces[f], settings.dx):
            share_row(f, k, grid, window, faces, lines)


@Kernel
def weigh_face_rows(
    run, now, counts, nodes, touched, slots, lowest, ground_nodes, folds, exact, faces, lines, face_yields, settings
):
    """Find the rows in contact with smooth faces (see `point_faces`); a thread per face."""
    if run[STATUS] != 0:
        return
    grid, ground = NodeBlocks(nodes, touched, run[TOUCHED]), Ground(ground_nodes, folds, exact)
    window = window_now(run, slots, lowest)
    for f in range(cuda.grid(1), faces.shape[0], cuda.gridsize(1)):
        if faces[f, FACE_BARRIER] > 0.0:
            weigh_rows(f, grid, window, ground, faces, lines, face_yields, counts[STEP] + 1, now[DT], settings)


@Kernel
def weigh_face_columns(
    run, now, counts, nodes, touched, slots, lowest, ground_nodes, folds, exact, faces, lines, yields, settings
):
    """Weigh the node columns of smooth faces at the ground (see `point_faces`); a thread per node column."""
    if run[STATUS] != 0:
        return
    grid, ground = NodeBlocks(nodes, touched, run[TOUCHED]), Ground(ground_nodes, folds, exact)
    window = window_now(run, slots, lowest)
    for e in range(cuda.grid(1), COLUMNS * faces.shape[0], cuda.gridsize(1)):
        f, n = e // COLUMNS, e % COLUMNS
        if faces[f, FACE_BARRIER] > 0.0:
            weigh_column(f, n, grid, window, ground, faces, lines, yields, counts[STEP] + 1, now[DT], settings)


@Kernel
def settle_faces(
    run,
    now,
    nodes,
    touched,
    slots,
    lowest,
    ground_nodes,
    folds,
    exact,
    zone_values,
    faces,
    lines,
    settings,
    contact,
    zones,
    barrier,
):
    """Contact with smooth faces, and with the ground beside them (see `point_faces`); a thread per face."""
    if run[STATUS] != 0:
        return
    grid, ground = NodeBlocks(nodes, touched, run[TOUCHED]), Ground(ground_nodes, folds, exact)
    window = window_now(run, slots, lowest)
    for f in range(cuda.grid(1), faces.shape[0], cuda.gridsize(1)):
        if faces[f, FACE_BARRIER] > 0.0:
            settle_face(f, grid, window, ground, zone_values, faces, lines, now[DT], settings, contact, zones, barrier)


@Kernel
def keep_before_faces(run, counts, rows, keys, lowest, inside, faces, barriers, reports, settings):
    """Move points back to smooth faces that they have passed (see `point_faces`); a thread per point."""
    if run[STATUS] != 0:
        return
    for p in range(cuda.grid(1), counts[ROWS], cuda.gridsize(1)):
        keep_before_face(p, rows, keys, lowest, inside, faces, barriers, settings.dx, reports[cuda.grid(1)])


@Kernel
def book_faces(
    run,
    counts,
    nodes,
    touched,
    slots,
    lowest,
    ground_nodes,
    folds,
    exact,
    faces,
    lines,
    yields,
    face_yields,
    booked,
    reports,
    settings,
):
    """Loads on smooth faces, each in its own row of `booked`, and how far they yielded; a thread per face."""
    if run[STATUS] != 0:
        return
    grid, ground = NodeBlocks(nodes, touched, run[TOUCHED]), Ground(ground_nodes, folds, exact)
    window = window_now(run, slots, lowest)
    for f in range(cuda.grid(1), faces.shape[0], cuda.gridsize(1)):
        if faces[f, FACE_BARRIER] > 0.0:
            for k in range(POINT_BARRIER_SUMS):
                booked[int(faces[f, FACE_BARRIER]) - 1, k] = 0.0
            book_face(
                f,
                grid,
                window,
                ground,
                faces,
                lines,
                yields,
                face_yields,
                counts[STEP] + 1,
                reports[cuda.grid(1)],
                booked,
                settings,
            )


@capped(double=112)
def press_on_crests(run, columns, nodes, touched, slots, lowest, barriers, booked, reports, settings, barrier):
    """Contact with crests in the node `columns` int32[n, 2] that barriers stand on (see `point_crests`).

    It sets the loads of these columns to zero and is the first to book them; a thread per column.
    """
    if run[STATUS] != 0:
        return
    grid, window = NodeBlocks(nodes, touched, run[TOUCHED]), window_now(run, slots, lowest)
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
                press_at_crest(
                    slots[place], column, grid, window, barriers, reports[cuda.grid(1)], booked, settings, barrier
                )


@capped(double=104)
def hold_at_barriers(
    run,
    now,
    columns,
    nodes,
    touched,
    slots,
    lowest,
    ground_nodes,
    folds,
    exact,
    zone_values,
    barriers,
    column_mass,
    flow,
    booked,
    reports,
    settings,
    contact,
    zones,
    barrier,
):
    """Contact node by node in the node `columns` int32[n, 2] that barriers stand on, from the lowest block upwards."""
    if run[STATUS] != 0:
        return
    grid = NodeBlocks(nodes, touched, run[TOUCHED])
    ground = Ground(ground_nodes, folds, exact)
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
                    ground,
                    zone_values,
                    barriers,
                    column_mass,
                    flow,
                    reports[cuda.grid(1)],
                    booked,
                    now[DT],
                    settings,
                    contact,
                    zones,
                    barrier,
                )


@in_double
def sum_booked(run, booked, start, sums):
    """Sum the rows of each barrier, `start` int64[barriers + 1] of `booked`, into `sums` float64[CHUNKS, barriers, .].

    One thread per number.
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
def collect_barriers(run, stage, report, sums):
    """Add the loads of a step to those of the run; one thread per barrier."""
    if run[STATUS] != 0:
        return
    for b in range(cuda.grid(1), sums.shape[0], cuda.gridsize(1)):
        collect_point_barrier(b, report, sums, stage[DT])


class DeviceBarriers:
    """The barriers of a run on the device.

    Parameters
    ----------
    barriers : float64[rows, columns, POINT_BARRIER_ENTRIES]
    faces : float64[n, FACE_ENTRIES]
    sums : float64[barriers, POINT_BARRIER_SUMS + 1]
    face_yields : float64[2, n + 2, levels + 2, YIELD_ENTRIES]
    real : type
        Precision of the points, in which all but sums are kept.
    """

    def __init__(self, barriers, faces, sums, face_yields, real):
        if not len(sums):
            barriers = np.zeros((1, 1, POINT_BARRIER_ENTRIES))
        columns, barriers, faces, start = own_rows(barriers, faces, len(sums))
        self.opens = bool((barriers[..., SHARE] > 0.0).any())  # is any node column partly open?
        self.columns, self.start = cuda.to_device(columns), cuda.to_device(start)
        self.values, self.faces = cuda.to_device(barriers.astype(real)), cuda.to_device(faces.astype(real))
        self.lines = cuda.device_array((len(faces), COLUMNS + face_yields.shape[2] - 1, LINE_ENTRIES), real)
        self.booked = cuda.to_device(np.zeros((int(start[-1]), POINT_BARRIER_SUMS), real))
        self.report = cuda.device_array((CHUNKS, len(sums), POINT_BARRIER_SUMS), np.float64)
        self.sums = cuda.to_device(np.ascontiguousarray(sums))
        self.face_yields = cuda.to_device(np.ascontiguousarray(face_yields, real))
        rows, width = barriers.shape[:2] if self.opens else (1, 1)
        self.flow = cuda.to_device(np.zeros((rows, width, COLUMN_FLOW), real))


def own_rows(barriers, faces, count):
    """(int32[n, 2] node columns with a barrier, `barriers`, `faces`, int64[count + 1] first row of each barrier).

    In the copies of `barriers` and `faces` the number of the barrier is 1 + the row in which the node column or the
    face books what it takes up; the rows of a barrier follow each other.
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
