"""One step of the depth-averaged MPM in NumPy, as a scientist writes it first: reference for the solver's speed."""

import numpy as np

G = 9.81


def _axis(position, dx):
    s = position / dx + 1.0
    base = (s - 0.5).astype(np.int64)
    f = s - base
    weights = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])
    slopes = np.stack([f - 1.5, 2.0 - 2.0 * f, f - 0.5]) / dx
    return base, f, weights, slopes


def _bed(bed, x, y, dx):
    i, _, wx, gx = _axis(x, dx)
    j, _, wy, gy = _axis(y, dx)
    gradient = np.zeros((2, len(x)))
    for b in range(3):
        for a in range(3):
            value = bed[j + b, i + a]
            gradient[0] += wy[b] * gx[a] * value
            gradient[1] += gy[b] * wx[a] * value
    return gradient


def numpy_step(state, bed, node_gradient, dx, dt, kick, density, mu, xi, floor):
    """Advance `state` (dict of x, y, u, v, c float[2, 2, n], mass, area, gradient float[2, n], kappa) by `dt` [s].

    Velocities are accelerated for `kick` [s], from the middle of the last step to the middle of this one.
    Slope form, Voellmy, curvature on, open edges; the same arithmetic as the compiled step.
    """
    s = state
    shape, size = bed.shape, bed.size
    i, fx, wx, gx = _axis(s["x"], dx)
    j, fy, wy, gy = _axis(s["y"], dx)
    tx, ty = s["gradient"]
    c2 = 1.0 / (1.0 + tx * tx + ty * ty)
    push = 0.5 * kick * G * c2 * s["mass"] ** 2 / (density * s["area"])
    pull = kick * s["mass"] * G * c2
    mass, px, py, pk = (np.zeros(size) for _ in range(4))
    for b in range(3):
        for a in range(3):
            node = (j + b) * shape[1] + i + a
            w, dwx, dwy = wy[b] * wx[a], wy[b] * gx[a], gy[b] * wx[a]
            rx, ry = (a - fx) * dx, (b - fy) * dx
            mx = w * (s["mass"] * (s["u"] + s["c"][0, 0] * rx + s["c"][0, 1] * ry) - pull * tx)
            my = w * (s["mass"] * (s["v"] + s["c"][1, 0] * rx + s["c"][1, 1] * ry) - pull * ty)
            slope = c2 * (tx * dwx + ty * dwy)
            mass += np.bincount(node, w * s["mass"], size)
            px += np.bincount(node, mx + push * (dwx - tx * slope), size)
            py += np.bincount(node, my + push * (dwy - ty * slope), size)
            pk += np.bincount(node, w * s["mass"] * s["kappa"], size)
    wet = mass > 0
    u, v, kappa = (np.divide(p, mass, out=np.zeros(size), where=wet) for p in (px, py, pk))
    nx, ny = node_gradient[..., 0].ravel(), node_gradient[..., 1].ravel()
    cos = 1.0 / np.sqrt(1.0 + nx * nx + ny * ny)
    speed = np.sqrt(u * u + v * v + (u * nx + v * ny) ** 2)
    thickness = np.maximum(mass / (density * dx * dx), floor)
    reduced = np.maximum(speed - kick * mu * np.maximum(G + kappa, 0.0) * cos, 0.0)
    slowed = 2 * reduced / (1.0 + np.sqrt(1.0 + 4.0 * kick * G / (xi * thickness * cos) * reduced))
    factor = np.divide(slowed, speed, out=np.zeros(size), where=speed > 0)
    u, v = u * factor, v * factor
    n = len(s["x"])
    up, vp, grid_mass, c, du = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((2, 2, n)), np.zeros((2, 2, n))
    for b in range(3):
        for a in range(3):
            node = (j + b) * shape[1] + i + a
            w, dw, r = wy[b] * wx[a], (wy[b] * gx[a], gy[b] * wx[a]), (a - fx, b - fy)
            un, vn = u[node], v[node]
            up += w * un
            vp += w * vn
            grid_mass += w * mass[node]
            for k in range(2):
                c[0, k] += w * r[k] * un
                c[1, k] += w * r[k] * vn
                du[0, k] += dw[k] * un
                du[1, k] += dw[k] * vn
    stretch = (1 + dt * du[0, 0]) * (1 + dt * du[1, 1]) - dt * dt * du[0, 1] * du[1, 0]
    s["area"] = np.minimum(s["area"] * np.clip(stretch, 0.1, 10.0), 1000.0 * s["mass"] * dx * dx / grid_mass)
    s["x"], s["y"], s["c"] = s["x"] + dt * up, s["y"] + dt * vp, c * 4.0 / dx
    new = _bed(bed, s["x"], s["y"], dx)
    s["kappa"] = (up * (new[0] - tx) + vp * (new[1] - ty)) / dt
    w = up * tx + vp * ty
    out = (w - up * new[0] - vp * new[1]) / (1.0 + new[0] ** 2 + new[1] ** 2)
    turned = np.stack([up + out * new[0], vp + out * new[1], w - out])
    before, after = up * up + vp * vp + w * w, (turned**2).sum(axis=0)
    scale = np.sqrt(np.divide(before, after, out=np.ones(n), where=after > 0))
    s["u"], s["v"], s["gradient"] = turned[0] * scale, turned[1] * scale, new
