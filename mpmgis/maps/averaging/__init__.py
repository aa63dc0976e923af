"""Particles to cells to bands (NHESS 25-3897-2025, Eqs 2-17)."""
