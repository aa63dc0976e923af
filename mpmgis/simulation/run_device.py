"""Decide where the steps of a run are computed: on the processor or on a CUDA device."""

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from ..scene.tables import AUTO, CPU, CUDA
from ..system.errors import SceneError
from ..system.messages import log
from .memory_need import BYTES_PER_NODE

if TYPE_CHECKING:
    from .preparation import Prepared

# Particles from which on the device is chosen. 100 000 points took 0.56 ms per step on an H100, mostly fixed costs, and
# 1.5 ms on 16 cores beside it (2026-11-26); but kernels for the device compile for half a minute in each run.
FEWEST_ON_DEVICE = 200_000


def with_device(prepared: "Prepared") -> "Prepared":
    """Return the prepared run with the device of each stage, as [numerics] device requests.

    Parameters
    ----------
    prepared : Prepared

    Raises
    ------
    SceneError
        device = 'cuda', and a stage has something that a device cannot compute; with its name.
    """
    requested = prepared.scene.numerics.device
    if requested == CPU:
        return prepared
    outside = next((number for number, stage in enumerate(prepared.stages, 1) if stage.has_columns_outside), None)
    lack = "" if outside is None else f"a device cannot compute outside = 'columns' of stage {outside}"
    if lack and requested == CUDA:
        raise SceneError(f"device = 'cuda': {lack}; take device = 'cpu', or 'auto'")
    if requested == AUTO:
        particles = max(prepared.particles_of(number) for number in range(len(prepared.stages)))
        lack = lack or _lack_here(particles, prepared)
        log.info(f"device = 'auto': {'cpu, because ' + lack if lack else f'cuda, for {particles} particles'}")
    if lack:
        return prepared
    return replace(prepared, stages=tuple(replace(stage, device=CUDA) for stage in prepared.stages))


def _lack_here(particles, prepared):
    """Return why the processor is the better device of this machine; "" if a CUDA device is."""
    from ..solvers.gpu.available import found_device

    if particles < FEWEST_ON_DEVICE:
        return f"{particles} particles are fewer than {FEWEST_ON_DEVICE}"
    found = found_device()
    if found.device is None:
        return found.lack
    needed = _memory(prepared)[0]
    if needed > found.device.free and not found.device.simulated:
        return f"the run needs {needed / 1e9:.3g} GB on the device ({found.line()})"
    return ""


def require_devices(prepared: "Prepared") -> str:
    """Return what computes the steps, in words; "cpu" without a CUDA device.

    Parameters
    ----------
    prepared : Prepared

    Raises
    ------
    SceneError
        The run needs a CUDA device, and there is none, or it has too little memory for the particles of a stage.
    """
    if all(stage.device == CPU for stage in prepared.stages):
        return CPU
    from ..solvers.gpu.available import require_device

    return f"{CUDA}: {require_device(*_memory(prepared)).line()}"


def _memory(prepared):
    """Return (memory [bytes] on a device, solver) of the stage that needs most of it."""
    stages = enumerate(prepared.stages)
    return max((_memory_of(prepared.particles_of(number), stage), stage.scene.solver) for number, stage in stages)


def _memory_of(particles, stage):
    """Return the memory [bytes] that `particles` of a `stage` need on a device."""
    if stage.scene.solver == "points":
        from ..solvers.gpu.device_point_solver import device_memory

        return device_memory(particles, stage.scene.numerics.precision, stage.effects.material)
    from ..solvers.gpu.device_column_solver import device_memory_of_columns

    nodes = stage.grid.bed.size
    return device_memory_of_columns(particles, nodes, nodes * BYTES_PER_NODE, stage.effects)


def devices_record(earlier: Iterable[dict], time: float, device: str) -> list[dict]:
    """Return the record of the devices of a run, {from [s], device}, that continues on `device`.

    Parameters
    ----------
    earlier : iterable of dict
        Record until now.
    time : float [s]
        At which the run continues.
    device : str
        In words.
    """
    kept = [entry for entry in earlier if entry["from"] < time]
    if kept and kept[-1]["device"] == device:
        return kept
    return [*kept, {"from": time, "device": device}]
