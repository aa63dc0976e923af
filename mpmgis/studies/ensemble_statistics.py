"""Compute statistics of an ensemble per cell: probabilities, means, percentiles, envelopes of the peaks.

In cells that a member does not reach it counts with 0, and with an infinite arrival time. Cells that no member
reaches have no value. Members have equal weight.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..laws.quantities import BAND, Quantity
from ..system.errors import InputError

ARRIVAL = "t_arrival"
PEAKS = {"h": "h_max", "Ut": "Ut_max", "p": "p_max"}  # quantity -> band of a member's maxima
WORDS = {
    "h": "largest flow depth (normal)",
    "Ut": "largest speed along the slope",
    "p": "largest impact pressure",
    ARRIVAL: "time of arrival",
}
PROBABILITY = "probability"
DEFAULT_EXCEED = {"h": (0.5, 1.0, 2.0)}  # [m]
DEFAULT_PERCENTILES = (5.0, 50.0, 95.0)  # [%]
NEAR_MEMBER = 1e-9  # [ranks] distance within which a percentile is the value of one member


class Band(NamedTuple):
    """A band of a raster of statistics.

    Parameters
    ----------
    quantity : Quantity
    source : str
        Band of the members.
    kind : {"exceeded", "arrived", "mean", "percentile", "smallest", "largest"}
    number : float
        Threshold or percentile.
    """

    quantity: Quantity
    source: str
    kind: str
    number: float = 0.0


@dataclass(frozen=True)
class Products:
    """The requested statistics of an ensemble.

    Parameters
    ----------
    exceed : dict of str to tuple of float
        Thresholds by quantity: h [m], Ut [m s-1], p [Pa].
    percentiles : tuple of float
        In [0, 100].
    """

    exceed: dict
    percentiles: tuple

    @classmethod
    def of(cls, exceed: dict | None = None, percentiles: Sequence | None = None) -> "Products":
        """Return the requested statistics, with defaults for None.

        Parameters
        ----------
        exceed : dict of str to sequence of float, optional
            Thresholds by quantity: h [m], Ut [m s-1], p [Pa].
        percentiles : sequence of float, optional
            In [0, 100].

        Raises
        ------
        InputError
            An unknown quantity, or a number outside its range.
        """
        exceed = DEFAULT_EXCEED if exceed is None else exceed
        percentiles = DEFAULT_PERCENTILES if percentiles is None else percentiles
        for name, thresholds in exceed.items():
            if name not in PEAKS:
                raise InputError(f"--exceed {name}: expected one of {', '.join(PEAKS)}, for example h=0.5,1,2")
            if not thresholds or not all(_is_number(value) and value > 0 for value in thresholds):
                raise InputError(f"--exceed {name}={_listed(thresholds)}: expected numbers above 0")
        if not all(_is_number(value) and 0 <= value <= 100 for value in percentiles):
            raise InputError(f"--percentiles {_listed(percentiles)}: expected numbers from 0 to 100")
        ordered = {name: tuple(sorted(set(map(float, exceed[name])))) for name in PEAKS if name in exceed}
        return cls(ordered, tuple(sorted(set(map(float, percentiles)))))

    def rasters(self) -> dict[str, list[Band]]:
        """Return the bands of each raster, by its name."""
        arrived = Quantity("P_arrival", "1", "probability that the flow arrives", "float32")
        made = {PROBABILITY: [self._exceeded(name, value) for name, values in self.exceed.items() for value in values]}
        made[PROBABILITY].append(Band(arrived, ARRIVAL, "arrived"))
        for name in PEAKS:
            made[name] = self._spread(name, PEAKS[name], ("mean", "smallest", "largest"))
        made[ARRIVAL] = self._spread(ARRIVAL, ARRIVAL, ("smallest",))
        return made

    def _exceeded(self, name, threshold):
        unit = BAND[name].unit
        words = f"probability that the {WORDS[name]} is at least {threshold:g} {unit}"
        return Band(Quantity(f"P_{name}_{threshold:g}", "1", words, "float32"), PEAKS[name], "exceeded", threshold)

    def _spread(self, name, source, kinds):
        endings = {"mean": ("mean", "mean"), "smallest": ("min", "smallest"), "largest": ("max", "largest")}
        unit, bands = BAND[source].unit, []
        for kind in kinds:
            ending, word = endings[kind]
            words = f"{WORDS[name]}, {word} of all members"
            bands.append(Band(Quantity(f"{name}_{ending}", unit, words, "float32"), source, kind))
        for value in self.percentiles:
            words = f"{WORDS[name]}, {value:g}th percentile of the members"
            quantity = Quantity(f"{name}_p{value:g}", unit, words, "float32")
            bands.append(Band(quantity, source, "percentile", value))
        return bands

    def as_tables(self) -> dict:
        """Return the request as a dictionary for TOML."""
        return {"percentiles": list(self.percentiles), "exceed": {name: list(of) for name, of in self.exceed.items()}}


def statistics(bands: list[Band], source: str, stack: np.ndarray) -> dict[int, np.ndarray]:
    """Compute the bands of one source.

    Parameters
    ----------
    bands : list of Band
    source : str
        Of `quantities.MEMBER_BANDS`.
    stack : float32[members, rows, columns]
        NaN without flow of a member; overwritten.

    Returns
    -------
    dict of int to float32[rows, columns]
        By index in `bands`.
    """
    asked = {k: band for k, band in enumerate(bands) if band.source == source}
    missing = np.isnan(stack)
    nowhere = missing.all(axis=0)
    if any(band.kind == "arrived" for band in asked.values()):
        arrived = 1.0 - missing.mean(axis=0)
    np.copyto(stack, np.inf if source == ARRIVAL else 0.0, where=missing)
    del missing
    made = {k: _value(band, stack) for k, band in asked.items() if band.kind not in ("arrived", "percentile")}
    made |= {k: arrived for k, band in asked.items() if band.kind == "arrived"}
    ranked = {k: band.number for k, band in asked.items() if band.kind == "percentile"}
    if ranked:
        made |= dict(zip(ranked, _percentiles(stack, list(ranked.values())), strict=True))
    return {
        k: np.where(nowhere | ~np.isfinite(values), np.nan, values).astype(np.float32) for k, values in made.items()
    }


def _value(band, stack):
    if band.kind == "exceeded":
        return (stack >= np.float32(band.number)).mean(axis=0)
    if band.kind == "mean":
        return stack.mean(axis=0, dtype=np.float64)
    return stack.min(axis=0) if band.kind == "smallest" else stack.max(axis=0)


def _percentiles(stack, numbers):
    """Yield the percentile of `stack` along its first axis for each of the `numbers`, linear between two members.

    As in NumPy, but a percentile at the rank of a member is exactly its value: NumPy returns NaN for an arrival before
    an infinite one (0 times infinity). The stack is partially sorted in place.
    """
    places = [number / 100.0 * (len(stack) - 1) for number in numbers]
    below = [int(place + NEAR_MEMBER) for place in places]
    stack.partition(sorted({min(k + more, len(stack) - 1) for k in below for more in (0, 1)}), axis=0)
    for place, k in zip(places, below, strict=True):
        share = place - k
        if share <= NEAR_MEMBER:
            yield stack[k].copy()
        else:
            with np.errstate(invalid="ignore"):  # between two infinite arrival times
                yield stack[k] + share * (stack[k + 1].astype(float) - stack[k])


def exceedances(texts: Iterable[str]) -> dict:
    """Read thresholds by quantity from texts like h=0.5,1,2.

    Parameters
    ----------
    texts : iterable of str

    Raises
    ------
    InputError
        Other text.
    """
    made = {}
    for text in texts:
        name, equals, values = text.partition("=")
        try:
            thresholds = tuple(float(value) for value in values.split(",")) if equals else ()
        except ValueError:
            thresholds = ()
        if not thresholds:
            raise InputError(f"--exceed {text}: expected QUANTITY=NUMBER,.. for example h=0.5,1,2")
        made[name.strip()] = (*made.get(name.strip(), ()), *thresholds)
    return made


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _listed(values):
    return ",".join(map(str, values))
