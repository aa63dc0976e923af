"""Names that kernels call on laws: a numba method of that name hides a field of the same name in every NamedTuple."""

from mpmgis.compiled import law_functions
from mpmgis.laws.effect_slots import ColumnEffects
from mpmgis.solvers.columns.column_arrays import ColumnArrays
from mpmgis.solvers.columns.column_blocks import BlockWindow, SortedColumns, TouchedBlocks
from mpmgis.solvers.columns.column_motion import MotionLaws, SpeedBound, StepTimes
from mpmgis.solvers.columns.column_nodes import NodeArrays, NodeLaws
from mpmgis.solvers.columns.column_records import NodeFields, Settings
from mpmgis.solvers.columns.columns_to_grid import StressLaws
from mpmgis.solvers.columns.grid_to_columns import Batch, FlatGrid

RECORDS = (
    *(Settings, NodeFields, ColumnArrays, SortedColumns, BlockWindow, TouchedBlocks, NodeArrays, Batch, FlatGrid),
    *(StepTimes, SpeedBound, StressLaws, NodeLaws, MotionLaws),
)


def test_no_method_of_laws_is_named_like_a_field():
    methods = set(law_functions.OWN_METHODS)
    for group in (ColumnEffects, *RECORDS):
        assert not methods & set(group._fields), group
    for law in ColumnEffects():
        assert not methods & set(getattr(law, "_fields", ())), law
