"""Answer `mpmgis compare`: two results, or a result and an observed outline, in numbers and on a map."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..frames.run_terrain import terrain_of_rasters
from ..laws.quantities import SQUARE_METRES_PER_HECTARE, Quantity
from ..system.csv_rows import write_records
from ..system.errors import InputError
from ..system.messages import log
from ..system.option import PathLike
from ..system.option_values import defaults_of
from ..terrain.elevation import Terrain
from ..terrain.grid import Grid
from . import comparison, flow_line
from .answer_files import checked_output, finite_or_none, short_number, write_answer
from .comparison import Difference, Overlap
from .comparison_files import MapSide, write_classes, write_classes_style, write_comparison_map
from .comparison_sides import footprints_of, log_if_empty, open_side, reading_of, require_useful_options, sides_of
from .flow_line import given_line, heights_under, vertex_distances
from .outline_distance import OutlineDistances, outline_distances
from .question_options import ReadingOptions

HEAD_WIDTH = 46  # [characters] of the name of a quantity
HEADINGS = ("quantity", "unit", "A", "B", "A - B", "A with B")
CENTRE_LINE = "centre line of both flows"
FILES = ("map.png", "table.csv", "classes.tif", "classes.qml")


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
            "peak_a": finite_or_none(self.peak[0]),
            "peak_b": finite_or_none(self.peak[1]),
            "p99_a": finite_or_none(self.percentile[0]),
            "p99_b": finite_or_none(self.percentile[1]),
            "mean_difference": finite_or_none(self.difference.mean),
            "rms_difference": finite_or_none(self.difference.rms),
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
            "iou": finite_or_none(self.overlap.iou),
            "both_m2": self.overlap.both,
            "only_a_m2": self.overlap.only_first,
            "only_b_m2": self.overlap.only_second,
            "observed": None if self.observed is None else "ab"[self.observed],
            "observed_reached": finite_or_none(self.observed_reached),
            "outline_distance_m": None if self.distances is None else self.distances._asdict(),
            "line": {"source": self.line_source, "vertices": None if self.line is None else self.line.tolist()},
            "bands": [band.facts() for band in self.bands],
            "files": [str(file) for file in self.files],
        }

    def lines(self) -> list[str]:
        """Return lines of text for a terminal."""
        lines = [_headline(letter, side) for letter, side in zip("AB", self.sides, strict=True)]
        band = next(side.band for side in self.sides if side.band is not None)
        lines.append(
            f"footprint: {band} above {self.threshold:g} {self.unit}".rstrip()
            + f"; overlap on cells of {self.cell_size:g} m; runout along {self.line_source}"
        )
        lines.append("")
        lines.append(_row("", "", "A", "B", "A - B", "%"))
        lines += [_number_row(*row) for row in self.rows()]
        lines.append("")
        overlap = self.overlap
        for text, area in self.area_words():
            share = f"{100 * area / overlap.either:.1f} %"
            lines.append(_row(text, "ha", short_number(area / SQUARE_METRES_PER_HECTARE), share))
        lines.append(_row("overlap (IoU)", "", f"{overlap.iou:.3f}"))
        if self.observed is not None:
            lines.append(_row("share of the outline reached", "", f"{100 * self.observed_reached:.1f} %"))
        lines += [_row(quantity, unit, short_number(value)) for quantity, unit, value in self.distance_rows()]
        compared = [band for band in self.bands if math.isfinite(band.difference.mean)]
        if compared:
            lines += ["", _row("A - B where both flowed", "", "mean", "rms")]
            lines += [
                _row(band.name, band.unit, short_number(band.difference.mean), short_number(band.difference.rms))
                for band in compared
            ]
        return lines


def compare(
    first: PathLike,
    second: PathLike,
    reading: ReadingOptions | None = None,
    *,
    threshold: float = 0.1,
    band: str | None = None,
    line: PathLike | None = None,
    dem: PathLike | None = None,
    to_crs: str | None = None,
    output: PathLike | None = None,
    overwrite: bool = False,
) -> Comparison:
    """Compare two results, or a result and an observed outline; write map and table to `output`, if any.

    Area, runout and peaks of each side are computed on its own cells. Overlap and differences are computed on the cells
    of the finer side, extended over both footprints, with the other side's value at the cell centre.

    Parameters
    ----------
    first, second : path
    reading : ReadingOptions, optional
        Of another code's files; it may have further keys.
    threshold : float [m, or the unit of the band]
        Cells above it belong to the footprint.
    band : str, optional
        Band whose footprint is compared.
    line : path, optional
        File with the line along which runout is measured.
    dem : path, optional
        DTM, in `to_crs`.
    to_crs : str, optional
    output : path, optional
    overwrite : bool

    Returns
    -------
    Comparison

    Raises
    ------
    MpmgisError
        An input cannot be read or does not match, or the output exists; nothing is written then.
    """
    if not (math.isfinite(threshold) and threshold >= 0):
        raise InputError(f"`threshold` is {threshold:g}, expected a number of 0 or more")
    paths, how = (first, second), reading_of(reading or defaults_of(ReadingOptions))
    if output is not None:
        read = [path for path in (*paths, line, dem) if path is not None]
        output = checked_output(output, FILES, overwrite, read)
    require_useful_options(paths, how)
    sources = [open_side(path, dem, how) for path in paths]
    footprints, pairs, joint = footprints_of(paths, sources, threshold, band)
    bands = tuple(_band_facts(pair, sources, footprints, joint) for pair in pairs)
    terrain = _terrain(dem, to_crs, sources, joint)
    vertices, line_source = _line(line, footprints, terrain, joint)
    sides = sides_of(footprints, sources, vertices, terrain, threshold)
    masks = [footprint.on_joint for footprint in footprints]
    found = Comparison(
        sides=sides,
        threshold=threshold,
        unit=next(footprint.unit for footprint in footprints if footprint.band is not None),
        cell_size=joint.cell_size,
        overlap=comparison.overlap(*masks, joint.cell_area),
        line=vertices,
        line_source=line_source,
        bands=bands,
        distances=outline_distances(*(footprint.outline() for footprint in footprints), 0.5 * joint.cell_size),
    )
    if vertices is not None:
        _log_line_end(found)
    if output is None:
        return found
    return replace(found, files=write_answer(output, overwrite, _writers(found, footprints, joint, terrain)))


def _band_facts(pair, sources, footprints, joint):
    """Peaks of one quantity on each side's own cells, and the difference where both flowed."""
    units = [source.bands[name].quantity.unit for source, name in zip(sources, pair, strict=True) if name]
    if len(set(units) - {""}) > 1:
        raise InputError(
            f"{pair[0]} is in {units[0]} in {footprints[0].name}, {pair[1]} in {units[1]} in {footprints[1].name}; "
            "convert one of them (rio calc, or QGIS' raster calculator)"
        )
    peaks, percentiles, values = [], [], []
    for source, name, footprint in zip(sources, pair, footprints, strict=True):
        if name is None:
            peaks.append(math.nan)
            percentiles.append(math.nan)
            continue
        own, grid = source.read(name, joint)
        if name != footprint.band:  # logged before
            log_if_empty(source, name, own)
        peaks.append(comparison.peak(own, name))
        percentiles.append(comparison.high_percentile(own, name))
        values.append(comparison.nearest(own, grid, joint) if None not in pair else None)
    both = footprints[0].on_joint & footprints[1].on_joint
    gap = comparison.Difference(math.nan, math.nan) if None in pair else comparison.difference(*values, both)
    return BandFacts(pair, next((unit for unit in units if unit), ""), tuple(peaks), tuple(percentiles), gap)


def _terrain(dem, to_crs, sources, joint):
    """The given DTM, else of the first result with one; None without."""
    path = dem or next((source.terrain for source in sources if source.terrain is not None), None)
    if path is None or isinstance(path, Terrain):
        return path
    return terrain_of_rasters(path, joint.crs, to_crs=to_crs)


def _line(path, footprints, terrain, joint):
    """(vertices, description) of the line along which runout is measured; (None, reason) without `line` and DTM."""
    flowed = footprints[0].on_joint | footprints[1].on_joint
    if path is not None:
        return given_line(path, flowed, joint, terrain), str(path)
    if terrain is None:
        log.info("no DTM beside the results: runout needs `line`, or `dem` to find the path of the flow")
        return None, "none: no --line, no DTM"
    elevation = heights_under(flowed, joint, terrain)
    masks, weights = ([getattr(f, key) for f in footprints] for key in ("on_joint", "weight"))
    line = flow_line.centre_line(masks, weights, elevation, joint)
    if line is None:
        log.info(f"{terrain.path} has no elevations under the flow, or the flow is one cell: no runout; give `line`")
        return None, "none: no heights under the flow"
    return line, CENTRE_LINE


def _log_line_end(found):
    length = float(vertex_distances(found.line)[-1])
    beyond = max((side.farthest_along - length for side in found.sides if side.farthest is not None), default=0.0)
    if beyond > found.cell_size and found.line_source != CENTRE_LINE:
        log.info(f"{found.line_source} ends {beyond:.0f} m before the flow does; it is extended straight")


def _writers(found, footprints, joint, terrain):
    """File name -> function of the path to write."""
    values = [None if footprint.band is None else footprint.weight for footprint in footprints]
    name = next(footprint.band for footprint in footprints if footprint.band is not None)
    band, masks = Quantity(name, found.unit, ""), [footprint.on_joint for footprint in footprints]
    writers = (
        lambda path: _write_map(path, found, footprints, joint, terrain),
        lambda path: write_table(path, found),
        lambda path: write_classes(path, joint, *masks, values, band),
        write_classes_style,
    )
    return dict(zip(FILES, writers, strict=True))


def _write_map(path: Path, found: Comparison, footprints: tuple, joint: Grid, terrain: Terrain | None) -> None:
    threshold = f"{found.threshold:g} {found.unit}".strip()
    sides = [
        MapSide(side.name, footprint.on_joint, area, side.farthest, side.runout)
        for side, footprint, area in zip(
            found.sides, footprints, (found.overlap.only_first, found.overlap.only_second), strict=True
        )
    ]
    band = next(footprint.band for footprint in footprints if footprint.band is not None)
    title = f"Overlap (IoU) {found.overlap.iou:.3f}: {band} above {threshold}"
    write_comparison_map(path, terrain, joint, sides, found.overlap.both, found.line, title)


def write_table(path: Path, found: Comparison) -> None:
    """Write the numbers of a Comparison as CSV in SI units; missing numbers are empty.

    Parameters
    ----------
    path : Path
    found : Comparison
    """
    names = ("name", "", *(side.name for side in found.sides), "", "")
    rows = [(quantity, unit, *numbers, "") for quantity, unit, *numbers in found.rows()]
    common = [(quantity, unit, "", "", "", value) for quantity, unit, value in found.common_rows()]
    write_records(path, HEADINGS, [names, *rows, *common])


def _headline(letter, side):
    return f"{letter}  {side.name} ({side.kind}{f', {side.band}' if side.band else ''})"


def _number_row(quantity, unit, first, second, gap):
    scale = SQUARE_METRES_PER_HECTARE if unit == "m2" else 1.0
    share = 100 * gap / abs(second) if second else math.nan
    cells = [short_number(value / scale) for value in (first, second, gap)]
    return _row(quantity, "ha" if unit == "m2" else unit, *cells, f"{share:+.1f}" if math.isfinite(share) else "-")


def _row(quantity, unit, *cells):
    head = f"{quantity} [{unit}]" if unit else quantity
    return (f"{head:<{HEAD_WIDTH}}" + "".join(f"{cell:>12}" for cell in cells)).rstrip()
