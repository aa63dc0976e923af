"""Columns of equal mass."""


class EqualMassColumns:
    """Follows in the next commit."""
