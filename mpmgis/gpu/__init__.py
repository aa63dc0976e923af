"""The 3D solver on a CUDA device: kernels for numba-cuda, with the laws of `effects` (extra `mpmgis[gpu]`)."""
