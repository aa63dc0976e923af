"""The page of a report about places: where depth, speed and pressure were largest, and where mass left the terrain."""

import numpy as np

from ..analysis.run_summary import extremes
from ..reports.band_map import write_band_map
from ..reports.html import Picture, Table, section

JOINED_SHARE = 0.04  # of the longer side of the map: places nearer to each other have one label
LEAST_SHARE = 1e-5  # of the mass, from which on a place where mass left is listed
HEADINGS = ("number", "what", "value", "E [m]", "N [m]", "time [s]")
PEAKS = (  # band, words, unit, factor
    ("h_max", "largest depth in the maps", "m", 1.0),
    ("Ut_max", "largest speed in the maps", "m/s", 1.0),
    ("p_max", "largest pressure in the maps", "kPa", 1e-3),
)
STEPS = (("thickness", "largest vertical thickness of any step", "m"), ("speed", "largest speed of any step", "m/s"))
LEFT = {"hole": "into a hole of the DTM", "collar": "into the nodata around the DTM", "elsewhere": "at smaller places"}


def places_section(gathered, folder):
    """A section with a numbered table and map of places; None where none is known."""
    rows = [*_of_maps(gathered), *_of_record(gathered.record)]
    if not rows:
        return None
    cells = [(str(k), what, value, f"{x:.1f}", f"{y:.1f}", time) for k, (what, value, x, y, time) in
             enumerate(rows, start=1)]  # fmt: skip
    blocks = [Table(HEADINGS, tuple(cells))]
    depth = gathered.peaks.get("h_max")
    if depth is not None and np.isfinite(depth).any():
        path = folder / "places.png"
        marks = [(x, y, str(k)) for k, (_, _, x, y, _) in enumerate(rows, start=1)]
        flow = gathered.flow
        view = _view(flow.terrain, gathered.grid, depth > flow.min_depth, marks)
        write_band_map(
            path, flow.terrain, gathered.grid, depth, "h_max", "Places of the table", min_depth=flow.min_depth,
            view=view, marks=_labelled(marks, JOINED_SHARE * max(view[2] - view[0], view[3] - view[1])),
        )  # fmt: skip
        blocks.append(Picture(path.read_bytes(), "Places of the table over the largest depth"))
    return section("Places", *blocks, page=True)


def _of_maps(gathered):
    for band, words, unit, factor in PEAKS:
        values = gathered.peaks.get(band)
        if values is not None and np.isfinite(values).any():
            place = np.unravel_index(np.nanargmax(values), values.shape)
            x, y = gathered.grid.xy(*place)
            yield words, f"{values[place] * factor:.4g} {unit}", float(x), float(y), ""


def _of_record(record):
    """Rows of run.json: extremes of every step with their times, and where mass left."""
    stages = record.get("stages") or [record]
    balances = [stage["balances"] for stage in stages if stage.get("balances")] or (
        [record["balances"]] if record.get("balances") else []
    )
    found = record.get("extremes") or extremes(balances)
    for name, words, unit in STEPS:
        if name in found:
            one = found[name]
            yield words, f"{one['value']:.4g} {unit}", *map(float, one["at"]), f"{one['time']:.1f}"
    mass = record.get("mass") or {}
    left = mass.get("left_places") or [place for one in balances for place in one.get("left_places") or ()]
    total = max((one.get("mass_start") or 0.0 for one in balances), default=0.0)
    for place in left:
        if place["mass"] > LEAST_SHARE * total:
            words = LEFT.get(place["where"], f"over the {place['where']} edge of the DTM")
            share = f" ({100 * place['mass'] / total:.3g} %)" if total > 0 else ""
            yield f"mass left {words}", f"{place['mass']:.4g} kg{share}", place["east"], place["north"], ""


def _labelled(marks, distance):
    """All marks, with the numbers of those within `distance` [m] together at the first of them."""
    labels = []
    for x, y, text in marks:
        near = next((one for one in labels if np.hypot(one[0] - x, one[1] - y) <= distance), None)
        if near is None:
            labels.append([x, y, text])
        else:
            near[2] += f", {text}"
    return [*((x, y, "") for x, y, _ in marks), *map(tuple, labels)]


def _view(terrain, grid, flow, marks):
    """(west, south, east, north) [m] around flow and marks, within the terrain."""
    row, column = np.nonzero(flow)
    x, y = grid.xy(row, column)
    x, y = np.r_[x, [mark[0] for mark in marks]], np.r_[y, [mark[1] for mark in marks]]
    margin = 0.12 * max(np.ptp(x), np.ptp(y), 10 * grid.cell_size)
    west, south, east, north = terrain.grid.bounds
    return (
        float(max(x.min() - margin, west)), float(max(y.min() - margin, south)), float(min(x.max() + margin, east)),
        float(min(y.max() + margin, north)),
    )  # fmt: skip
