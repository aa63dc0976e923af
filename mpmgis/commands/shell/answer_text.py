"""Print the results of questions as lines of text."""

import math
from typing import Any

from ...laws.quantities import SQUARE_METRES_PER_HECTARE

SERIES_HEADINGS = ("point", "arrival [s]", "largest h [m]", "at [s]", "largest Ut [m/s]", "at [s]")
LOAD_HEADINGS = (
    "time [s]",
    "h normal [m]",
    "momentum [kN/m]",
    "at height [m]",
    "largest p [kPa]",
    "overburden [kN/m]",
    "at height [m]",
)
COLUMN_WIDTH = 19  # [characters] of a column of loads
HEAD_WIDTH = 46  # [characters] of the name of a quantity


def lines_of(verb: str, found: Any, values: dict[str, Any]) -> list[str]:
    """Return lines of text about the answer of a verb, then the paths of its files.

    Parameters
    ----------
    verb : str
    found : object
        What the function of the verb returned: paths, or an object with `files`.
    values : dict
        Options of the command by name.

    Returns
    -------
    list of str
    """
    if isinstance(found, (list, tuple)):
        return [str(path) for path in found]
    own = _LINES.get(verb, lambda found, values: [])(found, values)
    return [*own, *([] if verb == "compare" else map(str, found.files))]


def _runout(found, values):
    """Lines of text about a RunoutFound."""
    lines = [f"{found.name}: cells deeper than {found.threshold:g} m, along {found.line_source}"]
    for quantity, unit, value in found.rows():
        head = f"{quantity.replace('_', ' ')} [{unit}]" if unit != "1" else quantity.replace("_", " ")
        lines.append(f"{head:<40}{_figure(value):>10}")
    return lines


def _figure(value):
    if not math.isfinite(value):
        return "-"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3f}"


def _timeseries(found, values):
    """Lines of text about a SeriesFound."""
    width = max(map(len, (*found.names, SERIES_HEADINGS[0]))) + 2
    lines = [f"{SERIES_HEADINGS[0]:<{width}}" + "".join(f"{word:>18}" for word in SERIES_HEADINGS[1:])]
    for point, name in enumerate(found.names):
        numbers = found.arrival(point, values["min_depth"]), *found.peak("h", point), *found.peak("Ut", point)
        lines.append(f"{name:<{width}}" + "".join(f"{_short(value):>18}" for value in numbers))
    return lines


def _short(value):
    return f"{value:.4g}" if math.isfinite(value) else "-"


def _hydrograph(found, values):
    """Lines of text about a HydrographFound."""
    cells_volume, cells_mass = found.cells_totals()[-1]
    rate, time = found.peak()
    counted = f"{found.by_particles.sum()} of {len(found.by_particles)} intervals counted by particles"
    lines = [
        f"{found.name}: positive towards {found.azimuth:.0f} degrees from north; {counted}",
        f"through the section   {found.volume.sum():.6g} m3, {found.mass.sum():.6g} kg",
        f"by flux of cells      {cells_volume:.6g} m3, {cells_mass:.6g} kg",
        f"largest discharge     {rate:.6g} m3/s, mean of the interval to {time:g} s",
    ]
    balance = found.balance
    if balance is not None:
        parts = f"{balance.crossed:.6g} through it, {balance.round_ends:.6g} around its ends, {balance.began:.6g}"
        lines.append(
            f"mass beyond it        {balance.beyond:+.6g} kg = {parts} new there; error {balance.error:.1e} kg"
        )
    if found.unseen > 0:
        lines.append(f"up to {found.unseen:.6g} kg appeared or disappeared between two frames; counted from then on")
    return lines


def _vertical(found, values):
    """Lines of text about a VerticalFound."""
    width = max(map(len, (*found.names, "point"))) + 2
    lines = [f"{'point':<{width}}" + "".join(f"{word:>{COLUMN_WIDTH}}" for word in LOAD_HEADINGS)]
    for name, _, _, time, depth, momentum, height, largest, weight, height_of_weight in found.load_rows():
        cells = (time, depth, momentum / 1e3, height, largest / 1e3, weight / 1e3, height_of_weight)
        lines.append(f"{name:<{width}}" + "".join(f"{_short(value):>{COLUMN_WIDTH}}" for value in cells))
    return lines


def _intensity(found, values):
    """Lines of text about an IntensityFound."""
    guideline = found.guideline
    lines = [f"{found.name}: {guideline.title or guideline.name}", f"by {guideline.source}"]
    if guideline.note:
        lines.append(f"({guideline.note})")
    width = max(len(entry.name) for entry in guideline.classes) + 2
    for entry, area in zip(guideline.classes, found.areas, strict=True):
        lines.append(f"{entry.name:<{width}}{area / SQUARE_METRES_PER_HECTARE:>10.2f} ha   {entry.words()}")
    return lines + [f"{entry.name}: {entry.origin()}" for entry in guideline.classes if entry.read_in]


def _hazard_map(found, values):
    """Lines of text about a HazardFound."""
    matrix = found.matrix
    lines = [f"{matrix.title or matrix.name}", f"by {matrix.source}", *([f"({matrix.note})"] if matrix.note else [])]
    width = max(len(level.name) for level in matrix.levels) + 2
    for level, area in zip(matrix.levels, found.areas, strict=True):
        lines.append(f"{level.name:<{width}}{area / SQUARE_METRES_PER_HECTARE:>10.2f} ha   {level.meaning}")
    if found.not_assessed:
        lines.append(f"not assessed, no data: {found.not_assessed / SQUARE_METRES_PER_HECTARE:.2f} ha")
    if matrix.is_unread:
        lines.append("numbers of this matrix are not verified in the document in part; check them there")
    return lines


def _compare(found, values):
    """Lines of text about a Comparison."""
    lines = [_headline(letter, side) for letter, side in zip("AB", found.sides, strict=True)]
    band = next(side.band for side in found.sides if side.band is not None)
    lines.append(
        f"footprint: {band} above {found.threshold:g} {found.unit}".rstrip()
        + f"; overlap on cells of {found.cell_size:g} m; runout along {found.line_source}"
    )
    lines.append("")
    lines.append(_row("", "", "A", "B", "A - B", "%"))
    lines += [_number_row(*row) for row in found.rows()]
    lines.append("")
    overlap = found.overlap
    for text, area in found.area_words():
        share = f"{100 * area / overlap.either:.1f} %"
        lines.append(_row(text, "ha", _text(area / SQUARE_METRES_PER_HECTARE), share))
    lines.append(_row("overlap (IoU)", "", f"{overlap.iou:.3f}"))
    if found.observed is not None:
        lines.append(_row("share of the outline reached", "", f"{100 * found.observed_reached:.1f} %"))
    lines += [_row(quantity, unit, _text(value)) for quantity, unit, value in found.distance_rows()]
    compared = [band for band in found.bands if math.isfinite(band.difference.mean)]
    if compared:
        lines += ["", _row("A - B where both flowed", "", "mean", "rms")]
        lines += [
            _row(band.name, band.unit, _text(band.difference.mean), _text(band.difference.rms)) for band in compared
        ]
    return lines


def _headline(letter, side):
    return f"{letter}  {side.name} ({side.kind}{f', {side.band}' if side.band else ''})"


def _number_row(quantity, unit, first, second, gap):
    scale = SQUARE_METRES_PER_HECTARE if unit == "m2" else 1.0
    share = 100 * gap / abs(second) if second else math.nan
    cells = [_text(value / scale) for value in (first, second, gap)]
    return _row(quantity, "ha" if unit == "m2" else unit, *cells, f"{share:+.1f}" if math.isfinite(share) else "-")


def _row(quantity, unit, *cells):
    head = f"{quantity} [{unit}]" if unit else quantity
    return (f"{head:<{HEAD_WIDTH}}" + "".join(f"{cell:>12}" for cell in cells)).rstrip()


def _text(value):
    """Four digits of a number; a dash where it is not finite."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"


_LINES = {
    "runout": _runout,
    "timeseries": _timeseries,
    "hydrograph": _hydrograph,
    "vertical": _vertical,
    "intensity": _intensity,
    "report": _hazard_map,
    "compare": _compare,
}
