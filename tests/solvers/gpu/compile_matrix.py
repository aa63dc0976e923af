"""Registers, stack and spills of every kernel for two devices, by CUDA's assembler, without a driver.

`python tests/solvers/gpu/compile_matrix.py` prints the table of the guide of the GPU, and below it the kernels that
spill or exceed their limit; an argument selects kernels by name.
"""

import re
import subprocess
import sys
from typing import NamedTuple

import numpy as np
from law_kernels import CAPABILITIES, PRECISIONS, assembler, texts_of

LIMIT = 96  # registers of a kernel: 20 warps of 32 threads on a multiprocessor, of its 65536 registers
# kernels that need more, by what their name begins with, for float32 points (or columns) and for float64 points
MORE = {
    "grid_to_points": (112, 168),
    "move_rare_points": (112, 176),
    "press_on_ground": (112, 152),
    "hold_nodes": (LIMIT, 104),
    "hold_at_barriers": (LIMIT, 104),
    "press_on_crests": (LIMIT, 112),
    "weigh_face": (LIMIT, 136),
    "settle_faces": (LIMIT, 136),
    "columns_to_grid": (LIMIT, 128),
    "update_nodes": (LIMIT, 128),
    "grid_to_columns": (LIMIT, 128),
}
# kernels for float32 points that compute in double precision on purpose: the clock, sums of a run, outflow
IN_DOUBLE = (
    *("begin_step", "choose_step", "finish_step", "sum_node_reports", "sum_point_reports"),
    *("sum_booked", "collect_barriers", "begin_reports", "settle_rare_points", "keep_before_faces"),
)


class Need(NamedTuple):
    """What a kernel needs on a device of `capability`."""

    capability: str
    registers: int
    stack: int  # [bytes] of local arrays
    spilled: int  # [bytes] stored and loaded
    text: str  # assembly


def kernels(precision):
    """(name, kernel, types of its arguments) of all kernels for points of `precision`, or of "columns"."""
    import column_signatures
    import device_kernels

    import mpmgis.solvers.gpu.device_laws  # noqa: F401  (registers the functions of laws)

    if precision == "columns":
        return list(column_signatures.signatures())
    return list(device_kernels.signatures(PRECISIONS[precision]))


def needs(kernel, arguments, precision, folder, capabilities=tuple(CAPABILITIES)):
    """Needs of a kernel for each of `capabilities`; types are inferred once."""
    function = kernel.python(PRECISIONS.get(precision, np.float64))
    most = kernel.registers.get(PRECISIONS.get(precision, np.float64))
    found = texts_of(function, arguments, capabilities)
    return [assembled(text, capability, folder, most) for capability, text in found.items()]


def assembled(text, capability, folder, most=None):
    """What ptxas reports of a kernel, which may use `most` registers."""
    source = folder / "kernel.ptx"
    source.write_text(text)
    command = [assembler(), "-v", f"-arch={capability}", source, "-o", source.with_suffix(".cubin")]
    command += [] if most is None else [f"-maxrregcount={most}"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    spills = re.findall(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", done.stderr)
    stack = max(int(found[0]) for found in spills)
    spilled = sum(int(found[1]) + int(found[2]) for found in spills)
    return Need(capability, int(re.search(r"Used (\d+) registers", done.stderr)[1]), stack, spilled, text)


def limit_of(name, precision):
    """Largest number of registers that a kernel may need."""
    several = next((more for begin, more in MORE.items() if name.startswith(begin)), (LIMIT, LIMIT))
    return several[0 if precision == "float32" else 1]


def main():
    """Print a row of the table for each kernel that needs more than 64 registers, or whose name is asked for."""
    import tempfile
    from pathlib import Path

    print(f"| kernel | precision | {' | '.join(CAPABILITIES)} | limit |\n|---|---|{'---|' * (len(CAPABILITIES) + 1)}")
    count, wrong = 0, []
    with tempfile.TemporaryDirectory() as folder:
        for precision in (*PRECISIONS, "columns"):
            for name, kernel, arguments in kernels(precision):
                if sys.argv[1:] and sys.argv[1] not in name:
                    continue
                count, limit = count + 1, limit_of(name, precision)
                found = needs(kernel, arguments, precision, Path(folder))
                if sys.argv[1:] or max(need.registers for need in found) > 64:
                    own = " | ".join(str(need.registers) for need in found)
                    print(f"| `{name}` | {precision} | {own} | {limit} |", flush=True)
                if any(need.spilled or need.registers > limit for need in found):
                    wrong.append(f"{name}, {precision}")
    print(f"\n{count} kernels, of which {len(wrong)} spill or exceed their limit", *wrong, sep="\n")


if __name__ == "__main__":
    main()
