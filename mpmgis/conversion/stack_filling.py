"""Fill stacks of points, each from the bed upwards, in the order of the stacks."""

from typing import NamedTuple

import numpy as np

from ..compiled.jit import jit


class StackRows(NamedTuple):
    """Stacks to be filled, one row each.

    Parameters
    ----------
    count : int64[k]
        Points in each stack.
    place : float64[k, 3] [m]
        Foot of each stack.
    thickness : float64[k] [m]
    motion : float64[k, 3] [m s-1]
        Velocity at the foot.
    divergence : float64[k] [s-1]
        Decrease of the vertical velocity per metre of height.
    shares : float64[k, 2] [kg, m3]
        Mass and volume of each of a stack's points.
    load : float64[k] [Pa m-1]
        Vertical stress per metre below the surface.
    parent : uint64[k]
        Identity of the column of each stack.
    """

    count: np.ndarray
    place: np.ndarray
    thickness: np.ndarray
    motion: np.ndarray
    divergence: np.ndarray
    shares: np.ndarray
    load: np.ndarray
    parent: np.ndarray


class PointRows(NamedTuple):
    """Points of the stacks, one row each, to be filled.

    Parameters
    ----------
    position : float64[n, 3] [m]
    velocity : float64[n, 3] [m s-1]
    mass : float64[n] [kg]
    volume : float64[n] [m3]
    parent : uint64[n]
    depth : float64[n] [m]
        Below the surface. Empty: depth and stress are not computed.
    stress : float64[n] [Pa]
        Vertical stress.
    """

    position: np.ndarray
    velocity: np.ndarray
    mass: np.ndarray
    volume: np.ndarray
    parent: np.ndarray
    depth: np.ndarray
    stress: np.ndarray


@jit
def fill_stacks(stacks: StackRows, printed: bool, points: PointRows) -> None:
    """Fill the points of all stacks (MOX report 15/2025, Algorithm 2).

    Parameters
    ----------
    stacks : StackRows
    printed : bool
        True: points from bed to surface, Eq (2); False: in the middle of equal slices.
    points : PointRows, out
        Rows in the order of the stacks, each stack from the bed upwards.
    """
    count, place, thickness, motion, divergence, shares, load, parent = stacks
    position, velocity, mass, volume, point_parent, depth, stress = points
    p = 0
    wanted = depth.shape[0] > 0
    for k in range(count.shape[0]):
        for i in range(count[k]):
            level = i / (count[k] - 1) if printed else (i + 0.5) / count[k]
            height = level * thickness[k]
            position[p, 0], position[p, 1], position[p, 2] = place[k, 0], place[k, 1], place[k, 2] + height
            velocity[p, 0], velocity[p, 1] = motion[k, 0], motion[k, 1]
            velocity[p, 2] = motion[k, 2] - height * divergence[k]
            mass[p], volume[p] = shares[k, 0], shares[k, 1]
            point_parent[p] = parent[k]
            if wanted:
                depth[p] = thickness[k] - height
                stress[p] = load[k] * depth[p]
            p += 1
