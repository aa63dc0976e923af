"""Both solvers on a CUDA device: kernels for numba-cuda, with the laws of `effects` (extra `mpmgis[gpu]`)."""
