"""Columns to points and back: Algorithm 2 of MOX report 15/2025."""
