"""Where the steps of a run's points are computed: on the processor or on a CUDA device."""

from dataclasses import replace

from ...errors import SceneError
from ...messages import log
from ...scene.tables import AUTO, CPU, CUDA

FEWEST_ON_DEVICE = 200_000  # points; with fewer the launches of kernels take most of the time (estimated)


def with_device(prepared):
    """The Prepared run with the device of each stage, as [numerics] device requests.

    Raises
    ------
    SceneError
        device = 'cuda', and a stage of points has something that a device cannot compute; with its name.
    """
    requested = prepared.scene.numerics.device
    stages = [(number, stage) for number, stage in enumerate(prepared.stages) if stage.scene.solver == "points"]
    if requested == CPU or not stages:
        return prepared
    reason = ""
    for number, stage in stages:
        lack = lack_of(stage)
        if lack and requested == CUDA:
            where = f"stage {number + 1}: " if stage.table is not None else ""
            raise SceneError(f"{where}device = 'cuda' cannot compute {lack}; take device = 'cpu', or 'auto'")
        reason = reason or (lack and f"a device cannot compute {lack}")
    if requested == AUTO:
        points = max(prepared.particles_of(number) for number, _ in stages)
        reason = reason or _lack_here(points, stages)
        log.info(f"device = 'auto': {'the processor, because ' + reason if reason else f'cuda, for {points} points'}")
    if reason:
        return prepared
    made = (replace(one, device=CUDA) if one.scene.solver == "points" else one for one in prepared.stages)
    return replace(prepared, stages=tuple(made))


def lack_of(stage):
    """Names of what a device cannot compute of a Stage of points; "" if it computes all."""
    from ...solvers.device_points import refused

    names = list(refused(stage.effects, stage.known_walls))
    if stage.has_columns_outside:
        names.append("columns outside the window of a stage")
    return ", ".join(names)


def _lack_here(points, stages):
    """Why the processor is the better device of this machine for `points`; "" if a CUDA device is."""
    from ...gpu.available import found_device

    if points < FEWEST_ON_DEVICE:
        return f"{points} points are fewer than {FEWEST_ON_DEVICE}"
    found = found_device()
    if found.device is None:
        return found.lack
    needed = max(_memory(points, stage) for _, stage in stages)
    if needed > found.device.free and not found.device.simulated:
        return f"the run needs {needed / 1e9:.3g} GB on the device ({found.line()})"
    return ""


def require_devices(prepared):
    """What computes the steps of points, in words; "cpu" without a CUDA device.

    Raises
    ------
    SceneError
        A stage needs a CUDA device, and there is none, or it has too little memory for the points of the stage.
    """
    from ...gpu.available import require_device

    needed = [
        _memory(prepared.particles_of(number), stage)
        for number, stage in enumerate(prepared.stages) if stage.device == CUDA
    ]  # fmt: skip
    return f"{CUDA}: {require_device(max(needed)).line()}" if needed else CPU


def _memory(points, stage):
    """Memory [bytes] that `points` of a `stage` need on a device."""
    from ...solvers.device_points import device_memory

    return device_memory(points, stage.scene.numerics.precision, stage.effects.material)


def devices_record(earlier, time, device):
    """Entries {from [s], device} of a run that continues at `time` [s] on `device` after its `earlier` entries."""
    kept = [entry for entry in earlier if entry["from"] < time]
    if kept and kept[-1]["device"] == device:
        return kept
    return [*kept, {"from": time, "device": device}]
