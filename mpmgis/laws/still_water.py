"""Lakes at rest as a reference state: a lake at rest stays at rest to round-off; form `swe` only."""


def reference_depth(bed: float, level: float) -> float:
    """Compute the depth of the still lake [m]; each cell of the grid has the still-water level of its lake.

    Parameters
    ----------
    bed : float [m]
        Elevation of the bed.
    level : float [m]
        Elevation of the still water; very low where there is no lake.
    """
    return max(level - bed, 0.0)
