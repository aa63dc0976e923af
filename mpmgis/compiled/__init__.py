"""Interface to the compiler and its cache, laws as arguments of kernels, order of particles."""

from ..system import folder_settings  # noqa: F401  before numba is imported
