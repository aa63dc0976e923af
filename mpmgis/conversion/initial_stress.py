"""Compute the stress of points at the start of the 3D solver: that of their weight, on level ground or on a slope."""

from typing import TYPE_CHECKING

import numpy as np

from ..laws.contact_friction import STICKING
from ..laws.friction import Friction, strength_of_bed
from ..laws.material import Material
from ..laws.material_choice import strength_at_rest
from .ground_below import GroundBelow

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..terrain.elevation import Terrain

STEEPEST = 1.0  # [1] largest shear stress over normal stress at the start, where neither bed nor material limits it
USED = 0.9  # [1] largest share of a material's strength that is mobilised at the start, where equilibrium allows it
CHUNK = 1 << 18  # [points] whose stress is computed at once: temporary arrays stay small
STRONGEST = 1e3  # [1] largest strength over pressure that is considered; more makes no difference
TINY = 1e-300  # [Pa] keeps divisors off 0
LEVEL = 1e-100  # [1] slope up to which it has no direction: smaller numbers have few digits
THIN = 0.01  # [1] least over largest variance of places, below which the slope across the narrow direction is 0


def stress_of_weight(
    frame: "Frame",
    terrain: "Terrain",
    vertical_stress: np.ndarray,
    material: Material,
    contact: Friction,
    cell_size: float,
    gravity: float,
) -> np.ndarray:
    """Compute the Kirchhoff stress of points on a terrain under their weight.

    Parameters
    ----------
    frame : Frame
        Dimension 3.
    terrain : Terrain
    vertical_stress : float64[n] [Pa]
        -rho g c^2 d of the depth d of each point below the surface on a bed of cosine c
        (`ground_below.vertical_stress`).
    material : Material
    contact : Friction
    cell_size : float [m]
    gravity : float [m s-2]

    Returns
    -------
    float64[n, 6] [Pa]
        xx, yy, zz, xy, xz, yz.

    Notes
    -----
    The slope is that of the surface of the flow, over three thicknesses of it, up to 45 degrees. Friction of zones is
    not considered.
    """
    shear_modulus, (friction, cohesion) = material.shear_modulus, strength_at_rest(material)
    if friction == cohesion == 0.0:
        return kirchhoff_stress(vertical_stress, material.bulk_modulus, shear_modulus, strength=0.0)
    x, y = frame.particles.position[:, :2].T
    height, place = frame.particles.position[:, 2] + frame.origin[2], frame.map_xy()
    ground = GroundBelow.under(terrain, *place)
    steep2 = sum(slope**2 for slope in ground.gradient(*place))
    load = -frame.particles.mass / frame.particles.volume * gravity  # [Pa m-1]
    depth = vertical_stress / load * (1.0 + np.where(np.isfinite(steep2), steep2, 0.0))
    thickness = height - ground.height(*place) + depth
    known = np.isfinite(thickness)
    size = max(cell_size, float(np.median(thickness[known]))) if known.any() else cell_size
    slope = surface_slopes(x, y, height + depth, size)
    slope *= (STEEPEST / np.maximum(np.hypot(*slope.T), STEEPEST))[:, None]
    bed_friction, bed_yield = (STEEPEST, 0.0) if contact.kind == STICKING else strength_of_bed(contact)
    stress = np.empty((len(x), 6))
    for first in range(0, len(x), CHUNK):
        some = slice(first, first + CHUNK)
        cosine2 = 1.0 / (1.0 + (slope[some] ** 2).sum(axis=1))
        normal_stress = load[some] * depth[some] * cosine2
        bed = bed_friction + bed_yield / np.maximum(-load[some] * thickness[some] * cosine2, TINY)
        strength = np.minimum(friction + cohesion / np.maximum(-normal_stress, TINY), STRONGEST)
        stress[some] = kirchhoff_stress(normal_stress, material.bulk_modulus, shear_modulus, slope[some], bed, strength)
    return stress


def kirchhoff_stress(
    normal_stress: np.ndarray,
    bulk_modulus: float,
    shear_modulus: float,
    slope: np.ndarray | None = None,
    bed_friction: float | np.ndarray = STEEPEST,
    strength: float | np.ndarray = STRONGEST,
) -> np.ndarray:
    """Compute the Kirchhoff stress of points from their weight.

    On level ground sigma_xx = sigma_yy = K sigma_zz with K = nu / (1 - nu): points are confined sideways. Where the
    material does not bear that, K is the least that it bears (`lateral_ratio`).

    On a slope of angle theta the weight is that of an infinite layer in equilibrium: with sigma_n normal to the slope,
    the shear stress along it is t sigma_n with t = tan(theta), at most what bed and material bear, and the stress along
    the slope is K sigma_n.

    Parameters
    ----------
    normal_stress : float64[n] [Pa]
        Normal to the slope, negative in compression.
    bulk_modulus, shear_modulus : float [Pa]
    slope : float64[n, 2], optional [1]
        Of the surface along x and y; default level.
    bed_friction : float or float64[n] [1]
    strength : float or float64[n] [1]
        Largest |s| / sqrt(2) over p at rest, of the material.

    Returns
    -------
    float64[n, 6] [Pa]
        xx, yy, zz, xy, xz, yz.
    """
    lame = bulk_modulus - 2.0 / 3.0 * shear_modulus
    confined = lame / (lame + 2.0 * shear_modulus)
    slope = np.zeros((len(normal_stress), 2)) if slope is None else slope
    steepness = np.hypot(*slope.T)
    sine = np.minimum(strength, 1.0 - 1e-9)
    borne = sine / np.sqrt(1.0 - sine**2)
    shear = np.minimum(np.minimum(steepness, borne), np.minimum(bed_friction, STEEPEST))
    along = lateral_ratio(confined, shear, strength)
    across = np.minimum(along, 0.5 * (1.0 + along))  # between the principal stresses in the vertical plane
    cosine = 1.0 / np.sqrt(1.0 + steepness**2)
    downhill = -slope / np.where(steepness > LEVEL, steepness, 1.0)[:, None]
    downhill[steepness <= LEVEL] = (1.0, 0.0)
    normal = np.column_stack([-slope * cosine[:, None], cosine])
    tangent = np.column_stack([downhill * cosine[:, None], -steepness * cosine])
    level = np.column_stack([-downhill[:, 1], downhill[:, 0], np.zeros_like(steepness)])
    unit = [
        along * tangent[:, i] * tangent[:, j]
        + across * level[:, i] * level[:, j]
        + normal[:, i] * normal[:, j]
        - shear * (tangent[:, i] * normal[:, j] + normal[:, i] * tangent[:, j])
        for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    ]
    return normal_stress[:, None] * np.column_stack(unit)


def lateral_ratio(confined: float, shear: np.ndarray, strength: float | np.ndarray) -> np.ndarray:
    """Compute K, the stress along a layer over that normal to it, at rest.

    K is `confined`, that of an elastic layer, if |s| / sqrt(2) <= m p, m = 0.9 times the `strength`: a flow that starts
    at its yield surface would creep with every wave of pressure. Else K is the least with |s| / sqrt(2) = m p. Up to
    K = 1 both lateral stresses are K sigma_n, and with t = `shear`

        3 (1 - K)^2 + 9 t^2 = m^2 (1 + 2 K)^2;

    beyond, the stress across the slope is that in the middle of Mohr's circle, and

        (1 - K)^2 + 4 t^2 = m^2 (1 + K)^2.

    Where that has no solution, K = 1 + 2 t^2 mobilises the least strength, sin(theta) p.

    Parameters
    ----------
    confined : float [1]
        K of an elastic layer.
    shear : float64[n] [1]
        Shear stress along the layer over the stress normal to it, t.
    strength : float or float64[n] [1]
        As in `kirchhoff_stress`.

    Returns
    -------
    float64[n] [1]
    """
    m = USED * np.minimum(strength, STRONGEST)
    t2, m2 = shear**2, m**2
    low = np.maximum((3.0 + 2.0 * m2) ** 2 - (3.0 - 4.0 * m2) * (3.0 + 9.0 * t2 - m2), 0.0)
    high = m2 - t2 * (1.0 - m2)
    below = (3.0 + 9.0 * t2 - m2) / (3.0 + 2.0 * m2 + np.sqrt(low))
    beyond = (1.0 - m2 + 4.0 * t2) / (1.0 + m2 + 2.0 * np.sqrt(np.maximum(high, 0.0)))
    beyond = np.where(high > 0.0, beyond, 1.0 + 2.0 * t2)
    return np.maximum(np.where(shear <= m, below, beyond), confined)


def surface_slopes(x: np.ndarray, y: np.ndarray, height: np.ndarray, size: float) -> np.ndarray:
    """Compute the slope of the surface around each particle, that of a plane through it.

    Parameters
    ----------
    x, y, height : float64[n] [m]
        Of the surface above the particles.
    size : float [m]
        Side of the squares of a lattice. The plane is a least squares fit to the particles of 3 x 3 squares; where
        these are on a line or in a place, the slope is 0 along directions that they do not extend in.

    Returns
    -------
    float64[n, 2] [1]
        Along x and y.
    """
    east, north = (at - at.min() for at in (x, y))
    column, row = (np.floor(at / size).astype(np.int64) for at in (east, north))
    width = int(column.max()) + 3
    cells, of = np.unique((row + 1) * width + column + 1, return_inverse=True)
    of = of.reshape(-1)
    east, north, up = east / size - column, north / size - row, (height - height.mean()) / size
    pairs = (east, east), (east, north), (north, north), (east, up), (north, up)
    own = np.stack(
        [
            *(np.bincount(of, value, len(cells)) for value in (None, east, north, up)),
            *(np.bincount(of, one * other, len(cells)) for one, other in pairs),
        ]
    )
    total = np.zeros_like(own)
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            at = np.minimum(np.searchsorted(cells, cells + j * width + i), len(cells) - 1)
            n, sx, sy, sz, sxx, sxy, syy, sxz, syz = own[:, at] * (cells[at] == cells + j * width + i)
            moved = (n, sx + i * n, sy + j * n, sz)
            squares = (sxx + 2 * i * sx + i * i * n, sxy + i * sy + j * sx + i * j * n, syy + 2 * j * sy + j * j * n)
            total += (*moved, *squares, sxz + i * sz, syz + j * sz)
    n, sx, sy, sz, sxx, sxy, syy, sxz, syz = total
    xx, xy, yy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    spread = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    rise = np.stack([sxz - sx * sz / n, syz - sy * sz / n], axis=-1)
    planes = np.einsum("kij,kj->ki", np.linalg.pinv(spread, rcond=THIN, hermitian=True), rise)
    return planes[of]
