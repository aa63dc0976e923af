"""Sums over the points of a 3D run, for its balances."""

import numpy as np

from ...compiled.jit import jit, jit_inline
from ...laws.material import Material
from ...laws.material_choice import stored_energy
from .point_blocks import key_column, key_level, key_row
from .point_rows import BLOCK, GHOSTS, MASS, PX, PY, PZ, S0, S1, S2, S3, X, Y, Z, more_state

(
    MOMENTUM_X,  # [kg m s-1] momentum, east
    MOMENTUM_Y,  # [kg m s-1] north
    MOMENTUM_Z,  # [kg m s-1] up
    MOMENTUM_ABS,  # [kg m s-1] sum of the absolute values of the components
    KINETIC,  # [J] kinetic energy
    POTENTIAL,  # [J] potential energy from the lowest level
    STORED,  # [J] elastic energy
    OF_STATE,  # [kg J m-3] mass times S2; of a fluid that is the energy of the present correction per volume
    SUMS,  # number of sums
) = range(9)
double = np.float64  # conversion to double precision; `float` would keep float32 in compiled code
PART = 64  # points that are summed before their sum is added to the rest, which keeps the rounding small


@jit
def sums_of(
    rows: np.ndarray,
    keys: np.ndarray,
    lowest: np.ndarray,
    dx: float,
    gravity: float,
    density: float,
    material: Material,
) -> np.ndarray:
    """Compute the sums over points, float64[SUMS].

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
    lowest : int32[block rows, block columns, 2]
        The result of `point_blocks.lowest_blocks`.
    dx : float [m]
    gravity : float [m s-2]
    density : float [kg m-3]
    material : Material
    """
    sums, part = np.zeros(SUMS), np.zeros(SUMS)
    for p in range(rows.shape[0]):
        mass = double(rows[p, MASS])
        east, north, up = double(rows[p, PX]), double(rows[p, PY]), double(rows[p, PZ])
        level = key_level(keys[p]) + lowest[key_row(keys[p]), key_column(keys[p]), 0]
        s4, s5, s6, s7 = more_state(rows, p)
        state = (
            double(rows[p, S0]),
            double(rows[p, S1]),
            double(rows[p, S2]),
            double(rows[p, S3]),
            double(s4),
            double(s5),
            double(s6),
            double(s7),
        )
        stored = stored_energy(material, state)
        part[MOMENTUM_X] += east
        part[MOMENTUM_Y] += north
        part[MOMENTUM_Z] += up
        part[MOMENTUM_ABS] += abs(east) + abs(north) + abs(up)
        part[KINETIC] += 0.5 * (east * east + north * north + up * up) / mass
        part[POTENTIAL] += mass * gravity * ((double(rows[p, Z]) + (BLOCK * level - GHOSTS)) * dx)
        part[STORED] += mass / density * stored
        part[OF_STATE] += mass * double(rows[p, S2])
        if p % PART == PART - 1:
            sums += part
            part[:] = 0.0
    return sums + part


@jit
def speeds_of(rows: np.ndarray) -> np.ndarray:
    """Compute the speeds of points, float64[n] [m s-1].

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    """
    speeds = np.empty(rows.shape[0])
    for p in range(rows.shape[0]):
        east, north, up = double(rows[p, PX]), double(rows[p, PY]), double(rows[p, PZ])
        speeds[p] = np.sqrt(east * east + north * north + up * up) / double(rows[p, MASS])
    return speeds


@jit_inline
def _cells_of(rows, keys, p):
    """Return the place [cells] of point `p` from the centre of the cell in the corner of the domain."""
    x = double(rows[p, X]) + double(BLOCK * key_column(keys[p]) - GHOSTS) - 0.5
    y = double(rows[p, Y]) + double(BLOCK * key_row(keys[p]) - GHOSTS) - 0.5
    return x, y


@jit
def cells_of(rows: np.ndarray, keys: np.ndarray) -> tuple[int, int, int, int]:
    """Find the range of the cells whose centres are around points.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]

    Returns
    -------
    (int, int, int, int)
        First column, first row, last column, last row.
    """
    west = south = 1 << 60
    east = north = -(1 << 60)
    for p in range(rows.shape[0]):
        x, y = _cells_of(rows, keys, p)
        i, j = int(np.floor(x)), int(np.floor(y))
        west, south, east, north = min(west, i), min(south, j), max(east, i + 1), max(north, j + 1)
    return west, south, east, north


@jit
def spread_masses(rows: np.ndarray, keys: np.ndarray, west: int, south: int, held: np.ndarray) -> None:
    """Add the mass of points to cells, linear between their centres.

    Parameters
    ----------
    rows : float[n, ROW_SHORT or ROW_LONG]
    keys : int64[n]
    west, south : int
        Column and row of the first cell.
    held : float64[rows of cells, columns of cells] [kg]
        Changed by this function.
    """
    for p in range(rows.shape[0]):
        x, y = _cells_of(rows, keys, p)
        i, j = int(np.floor(x)), int(np.floor(y))
        fx, fy, mass = x - i, y - j, double(rows[p, MASS])
        i, j = i - west, j - south
        held[j, i] += mass * (1.0 - fx) * (1.0 - fy)
        held[j + 1, i] += mass * (1.0 - fx) * fy
        held[j, i + 1] += mass * fx * (1.0 - fy)
        held[j + 1, i + 1] += mass * fx * fy
