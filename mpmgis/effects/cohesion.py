"""Cohesion of the flow to its bed: a yield stress in addition to the friction law."""

from typing import NamedTuple


class NoCohesion(NamedTuple):
    """The null law: nothing is added."""

    null: float = 0.0  # the compiler requires a field

    def cohesive_stress(self):
        return 0.0


class Cohesion(NamedTuple):
    """A basal stress tau_0 that does not depend on load or speed, added to the friction law's.

    tau_0 of VoellmyMinShear (AvaFrame com1DFA). Dry snow 0 to 100 Pa, wet snow 50 to 1000 Pa, debris
    flows 100 to 5000 Pa.
    """

    stress: float  # tau_0 [Pa]

    def cohesive_stress(self):
        """tau_0 [Pa]."""
        return self.stress
