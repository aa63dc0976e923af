"""Columns at the points of a Halton sequence."""


class HaltonColumns:
    """Follows in the next commit."""
