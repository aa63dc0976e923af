"""What takes energy in a 3D run, measured step by step in a plain loop that knows nothing of the solver's own bookings.

A step changes the energy of the nodes by the impulses of stress, weight and contact. With the velocity v after the
step an impulse J does the work J . v, and |sum of J|^2 / 2 m is lost to the length of the step. The weight's work is
the potential energy that the points lose. The stress' is V tau : C dt of each point, with the stress before the step.
An elastic material takes the mean of that and of the same with the stress after the step; the difference is gained by
the length of the step, and nearly makes up for its loss in a body that swings. The rest is lost in the two transfers:
the energy of the points, with that of their affine velocity m (dx / 2)^2 |C|^2 / 2, less that of the nodes.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from plain_points import GHOSTS, compiled_step, plain_step, yields_of

from mpmgis.laws.friction import parameters_of
from mpmgis.laws.material import ELASTIC
from mpmgis.laws.material_choice import state_at_stress, wave_speed
from mpmgis.laws.softening import Softening

without_drag = cache(compiled_step)
TAKERS = ("ground", "transfers", "steps", "material")


@dataclass
class PlainRun:
    """Points of `solver` marched by `plain_step` on planes, with Coulomb's or Voellmy's contact; `lost` [J] by taker.

    What layers of a flow with drag lose to each other is in that of the ground.

    `material` is the work of the stress [J]: what the material stores and what its yielding takes. Points that leave
    the domain are taken out with their energy, `out` [J].
    """

    solver: object
    frame: object
    step: float
    lost: dict = field(default_factory=lambda: dict.fromkeys(TAKERS, 0.0))
    out: float = 0.0

    def __post_init__(self):
        particles, n = self.frame.particles, len(self.frame.particles)
        corner = self.solver._corner_from((0.0, 0.0, 0.0))
        self.place, self.velocity = particles.position - corner, particles.velocity.copy()
        self.affine, self.mass = np.zeros((n, 3, 3)), particles.mass.copy()
        self.stress, self.yields = np.zeros((n, 6)), yields_of(self.solver)
        self.numerics, self.material = self.solver.numerics, self.solver.effects.material
        self.state = np.column_stack(state_at_stress(self.material, tuple(self.stress.T)))

    def march(self, steps):
        for _ in range(steps):
            self._one_step()
        return self

    def _one_step(self):
        """A plain step between two looks at the energy of the points and of the nodes."""
        numerics, dx, dt = self.numerics, self.numerics.cell_size, self.step
        ground = self.solver._ground[..., :3]
        nodes = np.zeros((int(self.place[:, 2].max() / dx) + 14, *ground.shape[:2], 4))
        shares, away = self._weights(nodes.shape)
        free = self._on_nodes(shares, away, self.affine)
        volume = self.mass / numerics.density
        pushed = -4.0 * dt / dx**2 * volume[:, None, None] * self._tensor()
        impulse = np.einsum("nk,nab,nkb->nka", shares[1], pushed, away)
        before, stress, pressed = self.energy(), self.stress.copy(), np.empty_like(nodes)
        law = parameters_of(self.solver.effects.contact)
        drag = law.get("xi", 0.0)
        step = plain_step if drag else without_drag()
        step(
            self.place,
            self.velocity,
            self.affine,
            self.mass,
            self.state,
            self.stress,
            nodes,
            ground,
            self.yields,
            dx,
            dt,
            numerics.density,
            numerics.gravity,
            law["mu"],
            self.material,
            Softening(),
            wave_speed(self.material, numerics.density),
            drag,
            pressed,
        )
        self._book(nodes.reshape(-1, 4), pressed.reshape(-1, 4), shares, free, impulse, before)
        if self.material.kind == ELASTIC:
            gained = 0.5 * dt * (volume * ((self.stress - stress) * self._strain_rate()).sum(axis=1)).sum()
            self.lost["material"] += gained
            self.lost["steps"] -= gained
        self._let_out()

    def _book(self, nodes, pressed, shares, free, impulse, before):
        """Add the losses of the step that made `nodes` velocities of momenta `free` [kg m s-1] without forces.

        Node columns are `pressed` before single nodes far below the ground are held: each impulse does its own work.
        """
        mass = nodes[:, 3]
        wet = mass > 0.0
        mass, after, between = mass[wet], nodes[wet, :3], pressed[wet, :3]
        stressed = np.zeros((nodes.shape[0], 3))
        np.add.at(stressed, shares[0], impulse)
        free, stressed = free[wet] / mass[:, None], stressed[wet] / mass[:, None]
        weight = np.array([0.0, 0.0, -self.step * self.numerics.gravity])
        contact = after - free - stressed - weight
        at_nodes = [0.5 * (mass * (v**2).sum(axis=1)).sum() for v in (free, after)]
        first = contact - (after - between)
        earlier = (mass * (first * (between - after)).sum(axis=1)).sum()
        self.lost["ground"] -= (mass * (contact * after).sum(axis=1)).sum() + earlier
        self.lost["material"] -= (mass * (stressed * after).sum(axis=1)).sum()
        self.lost["steps"] += 0.5 * (mass * ((after - free) ** 2).sum(axis=1)).sum() + earlier
        self.lost["transfers"] += before - at_nodes[0] + at_nodes[1] - self.energy()

    def energy(self):
        """Kinetic energy [J] of the points with that of their affine velocity."""
        affine = 0.25 * self.numerics.cell_size**2 * (self.affine**2).sum(axis=(1, 2))
        return float(0.5 * (self.mass * ((self.velocity**2).sum(axis=1) + affine)).sum())

    def affine_energy(self):
        return float(0.125 * self.numerics.cell_size**2 * (self.mass * (self.affine**2).sum(axis=(1, 2))).sum())

    def _tensor(self):
        return self.stress[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]

    def _strain_rate(self):
        """Strain rate [n, 6] [s-1] of the points, the shear parts doubled."""
        c = self.affine
        shear = (c[:, a, b] + c[:, b, a] for a, b in ((0, 1), (0, 2), (1, 2)))
        return np.stack([c[:, 0, 0], c[:, 1, 1], c[:, 2, 2], *shear], axis=1)

    def _weights(self, shape):
        """((nodes, weights) [n, 27], offsets of the nodes [n, 27, 3] in m)."""
        s = self.place / self.numerics.cell_size + GHOSTS
        base = (s - 0.5).astype(int)
        f = s - base
        one = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])  # [3, n, axis]
        k, j, i = (part.ravel() for part in np.meshgrid(*3 * [np.arange(3)], indexing="ij"))
        at = np.ravel_multi_index((base[:, [2]] + k, base[:, [1]] + j, base[:, [0]] + i), shape[:3])
        weight = (one[i, :, 0] * one[j, :, 1] * one[k, :, 2]).T
        offset = (np.stack([i, j, k], axis=-1)[None] - f[:, None]) * self.numerics.cell_size
        return (at, weight, int(np.prod(shape[:3]))), offset

    def _on_nodes(self, shares, away, affine):
        """Momentum [kg m s-1] that the points bring to the nodes, stress and weight left out."""
        at, weight, count = shares
        moved = self.velocity[:, None] + np.einsum("nab,nkb->nka", affine, away)
        momentum = np.zeros((count, 3))
        np.add.at(momentum, at, (weight * self.mass[:, None])[..., None] * moved)
        return momentum

    def _let_out(self):
        """Take out the points that left the domain; what they had is `out`, their affine velocity went with them."""
        ny, nx = self.solver.grid.inside.shape
        x, y = self.place[:, 0], self.place[:, 1]
        dx = self.numerics.cell_size
        gone = (x < 0) | (y < 0) | (x >= nx * dx) | (y >= ny * dx)
        if not gone.any():
            return
        affine = self.affine_energy()
        speed2 = (self.velocity[gone] ** 2).sum(axis=1)
        self.out += (self.mass[gone] * (0.5 * speed2 + self.numerics.gravity * self.place[gone, 2])).sum()
        for name in ("place", "velocity", "affine", "mass", "state", "stress"):
            setattr(self, name, getattr(self, name)[~gone])
        self.lost["transfers"] += affine - self.affine_energy()
