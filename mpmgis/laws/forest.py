"""Forest: standing trees slow the flow and stop part of its mass; they break above a pressure.

Added friction mu_f and added drag c: tau = rho h (mu_f g_n + c U^2), along the ground, h normal to it (com1DFA's
resistance; added friction as in RAMMS: Christen et al. 2010, Teich et al. 2014). Detrainment: mass stops behind trees
at the rate K / U per area of ground (Feistl et al. 2014), with its momentum, so that the rest keeps its speed and is
braked by the stress K. From the first time that rho U^2 reaches the strength the trees do neither.

Where limits of speed or thickness are given, as in com1DFA of AvaFrame, slow or thin flow loses mass and is not braked,
and other flow is braked and loses no mass. Flow that is too thick breaks the trees.
"""

from typing import NamedTuple

# values of a node with forest: detrainment K [Pa], added drag c [m-1], added friction mu_f [1], strength [Pa], limits
# of detrainment (speed [m s-1], thickness normal to the ground [m]), thickness that breaks it [m]; 0 is no limit
DETRAINMENT, DRAG, FRICTION, STRENGTH, SLOW, THIN, TOO_THICK, FOREST_ENTRIES = range(8)


class NoForest(NamedTuple):
    """The null law: no trees."""

    null: float = 0.0  # the compiler requires a field

    def forest_active(self):
        return False

    def forest_breaks(self, strength, too_thick, density, thickness_normal, speed):
        return False

    def forest_only_detrains(self, slow, thin, thickness_normal, speed):
        return False

    def forest_detrained(self, detrainment, speed, time_step):
        return 0.0


class Forest(NamedTuple):
    """Trees: tau = rho h (mu_f g_n + c U^2); mass stops at the rate K / |U|, with its momentum (Feistl et al. 2014)."""

    null: float = 0.0  # the compiler requires a field

    def forest_active(self):
        return True

    def forest_breaks(self, strength, too_thick, density, thickness_normal, speed):
        """Whether flow of `density` [kg m-3] and `speed` [m s-1] breaks trees of `strength` [Pa].

        Flow of more than `too_thick` [m] normal to the ground breaks them at any speed; 0: none does.
        """
        return density * speed * speed >= strength or (too_thick > 0.0 and thickness_normal > too_thick)

    def forest_only_detrains(self, slow, thin, thickness_normal, speed):
        """Whether flow is at most `slow` [m s-1] or at most `thin` [m]: it loses mass and is not braked (com1DFA)."""
        return speed <= slow or thickness_normal <= thin

    def forest_detrained(self, detrainment, speed, time_step):
        """Mass [kg m-2] per area of the ground that stops in `time_step` [s]; none of a flow at rest."""
        if speed <= 0.0:
            return 0.0
        return detrainment * time_step / speed
