"""Errors, messages, whole files, locks, trust, HDF5, memory, processes."""
