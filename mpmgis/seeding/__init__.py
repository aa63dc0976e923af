"""Release areas and thickness to columns: Algorithm 1 of MOX report 15/2025."""
