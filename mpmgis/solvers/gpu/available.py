"""Find the CUDA device of this machine, or the reason in one line why none can be used.

numba-cuda is imported only when a device is asked for: it takes half a second and is an extra.
"""

import importlib.util
from importlib.metadata import PackageNotFoundError, version
from typing import NamedTuple

from ...system.errors import SceneError, one_line

INSTALL = "pip install 'mpmgis[gpu]'"
TESTED = ((0, 30, 4), (0, 31))  # versions of numba-cuda: from the first, below the second, as in pyproject.toml
NO_NUMPY = (2, 5)  # first version of NumPy that numba-cuda 0.30 does not work with, as in pyproject.toml
LEAST_CAPABILITY = (7, 5)  # lowest compute capability that CUDA 13 compiles for
CPU_INSTEAD = "take device = 'cpu'"
SMALLER = {  # solver -> how its run needs less memory
    "points": "use larger cells, precision = 'float32' or fewer points_per_cell",
    "columns": "use larger cells or fewer particles_per_cell",
}


class Device(NamedTuple):
    """A CUDA device.

    Parameters
    ----------
    name : str
    capability : (int, int)
        Compute capability.
    memory, free : int [bytes]
        Memory of the device, and its free part.
    simulated : bool
        Whether it is the CUDA simulator.
    """

    name: str
    capability: tuple[int, int]
    memory: int
    free: int
    simulated: bool = False

    def line(self) -> str:
        """Describe the device in words."""
        if self.simulated:
            return "the CUDA simulator (NUMBA_ENABLE_CUDASIM), which computes on the processor"
        major, minor = self.capability
        return (
            f"{self.name}, compute capability {major}.{minor}, {self.free / 1e9:.3g} of {self.memory / 1e9:.3g} GB free"
        )


class Found(NamedTuple):
    """The device of this machine, or None and the reason.

    Parameters
    ----------
    device : Device, optional
    lack : str
        Why there is no device.
    """

    device: Device | None
    lack: str = ""

    def line(self) -> str:
        """Describe the device, or the reason, in words."""
        return self.lack if self.device is None else self.device.line()


def found_device() -> Found:
    """Find the CUDA device that numba-cuda would use, or why none can be used.

    numba-cuda is imported if it is installed."""
    if importlib.util.find_spec("numba_cuda") is None:
        return Found(None, f"numba-cuda is not installed; {INSTALL} installs it")
    if lack := _version_lack():
        return Found(None, lack)
    from numba import config, cuda

    if config.ENABLE_CUDASIM:
        return Found(Device("CUDA simulator", (9, 0), 0, 0, simulated=True))
    from numba.cuda.cudadrv.driver import CudaAPIError
    from numba.cuda.cudadrv.error import CudaSupportError

    try:
        now = cuda.get_current_device()
        free, memory = cuda.current_context().get_memory_info()
    except (CudaSupportError, CudaAPIError) as error:
        return Found(None, f"no CUDA device can be used: {one_line(error)[:160].rstrip(' :.')}")
    name = now.name.decode() if isinstance(now.name, bytes) else str(now.name)
    device = Device(name, tuple(now.compute_capability), int(memory), int(free))
    if device.capability < LEAST_CAPABILITY:
        least = ".".join(map(str, LEAST_CAPABILITY))
        return Found(None, f"{device.line()}: its compute capability is below {least}")
    return Found(device)


def require_device(needed: float = 0.0, solver: str = "points") -> Device:
    """Return the device of this machine.

    Parameters
    ----------
    needed : float [bytes]
        Free memory that the run needs.
    solver : str
        A key of SMALLER.

    Raises
    ------
    SceneError
        There is no device, or it has too little memory.
    """
    device, lack = found_device()
    if device is None:
        raise SceneError(f"device = 'cuda': {lack}; or {CPU_INSTEAD}")
    if needed > device.free and not device.simulated:
        raise SceneError(
            f"device = 'cuda': the run needs {needed / 1e9:.3g} GB on the device ({device.line()}); "
            f"{SMALLER[solver]}, or {CPU_INSTEAD}"
        )
    return device


def _version_lack() -> str:
    """Return why the numba-cuda that is installed is not used; "" if it is.

    Laws are registered through an interface that numba-cuda does not document, which may differ in other versions.
    """
    try:
        installed = version("numba-cuda")
    except PackageNotFoundError:
        return f"numba-cuda is installed without its metadata; {INSTALL} repairs it"
    low, high = TESTED
    if not low <= _number(installed) < high:
        low, high = (".".join(map(str, bound)) for bound in TESTED)
        return f"numba-cuda {installed} is installed, expected {low} or later, below {high}; {INSTALL} installs it"
    if _number(version("numpy")) >= NO_NUMPY:
        least = ".".join(map(str, NO_NUMPY))
        return f"numba-cuda {installed} needs NumPy below {least}, got {version('numpy')}; {INSTALL} installs it"
    return ""


def _number(version: str) -> tuple[int, ...]:
    """Return the first three numbers of a version."""
    return tuple(int(part) for part in version.split(".")[:3] if part.isdigit())
