"""Decisions on effects: numbers of terrain and release, thresholds, and the record of each decision.

A decider is a function `(scene, facts, slots) -> Decision` with

scene : Scene
    It reads its own table.
facts : TerrainFacts
    Numbers about release and terrain.
slots : dict of str to law
    It puts its law into `slots[name of the slot]` if the effect is on; laws of earlier deciders are there already.

It returns what `by_number` (auto compares an indicator with a threshold), `as_asked` (no number decides) or
`not_called_for` (not used in the scene) returns. To add one: write it beside its kind (`scene/resistance_effects`,
`scene/terrain_effects`, `scene/point_effects`), give `TerrainFacts` its number with None as default, compute it in
`simulation/preparation`, and name the decider in `effect_decisions.DECIDERS`.
"""

from typing import Any, NamedTuple

LEAST_SLOPE = 0.01  # [1] tangent; on gentler ground friction over the slope says nothing
MOST_SHOWN, LEAST_SHOWN = 1000.0, 0.001  # numbers of a report beyond these say no more to a reader
KEEPS_ALL = "below the limit runout, area and depth change by less than 5 %"
KEEPS_LOAD = "below the limit the load on the bed changes by less than 5 %; runout, area and depth are not checked"
THRESHOLD = 0.05  # [1] an effect that changes a leading term by less than this is left out, unless stated

Slots = dict[str, Any]  # name of a slot -> the law in it


class Decision(NamedTuple):
    """Why an effect is on or off: the number that decided, its threshold, and the reason in words."""

    effect: str
    state: str  # "on" | "off"
    decided_by: str  # "scene" | "auto" | "forced"
    indicator: float | None  # [1]
    threshold: float | None  # [1]; on above it
    reason: str
    runout_change: float | None = None  # [1] estimated relative change in runout if it were the other way round

    @property
    def called_for(self) -> bool:
        """Whether the effect is on or a number decides on it; otherwise it is not reported."""
        return self.state == "on" or self.decided_by != "scene"

    def line(self, cost: str = "") -> str:
        """Return one line of a table on the terminal.

        Parameters
        ----------
        cost : str
            A further cell before the reason.
        """
        threshold = "" if self.threshold is None else f"> {self.threshold:g}"
        number = "" if self.indicator is None else _distinct(self.indicator, self.threshold)
        change = "" if self.runout_change is None else f"{100 * self.runout_change:+.0f} %"
        head = f"{self.effect:<16} {self.state:<4} {self.decided_by:<7} {number:>9} {threshold:<8}"
        return f"{head} {change:>8}{cost}  {self.reason}"


def _distinct(number: float, threshold: float | None) -> str:
    """Return `number` as text, with as many digits as it takes to differ from the `threshold`."""
    if threshold is None or threshold > LEAST_SHOWN:
        if abs(number) > MOST_SHOWN:
            return f"> {MOST_SHOWN:g}" if number > 0 else f"< -{MOST_SHOWN:g}"
        if 0.0 < abs(number) < LEAST_SHOWN:
            return f"< {LEAST_SHOWN:g}"
    digits = 3
    while threshold is not None and number != threshold and digits < 9 and float(f"{number:.{digits}g}") == threshold:
        digits += 1
    return f"{number:.{digits}g}"


class TerrainFacts(NamedTuple):
    """Numbers about release and reachable terrain that decide effects, computed in seconds (`terrain.flow_reach`).

    Spatial features are None if the scene has none.
    """

    centrifugal_ratio: float  # p95 of |u^T Hess b u| / g at the energy line's speed
    slope_median: float  # tan of the slope, over the reachable ground
    drop: float  # [m]
    speed: float  # [m s-1] of the energy line
    slope_steep: float = 0.0  # 99 % quantile
    detachment_ratio: float = 0.0  # p99 of U^2 curvature / (g cos) over convex ground; above 1 the flow takes off
    edge_distance: float | None = None  # [m] from reachable ground to where the terrain ends; 0: it gets there
    hole_in_reach: tuple | None = None  # (cells, E [m], N [m]) of nodata inside the DTM that the flow can reach
    line_edge_distance: float | None = None  # [m] the same from the energy line only, without ground downhill of it
    start_speed: float = 0.0  # [m s-1] largest of the initial flow, of inflow and of later releases
    release_thickness: float = 0.0  # [m] h0, vertical, mean over the mass
    release_length: float = 0.0  # [m] L0, along the mean slope under the release
    density: float = 1000.0  # [kg m-3]
    profile: tuple = ()  # ((horizontal distance, elevation), ...) [m] of the steepest way down from the release
    zone_spread: float | None = None  # (largest - smallest) / mean of mu over zones in reach
    forest_areas: tuple | None = None  # [m2] of forest, and of that in reach
    erodible_ratio: float | None = None  # erodible mass in reach over released mass
    barrier_distance: float | None = None  # [m] from reachable ground to the nearest barrier; 0: touched
    barrier_height_ratio: float | None = None  # lowest crest over h0 + U^2 / 2g there
    barrier_height: float | None = None  # [m] of the lowest crest above the ground there
    inflow: tuple = ()  # (volume [m3], first and last time [s], batches) of the hydrograph
    secondary: tuple | None = None  # (mass of the secondary releases over the rest's, number of their areas)
    lake_ratio: float | None = None  # water in lakes over released volume


def over_slope(friction_coefficient: float, facts: TerrainFacts) -> float | None:
    """Return a coefficient of friction over the median slope in reach [1]; None without friction or on level ground.

    Parameters
    ----------
    friction_coefficient : float [1]
    facts : TerrainFacts
    """
    if friction_coefficient <= 0.0 or facts.slope_median < LEAST_SLOPE:
        return None
    return friction_coefficient / facts.slope_median


def number_words(ratio: float | None) -> str:
    """Return what the number of friction is, for its line; "" without a number.

    Parameters
    ----------
    ratio : float or None [1]
        Result of `over_slope`.
    """
    return "" if ratio is None else "; the number is the coefficient of friction over the median slope in reach"


def use_of(table: Any) -> str:
    """Return `use` of a scene's table.

    Parameters
    ----------
    table : table of a scene or None
        None where the scene does not have it.

    Returns
    -------
    {"auto", "on", "off"}
        `auto` where the table is absent.
    """
    return "auto" if table is None else table.use


def by_number(effect: str, use: str, indicator: float, threshold: float, reason: str, protects: str = "") -> Decision:
    """Decide by a number: on where `indicator` is above `threshold`, unless `use` is on or off.

    Parameters
    ----------
    effect : str
        Name in the report.
    use : str
        As of `use_of`; anything but auto and on is off.
    indicator, threshold : float [1]
    reason : str
        What the number is, for the report.
    protects : str
        Which results the threshold protects, for the report.
    """
    reason = f"{reason}; {protects}" if protects else reason
    on = use == "on" or (use == "auto" and indicator > threshold)
    decided_by = "auto" if use == "auto" else "forced"
    return Decision(effect, "on" if on else "off", decided_by, float(indicator), threshold, reason)


def as_asked(effect: str, use: str, reason: str, indicator: float | None = None) -> Decision:
    """Decide as the scene asks: on because the scene has the effect, unless `use` is off; no number decides.

    Parameters
    ----------
    effect : str
        Name in the report.
    use : str
        As of `use_of`; on is reported as forced.
    reason : str
        For the report, where the effect is on.
    indicator : float, optional [1]
        For the report only.
    """
    if use == "off":
        return Decision(effect, "off", "forced", indicator, None, "use = 'off'")
    return Decision(effect, "on", "forced" if use == "on" else "scene", indicator, None, reason)


def not_called_for(effect: str, reason: str) -> Decision:
    """Return that an effect is off because the scene does not use it.

    Parameters
    ----------
    effect, reason : str
        Name and reason in the report.
    """
    return Decision(effect, "off", "scene", None, None, reason)
