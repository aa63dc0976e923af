"""Traction of the bed on a 3D flow (`contact_friction`): the mass of each node column on which it acts.

The traction acts on dx^2 / c of bed under each node column, and slows its mean speed (`point_layers`); on folds of the
ground, the nodes that touch it. At a steep margin a column has less bed than that: splines spread the mass of a flow a
cell and a half beyond it, which would add three columns of drag to a flow of any width. A column with less than RIM of
the mass of its heaviest neighbour has the corresponding share of the bed: a steep margin then adds an eighth of a
column, and a flow whose thickness changes by less than a fifth per cell none.
"""

import numpy as np

from ...compiled.block_order import CHUNKS
from ...compiled.jit import jit, jit_inline, jit_parallel, prange
from .point_ground import Ground, exact_at, fold_at, plane_at
from .point_rows import BLOCK, GHOSTS, NODE_MASS

# entries of a node column
TOUCHING = 0  # [kg] mass that touches the ground
WHOLE = 1  # [kg] total mass
COLUMN_MASSES = 2
BLOCK_COLUMNS = BLOCK * BLOCK * COLUMN_MASSES  # numbers of a block
RIM = 5.0 / 6.0  # of the heaviest neighbour's mass, below which a column has less than its whole bed
LEAST_MASS = 1e-30  # [kg] keeps divisors off 0


@jit_inline
def column_contact(
    block: np.ndarray, touched: np.ndarray, t: int, j: int, i: int, ground: Ground, dx: float, clearance: float
) -> tuple[float, float]:
    """Return the mass that touches the ground, and the mass, of a node column of a touched block.

    Parameters
    ----------
    block : float[BLOCK_SIZE]
        Masses and momenta, or velocities, at the nodes of the block.
    touched : int32[touched, 3]
        Row, column and level of the touched blocks.
    t : int
        Number of the block.
    j, i : int
        Node column in the block, from 0 to BLOCK - 1.
    ground : Ground
    dx : float [m]
    clearance : float [m]
        Height above the ground up to which a node touches it.

    Returns
    -------
    touching, whole : float [kg]
    """
    j_first, i_first, k_first = touched[t, 0] * BLOCK, touched[t, 1] * BLOCK, touched[t, 2] * BLOCK
    jj, ii = min(j_first + j, ground.nodes.shape[0] - 1), min(i_first + i, ground.nodes.shape[1] - 1)
    height, _, _, flat = plane_at(ground.nodes, jj, ii)
    first, lowest, levels = fold_at(ground.folds, jj, ii)
    touching = whole = 0.0
    for k in range(BLOCK):
        mass = block[((k * BLOCK + j) * BLOCK + i) * 4 + NODE_MASS]
        away = (float(k_first + k - GHOSTS) * dx - height) * flat
        if levels > 0:
            away = exact_at(ground.exact, first, lowest, levels, k_first + k)[0]
        touching += mass if away <= clearance else 0.0
        whole += mass
    return touching, whole


@jit_parallel
def weigh_contact(
    nodes: np.ndarray,
    touched: np.ndarray,
    n_touched: int,
    ground: Ground,
    dx: float,
    clearance: float,
    masses: np.ndarray,
) -> None:
    """Compute the masses in each block's node columns.

    Parameters
    ----------
    nodes : float[touched, BLOCK_SIZE]
    touched : int32[touched, 3]
        Row, column and level of the touched blocks.
    n_touched : int
        Number of touched blocks.
    ground : Ground
    dx, clearance : float [m]
        As of `column_contact`.
    masses : float64[touched, BLOCK_COLUMNS] [kg]
        Is set.
    """
    for c in prange(CHUNKS):
        for t in range(c * n_touched // CHUNKS, (c + 1) * n_touched // CHUNKS):
            block, part = nodes[t], masses[t]
            for j in range(BLOCK):
                for i in range(BLOCK):
                    touching, whole = column_contact(block, touched, t, j, i, ground, dx, clearance)
                    part[(j * BLOCK + i) * COLUMN_MASSES + TOUCHING] = touching
                    part[(j * BLOCK + i) * COLUMN_MASSES + WHOLE] = whole


@jit
def spread_contact(masses: np.ndarray, touched: np.ndarray, n_touched: int, columns: np.ndarray) -> None:
    """Add the sums of the blocks' node columns, block by block, to those of all the ground.

    Parameters
    ----------
    masses : float64[touched, BLOCK * BLOCK * entries]
        Sums in each block's node columns.
    touched : int32[touched, 3]
        Row, column and level of the touched blocks.
    n_touched : int
        Number of touched blocks.
    columns : float64[rows, columns, entries]
        Is added to.
    """
    entries = columns.shape[2]
    for t in range(n_touched):
        for j in range(BLOCK):
            for i in range(BLOCK):
                jj, ii = touched[t, 0] * BLOCK + j, touched[t, 1] * BLOCK + i
                if jj < columns.shape[0] and ii < columns.shape[1]:
                    for entry in range(entries):
                        columns[jj, ii, entry] += masses[t, (j * BLOCK + i) * entries + entry]


@jit
def clear_contact(touched: np.ndarray, n_touched: int, columns: np.ndarray) -> None:
    """Set sums of node columns to 0 again where `spread_contact` has added to them.

    Parameters
    ----------
    touched : int32[touched, 3]
        Row, column and level of the touched blocks.
    n_touched : int
        Number of touched blocks.
    columns : float64[rows, columns, entries]
        Is changed.
    """
    for t in range(n_touched):
        j, i = touched[t, 0] * BLOCK, touched[t, 1] * BLOCK
        columns[j : j + BLOCK, i : i + BLOCK] = 0.0


@jit_inline
def flow_on_bed(columns: np.ndarray, j: int, i: int, area: float) -> tuple[float, float]:
    """Return the mass that touches the bed of a node column, and the whole mass, over the area of bed [kg m-2].

    Parameters
    ----------
    columns : float[rows, columns, COLUMN_MASSES] [kg]
    j, i : int
        Node column.
    area : float [m2]
        Bed of a node column that the flow covers completely.

    Returns
    -------
    touching, whole : float [kg m-2]
        Above 0.
    """
    bed = max(bed_under(columns, j, i, area), LEAST_MASS)
    return max(columns[j, i, TOUCHING] / bed, LEAST_MASS), max(columns[j, i, WHOLE] / bed, LEAST_MASS)


@jit_inline
def bed_under(columns: np.ndarray, j: int, i: int, area: float) -> float:
    """Return the bed [m2] below the flow of a node column.

    Parameters
    ----------
    columns : float[rows, columns, COLUMN_MASSES] [kg]
    j, i : int
        Node column.
    area : float [m2]
        Bed of a node column that the flow covers completely.
    """
    heaviest = 0.0
    for jj in range(max(j - 1, 0), min(j + 2, columns.shape[0])):
        for ii in range(max(i - 1, 0), min(i + 2, columns.shape[1])):
            heaviest = max(heaviest, columns[jj, ii, WHOLE])
    covered = min(columns[j, i, WHOLE] / max(RIM * heaviest, LEAST_MASS), 1.0)
    return covered * area
