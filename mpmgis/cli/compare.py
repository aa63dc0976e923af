"""`mpmgis compare`: two results, or a result and an observed outline, in numbers and on a map."""

import argparse
import json
import math
from pathlib import Path

from . import foreign_options, talk
from .values import number, positive

EXAMPLE = """
mpmgis compare results_gis other_gis
mpmgis compare results_gis mapped_outline.gpkg --line flow_path.shp -o comparison
mpmgis compare results_gis reference/com1DFA --threshold 0.1 -o map.png
mpmgis compare results matter --axes e,u,-n --origin 600000,5170000,0 --density 1500 --dem dtm.tif
"""
DESCRIPTION = """
Area, runout, peaks, and how far the footprints overlap (IoU: the area in both over the area in either). A and B are
each an export (results_gis), the folder of a run, another code's particles (a folder or a file), rasters named *_pft,
*_pfv, *_ppr as ISeeSnow and AvaFrame do (their folder, or the beginning of their names), one raster, or an outline as
polygons. Of another code's particles the maxima are those of the frames that are there. Each side's area, runout and
peaks are taken on its own cells; overlap and differences on the finer side's, where the other side has the value of
its cell under the centre (nearest: nothing is blended). Beside an outline what only the result covers is
overestimated, what only the outline covers underestimated. Distances between outlines go from places on one, half a
cell apart, to the nearest place on the other; a raster's outline runs along its cells. Runout is the distance along
the line, from its start, to the farthest cell of the footprint; each cell counts at the nearest place of the line,
which goes on straight at its end. Without --line the line is the centre line of both flows together, from their
highest part.
"""
SQUARE_METRES_PER_HECTARE = 1e4
HEAD_WIDTH = 46  # of a quantity's name on the screen


def add_arguments(parser):
    """Declare the verb's options."""
    parser.description = DESCRIPTION.strip()
    parser.add_argument("first", metavar="A", type=Path, help="a result or an outline")
    parser.add_argument("second", metavar="B", type=Path, help="what it is compared with; differences are A - B")
    parser.add_argument(
        "--threshold",
        type=_not_negative,
        metavar="M",
        default=0.1,
        help="footprint: cells above this [m, or the unit of --band] (default 0.1)",
    )
    parser.add_argument(
        "--band",
        metavar="NAME",
        help="band whose footprint is compared, for example h_deposit with a mapped deposit (default: peak thickness, "
        "pft or h_max)",
    )
    parser.add_argument(
        "--line", type=Path, metavar="FILE", help="line along which runout is read, from the top (default: see above)"
    )
    parser.add_argument(
        "--dem",
        type=Path,
        metavar="FILE",
        help="DTM for the line, the map and the export of runs (default: the one beside the results)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON, in SI units")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PATH",
        help="write a map (.png), a table (.csv), classes (.tif: 1 only A, 2 only B, 3 both), or a folder of all",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier comparison of that name")
    group = parser.add_argument_group("another code's particle files, of either side")
    foreign_options.add_arguments(group)
    group.add_argument("--crs", metavar="EPSG:n|local", help="their CRS")
    group.add_argument("--density", type=positive, metavar="R", help="of the release [kg m-3]")
    group.add_argument("--standoff", type=number, metavar="M", default=0.0, help="as of export-raster (default 0)")


def run(arguments):
    """Compare; the numbers go to stdout."""
    from ..workflows.compare import CompareRequest, compare
    from ..workflows.export import ExportRequest

    asked = {key: value for key, value in vars(arguments).items() if key in CompareRequest.__dataclass_fields__}
    names = set(ExportRequest.__dataclass_fields__) - set(asked)
    asked["reading"] = ExportRequest((), **{key: value for key, value in vars(arguments).items() if key in names})
    with talk.notes_after_success():
        found = compare(CompareRequest(**asked))
    for file in found.files:
        talk.say(f"wrote {file}")
    print(json.dumps(found.facts(), indent=1, allow_nan=False) if arguments.json else "\n".join(screen(found)))
    return 0


def screen(found):
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
        lines.append(_row("of the outline reached", "", f"{100 * found.observed_reached:.1f} %"))
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
    """Four digits of a number, a dash where there is none."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def _not_negative(text):
    value = number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"got {text}, wanted 0 or more")
    return value
