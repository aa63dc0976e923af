"""The collapse between walls by a second, small program in plane strain, with less dissipation in the transfer.

python tests/scenes/granular_column/plane_strain.py [--aspect 1 --cells 16 --rate 4 --courant 0.6]

Points carry the velocity that the grid cannot represent, v_p - sum w_i v_i, which fades at the rate r sqrt(g H) / dx;
APIC drops it in every step, however short the step is. Law, cells and stiffness are those of the scene; the grid and
the contact (rough ground, smooth wall) are its own. It separates what the law gives from what the transfer takes.
"""

import argparse
import sys
import tomllib
from pathlib import Path

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain

from mpmgis.compiled import law_functions as _laws  # noqa: F401  (registers the methods of laws)
from mpmgis.laws.material import FAR, mu_i
from mpmgis.laws.material_choice import stress_step, stress_step_far
from mpmgis.laws.softening import Softening

sand = chain.scene_module("granular_column")
LAW = tomllib.loads(Path(__file__).with_name("scene.toml").read_text())["material"]
PARAMETERS = ("mu1", "mu2", "inertial_number", "grain_diameter", "grain_density", "volume_correction")
APIC = np.inf  # rate at which all of the residual is dropped in a step
MARGIN = 4  # nodes below the ground and behind the wall
SHARE = 1.0 / sand.PER_CELL**2  # volume of a point [plane cells]


@numba.njit
def stencil(place):
    """First node, offset and weights along one axis; `place` [cells]."""
    base = int(place - 0.5)
    f = place - base
    return base, f, (0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2)


@numba.njit
def spread(place, velocity, affine, stress, density, push, before, after):
    """Momentum and mass of the points at the nodes, into `before`; the impulse of their stress is added to `after`.

    `before`, `after` float64[columns, levels, 3]; `push` is 4 dt / (dx density).
    """
    before[:] = 0.0
    mass = density * SHARE
    for p in range(len(place)):
        i0, fx, wx = stencil(place[p, 0])
        k0, fz, wz = stencil(place[p, 1])
        pushed = push * mass
        for i in range(3):
            for k in range(3):
                w, rx, rz = wx[i] * wz[k], i - fx, k - fz
                u = velocity[p, 0] + affine[p, 0] * rx + affine[p, 1] * rz
                v = velocity[p, 1] + affine[p, 2] * rx + affine[p, 3] * rz
                before[i0 + i, k0 + k, 0] += w * mass * u
                before[i0 + i, k0 + k, 1] += w * mass * v
                before[i0 + i, k0 + k, 2] += w * mass
                after[i0 + i, k0 + k, 0] -= w * pushed * (stress[p, 0] * rx + stress[p, 4] * rz)
                after[i0 + i, k0 + k, 1] -= w * pushed * (stress[p, 4] * rx + stress[p, 2] * rz)


@numba.njit
def move_nodes(before, after, fall):
    """Velocities before and after the step at the nodes: gravity, ground to which all sticks, smooth wall."""
    fastest = 0.0
    for i in range(before.shape[0]):
        for k in range(before.shape[1]):
            mass = before[i, k, 2]
            if mass <= 0.0:
                continue
            for a in range(2):
                before[i, k, a] /= mass
                after[i, k, a] = before[i, k, a] + after[i, k, a] / mass
            after[i, k, 1] -= fall
            if k <= MARGIN and after[i, k, 1] < 0.0:
                after[i, k, 0] = after[i, k, 1] = 0.0
            if i <= MARGIN:
                after[i, k, 0] = max(after[i, k, 0], 0.0)
            fastest = max(fastest, after[i, k, 0] ** 2 + after[i, k, 1] ** 2)
    return np.sqrt(fastest)


@numba.njit
def gather(place, velocity, affine, state, stress, before, after, dt, dx, kept, material, softening):
    """Velocity, place and stress of the points after the step; affine velocities are in m/s per cell."""
    for p in range(len(place)):
        i0, fx, wx = stencil(place[p, 0])
        k0, fz, wz = stencil(place[p, 1])
        old_u = old_v = u = v = xx = xz = zx = zz = 0.0
        for i in range(3):
            for k in range(3):
                w, rx, rz = wx[i] * wz[k], i - fx, k - fz
                here, there = after[i0 + i, k0 + k], before[i0 + i, k0 + k]
                old_u, old_v = old_u + w * there[0], old_v + w * there[1]
                u, v = u + w * here[0], v + w * here[1]
                xx, xz = xx + 4.0 * w * here[0] * rx, xz + 4.0 * w * here[0] * rz
                zx, zz = zx + 4.0 * w * here[1] * rx, zz + 4.0 * w * here[1] * rz
        velocity[p, 0] = u + kept * (velocity[p, 0] - old_u)
        velocity[p, 1] = v + kept * (velocity[p, 1] - old_v)
        affine[p, 0], affine[p, 1], affine[p, 2], affine[p, 3] = xx, xz, zx, zz
        place[p, 0] += dt / dx * u
        place[p, 1] += dt / dx * v
        s, g = state[p], dt / dx
        own = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
        gradient = g * xx, 0.0, g * xz, 0.0, 0.0, 0.0, g * zx, 0.0, g * zz
        new, loads, code = stress_step(material, softening, own, gradient, dt)
        if code == FAR:
            new, loads, code = stress_step_far(material, softening, own, gradient, dt)
        for e in range(8):
            state[p, e] = new[e]
        for e in range(6):
            stress[p, e] = loads[e]


@numba.njit
def collapse(place, shape, end, dx, density, gravity, sound, courant, fade, material, softening):
    """Places [cells] after `end` [s] of points that start at rest at `place` float64[n, 2]."""
    n = len(place)
    velocity, affine = np.zeros((n, 2)), np.zeros((n, 4))
    state, stress = np.zeros((n, 8)), np.zeros((n, 6))
    before, after = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    time = fastest = 0.0
    while time < end:
        dt = courant * dx / (sound + fastest)
        after[:] = 0.0
        spread(place, velocity, affine, stress, density, dt * 4.0 / (dx * density), before, after)
        fastest = move_nodes(before, after, dt * gravity)
        gather(place, velocity, affine, state, stress, before, after, dt, dx, np.exp(-fade * dt), material, softening)
        time += dt
    return place


def runout(column, rate, courant=0.6, stiff=sand.STIFF):
    """Runout [L0] within which 99 % of the mass lie at the end, of a plane Column; `rate` r, or APIC."""
    numbers = {key: value for key, value in LAW.items() if key in PARAMETERS}
    material = mu_i(*sand.moduli(column, stiff), **numbers)
    sound = np.sqrt((material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus) / sand.DENSITY)
    counts = [round(side / column.cell * sand.PER_CELL) for side in (sand.LENGTH, column.height)]
    axes = [(np.arange(count) + 0.5) / sand.PER_CELL + MARGIN for count in counts]
    place = np.column_stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")])
    fade = rate / column.fall * column.height / column.cell if np.isfinite(rate) else 1e300
    shape = int(2.5 * column.measured * sand.LENGTH / column.cell) + counts[0] + 20, counts[1] + 20
    place = collapse(
        place,
        shape,
        sand.FALLS * column.fall,
        column.cell,
        sand.DENSITY,
        sand.GRAVITY,
        sound,
        courant,
        fade,
        material,
        Softening(),
    )
    return float(np.quantile(place[:, 0] - MARGIN, 0.99)) * column.cell / sand.LENGTH - 1.0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--aspect", type=float, default=1.0, help="height over length")
    parser.add_argument("--cells", type=int, default=16, help="over the smaller of the two")
    parser.add_argument("--rate", type=float, default=4.0, help="at which residual velocities fade; inf: APIC")
    parser.add_argument("--courant", type=float, default=0.6)
    asked = parser.parse_args()
    print(f"{runout(sand.Column(asked.aspect, asked.cells), asked.rate, asked.courant):.3f}")


if __name__ == "__main__":
    main()
