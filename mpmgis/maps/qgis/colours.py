"""Colours of bands: one colour map for each quantity, and class limits that span the values of a run.

Each map is ordered in lightness and safe for colour-blind readers, and its dark end is light enough for a hillshade to
show through it. They are parts of the maps of Crameri (2018, doi:10.5281/zenodo.1243862, MIT licence), as hex values,
because the direction of a colour map differs between its releases. Limits are those of AvaFrame where they fit the run,
for comparison of results.
"""

import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...laws.quantities import Quantity
from ...system.errors import InputError
from ..averaging.exported_folder import TYPICAL_PERCENTILE

LAJOLLA = ("#fffecb", "#f7dc77", "#eeb355", "#e68f52", "#de6b4f", "#bb4b48", "#7d3b35")  # depth
BATLOW = ("#011959", "#144d62", "#3c6d56", "#818232", "#d29343", "#fdac9e", "#faccfa")  # lines in plots
BATLOW_REVERSED = ("#faccfa", "#fdb3b1", "#ef9b67", "#b98f32", "#787f36", "#426f52", "#1b5962")  # speed
HAWAII_REVERSED = ("#b3f2fd", "#5fe2bb", "#80c55f", "#9c961c", "#996330", "#94394d", "#8c0273")  # pressure
ACTON_REVERSED = ("#ebd7eb", "#e2b5d1", "#d88fb2", "#c56d95", "#9b658f", "#77628d", "#57517e")  # probability
DAVOS_REVERSED = ("#f5f5d7", "#cfd6a2", "#9baf88", "#7a978d", "#5f8598", "#43709d", "#285190")  # mass, number
NUUK = ("#05598c", "#386982", "#6f878d", "#a1a698", "#bab98d", "#d1d084", "#fefeb2")  # time of arrival
VIK = ("#05528a", "#4289af", "#9dc4d6", "#ece5e0", "#dfb298", "#c87c51", "#a74310")  # signed velocities

DEPTH_LIMITS = (0.5, 1, 2, 3, 4, 5)  # [m]
SPEED_LIMITS = (1, 5, 10, 15, 20, 25, 30)  # [m/s]
PRESSURE_LIMITS = (1, 10, 25, 50, 100)  # [kPa]
PROBABILITY_LIMITS = (0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9)  # [1]
CLASS_STEPS = (1, 2, 2.5, 5, 10)  # widths of classes, times a power of ten
MOST_CLASSES = 7  # [classes] of equal width, or of equal area
FEWEST_BALANCED = 3  # [limits] of classes of equal area
CROWDED = 0.4  # [1] share of the cells with flow in the last class from which classes have equal areas
NO_CLASSES: Mapping[str, tuple] = {}
BEYOND_HAZARD = 1.25  # [1] largest typical value that keeps the hazard classes, over the last of them
OPACITY = 0.75  # [1] of a flow over the hillshade
NORMAL_SIGN = "+ away from it, - into it"
PROBABILITY = "P_"  # prefix of probability bands
STATISTIC = re.compile(r"max|min|mean|arrival|p\d+(\.\d+)?")  # last part of a band's name
BY_HEIGHT = re.compile(r"(rho|p)_-?[\d.]+_-?[\d.]+")  # names of bands of layers of height


class Look(NamedTuple):
    """Display style of one band.

    Parameters
    ----------
    words : str
        Name in the layer list.
    unit : str
        Displayed unit.
    ramp : tuple of str
        Colours from low to high.
    shown : str
        "depth" (hidden below the smallest depth), "size" (hidden at zero), "rate" (shown from zero) or "signed"
        (symmetric about zero).
    limits : tuple of float
        Hazard classes in `unit`; empty: classes of the run.
    factor : float
        Displayed value over the band's.
    fixed : bool
        The limits hold whatever the values are.
    """

    words: str
    unit: str
    ramp: tuple
    shown: str
    limits: tuple = ()
    factor: float = 1.0
    fixed: bool = False

    def title(self, name: str) -> str:
        """Return the name of a dataset: words, symbol and unit.

        Parameters
        ----------
        name : str
            Of the band.
        """
        return f"{self.words} {name}" + (f" ({self.unit})" if self.unit else "")

    def layer_name(self, name: str) -> str:
        """Return the name in the layer list, symbol first, for example "h max [m]: largest flow depth (normal)".

        Parameters
        ----------
        name : str
            Of the band.
        """
        return f"{symbol(name)}{self.bracket}: {self.words}"

    @property
    def bracket(self) -> str:
        """The unit in brackets, after a blank; "" without one."""
        unit = self.unit.partition(";")[0]
        return f" [{unit}]" if unit and ":" not in unit else ""


LOOKS = {
    "h": Look("flow depth (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "t": Look("flow thickness (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "Un": Look("velocity normal to the slope", f"m/s; {NORMAL_SIGN}", VIK, "signed"),
    "Ut": Look("speed along the slope", "m/s", BATLOW_REVERSED, "rate", SPEED_LIMITS),
    "Ut_E": Look("velocity along the slope, to the east", "m/s", VIK, "signed"),
    "Ut_N": Look("velocity along the slope, to the north", "m/s", VIK, "signed"),
    "t_vol": Look("thickness by volume (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "n": Look("number of particles", "", DAVOS_REVERSED, "size"),
    "mass": Look("mass per plan area", "kg/m2", DAVOS_REVERSED, "size"),
    "p": Look("impact pressure", "kPa", HAWAII_REVERSED, "rate", PRESSURE_LIMITS, 1e-3),
    "detached": Look("clear of the bed", "1: yes", HAWAII_REVERSED, "size", (1,)),
    "h_max": Look("largest flow depth (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "t_max": Look("largest flow thickness (normal)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "Un_max": Look("largest velocity away from the slope", "m/s", VIK, "signed"),
    "Un_min": Look("largest velocity into the slope", "m/s; negative", VIK, "signed"),
    "Ut_max": Look("largest speed along the slope", "m/s", BATLOW_REVERSED, "rate", SPEED_LIMITS),
    "p_max": Look("largest impact pressure", "kPa", HAWAII_REVERSED, "rate", PRESSURE_LIMITS, 1e-3),
    "t_arrival": Look("time of arrival", "s", NUUK, "rate"),
    "eroded": Look("eroded depth (vertical)", "m", LAJOLLA, "size"),
    "erosion_rate_max": Look("largest rate of erosion (vertical)", "mm/s", LAJOLLA, "size", (), 1e3),
    "deposit": Look("deposit (vertical)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "thickness_end": Look("last step, still moving (vertical)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "detrained": Look("stopped in forest (vertical)", "m", LAJOLLA, "depth", DEPTH_LIMITS),
    "broken_forest": Look("broken forest", "1: all of the cell", HAWAII_REVERSED, "size", (1,)),
    "surface_new": Look("ground at the end", "m", NUUK, "rate"),
    "bed_new": Look("bed after erosion", "m", NUUK, "rate"),
}


def symbol(name: str) -> str:
    """Return a band's name as a symbol: "h max", "Ut p95", "P(h >= 0.5 m)", "P(arrival)".

    Parameters
    ----------
    name : str
        Of the band.
    """
    of, _, last = name.removeprefix(PROBABILITY).rpartition("_")
    if not name.startswith(PROBABILITY):
        return f"{of} {last}" if of and STATISTIC.fullmatch(last) else name
    unit = {"h": "m", "Ut": "m/s", "p": "Pa"}.get(of)
    return f"P({of} >= {last} {unit})" if unit else f"P({last})"


def look_of(quantity: Quantity, classes: Mapping[str, tuple] = NO_CLASSES) -> Look:
    """Return the display style of a band; a band outside the table is shown by size.

    Probabilities have their own classes; an ensemble statistic (`h_mean`, `p_p95`) or a layer of height
    (`p_0_1`) has the look of its quantity.

    Parameters
    ----------
    quantity : Quantity
    classes : dict of str to tuple of float
        Limits of classes that do not depend on the values, by quantity.
    """
    look = _usual_look(quantity)
    limits = classes.get(quantity.name) or classes.get(_of(quantity.name))
    return look._replace(limits=limits, fixed=True) if limits and look.shown != "signed" else look


def _of(name):
    """The quantity of a band: "h" of "h_max" or "h_p95"; a time of arrival is a quantity of its own."""
    of, _, last = name.rpartition("_")
    return of if of and last != "arrival" and STATISTIC.fullmatch(last) else name


def _usual_look(quantity):
    if quantity.name.startswith(PROBABILITY):
        return Look(quantity.long_name, "", ACTON_REVERSED, "size", PROBABILITY_LIMITS)
    by_height = BY_HEIGHT.fullmatch(quantity.name)
    of = LOOKS.get(by_height[1] if by_height else quantity.name.rpartition("_")[0])
    plain = Look(quantity.long_name, quantity.unit.replace(" s-1", "/s"), LAJOLLA, "size")
    return LOOKS.get(quantity.name, plain if of is None else of._replace(words=quantity.long_name))


def class_limits(look: Look, typical: float) -> tuple:
    """Choose the upper limits of all classes except the last.

    They are the hazard classes if `typical` lies between the third limit and 1.25 times the last; else classes of equal
    width (1, 2, 2.5 or 5 times a power of ten) with the first one halved, and the last one open below `typical`.

    Parameters
    ----------
    look : Look
    typical : float
        Typical largest value, in the band's unit.

    Returns
    -------
    tuple of float
        In the look's unit.
    """
    reached = typical * look.factor
    hazard = look.limits
    fitting = len(hazard) < 3 or hazard[2] <= reached <= BEYOND_HAZARD * hazard[-1]
    if hazard and (look.fixed or fitting):
        return hazard
    step, count = _equal_classes(reached)
    return tuple(float(f"{step * k:.6g}") for k in (0.5, *range(1, count + 1)))


def balanced_limits(look: Look, values: np.ndarray) -> tuple:
    """Choose limits of a depth whose values crowd beyond the last usual limit: classes of about equal area.

    Most cells of a thick 3D flow would have the darkest colour otherwise.

    Parameters
    ----------
    look : Look
    values : float[n]
        Of the cells with flow, in the band's unit.

    Returns
    -------
    tuple of float
        In the look's unit; empty where the usual classes show the values.
    """
    values = np.asarray(values, dtype=float) * look.factor
    if look.shown != "depth" or look.fixed or values.size < MOST_CLASSES:
        return ()
    usual = class_limits(look, float(np.percentile(values, TYPICAL_PERCENTILE)) / look.factor)
    if np.mean(values > usual[-1]) <= CROWDED:
        return ()
    shares = np.percentile(values, np.arange(1, MOST_CLASSES) * 100.0 / MOST_CLASSES)
    limits = tuple(sorted({float(f"{value:.2g}") for value in shares if value > 0}))
    return limits if len(limits) >= FEWEST_BALANCED else ()


def fitting_classes(chosen: Mapping[str, tuple], depths: Mapping[str, np.ndarray]) -> dict[str, tuple]:
    """Return limits of classes by quantity: those chosen, and of depths that crowd in the last usual class.

    Parameters
    ----------
    chosen : dict of str to tuple of float
    depths : dict of str to float[n] [m]
        Of the cells with flow, by quantity of LOOKS.
    """
    found = {name: balanced_limits(LOOKS[name], values) for name, values in depths.items() if name not in chosen}
    return {**{name: limits for name, limits in found.items() if limits}, **chosen}


def chosen_classes(texts: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Return limits of classes by quantity.

    Parameters
    ----------
    texts : sequence of str
        "NAME=A,B,..".

    Raises
    ------
    InputError
        A name is no quantity with classes, or its limits do not ascend.
    """
    known = [name for name, look in LOOKS.items() if look.shown != "signed" and _of(name) == name]
    found = {}
    for text in texts:
        name, _, numbers = str(text).partition("=")
        if name.strip() not in known:
            raise InputError(f"`classes={text}`: {name!r} has no classes; expected one of {', '.join(known)}")
        try:
            limits = tuple(float(part) for part in numbers.split(","))
        except ValueError:
            limits = ()
        if not limits or not all(low < high for low, high in pairwise((0.0, *limits, math.inf))):
            raise InputError(f"`classes={text}`: expected ascending numbers above 0, for example h=0.5,1,2,4")
        found[name.strip()] = limits
    return found


def _equal_classes(reached):
    """(Width, number of limits) of the fewest classes, from 4 to MOST_CLASSES, that span 0 to `reached`."""
    if not 1e-300 < reached < 1e300:
        return 0.2, 5
    power = 10.0 ** math.floor(math.log10(reached / MOST_CLASSES))
    step = next(m * power for m in CLASS_STEPS if reached <= m * power * MOST_CLASSES * (1 + 1e-9))
    return step, max(math.ceil(reached / step - 1e-9) - 1, 1)


def round_up(value: float) -> float:
    """Return the next 1, 2 or 5 times a power of ten at or above a value; 1 if it is not positive or not finite.

    Parameters
    ----------
    value : float
    """
    if not 1e-300 < value < 1e300:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{next(m for m in (1, 2, 5, 10) if value <= m * power * (1 + 1e-9)) * power:.6g}")


def ramp_colours(ramp: tuple, count: int) -> list[str]:
    """Return hex colours spread evenly over a ramp, ends included.

    Parameters
    ----------
    ramp : tuple of str
    count : int
    """
    stops = np.array([[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in ramp], dtype=float)
    at = np.linspace(0, len(ramp) - 1, count)
    channels = [np.interp(at, np.arange(len(ramp)), stops[:, k]) for k in range(3)]
    return ["#" + "".join(f"{round(c):02x}" for c in colour) for colour in zip(*channels, strict=True)]


class ColourClass(NamedTuple):
    """One class of a legend.

    Parameters
    ----------
    upper : float
        Largest value, in the band's unit.
    colour : str or None
        None: transparent.
    label : str
    """

    upper: float
    colour: str | None
    label: str


def colour_classes(look: Look, typical: float, min_depth: float = 0.0) -> list[ColourClass]:
    """Return the classes for all values of a band, from a transparent class (if any) to "> limit".

    Parameters
    ----------
    look : Look
    typical : float
        Typical largest value, in the band's unit.
    min_depth : float [m]
        Depths up to this are transparent.

    Returns
    -------
    list of ColourClass
    """
    limits = class_limits(look, typical)
    floor = min_depth if look.shown == "depth" and min_depth < limits[0] else 0.0
    classes = [] if look.shown == "rate" else [ColourClass(floor, None, f"up to {floor:g} (not drawn)")]
    lowest = f"{floor:g}"
    for limit, colour in zip((*limits, math.inf), ramp_colours(look.ramp, len(limits) + 1), strict=True):
        unit = look.unit.partition(";")[0]
        label = f"> {lowest} {unit}" if math.isinf(limit) else f"{lowest} - {limit:g} {unit}"
        classes.append(ColourClass(limit / look.factor, colour, label.strip()))
        lowest = f"{limit:g}"
    return classes
