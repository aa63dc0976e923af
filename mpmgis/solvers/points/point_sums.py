"""Sums over the points of a 3D run, for its balances."""

import numpy as np

from ...compiled.jit import jit, jit_inline
from .point_blocks import key_column, key_level, key_row
from .point_rows import BLOCK, GHOSTS, MASS, PX, PY, PZ, S0, S1, S2, S3, X, Y, Z, more_state

# momentum [kg m s-1], sum of the absolute values of its components, kinetic energy, potential energy from the lowest
# level and elastic energy [J], mass times the second number of state (of `Fluid`: energy of the present correction per
# volume [J m-3]) [kg J m-3]
MOMENTUM_X, MOMENTUM_Y, MOMENTUM_Z, MOMENTUM_ABS, KINETIC, POTENTIAL, STORED, OF_STATE, SUMS = range(9)
double = np.float64  # conversion to double precision; `float` would keep float32 in compiled code
PART = 64  # points that are added before they are added to the rest, which keeps the rounding small


@jit
def sums_of(rows, keys, lowest, dx, gravity, density, material):
    """float64[SUMS] over the points of `rows` in the blocks `keys`."""
    sums, part = np.zeros(SUMS), np.zeros(SUMS)
    for p in range(rows.shape[0]):
        mass = double(rows[p, MASS])
        east, north, up = double(rows[p, PX]), double(rows[p, PY]), double(rows[p, PZ])
        level = key_level(keys[p]) + lowest[key_row(keys[p]), key_column(keys[p]), 0]
        s4, s5, s6, s7 = more_state(rows, p)
        stored = material.stored_energy(
            double(rows[p, S0]),
            double(rows[p, S1]),
            double(rows[p, S2]),
            double(rows[p, S3]),
            double(s4),
            double(s5),
            double(s6),
            double(s7),
        )
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
def speeds_of(rows):
    """float64[n] [m s-1]: speeds of the points of `rows`."""
    speeds = np.empty(rows.shape[0])
    for p in range(rows.shape[0]):
        east, north, up = double(rows[p, PX]), double(rows[p, PY]), double(rows[p, PZ])
        speeds[p] = np.sqrt(east * east + north * north + up * up) / double(rows[p, MASS])
    return speeds


@jit_inline
def _cells_of(rows, keys, p):
    """Place [cells] of point `p` from the centre of the cell in the corner of the domain."""
    x = double(rows[p, X]) + double(BLOCK * key_column(keys[p]) - GHOSTS) - 0.5
    y = double(rows[p, Y]) + double(BLOCK * key_row(keys[p]) - GHOSTS) - 0.5
    return x, y


@jit
def cells_of(rows, keys):
    """First and last column and row of the cells whose centres are around points: west, south, east, north."""
    west = south = 1 << 60
    east = north = -(1 << 60)
    for p in range(rows.shape[0]):
        x, y = _cells_of(rows, keys, p)
        i, j = int(np.floor(x)), int(np.floor(y))
        west, south, east, north = min(west, i), min(south, j), max(east, i + 1), max(north, j + 1)
    return west, south, east, north


@jit
def spread_masses(rows, keys, west, south, held):
    """Add the mass [kg] of points to the cells `held` [rows, columns] from [south, west] on, linear between centres."""
    for p in range(rows.shape[0]):
        x, y = _cells_of(rows, keys, p)
        i, j = int(np.floor(x)), int(np.floor(y))
        fx, fy, mass = x - i, y - j, double(rows[p, MASS])
        i, j = i - west, j - south
        held[j, i] += mass * (1.0 - fx) * (1.0 - fy)
        held[j + 1, i] += mass * (1.0 - fx) * fy
        held[j, i + 1] += mass * fx * (1.0 - fy)
        held[j + 1, i + 1] += mass * fx * fy
