"""Points at the edges of the domain: in single precision too, a point at a wall is over a cell of the domain."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.solvers.points import point_batch as line
from mpmgis.solvers.points import point_report as entry
from mpmgis.solvers.points.point_edges import INSIDE, book_out
from mpmgis.solvers.points.point_rows import BLOCK, GHOSTS, Edges

AT = st.floats(-1.0, BLOCK + 1.0)  # [cells] beyond the nearest block, as far as a point moves in a step


def at_walls(x, y, cells, precision):
    """(scratch, integers, block, edges) of a point at (x, y) in the last block of a domain, after its walls."""
    real = np.dtype(precision).type
    scratch, integers = np.zeros(line.LINES, precision), np.zeros(line.INTEGERS, np.int32)
    block = ((cells + GHOSTS - 1) // BLOCK, (cells + GHOSTS - 1) // BLOCK, 0)
    west = GHOSTS - BLOCK * block[0]
    edges = Edges(real(west), real(west), real(west + cells), real(west + cells))
    near, far = real(edges.west + real(INSIDE)), real(edges.east - real(INSIDE))  # as `keep_inside`
    scratch[line.X], scratch[line.Y] = min(max(real(x), near), far), min(max(real(y), near), far)
    integers[line.I_STAYS] = 1
    return scratch, integers, block, edges


@pytest.mark.parametrize("precision", ["float64", "float32"])
@given(x=AT, y=AT, cells=st.integers(8, 20_000))
def test_a_point_at_a_wall_stays(precision, x, y, cells):
    """The cells that it is next to have an elevation; all others of the domain have none."""
    scratch, integers, block, edges = at_walls(x, y, cells, precision)
    last = cells - 2 * BLOCK  # only the last rows and columns of the domain are stored
    inside = Last(last, cells)
    settings = SimpleNamespace(dx=1.0, gravity=9.81)
    book_out(scratch, integers, 1, block, inside, edges, settings, np.zeros(entry.REPORT))
    assert integers[line.I_STAYS] == 1


class Last:
    """Nodata but for the last cells of a square domain; any other index is an error."""

    def __init__(self, first, cells):
        self.first, self.cells = first, cells

    def __getitem__(self, place):
        assert all(0 <= index < self.cells for index in place), f"cell {place} of {self.cells}"
        return int(min(place) >= self.first)
