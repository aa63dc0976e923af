"""Both steps on a CUDA device with numba-cuda (extra `mpmgis[gpu]`)."""
