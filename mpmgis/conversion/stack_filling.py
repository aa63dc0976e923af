"""Conversion loop: stacks of points, each from the bed upwards, in the order of the stacks."""

from ..compiled.jit import jit


@jit
def fill_stacks(
    count,
    printed,
    place,
    thickness,
    motion,
    divergence,
    shares,
    load,
    parent,
    position,
    velocity,
    mass,
    volume,
    point_parent,
    depth,
    stress,
):
    """Fill the points of all stacks (MOX report 15/2025, Algorithm 2).

    Parameters
    ----------
    count : int64[k]
        Points in each stack.
    printed : bool
        True: from bed to surface, Eq (2); False: in the middle of equal slices.
    place : float64[k, 3] [m]
        Foot of each stack.
    thickness : float64[k] [m]
    motion : float64[k, 3] [m s-1]
        Velocity at the foot.
    divergence : float64[k] [s-1]
        Fall of the vertical velocity with height.
    shares : float64[k, 2] [kg, m3]
        Mass and volume of each of a stack's points.
    load : float64[k] [Pa m-1]
        Vertical stress for each metre under the surface.
    parent : uint64[k]
    position, velocity, mass, volume, point_parent, depth, stress : out
        One row per point; `depth` and `stress` can be empty and are then not computed.
    """
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
