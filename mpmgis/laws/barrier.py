"""Barriers as a screening tool: the flow passes a wall only by its height above the crest.

No flow passes through a wall that is higher than the flow; along the wall it slides with Coulomb friction.
Above the crest a wall is a broad-crested weir. Loads need a 3D run: a depth-averaged column has no
splash, no jet and one velocity from bed to surface.
"""

from math import sqrt
from typing import NamedTuple

# boundary condition of a node in a wall
FACE = 0.0  # the flow can leave the wall
CORE = 1.0  # the flow cannot cross
CORNER = 2.0  # there is no flow


def weir_discharge(gravity: float, head: float, speed: float) -> float:
    """Compute the discharge over a metre of crest.

    A slow flow passes critically, q = sqrt(g) (2 head / 3)^(3/2) (broad-crested weir); a fast one keeps its speed
    above the crest, q = head * speed.

    Parameters
    ----------
    gravity : float [m s-2]
    head : float [m]
        Surface before the wall above its crest.
    speed : float [m s-1]
        Speed of the flow towards the wall.

    Returns
    -------
    float [m2 s-1]
    """
    above = max(head, 0.0)
    critical = 2.0 * above / 3.0
    return max(sqrt(gravity * critical) * critical, above * speed)


def opening_discharge(gravity: float, depth: float, speed: float, depth_beyond: float, speed_beyond: float) -> float:
    """Compute the largest discharge through a metre of an opening.

    From the side with the larger energy head E = depth + speed^2 / 2g the flow passes critically, q = sqrt(g) (2 E
    / 3)^(3/2), the largest discharge that any flow of this head has (Chow 1959, section 3-3). If the depth beyond
    exceeds 2 E / 3, it is the depth in the opening, q = depth sqrt(2 g (E - depth)).

    Parameters
    ----------
    gravity : float [m s-2]
    depth, speed : float [m], [m s-1]
        Depth on one side, and speed there towards the opening.
    depth_beyond, speed_beyond : float [m], [m s-1]
        The same of the other side.

    Returns
    -------
    float [m2 s-1]
    """
    head = depth + 0.5 * speed * speed / gravity
    head_beyond = depth_beyond + 0.5 * speed_beyond * speed_beyond / gravity
    tail = depth_beyond if head >= head_beyond else depth
    head = max(head, head_beyond)
    within = max(2.0 * head / 3.0, min(tail, head))
    return within * sqrt(2.0 * gravity * (head - within))


def deflected(
    u: float, v: float, normal_x: float, normal_y: float, hold: float, mu: float, open_speed: float
) -> tuple[float, float]:
    """Compute the velocity at a node in the wall.

    Through the wall the flow keeps at most `open_speed`. A reduction of the speed across the wall reduces the speed
    along it by `mu` times as much.

    Parameters
    ----------
    u, v : float [m s-1]
        Velocity of the node.
    normal_x, normal_y : float [1]
        Outward unit normal of the wall on this side.
    hold : float
        Boundary condition of the node: FACE, CORE or CORNER.
    mu : float [1]
        Friction coefficient along the wall.
    open_speed : float [m s-1]
        Largest speed across the wall; 0 below the crest.

    Returns
    -------
    u, v : float [m s-1]
    """
    across = u * normal_x + v * normal_y
    along_x, along_y = u - across * normal_x, v - across * normal_y
    along = sqrt(along_x * along_x + along_y * along_y)
    kept_across = max(across, -open_speed)
    if hold > FACE:
        kept_across = min(kept_across, open_speed)
    kept_along = max(along - mu * abs(across - kept_across), 0.0)
    if hold > CORE:
        kept_along = min(kept_along, open_speed)
    share = kept_along / along if along > 0.0 else 0.0
    return kept_across * normal_x + share * along_x, kept_across * normal_y + share * along_y


def let_through(
    u: float, v: float, normal_x: float, normal_y: float, side: float, mu: float, open_speed: float
) -> tuple[float, float]:
    """Compute the velocity at a node that is partly open.

    Along the normal the flow passes at `open_speed` at most. Sideways, along (normal_y, -normal_x), it moves only
    away from the wall. A reduction of one speed reduces the other by `mu` times as much.

    Parameters
    ----------
    u, v : float [m s-1]
        Velocity of the node.
    normal_x, normal_y : float [1]
        Outward unit normal of the wall on this side.
    side : float
        Sign of the direction (normal_y, -normal_x) in which the opening lies.
    mu : float [1]
        Friction coefficient along the wall.
    open_speed : float [m s-1]
        Largest speed through the opening.

    Returns
    -------
    u, v : float [m s-1]
    """
    across, along = u * normal_x + v * normal_y, u * normal_y - v * normal_x
    kept_across = min(max(across, -open_speed), open_speed)
    kept_along = along if along * side >= 0.0 else 0.0
    rubbed_along = max(abs(kept_along) - mu * abs(across - kept_across), 0.0)
    rubbed_across = max(abs(kept_across) - mu * abs(along - kept_along), 0.0)
    kept_along = rubbed_along if kept_along > 0.0 else -rubbed_along
    kept_across = rubbed_across if kept_across > 0.0 else -rubbed_across
    return kept_across * normal_x + kept_along * normal_y, kept_across * normal_y - kept_along * normal_x


class NoBarrier(NamedTuple):
    """The null law: no barrier."""

    null: float = 0.0  # the compiler requires a field

    def barrier_active(self) -> bool:
        """Return False: there is no barrier."""
        return False

    def opening_discharge(
        self, gravity: float, depth: float, speed: float, depth_beyond: float, speed_beyond: float
    ) -> float:
        """Return 0: nothing flows through an opening.

        Parameters
        ----------
        gravity : float [m s-2]
        depth, speed : float [m], [m s-1]
            Depth on one side, and speed there towards the opening.
        depth_beyond, speed_beyond : float [m], [m s-1]
            The same of the other side.
        """
        return 0.0

    def let_through(
        self, u: float, v: float, normal_x: float, normal_y: float, side: float, mu: float, open_speed: float
    ) -> tuple[float, float]:
        """Return the velocity unchanged.

        Parameters
        ----------
        u, v : float [m s-1]
            Velocity of the node.
        normal_x, normal_y : float [1]
            Outward unit normal of the wall on this side.
        side : float
            Sign of the direction (normal_y, -normal_x) in which the opening lies.
        mu : float [1]
            Friction coefficient along the wall.
        open_speed : float [m s-1]
            Largest speed through the opening.
        """
        return u, v

    def kept_along(self, mu: float, slip: float, pressed: float) -> float:
        """Return 1: no speed is lost.

        Parameters
        ----------
        mu : float [1]
            Friction coefficient along the wall.
        slip : float [m s-1]
            Speed along the face.
        pressed : float [m s-1]
            Speed towards the face, which the face stops.
        """
        return 1.0


class Barrier(NamedTuple):
    """A wall with Coulomb friction mu along it (0: smooth) and a weir above its crest."""

    null: float = 0.0  # the compiler requires a field

    def barrier_active(self) -> bool:
        """Return True: there are barriers."""
        return True

    def opening_discharge(
        self, gravity: float, depth: float, speed: float, depth_beyond: float, speed_beyond: float
    ) -> float:
        """Compute the largest discharge through a metre of an opening [m2 s-1].

        Parameters
        ----------
        gravity : float [m s-2]
        depth, speed : float [m], [m s-1]
            Depth on one side, and speed there towards the opening.
        depth_beyond, speed_beyond : float [m], [m s-1]
            The same of the other side.
        """
        return opening_discharge(gravity, depth, speed, depth_beyond, speed_beyond)

    def let_through(
        self, u: float, v: float, normal_x: float, normal_y: float, side: float, mu: float, open_speed: float
    ) -> tuple[float, float]:
        """Compute the velocity at a node that is partly open.

        Parameters
        ----------
        u, v : float [m s-1]
            Velocity of the node.
        normal_x, normal_y : float [1]
            Outward unit normal of the wall on this side.
        side : float
            Sign of the direction (normal_y, -normal_x) in which the opening lies.
        mu : float [1]
            Friction coefficient along the wall.
        open_speed : float [m s-1]
            Largest speed through the opening.
        """
        return let_through(u, v, normal_x, normal_y, side, mu, open_speed)

    def kept_along(self, mu: float, slip: float, pressed: float) -> float:
        """Compute the share of the speed along a rigid face that is left after Coulomb friction.

        Parameters
        ----------
        mu : float [1]
            Friction coefficient along the wall.
        slip : float [m s-1]
            Speed along the face.
        pressed : float [m s-1]
            Speed towards the face, which the face stops.

        Returns
        -------
        float [1]
        """
        return max(0.0, 1.0 - mu * pressed / slip)
