"""Preparation of a run, its stages, warm-up of compiled code, and prediction of its cost."""
