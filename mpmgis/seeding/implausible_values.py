"""Messages about releases and friction that are possible but unlikely."""

from typing import NamedTuple

from ..system.messages import log

DENSITY = (100.0, 3500.0)  # [kg m-3] loose new snow to dense ore
THICKNESS = (0.01, 100.0)  # [m] mean, vertical; usual range
FEWEST_COLUMNS = 50  # fewer do not resolve a flow
FEWEST_ACROSS = 4.0  # [cells] side of a square of the release's area; fewer do not resolve its outline
MOST_MU = 1.2  # [1] of friction: tan 50 degrees
LEAST_XI = 10.0  # [m s-2] of friction: drag of a dense forest


class Fixes(NamedTuple):
    """Advice on what to change, for the messages.

    Parameters
    ----------
    density, thickness : str
        Where they are given.
    more, finer : str
        How to have more columns, and smaller cells.
    """

    density: str
    thickness: str
    more: str
    finer: str


def report_implausible_friction(parameters: dict) -> None:
    """Report each parameter of the friction outside its usual range; it is used as it is.

    Parameters
    ----------
    parameters : dict
        Name -> value.
    """
    mu, xi = (parameters.get(name) for name in ("mu", "xi"))
    if isinstance(mu, (int, float)) and mu > MOST_MU:
        log.info(
            f"[friction] mu = {mu:g}, usual is 0 to {MOST_MU:g}; it is the tangent of the friction angle: that of 20 "
            "degrees is 0.36"
        )
    if isinstance(xi, (int, float)) and xi < LEAST_XI:
        log.info(f"[friction] xi = {xi:g} m s-2, usual is {LEAST_XI:g} to 3000; check it and its unit")


def report_implausible(count: int, density: float, thickness: float, across: float, fixes: Fixes) -> None:
    """Report what is unusual about a release, in one line each; it is used as it is.

    Parameters
    ----------
    count : int
        Number of columns.
    density : float [kg m-3]
    thickness : float [m]
        Mean vertical thickness.
    across : float [cells]
        Side of a square of the release's area.
    fixes : Fixes
    """
    for name, value, unit, (low, high), cure in (
        ("density", density, "kg m-3", DENSITY, fixes.density),
        ("mean thickness", thickness, "m", THICKNESS, fixes.thickness),
    ):
        if not low <= value <= high:
            log.info(
                f"{name} of the release: {value:.5g} {unit}, usual is {low:g} to {high:g}; check {cure} and its unit"
            )
    if count < FEWEST_COLUMNS:
        columns = "1 column carries" if count == 1 else f"{count} columns carry"
        log.info(f"only {columns} the release, too few to resolve a flow; {fixes.more}")
    elif across < FEWEST_ACROSS:
        log.info(
            f"only {across:.2g} cells are across the release, too few to resolve its outline and its flow; "
            f"{fixes.finer}"
        )
