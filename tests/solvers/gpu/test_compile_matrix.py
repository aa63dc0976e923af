"""Every kernel compiles for sm_90, in slow tests for sm_80 and in float64 too. It spills no registers, needs no more of
them than a limit, and has no double precision for float32 points unless it is meant to."""

import pytest
from compile_matrix import IN_DOUBLE, MORE, kernels, limit_of, needs
from law_kernels import PRECISIONS, assembler, compiler_lack

LACK = compiler_lack() or ("" if assembler() else "no ptxas (pip install nvidia-cuda-nvcc)")
pytestmark = pytest.mark.skipif(bool(LACK), reason=LACK)
WITH_SINE = ("columns_to_grid", "update_nodes")  # the sine of CUDA's library has a local array; of Bingham's law
FEWEST = {"float64": 40, "float32": 40, "columns": 25}  # kernels


@pytest.mark.thorough
@pytest.mark.parametrize("precision", [pytest.param("float64", marks=pytest.mark.slow), "float32", "columns"])
def test_kernels_compile_without_spills_within_their_registers(precision, tmp_path):
    names = require_few_registers(kernels(precision), precision, tmp_path, ["sm_90"])
    assert len(names) > FEWEST[precision]
    assert precision != "columns" or {name.split()[0] for name in names} >= kernels_of_columns()


@pytest.mark.slow
@pytest.mark.parametrize("precision", [*PRECISIONS, "columns"])
def test_kernels_for_older_devices_do_too(precision, tmp_path):
    names = require_few_registers(kernels(precision), precision, tmp_path, ["sm_80"])
    assert len(names) > FEWEST[precision]


def require_few_registers(signatures, precision, folder, capabilities):
    """Names of the kernels; fails with a list of all that spill or need too much on devices of `capabilities`."""
    wrong, names = [], set()
    for name, kernel, arguments in signatures:
        names.add(name)
        for need in needs(kernel, arguments, precision, folder, capabilities):
            here = f"{name} {need.capability}"
            if f".target {need.capability}" not in need.text or ".visible .entry" not in need.text:
                wrong.append(f"{here}: not a kernel for this device")
            if need.spilled:
                wrong.append(f"{here}: {need.spilled} bytes are spilled")
            if need.registers > limit_of(name, precision):
                wrong.append(f"{here}: {need.registers} registers, expected at most {limit_of(name, precision)}")
            if need.stack and name not in WITH_SINE:
                wrong.append(f"{here}: {need.stack} bytes of local arrays")
            if precision == "float32" and not name.startswith(IN_DOUBLE) and ".f64" in need.text:
                wrong.append(f"{here}: double precision")
    assert not wrong, "\n".join(wrong)
    return names


def kernels_of_columns():
    """Names of all kernels for columns."""
    from mpmgis.solvers.gpu import (
        device_column_detrainment,
        device_column_nodes,
        device_column_reports,
        device_column_sort,
        device_column_transfer,
    )
    from mpmgis.solvers.gpu.device_functions import Kernel

    modules = (
        device_column_detrainment,
        device_column_nodes,
        device_column_reports,
        device_column_sort,
        device_column_transfer,
    )
    return {name for module in modules for name, value in vars(module).items() if isinstance(value, Kernel)}


@pytest.mark.thorough
def test_kernels_with_another_limit_exist():
    names = {name for precision in ("float32", "columns") for name, _, _ in kernels(precision)}
    assert all(any(name.startswith(begin) for name in names) for begin in (*MORE, *IN_DOUBLE))
