"""What a look at a flow's energy sees, and how much of it was made out of nothing since the look before."""

from typing import NamedTuple

GAIN_STOP = 0.1  # of kinetic energy and work since the last look, above which energy has been made out of nothing
REST_SHARE = 0.01  # of the largest kinetic energy so far, below which a flow rests: no less counts as kinetic energy
REST_LIFT = 0.01  # [cells] by which all mass is lifted by the energy that counts as kinetic at the least


class EnergyLook(NamedTuple):
    """Energies [J] at one moment.

    Parameters
    ----------
    made : float
        All energy that there is and that has left, less all that was put in since the start: below 0 by what was lost,
        and growing only where energy is made out of nothing.
    kinetic : float
        Of what is on the terrain now.
    least : float
        Kinetic energy that a flow at rest counts as, see `least_kinetic`.
    work : tuple of float
        Done since the start: by the weight, by stress, on what was booked as lost; and kinetic energy put in.
    time : float [s]
    """

    made: float
    kinetic: float
    least: float
    work: tuple
    time: float

    def gained_since(self, last):
        """(share [1] of kinetic energy and work since the EnergyLook `last` that was made out of nothing; J)."""
        made = self.made - last.made
        work = sum(abs(now - before) for now, before in zip(self.work, last.work, strict=True))
        return made / max(max(last.kinetic, last.least) + work, 1e-300), made


def least_kinetic(peak, mass, gravity, cell_size):
    """Kinetic energy [J] that a flow of `mass` [kg] at rest counts as: 1 % of its `peak` [J], or what lifts it by 1 %
    of a cell; rounding of single precision stays below a tenth of that."""
    return max(REST_SHARE * peak, mass * gravity * REST_LIFT * cell_size)
