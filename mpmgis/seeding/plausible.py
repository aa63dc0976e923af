"""Releases that are possible and yet hardly meant: a unit mixed up, or too few columns to say anything."""

from typing import NamedTuple

DENSITY = (100.0, 3500.0)  # [kg m-3] loose new snow to dense ore
THICKNESS = (0.01, 100.0)  # [m]
FEWEST_COLUMNS = 50


class Cures(NamedTuple):
    """What the user would change: where `density` and `thickness` are given, and how to have `more` columns."""

    density: str
    thickness: str
    more: str


def tell_if_implausible(count, density, thickness, cures, say):
    """Say in one line each what about a release is hardly meant; it is taken as it is.

    Parameters
    ----------
    count : int
        Columns.
    density : float [kg m-3]
    thickness : float [m]
        Mean, vertical.
    cures : Cures
    say : callable
    """
    for name, value, unit, (low, high), cure in (
        ("density", density, "kg m-3", DENSITY, cures.density),
        ("mean thickness", thickness, "m", THICKNESS, cures.thickness),
    ):
        if not low <= value <= high:
            say(f"{name} of the release: {value:.5g} {unit}, usual is {low:g} to {high:g}; check {cure} and its unit")
    if count < FEWEST_COLUMNS:
        columns = "1 column carries" if count == 1 else f"{count} columns carry"
        say(f"only {columns} the release, too few to resolve a flow; {cures.more}")
