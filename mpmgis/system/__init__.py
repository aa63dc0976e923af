"""Errors, messages, whole files, locks, trust, HDF5, memory, processes."""

from . import folder_settings  # noqa: F401  before any library that reads settings is imported
