"""Both steps on a CUDA device with numba-cuda (extra `mpmgis[gpu]`)."""

from ...system import folder_settings  # noqa: F401  before numba is imported
