"""A line that the user drew for a flow: read, held against the flow, turned so that it runs downhill."""

from ..errors import InputError
from ..io.observed import read_line
from ..products.flow_line import distance_to_line


def given_line(path, flowed, grid, terrain, say):
    """float64[n, 2] [m]: the line at `path`, from its upper end.

    Parameters
    ----------
    path : Path
    flowed : bool[rows, columns]
        Cells of `grid` that the flow reached; the line must pass within two cells of one.
    grid : Grid
    terrain : Terrain or None
        Without it the line keeps its direction.
    say : callable

    Raises
    ------
    MpmgisError
    """
    line = read_line(path, grid, say)
    distance = distance_to_line(line, flowed, grid)
    if distance > 2 * grid.cell_size:
        raise InputError(f"{path} passes no nearer than {distance:.0f} m to the flow; give the line that it took")
    if terrain is not None:
        begin, end = terrain.sample(*line[[0, -1]].T)
        if begin < end:
            say(f"{path} runs uphill, from {begin:.0f} to {end:.0f} m; it is taken the other way round")
            return line[::-1]
    return line
