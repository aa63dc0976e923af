"""A comparison as files: its numbers as a table, its footprints and values as bands of a GeoTIFF."""

import numpy as np

from ..fields import Quantity
from ..products.comparison import nearest, upright
from .csv_table import write_records
from .geotiff import write_geotiff

HEADINGS = ("quantity", "unit", "A", "B", "A - B", "A with B")
CLASSES = {1: "only A", 2: "only B", 3: "both"}


def write_table(path, found):
    """Write the numbers of a Comparison as CSV in SI units, an empty cell where there is no number."""
    names = ("name", "", *(side.name for side in found.sides), "", "")
    rows = [(quantity, unit, *numbers, "") for quantity, unit, *numbers in found.rows()]
    common = [(quantity, unit, "", "", "", value) for quantity, unit, value in found.common_rows()]
    write_records(path, HEADINGS, [names, *rows, *common])


def class_numbers(first, second):
    """uint8[rows, columns]: 1 only the first mask, 2 only the second, 3 both, 0 none."""
    return first.astype(np.uint8) + 2 * second.astype(np.uint8)


def write_classes(path, grid, first, second, values, band):
    """Write a GeoTIFF of who flowed where, with both sides' values and their difference where both are known.

    Parameters
    ----------
    path : Path
    grid : Grid
        Of all arrays; one that is not north-up is written as the nearest cells of one that is.
    first, second : bool[rows, columns]
    values : (float[rows, columns], float[rows, columns])
        Each side's own, NaN where there is none; an outline's is None.
    band : Quantity
        What the values are.
    """
    flat = upright(grid)
    numbers = class_numbers(first, second).astype(float)
    numbers[numbers == 0] = np.nan
    meaning = ", ".join(f"{number} {word}" for number, word in CLASSES.items())
    bands = [(Quantity("class", "1", meaning), numbers)]
    known = {side: value for side, value in zip("AB", values, strict=True) if value is not None}
    bands += [(Quantity(f"{band.name}_{side}", band.unit, ""), value) for side, value in known.items()]
    if len(known) == 2:
        bands.append((Quantity(f"{band.name}_A_minus_B", band.unit, ""), values[0] - values[1]))
    on_flat = [(quantity, nearest(value, grid, flat)) for quantity, value in bands]
    write_geotiff(path, flat, on_flat, {"class": meaning})
