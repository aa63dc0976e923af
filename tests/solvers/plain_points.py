"""One step of the 3D MPM as a plain loop over points and nodes: the oracle of the solver's kernels.

Runs as Python, and compiled as it stands, which is the scalar version that the benchmark compares with.
"""

import importlib.util
import sys

import numba
import numpy as np

from mpmgis.laws.material_choice import stress_step

COMPILED = (
    "stencil",
    "carried",
    "yielding",
    "beyond",
    "on_slope",
    "ratio",
    "depth_of",
    "across_of",
    "shares_of",
    "press",
    "hold",
    "limited",
    "plain_step",
)
GHOSTS = 4  # nodes before the domain's corner, which the solver has too
LEAST_SHARE, LIGHTEST = 0.35, 0.1
LAYER, MOST_YIELD = 20.0, 0.2  # [cells] of the ground that yields
BENEATH = 1.5  # [cells] under the ground, from which nodes are held one by one
GRIPPED, THIN, STILL, BENT = 2.0, 0.75, 1e-3, 0.02  # where the affine velocity is limited


def compiled_step():
    """`plain_step` compiled as it stands, of flows without drag on the ground."""
    spec = importlib.util.spec_from_file_location("compiled_plain_points", __file__)
    copy = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = copy
    spec.loader.exec_module(copy)
    options = {"fastmath": {"nsz"}, "error_model": "numpy"}
    for name in COMPILED:
        setattr(copy, name, numba.njit(**options)(getattr(copy, name)))
    copy.couple = numba.njit(lambda *_: None)
    return copy.plain_step


def stencil(place, dx):
    """First node, offset and weights along one axis."""
    s = place / dx + GHOSTS
    base = int(s - 0.5)
    f = s - base
    return base, f, (0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2)


def covered(nodes, j, i):
    """Share of its bed that a node column stands on: less than 1 where it has under five sixths of the mass of the
    heaviest around it."""
    heaviest = 0.0
    for b in range(j - 1, j + 2):
        for a in range(i - 1, i + 2):
            heaviest = max(heaviest, nodes[:, b, a, 3].sum())
    return min(nodes[:, j, i, 3].sum() / (5.0 / 6.0 * heaviest), 1.0)


def roughness(xi, gravity):
    """z0 / h of a bed whose log law has the depth mean sqrt(xi / g) times the shear velocity, by bisection."""
    low, high, asked = -200.0, 20.0, 0.4 * np.sqrt(xi / gravity)
    for _ in range(200):
        middle = 0.5 * (low + high)
        r = np.exp(middle)
        low, high = (middle, high) if (1.0 + r) * np.log(1.0 + 1.0 / r) - 1.0 > asked else (low, middle)
    return np.exp(low)


def column_of(nodes, j, i, level, foot, full):
    """(levels, heights above the ground in cells, splines there) of the contiguous nodes of a column."""
    levels = []
    for k in range(level - 1, nodes.shape[0]):
        mass = nodes[k, j, i, 3]
        if mass <= 0.0 and (levels or k > level):
            break
        below = nodes[k - 1, j, i, 3]
        if mass > 0.0:
            if levels and k > level + 1 and below < 0.25 * full and mass > below:
                break
            levels.append(k)
    offset = np.array(levels) - level
    spline = {-1: 0.5 * (0.5 - foot) ** 2, 0: 0.75 - foot * foot, 1: 0.5 * (0.5 + foot) ** 2}
    return levels, offset - foot, np.array([spline.get(k, 0.0) for k in offset])


def couple(nodes, ground, dx, dt, density, gravity, mu, xi, slack):
    """Voellmy's drag and the links between layers, of velocities at `nodes`, as one dense system for each column."""
    rough, moved = roughness(xi, gravity), nodes.copy()
    for j in range(1, nodes.shape[1] - 1):
        for i in range(1, nodes.shape[2] - 1):
            if nodes[:, j, i, 3].max() == 0.0:
                continue
            height, sx, sy = ground[j, i, 0], ground[j, i, 1], ground[j, i, 2]
            nz = 1.0 / np.sqrt(1.0 + sx * sx + sy * sy)
            normal = np.array([-sx, -sy, 1.0]) * nz
            place = height / dx + GHOSTS
            level = int(place + 0.5)
            share = covered(nodes, j, i)
            at, above, spline = column_of(nodes, j, i, level, place - level, share * density * dx**3)
            if not at:
                continue
            mass = nodes[at, j, i, 3]
            if (spline * mass).sum() < LEAST_SHARE * mass[:4].max() or (spline * mass).sum() == 0.0:
                continue
            velocity = nodes[at, j, i, :3]
            along = velocity - np.outer(velocity @ normal, normal)
            bed, momentum = share * dx * dx / nz, mass @ along
            speed = np.sqrt(momentum @ momentum) / mass.sum()
            kept = 2.0 / (1.0 + np.sqrt(1.0 + 4.0 * density * gravity * dt * bed / mass.sum() * speed / xi))
            push = np.outer((kept - 1.0) * mass * spline / (mass * spline).sum(), momentum)
            z = np.maximum(above, 0.5) * dx * nz + rough * mass.sum() / (density * bed)
            slip = np.sqrt((np.diff(along, axis=0) ** 2).sum(axis=1))
            turbulent = density * bed * 0.16 * slip / np.maximum(np.log(z[1:] / z[:-1]), 0.05) ** 2
            dry = slack * mu * mass.sum() * gravity * nz / np.maximum(slip, 1e-3 * np.sqrt(gravity * dx))
            link = dt * (mass.sum() - np.cumsum(mass)[:-1]) / mass.sum() * (turbulent + dry)
            system = np.diag(mass)
            for k, of in enumerate(link):
                system[k : k + 2, k : k + 2] += of * np.array([[1.0, -1.0], [-1.0, 1.0]])
            after = np.linalg.solve(system, mass[:, None] * along + push)
            moved[at, j, i, :3] += after - along
    nodes[:] = moved


def yields_of(solver):
    """float64[rows, columns] [m]: yield of the ground at the solver's start, -1 where nothing lies on it."""
    start = solver.arrays.yields[0]
    return np.where(start[..., 1] == 1.0, start[..., 0], -1.0)


def carried(yields, j, i, east, north, weighed):
    """Yield of the ground under a node column, which moves with the flow, by a step of `east` and `north` [cells].

    What comes along makes it at most `weighed` [m], that under the column's weight."""
    own = yields[j, i]
    beside = yields[j, i - 1], yields[j, i + 1], yields[j - 1, i], yields[j + 1, i]
    if own < 0.0:
        total = count = 0.0
        for value in beside:
            if value >= 0.0:
                total, count = total + value, count + 1.0
        return min(total / max(count, 1.0), weighed)
    behind = beside[0] if east > 0.0 else beside[1]
    moved = own + (abs(east) * (behind - own) if behind >= 0.0 else 0.0)
    behind = beside[2] if north > 0.0 else beside[3]
    moved += abs(north) * (behind - own) if behind >= 0.0 else 0.0
    return max(min(moved, max(own, weighed)), 0.0)


def yielding(into, give, yielded, impedance, back, most, dt):
    """Normal impulse of ground that yields, and its yield after it."""
    normal = max(dt * impedance * (into + yielded / back) / (1.0 + dt * impedance * give), 0.0)
    if yielded + dt * (into - normal * give) > most:
        normal = max((into - max(most - yielded, 0.0) / dt) / give, normal)
    if normal > 0.0:
        return normal, max(yielded + dt * (into - normal * give), 0.0)
    return 0.0, yielded * np.exp(-dt / back)


def beyond(away, power):
    """Integral of r^power w(r) over the distances r > `away` [cells] from a node, by Gauss points in each piece of the
    spline w."""
    total = 0.0
    for low, high in ((-1.5, -0.5), (-0.5, 0.5), (0.5, 1.5)):
        low = min(max(low, away), high)
        for x, weight in ((-np.sqrt(0.6), 5.0 / 18.0), (0.0, 8.0 / 18.0), (np.sqrt(0.6), 5.0 / 18.0)):
            r = 0.5 * (low + high) + 0.5 * (high - low) * x
            w = 0.75 - r * r if abs(r) < 0.5 else 0.5 * (1.5 - abs(r)) ** 2
            total += weight * (high - low) * r**power * w
    return total


def on_slope(away, rise):
    """(weight, place) of Gauss's five points of a mean with the spline as weight along a slope."""
    near, far, inner, outer = 0.5877982813242693, 1.125241444035807, 0.2421323233425994, 0.03265097603233586
    return (
        (1.0 - 2.0 * (inner + outer), away),
        (inner, away - near * rise),
        (inner, away + near * rise),
        (outer, away - far * rise),
        (outer, away + far * rise),
    )


def ratio(away, rise):
    """Share of a node in the contact, over its mass, of a space filled above ground `away` [cells] above the node that
    rises by `rise`, and the part of its mass."""
    pressed = filled = 0.0
    for weight, there in on_slope(away, rise):
        pressed += weight * 4.0 * beyond(there, 1)
        filled += weight * beyond(there, 0)
    return pressed / max(filled, 1e-9)


def across_of(foot, rise, normal, masses, heaviest, shares):
    """Shares of the nodes as `shares_of` in the horizontal component of the normal impulse.

    On level ground they differ from `shares` by the spline across the line of nodes less its integral along it. On a
    slope s along an axis the difference of that component is 1 - s^2 of it; both axes count with what the push has.
    """
    across, away = normal[0] ** 2 + normal[1] ** 2, foot - np.arange(-2.0, 3.0)
    part = 0.0
    for n in range(2):
        if across > 0.0:
            part += normal[n] ** 2 / across * (1.0 - (normal[n] / normal[2]) ** 2)
    if part <= 0.0:
        return shares
    level = np.zeros(5)
    for n, a in enumerate(away):
        for weight, there in on_slope(a, rise):
            spline = 0.75 - there * there if abs(there) < 0.5 else 0.5 * max(1.5 - abs(there), 0.0) ** 2
            level[n] += weight * (spline - 4.0 * beyond(there, 1))
    more = part * depth_of(foot, masses) * level
    more = np.minimum(np.maximum(more, -shares), np.maximum(masses / (LIGHTEST * heaviest) - shares, 0.0))
    moment = more @ np.arange(-2.0, 3.0)
    more[2] -= more.sum() - moment
    more[3] -= moment
    return shares + more


def depth_of(foot, masses):
    """How deep the flow is at the ground, 0 to 1, from the centre of the masses of the nodes -2 to 2."""
    near = masses * np.array([0.5 - foot, 1.0, 1.0, 1.0, 0.5 + foot])
    centre = near @ (np.arange(-2.0, 3.0) - foot) / max(near.sum(), 1e-300)
    return min(max(centre / 0.75, 0.0), 1.0)


def shares_of(foot, rise, masses, heaviest):
    """Shares of the nodes -2 to 2 levels above the one nearest to the ground, whose place is `foot` [cells]."""
    away = foot - np.arange(-2.0, 3.0)
    shares = np.zeros(5)
    for n, a in enumerate(away):
        limit = max(min(1.0 - 0.5 * a, 2.5 + a), 0.0)
        shares[n] = min(ratio(a, rise) * masses[n] / heaviest, limit)
    weights = np.maximum((1.0 - away) * (2.0 + away), 0.0)
    powers = np.stack((np.ones(5), -away))
    change = np.linalg.solve((weights * powers) @ powers.T, np.array([1.0, 0.0]) - powers @ shares)
    shares = np.clip(shares + weights * (change @ powers), 0.0, 6.0 * masses / heaviest)
    part = depth_of(foot, masses)
    spline = np.array([0.0, 0.5 * (0.5 - foot) ** 2, 0.75 - foot * foot, 0.5 * (0.5 + foot) ** 2, 0.0])
    return part * shares / max(shares.sum(), 1e-300) + (1.0 - part) * spline


def press(nodes, ground, yields, dx, dt, density, gravity, sound, mu):
    """Contact of all node columns with the ground, of velocities at `nodes`; `yields` [m], -1 where nothing was."""
    moved, before = nodes.copy(), yields.copy()
    yields[:] = -1.0
    for j in range(1, nodes.shape[1] - 1):
        for i in range(1, nodes.shape[2] - 1):
            if nodes[:, j, i, 3].max() == 0.0:
                continue
            height, sx, sy = ground[j, i, 0], ground[j, i, 1], ground[j, i, 2]
            steep = np.sqrt(1.0 + sx * sx + sy * sy)
            normal = np.array([-sx, -sy, 1.0]) / steep
            place = height / dx + GHOSTS
            level = int(place + 0.5)
            foot = place - level
            around = np.arange(max(level - 2, 0), level + 3)
            masses = nodes[around, j, i, 3]
            heaviest, centre = masses.max(), masses @ (around - level).astype(np.float64) / max(masses.sum(), 1e-300)
            if heaviest <= 0.0:
                continue
            if centre < foot:
                lower = int(np.floor(centre + 0.5))
                level, foot = level + lower, centre - lower
            weights = 0.0, 0.5 * (0.5 - foot) ** 2, 0.75 - foot * foot, 0.5 * (0.5 + foot) ** 2, 0.0
            near = nodes[level - 2 : level + 3, j, i]
            v, give, here, rise = np.zeros(3), 0.0, 0.0, np.sqrt(steep * steep - 1.0)
            shares = shares_of(foot, rise, near[:, 3], heaviest)
            across, pushed = across_of(foot, rise, normal, near[:, 3], heaviest, shares), np.zeros(5)
            speed = give_across = both = 0.0
            for k in range(5):
                mass = near[k, 3]
                if mass > 0.0:
                    pushed[k] = 1.0 / max(mass, LIGHTEST * max(shares[k], abs(across[k])) * heaviest)
                    v += shares[k] * near[k, :3]
                    speed -= (across[k] - shares[k]) * (near[k, 0] * normal[0] + near[k, 1] * normal[1])
                    give += shares[k] ** 2 / max(mass, LIGHTEST * shares[k] * heaviest)
                    give_across += across[k] ** 2 * pushed[k]
                    both += across[k] * shares[k] * pushed[k]
                    here += weights[k] * mass
            if here < LEAST_SHARE * heaviest or give <= 0.0:
                continue
            if np.all(across == shares):
                give_across = both = give
            into = speed - (v @ normal)
            give_normal = give * normal[2] ** 2 + give_across * (1.0 - normal[2] ** 2)
            back, cells = LAYER * dx / sound, nodes[:, j, i, 3].sum() / heaviest
            rubs = 1.0 - mu < 1.0  # as in the kernel: a smaller friction is none in floating point
            if rubs:
                weighed = min(back * gravity * cells * dx / (steep * steep * sound), MOST_YIELD * dx)
                yielded = carried(before, j, i, v[0] * dt / dx, v[1] * dt / dx, weighed)
                impedance = sound * heaviest * steep / dx
            rubbed = np.zeros(3)
            for _ in range(2 if rubs and both != give else 1):
                onto = into - (both - give) * (rubbed[:2] @ normal[:2])
                pressed = max(onto, 0.0) / give_normal
                if rubs:
                    pressed, yields[j, i] = yielding(onto, give_normal, yielded, impedance, back, MOST_YIELD * dx, dt)
                moving = v + pressed * (both - give) * np.array([normal[0], normal[1], 0.0])
                along = moving - (moving @ normal) * normal
                slip = np.sqrt(along @ along)
                kept = 1.0
                if slip > 0.0:
                    kept = max(0.0, 1.0 - mu * pressed * give / slip)
                rubbed = (kept - 1.0) / give * along
            for k in range(5):
                if near[k, 3] > 0.0:
                    push = shares[k] * rubbed
                    push[:2] += across[k] * pressed * normal[:2]
                    push[2] += shares[k] * pressed * normal[2]
                    moved[level - 2 + k, j, i, :3] += pushed[k] * push
    nodes[:] = moved


def hold(nodes, ground, dx, mu):
    """Contact of single nodes far under the ground, of velocities at `nodes`."""
    for j in range(nodes.shape[1]):
        for i in range(nodes.shape[2]):
            height, sx, sy = ground[j, i, 0], ground[j, i, 1], ground[j, i, 2]
            normal = np.array([-sx, -sy, 1.0]) / np.sqrt(1.0 + sx * sx + sy * sy)
            for k in range(nodes.shape[0]):
                node = nodes[k, j, i]
                into = -(node[:3] @ normal)
                if node[3] <= 0.0 or (k - GHOSTS) * dx - height > -BENEATH * dx or into <= 0.0:
                    continue
                along = node[:3] + into * normal
                slip = np.sqrt(along @ along)
                node[:3] = along * max(0.0, 1.0 - mu * into / slip) if slip > 0.0 else along


def limited(own, variance, mass_near, above, dx, density, signal_speed):
    """The share of its velocity gradient that a point carries on, whose nodes have `mass_near` [kg] around it.

    `own` is |C|^2 dx^2 / 4, `variance` that of the nodes' velocities about the point's, `above` [cells] the height.
    """
    dense, still = mass_near >= THIN * density * dx**3, own <= (STILL * signal_speed) ** 2
    if above < GRIPPED or dense or still or own >= (1.0 - BENT) * variance:
        return 1.0
    return (own / variance) ** 4


def plain_step(
    place,
    velocity,
    affine,
    mass,
    state,
    stress,
    nodes,
    ground,
    yields,
    dx,
    dt,
    density,
    gravity,
    mu,
    material,
    soft,
    sound,
    xi=0.0,
    pressed=None,
):
    """Advance by `dt` [s]; all arrays are changed in place.

    Parameters
    ----------
    place, velocity : float64[n, 3] [m], [m s-1]
        From the corner of the domain at its lowest level.
    affine : float64[n, 3, 3] [s-1]
    mass : float64[n] [kg]
    state : float64[n, 8]
    stress : float64[n, 6] [Pa]
    nodes : float64[layers, rows, columns, 4]
        Room for mass and momentum.
    ground : float64[rows, columns, 3]
        Elevation [m] and slopes.
    yields : float64[rows, columns] [m]
        By which the ground yields, -1 where nothing touches it.
    sound : float [m s-1]
        Speed of pressure waves.
    xi : float [m s-2], optional
        Of Voellmy's drag on the ground; 0: none.
    pressed : float64[layers, rows, columns, 4], optional
        Out: `nodes` after the contact of node columns, before that of single nodes.

    Returns
    -------
    int
        Points whose affine velocity was limited.
    """
    count = 0
    nodes[:] = 0.0
    for p in range(len(mass)):
        i0, fx, wx = stencil(place[p, 0], dx)
        j0, fy, wy = stencil(place[p, 1], dx)
        k0, fz, wz = stencil(place[p, 2], dx)
        push = dt * 4.0 / (dx * dx) * mass[p] / density
        xx, yy, zz, xy, xz, yz = stress[p]
        for k in range(3):
            for j in range(3):
                for i in range(3):
                    w = wx[i] * wy[j] * wz[k]
                    r = (i - fx) * dx, (j - fy) * dx, (k - fz) * dx
                    node, c = nodes[k0 + k, j0 + j, i0 + i], affine[p]
                    pushes = (
                        push * (xx * r[0] + xy * r[1] + xz * r[2]),
                        push * (xy * r[0] + yy * r[1] + yz * r[2]),
                        push * (xz * r[0] + yz * r[1] + zz * r[2]),
                    )
                    for a in range(3):
                        moved = velocity[p, a] + c[a, 0] * r[0] + c[a, 1] * r[1] + c[a, 2] * r[2]
                        node[a] += w * (mass[p] * moved - pushes[a])
                    node[3] += w * mass[p]
    for node in nodes.reshape(-1, 4):
        if node[3] > 0.0:
            node[:3] /= node[3]
            node[2] -= dt * gravity
    if xi > 0.0:
        couple(nodes, ground, dx, dt, density, gravity, mu, xi, 0.0 if material.shear_modulus > 0.0 else 1.0)
    press(nodes, ground, yields, dx, dt, density, gravity, sound, mu)
    if pressed is not None:
        pressed[:] = nodes
    hold(nodes, ground, dx, mu)
    for p in range(len(mass)):
        i0, fx, wx = stencil(place[p, 0], dx)
        j0, fy, wy = stencil(place[p, 1], dx)
        k0, fz, wz = stencil(place[p, 2], dx)
        new, gradient = velocity[p], affine[p]
        new[:] = 0.0
        gradient[:] = 0.0
        for k in range(3):
            for j in range(3):
                for i in range(3):
                    w = wx[i] * wy[j] * wz[k]
                    node = nodes[k0 + k, j0 + j, i0 + i]
                    r = (i - fx) * dx, (j - fy) * dx, (k - fz) * dx
                    for a in range(3):
                        new[a] += w * node[a]
                        for b in range(3):
                            gradient[a, b] += 4.0 / (dx * dx) * w * node[a] * r[b]
        for a in range(3):
            place[p, a] += dt * new[a]
        s, c = state[p], gradient
        strain = (
            dt * c[0, 0],
            dt * c[0, 1],
            dt * c[0, 2],
            dt * c[1, 0],
            dt * c[1, 1],
            dt * c[1, 2],
            dt * c[2, 0],
            dt * c[2, 1],
            dt * c[2, 2],
        )
        before = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
        after, loads, _ = stress_step(material, soft, before, strain, dt)
        for e in range(8):
            state[p, e] = after[e]
        for e in range(6):
            stress[p, e] = loads[e]
        near = variance = own = 0.0
        for k in range(3):
            for j in range(3):
                for i in range(3):
                    w, node = wx[i] * wy[j] * wz[k], nodes[k0 + k, j0 + j, i0 + i]
                    near += w * node[3]
                    for a in range(3):
                        variance += w * (node[a] - new[a]) ** 2
        for a in range(3):
            for b in range(3):
                own += 0.25 * dx * dx * gradient[a, b] ** 2
        jj, ii = j0 + int(fy + 0.5), i0 + int(fx + 0.5)
        height, sx, sy = ground[jj, ii, 0], ground[jj, ii, 1], ground[jj, ii, 2]
        above = (k0 + fz - GHOSTS) * dx - height - sx * (i0 + fx - ii) * dx - sy * (j0 + fy - jj) * dx
        above /= dx * np.sqrt(1.0 + sx * sx + sy * sy)
        kept = limited(own, variance, near, above, dx, density, sound)
        gradient *= kept
        count += kept < 1.0
    return count
