"""Barriers as a screening tool: the flow passes a wall only by its height above the crest.

No flow passes through a wall that is higher than the flow; along the wall it slides with Coulomb friction.
Above the crest a wall is a broad-crested weir. Loads need a 3D run: a depth-averaged column has no
splash, no jet and one velocity from bed to surface.
"""

from math import sqrt
from typing import NamedTuple

# boundary condition of a node in a wall: FACE, flow can leave; CORE, flow cannot cross; CORNER, no flow
FACE, CORE, CORNER = 0.0, 1.0, 2.0


class NoBarrier(NamedTuple):
    """The null law: no barrier."""

    null: float = 0.0  # the compiler requires a field

    def barrier_active(self):
        return False

    def weir_discharge(self, gravity, head, speed):
        return 0.0

    def opening_discharge(self, gravity, depth, speed, depth_beyond, speed_beyond):
        return 0.0

    def kept_along(self, mu, slip, pressed):
        return 1.0

    def deflected(self, u, v, normal_x, normal_y, hold, mu, open_speed):
        return u, v

    def let_through(self, u, v, normal_x, normal_y, side, mu, open_speed):
        return u, v


class Barrier(NamedTuple):
    """A wall with Coulomb friction mu along it (0: smooth) and a weir above its crest."""

    null: float = 0.0  # the compiler requires a field

    def barrier_active(self):
        return True

    def weir_discharge(self, gravity, head, speed):
        """Discharge over a metre of crest [m2 s-1].

        `head` [m] is the surface before the wall above its crest, `speed` [m s-1] the flow's towards the wall. A slow
        flow passes critically, q = sqrt(g) (2 head / 3)^(3/2) (broad-crested weir); a fast one keeps its speed above
        the crest, q = head * speed.
        """
        above = max(head, 0.0)
        critical = 2.0 * above / 3.0
        return max(sqrt(gravity * critical) * critical, above * speed)

    def opening_discharge(self, gravity, depth, speed, depth_beyond, speed_beyond):
        """Largest discharge through a metre of an opening [m2 s-1].

        `depth` [m] is the flow's on one side and `speed` [m s-1] its speed towards the opening, `depth_beyond` and
        `speed_beyond` those of the other side. From the side with the larger energy head E = depth + speed^2 / 2g the
        flow passes critically, q = sqrt(g) (2 E / 3)^(3/2), the largest discharge that any flow of this head has
        (Chow 1959, section 3-3). If the depth beyond exceeds 2 E / 3, it is the depth in the opening,
        q = depth sqrt(2 g (E - depth)).
        """
        head = depth + 0.5 * speed * speed / gravity
        head_beyond = depth_beyond + 0.5 * speed_beyond * speed_beyond / gravity
        tail = depth_beyond if head >= head_beyond else depth
        head = max(head, head_beyond)
        within = max(2.0 * head / 3.0, min(tail, head))
        return within * sqrt(2.0 * gravity * (head - within))

    def kept_along(self, mu, slip, pressed):
        """Share [1] left of the speed `slip` [m s-1] on a rigid face that stops the normal speed `pressed` [m s-1]."""
        return max(0.0, 1.0 - mu * pressed / slip)

    def deflected(self, u, v, normal_x, normal_y, hold, mu, open_speed):
        """Velocity [m s-1] at a node in the wall, whose outward unit normal on this side is (normal_x, normal_y).

        Through the wall the flow keeps at most `open_speed`, which is 0 below the crest. A reduction of the speed
        across the wall reduces the speed along it by `mu` times as much.
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

    def let_through(self, u, v, normal_x, normal_y, side, mu, open_speed):
        """Velocity [m s-1] at a node that is partly open; the flow passes along the normal (normal_x, normal_y).

        It passes at `open_speed` at most. Sideways, along (normal_y, -normal_x), it moves only away from the wall,
        whose opening is in the direction `side`. A reduction of one speed reduces the other by `mu` times as much.
        """
        across, along = u * normal_x + v * normal_y, u * normal_y - v * normal_x
        kept_across = min(max(across, -open_speed), open_speed)
        kept_along = along if along * side >= 0.0 else 0.0
        rubbed_along = max(abs(kept_along) - mu * abs(across - kept_across), 0.0)
        rubbed_across = max(abs(kept_across) - mu * abs(along - kept_along), 0.0)
        kept_along = rubbed_along if kept_along > 0.0 else -rubbed_along
        kept_across = rubbed_across if kept_across > 0.0 else -rubbed_across
        return kept_across * normal_x + kept_along * normal_y, kept_across * normal_y - kept_along * normal_x
