"""Start of another 3D solver: points in local coordinates, ground, material and background grid."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..system.errors import InputError
from ..terrain.elevation import Terrain
from .initial_stress import kirchhoff_stress

if TYPE_CHECKING:
    from ..frames.particles import Frame

CELLS_AROUND = 10  # [cells] fewest of the grid beyond the points, where no window is given
CELLS_UNDER = 3  # [cells] of the grid under the lowest ground
CELLS_OVER = 4  # [cells] of the grid above the flow, which can also rise to twice its height
COURANT = 0.2  # [1] Courant number of the time step written for solvers that require one


@dataclass(frozen=True)
class Box:
    """Origin of the local coordinates of a solver, and its ground.

    Parameters
    ----------
    origin : (float, float, float) [m]
        (E, N, H) of the local (0, 0, 0), the grid's lower south-west corner.
    terrain : Terrain
        The window of the DTM.
    size : (float, float, float) [m]
        Of the box along E, N and up.
    cell : float or None [m]
        Side of the grid's cubes, a whole number of which fills the box.
    headroom : float [m]
        Height over the bed that the grid has at the least.
    """

    origin: tuple
    terrain: Terrain
    size: tuple
    cell: float | None
    headroom: float

    @property
    def cells(self) -> tuple[int, int, int]:
        """Number of cubes along x, y and z."""
        return tuple(round(length / self.cell) for length in self.size)

    def bed_at_nodes(self) -> np.ndarray:
        """Compute the places on the bed below the nodes of the grid.

        Returns
        -------
        float64[nx + 1, ny + 1, 3] [m]
            Local coordinates; NaN where there is no bed.
        """
        nx, ny, _ = self.cells
        east, north, up = self.origin
        x, y = np.meshgrid(self.cell * np.arange(nx + 1), self.cell * np.arange(ny + 1), indexing="ij")
        return np.stack([x, y, self.terrain.sample(east + x, north + y) - up], axis=-1)


@dataclass(frozen=True)
class SolverStart:
    """Points at one time in local coordinates, with further data for a solver.

    Parameters
    ----------
    position, velocity : float64[n, 3] [m], [m s-1]
        Towards E, N and up, from `box.origin`.
    ids : int64[n]
    mass : float64[n] [kg]
    volume, current_volume : float64[n] [m3]
        Mass over density, for solvers that compute mass from volume; that of the frame.
    vertical_stress : float64[n] or None [Pa]
        Of the weight above a point (`ground_below`), where the frame has it.
    time, density : float [s], [kg m-3]
    box : Box
    crs : pyproj.CRS or None
    material : MaterialTable or None
    bed_friction : float or None [1]
        tan of the friction angle on the bed.
    end_time : float or None [s]
    gravity : float [m s-2]
    """

    position: np.ndarray
    velocity: np.ndarray
    ids: np.ndarray
    mass: np.ndarray
    volume: np.ndarray
    current_volume: np.ndarray
    vertical_stress: np.ndarray | None
    time: float
    density: float
    box: Box
    crs: Any = None
    material: Any = None
    bed_friction: float | None = None
    end_time: float | None = None
    gravity: float = 9.81

    @property
    def cell(self) -> float | None:
        """Side of the grid's cubes [m]."""
        return self.box.cell

    @property
    def cells(self) -> tuple[int, int, int]:
        """Number of cubes along x, y and z."""
        return self.box.cells

    @property
    def headroom(self) -> float:
        """Height over the bed that the grid has at the least [m]."""
        return self.box.headroom

    @cached_property
    def elastic(self) -> tuple[float, float]:
        """Young's modulus [Pa] and Poisson's ratio [1], from the material's bulk and shear modulus."""
        bulk, shear = self.material.parameters["bulk_modulus"], self.material.parameters["shear_modulus"]
        return 9 * bulk * shear / (3 * bulk + shear), (3 * bulk - 2 * shear) / (2 * (3 * bulk + shear))

    @property
    def tension_limit(self) -> float:
        """Largest tension [Pa] of a Drucker-Prager material as Mohr-Coulomb: at most where its cone ends."""
        values = self.material.parameters
        cohesion, tangent = values["cohesion"], math.tan(math.radians(values["friction_angle"]))
        limit = 10 * cohesion if self.material.tension_limit is None else self.material.tension_limit
        return min(limit, cohesion / tangent) if tangent > 0 else limit

    @property
    def time_step(self) -> float:
        """COURANT times the travel time of a pressure wave through a cell [s], two digits."""
        values = self.material.parameters
        wave = math.sqrt((values["bulk_modulus"] + 4 / 3 * values.get("shear_modulus", 0.0)) / self.density)
        speed = float(np.sqrt((self.velocity**2).sum(axis=1)).max())
        return float(f"{COURANT * self.cell / (wave + speed):.2g}")

    @property
    def stress(self) -> np.ndarray | None:
        """Stress xx, yy, zz, xy, xz, yz under the weight above, float64[n, 6] [Pa]; None where that is not known."""
        if self.vertical_stress is None:
            return None
        values = self.material.parameters
        return kirchhoff_stress(self.vertical_stress, values["bulk_modulus"], values.get("shear_modulus", 0.0))


def start_box(
    frames: Iterable, terrain: Terrain, cell: float | None = None, window: (float | float | float) | None = None
) -> Box:
    """Choose the box of local coordinates for frames of points.

    Parameters
    ----------
    frames : iterable of Frame
        Of points; is iterated twice.
    terrain : Terrain
    cell : float, optional [m]
        Of the solver's grid; default: no grid.
    window : (float, float, float, float), optional [m]
        West, south, east, north; default the extent of the points, extended by its size, but not beyond the DTM.

    Raises
    ------
    InputError
        A point outside the window, the points off the DTM, cells that do not fit.
    """
    low, high = _extent(frames)
    margin = max(*(high - low)[:2], CELLS_AROUND * (cell or 0.0))
    west, south, east, north = terrain.grid.bounds
    asked = window or (low[0] - margin, low[1] - margin, high[0] + margin, high[1] + margin)
    step = _round_step(max(high - low))
    west, south = (max(_down(a, step), -_down(-b, step)) for a, b in ((asked[0], west), (asked[1], south)))
    east, north = min(asked[2], east), min(asked[3], north)
    within = f"the window {','.join(f'{side:.10g}' for side in window)}" if window else f"the DTM {terrain.path}"
    if window is not None:  # also one beside the DTM, into which no cells would fit
        _require_within(low, high, (west, south, east, north), within, "--window around them")
    if cell is not None and cell > min(east - west, north - south):
        raise InputError(
            f"cells of {cell:g} m do not fit into the ground around the points, {east - west:g} x "
            f"{north - south:g} m; take a smaller --cell"
        )
    if cell is not None:
        off = max(1e-9, terrain.grid.rounding / cell)  # [cells]
        across, along = (math.floor(length / cell + off) for length in (east - west, north - south))
        east, north = west + cell * across, south + cell * along
    _require_within(low, high, (west, south, east, north), within, "--window around them" if window else "larger --dem")
    part = terrain.cropped((west, south, east, north), 1)
    floor, top = _least_and_most(part)
    thickness = max(max(_height(frame, part) for frame in frames), 0.0)
    headroom = 2 * thickness + CELLS_OVER * (cell or 0.0)
    bottom = _down(min(floor, low[2]) - CELLS_UNDER * (cell or 0.0), step)
    up = max(top, high[2]) + headroom - bottom
    if cell is not None:
        up = cell * math.ceil(up / cell - 1e-9)
    return Box((float(west), float(south), float(bottom)), part, (east - west, north - south, up), cell, headroom)


def _require_within(low, high, bounds, name, fix):
    """Refuse points from `low` to `high` [m] that are not all in the `bounds` of `name`."""
    west, south, east, north = bounds
    if low[0] < west or low[1] < south or high[0] > east or high[1] > north:
        raise InputError(
            f"the points are from E {low[0]:.1f} to {high[0]:.1f} and N {low[1]:.1f} to {high[1]:.1f}, not all within "
            f"{name}; give a {fix}"
        )


def _round_step(extent):
    """Whole metres, or of scenes below 100 m the power of ten at or below a hundredth of their `extent` [m]."""
    return min(1.0, 10.0 ** math.floor(math.log10(max(extent, 1e-9)) - 2.0 + 1e-9))


def _down(value, step):
    """The multiple of `step` at or below `value` [m]; exact for whole metres."""
    return float(math.floor(value)) if step == 1.0 else math.floor(value / step + 1e-6) * step


def _extent(frames):
    """(float64[3], float64[3]) [m]: least and most E, N, H of all points."""
    least, most = np.full(3, np.inf), np.full(3, -np.inf)
    for frame in frames:
        position = frame.particles.position + np.asarray(frame.origin)
        least, most = np.minimum(least, position.min(axis=0)), np.maximum(most, position.max(axis=0))
    return least, most


def _least_and_most(terrain):
    if not terrain.valid.any():
        raise InputError(f"{terrain.path or 'the terrain'} has no heights around the points; give theirs with --dem")
    return float(np.nanmin(terrain.elevation)), float(np.nanmax(terrain.elevation))


def _height(frame, terrain):
    """Largest height of a point over the bed [m]."""
    height = frame.particles.position[:, 2] + frame.origin[2] - terrain.sample(*frame.map_xy())
    return float(np.nanmax(height)) if np.isfinite(height).any() else 0.0


def release_density(frame: "Frame") -> float:
    """Return the density [kg m-3] of a frame of points: from its header, otherwise its mass over its volume.

    Parameters
    ----------
    frame : Frame
    """
    declared = frame.header.get("density")
    if isinstance(declared, (int, float, np.number)) and math.isfinite(declared) and declared > 0:
        return float(declared)
    particles = frame.particles
    return float(particles.mass.sum(dtype=float) / particles.volume.sum(dtype=float))


def solver_start(frame: "Frame", box: Box, density: float, crs: Any = None) -> SolverStart:
    """Return the start of a solver, without a material (`with_material`).

    Parameters
    ----------
    frame : Frame
        Of points.
    box : Box
    density : float [kg m-3]
    crs : pyproj.CRS, optional
    """
    particles = frame.particles
    mass = particles.mass.astype(float)
    return SolverStart(
        position=particles.position.astype(float) + (np.asarray(frame.origin) - np.asarray(box.origin)),
        velocity=particles.velocity.astype(float),
        ids=np.arange(len(mass)) if particles.id is None else particles.id.astype(np.int64),
        mass=mass,
        volume=mass / density,
        current_volume=particles.volume.astype(float),
        vertical_stress=frame.particle_state("vertical_stress"),
        time=frame.time,
        density=density,
        box=box,
        crs=crs,
    )


def with_material(
    start: SolverStart, material: Any, bed_friction: float | None = None, end_time: float | None = None
) -> SolverStart:
    """Return a start with its material.

    Parameters
    ----------
    start : SolverStart
    material : MaterialTable
    bed_friction : float, optional [1]
        tan of the friction angle on the bed.
    end_time : float, optional [s]
    """
    return replace(start, material=material, bed_friction=bed_friction, end_time=end_time)
