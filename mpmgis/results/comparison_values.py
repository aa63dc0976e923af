"""Hold the result of a comparison, as table rows and as plain values."""

import math
from dataclasses import dataclass

import numpy as np

from .comparison import Difference, Overlap
from .flow_line import Runout
from .outline_distance import OutlineDistances


@dataclass(frozen=True)
class Side:
    """One of the two results: `name`, `kind`, `band` of its footprint (None: an outline), `area` [m2].

    `farthest` (Runout or None) is measured from the start of the line. The runout is measured from `top` [m], the
    distance along the line of the highest point of the flow (NaN: unknown).
    """

    name: str
    kind: str
    band: str | None
    area: float
    farthest: Runout | None = None
    top: float = math.nan

    @property
    def farthest_along(self) -> float:
        """Distance [m] along the line from its start to the farthest point; NaN without one."""
        return math.nan if self.farthest is None else self.farthest.distance

    @property
    def runout(self) -> float:
        """Distance [m] along the line from the highest to the farthest point of the flow; NaN if unknown."""
        return self.farthest_along - self.top

    def facts(self) -> dict:
        """Return the side as plain numbers and strings."""
        place = None if self.farthest is None else [self.farthest.x, self.farthest.y]
        return {
            "name": self.name,
            "kind": self.kind,
            "band": self.band,
            "area_m2": self.area,
            "runout_m": _number(self.runout),
            "runout_at": place,
            "farthest_along_line_m": _number(self.farthest_along),
        }


@dataclass(frozen=True)
class BandFacts:
    """One quantity of both: names (None: missing), unit, (first, second) `peak` and 99th `percentile`, difference."""

    names: tuple
    unit: str
    peak: tuple
    percentile: tuple
    difference: Difference

    @property
    def name(self) -> str:
        """Both names joined, or the common name."""
        return " / ".join(dict.fromkeys(name for name in self.names if name))

    def facts(self) -> dict:
        """Return the band as plain numbers and strings."""
        return {
            "a": self.names[0],
            "b": self.names[1],
            "unit": self.unit,
            "peak_a": _number(self.peak[0]),
            "peak_b": _number(self.peak[1]),
            "p99_a": _number(self.percentile[0]),
            "p99_b": _number(self.percentile[1]),
            "mean_difference": _number(self.difference.mean),
            "rms_difference": _number(self.difference.rms),
        }


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison. Plan areas [m2], distances [m].

    Parameters
    ----------
    sides : (Side, Side)
    threshold : float
        In `unit`; cells above it belong to the footprint.
    cell_size : float [m]
        Of the common grid.
    overlap : Overlap
    line : float[n, 2] [m] or None
        Line along which the runout is measured.
    line_source : str
        Source of the line, or the reason for its absence.
    bands : tuple of BandFacts
    distances : OutlineDistances or None
        Between the outlines of both footprints.
    files : tuple of Path
        Files written.
    """

    sides: tuple
    threshold: float
    unit: str
    cell_size: float
    overlap: Overlap
    line: np.ndarray | None
    line_source: str
    bands: tuple
    distances: OutlineDistances | None = None
    files: tuple = ()

    @property
    def observed(self) -> int | None:
        """Index of the side that is an observed outline; None if both are results."""
        return next((k for k, side in enumerate(self.sides) if side.band is None), None)

    def area_words(self) -> tuple:
        """Return labels and plan areas of what both cover, only the first covers, and only the second covers.

        Against an observed outline: area of the result alone is overestimated, of the outline alone underestimated.

        Returns
        -------
        tuple of (str, float [m2])
        """
        words = {None: ("only A", "only B"), 0: ("underestimated, only A", "overestimated, only B")}
        words[1] = ("overestimated, only A", "underestimated, only B")
        first, second = words[self.observed]
        overlap = self.overlap
        return (("both", overlap.both), (first, overlap.only_first), (second, overlap.only_second))

    @property
    def observed_reached(self) -> float:
        """Share of the outline covered by the result; NaN if both are results or the outline is empty."""
        if self.observed is None:
            return math.nan
        only = (self.overlap.only_first, self.overlap.only_second)[self.observed]
        outline = self.overlap.both + only
        return self.overlap.both / outline if outline > 0 else math.nan

    def distance_rows(self) -> tuple:
        """Return the distances between the outlines as rows; () if one is empty.

        Returns
        -------
        tuple of (str, str, float)
            Quantity, unit, value.
        """
        if self.distances is None:
            return ()
        words = ("A to B, mean", "B to A, mean", "both ways, mean", "both ways, 95 %", "both ways, largest (Hausdorff)")
        return tuple((f"outlines {word}", "m", value) for word, value in zip(words, self.distances, strict=True))

    def reported_bands(self) -> list[BandFacts]:
        """Return the bands to report: common bands; if one side is an outline, the footprint band of the other.

        A band with the same numbers as an earlier one is omitted: columns have t = h.
        """
        alone, footprints = any(side.band is None for side in self.sides), {side.band for side in self.sides} - {None}
        reported = {}
        for band in self.bands:
            if (set(band.names) & footprints) if alone else None not in band.names:
                reported.setdefault(str((band.unit, band.peak, band.percentile, band.difference)), band)
        return list(reported.values())

    def rows(self) -> list[tuple]:
        """Return a row for every number with a value for each side.

        Returns
        -------
        list of (str, str, float, float, float)
            Quantity, unit, first, second, first minus second.
        """
        first, second = self.sides
        rows = [("area", "m2", first.area, second.area)]
        if self.line is not None:
            rows.append(("runout", "m", first.runout, second.runout))
            rows.append(("farthest along line", "m", first.farthest_along, second.farthest_along))
        for band in self.reported_bands():
            rows.append((f"{band.name} peak", band.unit, *band.peak))
            rows.append((f"{band.name} 99 %", band.unit, *band.percentile))
        return [(*row, row[2] - row[3]) for row in rows]

    def common_rows(self) -> list[tuple]:
        """Return a row for every number that describes both sides together.

        Returns
        -------
        list of (str, str, float)
            Quantity, unit, value.
        """
        overlap = self.overlap
        rows = [(word, "m2", area) for word, area in self.area_words()]
        rows.append(("overlap (IoU)", "1", overlap.iou))
        if self.observed is not None:
            rows.append(("of the outline reached", "1", self.observed_reached))
        rows += self.distance_rows()
        for band in self.reported_bands():
            if math.isfinite(band.difference.mean):
                rows.append((f"{band.name} A - B mean", band.unit, band.difference.mean))
                rows.append((f"{band.name} A - B rms", band.unit, band.difference.rms))
        return rows

    def facts(self) -> dict:
        """Return all results as plain numbers, lists and strings; None for missing numbers."""
        return {
            "a": self.sides[0].facts(),
            "b": self.sides[1].facts(),
            "threshold": self.threshold,
            "unit": self.unit,
            "cell_size_m": self.cell_size,
            "iou": _number(self.overlap.iou),
            "both_m2": self.overlap.both,
            "only_a_m2": self.overlap.only_first,
            "only_b_m2": self.overlap.only_second,
            "observed": None if self.observed is None else "ab"[self.observed],
            "observed_reached": _number(self.observed_reached),
            "outline_distance_m": None if self.distances is None else self.distances._asdict(),
            "line": {"source": self.line_source, "vertices": None if self.line is None else self.line.tolist()},
            "bands": [band.facts() for band in self.bands],
            "files": [str(file) for file in self.files],
        }


def _number(value):
    return value if math.isfinite(value) else None
