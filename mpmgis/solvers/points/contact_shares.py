"""Shares of the nodes around a face in the contact of a 3D flow with it.

A pressure p in the points beyond a face pushes node k of the line of nodes across it with p A times the integral of
4 r w(r) over the distances r [cells] from the node to these points: w is the spline, and 4 w r / dx the gradient of
MLS-MPM (Hu et al. 2018, ACM Trans. Graph. 37:150). A push of the face that is shared in the same way keeps each node
in equilibrium. With the spline itself as share, pressures near an inclined bed alternate by up to 74 % about the right
one. Distances count in cells, and masses come from the points, which do not fill the space evenly.

The pressure at an inclined face also pushes the nodes across their line. This component acts on them with other
shares: the gradient is then taken across the line, and along the line the spline itself counts. With the same shares
for both components, water over an inclined floor flows down along the floor and back at its surface.
"""

from ...compiled.jit import jit_borrowing, jit_inline
from .point_rows import GHOSTS

MOST_RATIO = 6.0  # [1] largest ratio of a node's share and mass: 4 r, of points up to 1.5 cells away
DEEP = 0.75  # [cells] height of the centre of a column's masses above the ground, from which pressure sets all shares
LIGHTEST = 0.1  # [1] of the mass of a full node with its share: a lighter node is pushed as if it had this mass
# Gauss's five points for a mean with the spline as weight, exact for polynomials of the ninth degree.
NEAR = 0.5877982813242693  # [cells] distance of the inner pair of points from the middle
FAR = 1.125241444035807  # [cells] distance of the outer pair
NEAR_WEIGHT = 0.2421323233425994  # [1] weight of each point of the inner pair
FAR_WEIGHT = 0.03265097603233586  # [1] weight of each point of the outer pair
MIDDLE_WEIGHT = 1.0 - 2.0 * (NEAR_WEIGHT + FAR_WEIGHT)  # [1] weight of the point in the middle


@jit_inline
def foot_of(height: float, dx: float) -> tuple[int, float]:
    """Find the node level nearest to the ground.

    Parameters
    ----------
    height : float [m]
        Of the ground.
    dx : float [m]

    Returns
    -------
    (int, float [cells])
        Level of the node; place of the ground above it, -0.5 to 0.5.
    """
    place = height / dx + float(GHOSTS)
    level = int(place + 0.5)
    return level, place - float(level)


@jit_inline
def spline_at(foot: float, offset: int) -> float:
    """Compute the weight of a node near the ground in the spline at the ground [1].

    Parameters
    ----------
    foot : float [cells]
        Place of the ground above the nearest node.
    offset : int
        -1, 0 or 1: levels of the node above the nearest one.
    """
    if offset == 0:
        return 0.75 - foot * foot
    half = 0.5 + float(offset) * foot
    return 0.5 * (half * half)


@jit_inline
def pressure_share(away: float) -> float:
    """Compute the share of a node in the pressure of points above level ground [1]: 4 r w(r) over r > away.

    w is the spline. 4 w r / dx is the gradient of MLS-MPM (Hu et al. 2018, ACM Trans. Graph. 37:150).

    Parameters
    ----------
    away : float [cells]
        Height of the ground above the node.
    """
    a = min(abs(away), 1.5)
    if a < 0.5:
        return 0.8125 + a * a * (a * a - 1.5)
    t = 1.5 - a
    return t * t * t * (1.0 - 0.5 * t)


@jit_inline
def mass_share(away: float) -> float:
    """Compute the share of a node's mass that is above level ground [1]: w(r) over r > away.

    Parameters
    ----------
    away : float [cells]
        Height of the ground above the node.
    """
    a = min(abs(away), 1.5)
    t = 1.5 - a
    share = 0.5 + a * (a * a / 3.0 - 0.75) if a < 0.5 else t * t * t / 6.0
    return share if away > 0.0 else 1.0 - share


@jit_borrowing
def shares_on_slope(away: float, rise: float) -> tuple[float, float]:
    """Compute `pressure_share` and `mass_share` of a node below ground that rises to one side.

    They are the means over the spline along the slope, on which a distance [cells] is a difference in height of `rise`
    times it.

    Parameters
    ----------
    away : float [cells]
        Height of the ground above the node.
    rise : float [1]
        Tangent of the slope.

    Returns
    -------
    (float [1], float [1])
    """
    near, far = NEAR * rise, FAR * rise
    pressed = MIDDLE_WEIGHT * pressure_share(away)
    pressed += NEAR_WEIGHT * (pressure_share(away + near) + pressure_share(away - near))
    pressed += FAR_WEIGHT * (pressure_share(away + far) + pressure_share(away - far))
    return pressed, mass_share_on_slope(away, rise)


@jit_borrowing
def mass_share_on_slope(away: float, rise: float) -> float:
    """Compute the `mass_share` of a node below ground that rises to one side [1], see `shares_on_slope`.

    Parameters
    ----------
    away : float [cells]
        Height of the ground above the node.
    rise : float [1]
        Tangent of the slope.
    """
    near, far = NEAR * rise, FAR * rise
    if abs(away) >= 1.5 + far:
        return 0.0 if away > 0.0 else 1.0
    filled = MIDDLE_WEIGHT * mass_share(away)
    filled += NEAR_WEIGHT * (mass_share(away + near) + mass_share(away - near))
    return filled + FAR_WEIGHT * (mass_share(away + far) + mass_share(away - far))


@jit_borrowing
def share_of_mass(away: float, rise: float, mass: float) -> float:
    """Compute the share of a node below ground that rises to one side from the node's mass [1].

    The ratio of share and mass is that of a space filled above the ground; a node in its interior has the mass 1. The
    limit is 0 from 2 cells below the ground: there a node has a share only on steep slopes, at most 0.007 up to 45
    degrees. With that share, sand at rest between a floor of 45 degrees and a wall pushed the wall more and more. Above
    the ground the limit is 0 where the nodes that count end, 2.5 cells away.

    Parameters
    ----------
    away : float [cells]
        Height of the ground above the node.
    rise : float [1]
        Tangent of the slope.
    mass : float [1]
        Of the node, over that of a node in the flow's interior.
    """
    pressed, filled = shares_on_slope(away, rise)
    limit = max(min(1.0 - 0.5 * away, 2.5 + away), 0.0)
    return min(pressed / max(filled, 1e-15) * mass, limit)


@jit_borrowing
def contact_shares(
    foot: float, rise: float, m0: float, m1: float, m2: float, m3: float, m4: float
) -> tuple[float, float, float, float, float]:
    """Compute the shares of the nodes -2 to 2 levels above the nearest one in the contact with the ground [1].

    They are those of the component of the push along the line of nodes, and of friction. They follow from the masses
    (see `share_of_mass`), with the sum 1 and the moment `foot` (see `_change`). No share is negative, or more than
    MOST_RATIO times the mass, which no arrangement of points exceeds; where that limits one (in narrow corners, on very
    steep ground), all are scaled to the sum 1. They are continuous in place, slope and masses.

    Of a sheet thinner than 1.5 cells the weights of the spline take over, the more the thinner it is: its points move
    with the velocity that these give, and the shares of pressure would let it sink.

    Parameters
    ----------
    foot : float [cells]
        Place of the ground above the nearest node.
    rise : float [1]
        Tangent of the slope.
    m0, m1, m2, m3, m4 : float [1]
        Masses of the nodes, over that of a node in the flow's interior.
    """
    s0 = share_of_mass(foot + 2.0, rise, m0)
    s1 = share_of_mass(foot + 1.0, rise, m1)
    s2 = share_of_mass(foot, rise, m2)
    s3 = share_of_mass(foot - 1.0, rise, m3)
    s4 = share_of_mass(foot - 2.0, rise, m4)
    short = 1.0 - s0 - s1 - s2 - s3 - s4
    tilt = foot * (1.0 - short) + 2.0 * s0 + s1 - s3 - 2.0 * s4 - 0.5 * short
    even, lean = _change(foot, short, tilt)
    s0 = _held(s0, MOST_RATIO * m0)
    s1 = _changed(s1, -1.5 - foot, even, lean, MOST_RATIO * m1)
    s2 = _changed(s2, -0.5 - foot, even, lean, MOST_RATIO * m2)
    s3 = _changed(s3, 0.5 - foot, even, lean, MOST_RATIO * m3)
    s4 = _changed(s4, 1.5 - foot, even, lean, MOST_RATIO * m4)
    return _with_spline(depth_of(foot, m0, m1, m2, m3, m4), foot, s0, s1, s2, s3, s4)


@jit_inline
def _across_level(away):
    """Compute the share across the line less `pressure_share`, for level ground `away` [cells] above the node.

    For the component across the line, the weight along the line is the spline w: this is w(away) less
    `pressure_share`.
    """
    a = min(abs(away), 1.5)
    if a < 0.5:
        return a * a * (0.5 - a * a) - 0.0625
    t = a - 0.5
    other = (1.0 - t) * t
    return 0.5 * other * other


@jit_borrowing
def more_across(away: float, rise: float, part: float, share: float, mass: float) -> float:
    """Compute the difference of a node's share in a push across the line from its share along the line [1].

    `_across_level` is averaged as in `shares_on_slope`. The share across is not negative, and not more than the mass
    over LIGHTEST: a lighter node would take only a part of the push.

    Parameters
    ----------
    away : float [cells]
        Height of the ground above the node.
    rise : float [1]
        Tangent of the slope.
    part : float [1]
        The result of `across_part`.
    share : float [1]
        Of the node along the line.
    mass : float [1]
        Of the node.
    """
    near, far = NEAR * rise, FAR * rise
    if abs(away) >= 1.5 + far:
        return 0.0
    more = MIDDLE_WEIGHT * _across_level(away)
    more += NEAR_WEIGHT * (_across_level(away + near) + _across_level(away - near))
    more += FAR_WEIGHT * (_across_level(away + far) + _across_level(away - far))
    return min(max(part * more, -share), max(mass / LIGHTEST - share, 0.0))


@jit_inline
def across_part(nx: float, ny: float, nz: float) -> float:
    """Compute the part of the difference between level ground's two sets of shares that counts on a slope [1].

    A component along an axis of the grid has the gradient of that axis, and the spline along both others. With the
    slope s along that axis, its shares differ from those along the line by 1 - s^2 times the difference on level
    ground. The mean of both axes, weighted by the components of the push, is what acts on its horizontal direction. It
    is 0 on slopes of 45 degrees along the grid: there both sets are equal.

    Parameters
    ----------
    nx, ny, nz : float [1]
        Unit normal of the slope.
    """
    across = nx * nx + ny * ny
    return max(1.0 - (nx * nx * nx * nx + ny * ny * ny * ny) / (nz * nz * across), 0.0) if across > 0.0 else 0.0


@jit_inline
def balanced(offset: int, more: float, total: float, moment: float) -> float:
    """Change the `more_across` of a node so that sum and moment over all nodes are 0 [1].

    Parameters
    ----------
    offset : int
        Levels of the node above the nearest one; nodes 0 and 1 take the change.
    more : float [1]
        `more_across` of the node.
    total : float [1]
        Sum over all nodes without the change.
    moment : float [cells]
        Moment about node 0 without the change.
    """
    if offset == 0:
        return more - total + moment
    return more - moment if offset == 1 else more


@jit_borrowing
def row_shares(
    foot: float, rise: float, m0: float, m1: float, m2: float, m3: float, m4: float
) -> tuple[float, float, float, float, float]:
    """Compute the shares of the nodes of a row in the contact with a barrier's face [1], see `contact_shares`.

    Shares of the outer nodes go to their neighbours, because the outer nodes may belong to another face. The moment
    changes by their difference, and a neighbour may get more than MOST_RATIO times its mass. Before a face along the
    grid with a full flow the outer nodes have no share.

    Parameters
    ----------
    foot : float [cells]
        Place of the face from the nearest node.
    rise : float [1]
        By which the face leans along its rows.
    m0, m1, m2, m3, m4 : float [1]
        Masses of the nodes, over that of a node in the flow's interior.
    """
    s0, s1, s2, s3, s4 = contact_shares(foot, rise, m0, m1, m2, m3, m4)
    return 0.0, s0 + s1, s2, s3 + s4, 0.0


@jit_inline
def depth_of(foot: float, m0: float, m1: float, m2: float, m3: float, m4: float) -> float:
    """Compute how deep a flow is at the ground [1]: 1 from 1.5 cells, 0 where it is not above the ground.

    It follows from the centre of the masses within 2.5 cells.

    Parameters
    ----------
    foot : float [cells]
        Place of the ground above the nearest node.
    m0, m1, m2, m3, m4 : float [1]
        Masses of the nodes -2 to 2 levels above the nearest one.
    """
    m0, m4 = m0 * (0.5 - foot), m4 * (0.5 + foot)  # each is 0 where the nearest node changes
    total = m0 + m1 + m2 + m3 + m4
    centre = (m3 - m1 + 2.0 * (m4 - m0) - foot * total) / max(total, 1e-300)
    return _held(centre / DEEP, 1.0)


@jit_borrowing
def _with_spline(part, foot, s0, s1, s2, s3, s4):
    """Mix `part` of the shares, scaled to the sum 1, with the weights of the spline for the rest."""
    scale, rest = part / max(s0 + s1 + s2 + s3 + s4, 1e-300), 1.0 - part
    return (
        scale * s0,
        scale * s1 + rest * spline_at(foot, -1),
        scale * s2 + rest * spline_at(foot, 0),
        scale * s3 + rest * spline_at(foot, 1),
        scale * s4,
    )


@jit_borrowing
def _change(foot, short, tilt):
    """Return (even, lean) of the change (9/4 - e^2) (even + lean e) with the sum `short` and the moment `tilt`.

    e [cells] is a node's distance above half a cell over the ground. The three nodes of |e| < 3/2 are changed: the
    masses of those further below show where the points end.
    """
    middle = 0.5 - foot if foot >= 0.0 else -0.5 - foot  # e of the second of them
    m2 = middle * middle
    whole, first, second = 4.75 - 3.0 * m2, middle * (0.75 - 3.0 * m2), 2.5 - m2 * (5.25 + 3.0 * m2)
    over = 1.0 / (whole * second - first * first)
    return (second * short - first * tilt) * over, (whole * tilt - first * short) * over


@jit_inline
def _changed(share, e, even, lean, most):
    """Return `share` with its `_change`, within 0 and `most`."""
    return _held(share + max(2.25 - e * e, 0.0) * (even + lean * e), most)


@jit_inline
def _held(share, most):
    """Limit `share` to the range from 0 to `most`."""
    return min(max(share, 0.0), most)


@jit_inline
def share_at(offset: int, shares: tuple[float, float, float, float, float]) -> float:
    """Return the share of one node of `contact_shares` [1].

    Parameters
    ----------
    offset : int
        -2 to 2: levels of the node above the nearest one.
    shares : tuple of five float [1]
    """
    if offset == 0:
        return shares[2]
    if offset < 0:
        return shares[1] if offset == -1 else shares[0]
    return shares[3] if offset == 1 else shares[4]


@jit_inline
def pushed_mass(mass: float, share: float, heaviest: float) -> float:
    """Return the mass with which a node is pushed [kg]: its own, or a part of its column's largest for a light node.

    Parameters
    ----------
    mass : float [kg]
    share : float [1]
        Of the node in the contact.
    heaviest : float [kg]
        Mass of the heaviest node of its column.
    """
    return max(mass, LIGHTEST * share * heaviest)


@jit_borrowing
def part_before(away: float) -> tuple[float, float]:
    """Compute the centre and the spread of the part of a node's spline before a wall.

    Parameters
    ----------
    away : float [cells]
        Distance of the node before the wall; negative behind it.

    Returns
    -------
    (float [cells], float [1])
        Distance of the centre from the node, away from the wall; variance of the part over that of the whole spline.
    """
    a = min(abs(away), 1.5)
    if a < 0.5:
        share = 0.5 - 0.75 * a + a * a * a / 3.0
        moment = 0.203125 - a * a * (0.375 - 0.25 * a * a)
        square = 0.125 - a * a * a * (0.25 - 0.2 * a * a)
    else:
        t = 1.5 - a
        share = t * t * t / 6.0
        moment = t * t * t * (0.25 - 0.125 * t)
        square = t * t * t * (0.375 - t * (0.375 - 0.1 * t))
    if away > 0.0:
        share, square = 1.0 - share, 0.25 - square
    if share < 1e-9:
        return a, 0.0
    centre = moment / share
    return centre, max(4.0 * (square / share - centre * centre), 0.0)
