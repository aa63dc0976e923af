"""Limits between the classes of terrain."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ClassLimits:
    """Limits between the classes of terrain.

    Parameters
    ----------
    flat_slope : float [degrees]
        Ground of a smaller slope is flat, unless it is in a channel or gully.
    channel_radius, gully_radius : float [m]
        At which the ground around is compared with the cell.
    channel_rise, gully_rise : float [1]
        Least mean rise over the radius.
    """

    flat_slope: float = 8.0
    channel_radius: float = 60.0
    channel_rise: float = 0.06
    gully_radius: float = 20.0
    gully_rise: float = 0.15
