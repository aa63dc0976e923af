"""The table of the arrays of a solver: what is made of it, and what grows."""

import numpy as np
import pytest

from mpmgis.frames.state_arrays import PARTICLES, REAL, array_table, grown_arrays, made_arrays
from mpmgis.solvers.columns.column_arrays import ColumnArrays
from mpmgis.solvers.points.point_arrays import PointArrays


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("record", [ColumnArrays, PointArrays])
def test_arrays_have_the_types_and_shapes_of_the_table_and_those_of_particles_grow(record, real):
    table = array_table(record)
    assert list(table) == list(record._fields)
    names = {length for array in table.values() for length in array.shape if isinstance(length, str)}
    sizes = {name: 2 + number for number, name in enumerate(sorted(names))}
    arrays = made_arrays(record, real, sizes)
    arrays.rows[:] = 1.0
    grown = grown_arrays(arrays, 50)
    for name, array in table.items():
        values, later = getattr(arrays, name), getattr(grown, name)
        assert values.dtype == (real if array.dtype is REAL else array.dtype), name
        assert values.shape == tuple(sizes.get(length, length) for length in array.shape), name
        if array.shape[0] == PARTICLES:
            assert len(later) == 50 and later.dtype == values.dtype and (later[: len(values)] == values).all(), name
            assert not later[len(values) :].any(), name
        else:
            assert later is values, name


def test_names_in_the_state_of_a_frame_are_single():
    for record in (ColumnArrays, PointArrays):
        kept = [array.kept for array in array_table(record).values() if array.kept]
        assert len(kept) == len(set(kept)) and {"clock", "counts", "ledger", "barriers"} <= set(kept)
