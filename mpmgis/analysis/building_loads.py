"""Estimates of the load of an undisturbed flow on the outline of buildings, over time.

A piece of outline that faces the flow bears, per width, the drag C_d rho v^2 h / 2 of a pressure that is uniform over
the depth h, with its resultant at h / 2, and the hydrostatic force rho g h^2 / 2, with its resultant at h / 3. C_d = 2
is the momentum flux rho h v^2 of a flow that the wall stops (balance of momentum).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from ..fields import GRAVITY

BANDS = ("h", "Ut_E", "Ut_N", "Ut")
FIELDS = {  # attribute: unit, meaning; each has its time in <attribute>_t, but the height
    "flow_depth": ("m", "largest flow depth at the outline"),
    "flow_speed": ("m s-1", "largest speed along the slope at the outline"),
    "flow_press": ("Pa", "largest pressure at the foot: C_d rho v^2 / 2 + rho g h"),
    "flow_fwidth": ("N m-1", "largest force per width of a piece of outline"),
    "flow_force": ("N", "largest force on the outline that faces the flow"),
    "flow_moment": ("N m", "largest moment of that force about the foot"),
    "flow_height": ("m", "height of the resultant over the foot at the time of the largest force"),
}
TIMED = tuple(name for name in FIELDS if name != "flow_height")
DIRECTIONS = 72  # tried for a flow at rest, which presses on all sides
STILL = 1e-9  # of the speed of the pieces: a smaller mean velocity has no direction


@dataclass(frozen=True)
class Outline:
    """Pieces of a building's outer outline.

    `x`, `y` float64[n] [m]: where the flow is taken, in front of the middle of each piece; `normal` float64[n, 2]:
    outward unit normal; `length` float64[n] [m].
    """

    x: np.ndarray
    y: np.ndarray
    normal: np.ndarray
    length: np.ndarray


def outline_of(shape: shapely.Geometry, cell_size: float) -> Outline:
    """The Outline of a polygon or multipolygon, in pieces of at most half a cell.

    The flow of a piece is that half a cell in front of it, so that a building that stands in the terrain has the flow
    at its walls and not that on its roof. Courtyards are not loaded.
    """
    places, normals, lengths = [], [], []
    for polygon in shapely.get_parts(shape):
        ring = np.asarray(orient(polygon).exterior.coords)[:, :2]  # counter-clockwise
        for start, end in pairwise(ring):
            side = float(np.hypot(*(end - start)))
            if side == 0.0:
                continue
            count = max(1, int(np.ceil(2.0 * side / cell_size)))
            along = (end - start) / side
            outward = np.array([along[1], -along[0]])
            middles = (np.arange(count) + 0.5)[:, None] * side / count
            places.append(start + middles * along + 0.5 * cell_size * outward)
            normals.append(np.tile(outward, (count, 1)))
            lengths.append(np.full(count, side / count))
    x, y = np.concatenate(places).T
    return Outline(x, y, np.concatenate(normals), np.concatenate(lengths))


def line_loads(depth: np.ndarray, speed: np.ndarray, density: float, drag: float) -> tuple:
    """(force [N m-1], moment about the foot [N], pressure at the foot [Pa]) per width of a flow against a wall.

    Parameters
    ----------
    depth : float64[...] [m]
    speed : float64[...] [m s-1]
    density : float [kg m-3]
    drag : float [1]
        C_d.
    """
    dynamic = 0.5 * drag * density * speed**2
    static = density * GRAVITY * depth
    force = dynamic * depth + 0.5 * static * depth
    moment = dynamic * depth**2 / 2.0 + static * depth**2 / 6.0
    return force, moment, np.where(depth > 0, dynamic + static, 0.0)


def largest_loads(
    outline: Outline, times: Sequence, values: dict, density: float, drag: float, min_depth: float
) -> dict[str, float]:
    """Largest loads of a building over time.

    Parameters
    ----------
    outline : Outline
    times : sequence of float [s]
    values : dict of str to float64[times, n]
        BANDS at the pieces of the outline; NaN where there is no flow.
    density : float [kg m-3]
    drag : float [1]
        C_d.
    min_depth : float [m]
        Flow shallower than this does not load.

    Returns
    -------
    dict of str to float
        FIELDS, and `<name>_t` [s] for those of TIMED. Without flow: zeros, and NaN for times and height.
    """
    wet = np.nan_to_num(values["h"]) >= min_depth
    depth, speed, east, north = (np.where(wet, np.nan_to_num(values[name]), 0.0) for name in ("h", "Ut", *BANDS[1:3]))
    force, moment, pressure = line_loads(depth, speed, density, drag)
    total = np.array([_facing(outline, *row) for row in zip(east, north, force, moment, strict=True)])
    series = dict(zip(TIMED, (*(v.max(axis=1) for v in (depth, speed, pressure, force)), *total.T), strict=True))
    found = {}
    for name, one in series.items():
        k = int(np.argmax(one))
        found[name] = float(one[k])
        found[f"{name}_t"] = float(times[k]) if one[k] > 0 else np.nan
    k = int(np.argmax(total[:, 0]))
    found["flow_height"] = float(total[k, 1] / total[k, 0]) if total[k, 0] > 0 else np.nan
    return found


def _facing(outline, east, north, force, moment):
    """(force [N], moment [N m]) on the pieces that face the flow; of one at rest from where they are largest."""
    mean = np.array([outline.length @ east, outline.length @ north])
    size = float(np.hypot(*mean))
    if size > STILL * outline.length.sum():
        directions = mean[None] / size
    else:
        angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    width = np.clip(-directions @ outline.normal.T, 0.0, None) * outline.length
    forces = width @ force
    k = int(np.argmax(forces))
    return forces[k], width[k] @ moment
