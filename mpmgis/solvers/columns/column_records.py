"""Records on which the loop over columns works: settings, and fields at the nodes."""

from typing import NamedTuple

import numpy as np


class Settings(NamedTuple):
    """Settings that are constant during the time integration."""

    dx: float  # [m]
    density: float  # [kg m-3]
    gravity: float  # [m s-2]
    cfl: float  # [1] Courant number C
    fixed_dt: float  # [s]; 0: by the Courant number
    move_limit: float  # [1] largest share of a cell that a column moves in a step
    fall_limit: float  # [s] C times the time in which the steepest ground moves a resting column by a cell
    clamp: float  # [1] a column is at most so many times as thick or as thin as the grid; 0: no limit
    thickness_floor: float  # [m] least thickness for friction
    wet_thickness: float  # [m] above which a node counts as reached by the flow
    arrival_thickness: float  # [m] above which speed, pressure and arrival time are recorded
    wild_stop: float  # [1] share of the mass that is much too fast, at which a run stops
    wall: bool  # the edges are walls
    holes: bool  # the terrain has cells without elevation
    stop_at_rest: bool  # the stop rules apply
    keep_peaks: bool  # running peaks of speed and pressure and the arrival are recorded


class NodeFields(NamedTuple):
    """Spatial fields at the nodes [ny + 3, nx + 3] or in the cells [ny, nx]; one entry where not in use."""

    bed: np.ndarray  # [m]
    gradient: np.ndarray  # [..., 2]
    inside: np.ndarray  # cells; 1 where there is terrain
    zone_values: np.ndarray  # [..., parameters of the friction law]
    erodible: np.ndarray  # [kg m-2] that can still be taken up
    erodible_share: np.ndarray  # [1] of a node's square in which it lies
    barriers: np.ndarray  # [..., BARRIER_ENTRIES]
    lake_level: np.ndarray  # cells; [m]
    forest: np.ndarray  # [..., FOREST_ENTRIES] values of the trees; all 0: none
    forest_state: np.ndarray  # [..., FOREST_STATE] mass that stopped [kg], and whether the trees are broken
    forest_share: np.ndarray  # share of a node's mass that stops in this step
    forest_sums: np.ndarray  # [FOREST_SUMS] over the run
    trigger_thickness: np.ndarray  # [areas that the flow releases]; [m] that has to reach each
