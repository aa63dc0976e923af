"""Numerical parameters of the 3D solver, its Courant number and the settings of its kernel."""

from dataclasses import dataclass

import numpy as np

from ...laws.material import Material
from ...laws.material_choice import wave_speed
from ...laws.quantities import GRAVITY
from .point_peaks import LONE_SHARE as LONE_NODE_SHARE
from .point_rows import Settings

LONE_SHARE = 0.85  # [1] of the step at which a single point oscillates with growing amplitude; 0.95 is too much
BAND_OF_ONE = 0.13  # [1] density band of one point per cell; more points make less noise, by the root of their number
MOST_BAND = 0.25  # [1] widest density band
LEAK_STOP = 1e-3  # [1] share of the mass found more than a cell below the ground in one step, at which a run stops
LEAK_POINTS = 4.5  # [1] times the mass of the heaviest point: up to four points do not stop a run
PRECISIONS = {"float64": np.float64, "float32": np.float32}


@dataclass(frozen=True)
class PointNumerics:
    """Numerical parameters of the 3D solver; its laws are in `PointEffects`.

    Parameters
    ----------
    cell_size : float [m]
    cfl : float [1]
        Courant number, limited by the stability of a single point, see `courant_number`.
    edges : str
        "open" or "wall": what the edges of the domain are.
    gravity : float [m s-2]
    density : float [kg m-3]
        Of the material.
    clearance : float [cells]
        Height above the ground up to which a node on a fold of it (a cliff, a kink) is in contact with it.
    time_step : float, optional [s]
        Fixed length of a step; None: by the Courant number.
    stop_at_rest : bool
        Used by the time integration.
    precision : str
        "float64" or "float32", of points and grid; sums, time and balances are always float64.
    maxima : bool
        Whether running peaks are stored.
    arrival_thickness : float [m]
        Least thickness of the flow whose speed, pressure and arrival count in them.
    """

    cell_size: float
    cfl: float = 0.4
    edges: str = "open"
    gravity: float = GRAVITY
    density: float = 1000.0
    clearance: float = 0.5
    time_step: float | None = None
    stop_at_rest: bool = False
    precision: str = "float64"
    maxima: bool = False
    arrival_thickness: float = 0.05


def courant_number(material: Material, numerics: PointNumerics) -> float:
    """Compute the Courant number of a run: that of `numerics`, or the stability limit of a single point [1].

    A single point strains with the nodes around it, C' = -(4 / dx^2) tau / rho, and oscillates at 2 / dx
    sqrt(max(3 K, 2 G) / rho), faster than a wave crosses cells; explicit steps are stable up to 2 over that, dx /
    sqrt(max(3 K, 2 G) / rho). The limit is 0.58 for fluids and 0.77 for solids with G = 0.6 K: at 0.9 one such point on
    the ground had three times its energy after a second. Closer to the limit than LONE_SHARE, a change of the step
    excites the oscillation: at 0.95 a point on rough ground gained 1 % of its energy by two changes, at 0.85 none.

    Parameters
    ----------
    material : Material
    numerics : PointNumerics
    """
    stiffest = max(3.0 * material.bulk_modulus, 2.0 * material.shear_modulus)
    lone = wave_speed(material, numerics.density) / np.sqrt(stiffest / numerics.density)
    return float(min(numerics.cfl, LONE_SHARE * lone))


def kernel_settings(
    numerics: PointNumerics, material: Material, inside: np.ndarray, heaviest: float, mass: float
) -> Settings:
    """Make the settings of the kernels.

    Parameters
    ----------
    numerics : PointNumerics
    material : Material
    inside : bool[ny, nx]
        Where the terrain has an elevation.
    heaviest : float [kg]
        Mass of the heaviest point.
    mass : float [kg]
        Of all points.
    """
    dx, viscosity = numerics.cell_size, material.dynamic_viscosity
    ny, nx = inside.shape
    return Settings(
        dx=float(dx),
        density=float(numerics.density),
        gravity=float(numerics.gravity),
        cfl=courant_number(material, numerics),
        signal_speed=float(wave_speed(material, numerics.density)),
        viscous_limit=numerics.density * dx * dx / (6.0 * viscosity) if viscosity > 0.0 else np.inf,
        fixed_dt=float(numerics.time_step or 0.0),
        clearance=float(numerics.clearance * dx),
        cells_x=nx,
        cells_y=ny,
        wall=numerics.edges == "wall",
        holes=not inside.all(),
        keep_peaks=bool(numerics.maxima),
        arrival_thickness=float(numerics.arrival_thickness),
        slack=0.0 if material.shear_modulus else 1.0,
        **mass_limits(numerics, heaviest, mass),
    )


def mass_limits(numerics: PointNumerics, heaviest: float, mass: float) -> dict[str, float]:
    """Compute the entries of `Settings` that depend on the heaviest point and on the mass.

    The density band follows the variation of the density of irregular points. The leak limit is never below the share
    of four points: in a flow with a plane of symmetry, points that creep below the ground in front of a wall are moved
    back two or four at a time. `lone_thickness` is that of a single point at a node.

    Parameters
    ----------
    numerics : PointNumerics
    heaviest : float [kg]
        Mass of the heaviest point.
    mass : float [kg]
        Of all points.
    """
    fill = heaviest / (numerics.density * numerics.cell_size**3)  # [cells] of a point
    return {
        "density_band": min(BAND_OF_ONE * float(np.sqrt(fill)), MOST_BAND),
        "leak_stop": max(LEAK_STOP, LEAK_POINTS * heaviest / max(mass, 1e-300)),
        "lone_thickness": float(LONE_NODE_SHARE * heaviest / (numerics.density * numerics.cell_size**2)),
    }
