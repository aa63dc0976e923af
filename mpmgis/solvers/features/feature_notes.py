"""Lines about how spatial features are computed, said only of those that act."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely

from ...laws.entrainment import NO_EROSION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...laws.effect_slots import ColumnEffects, PointEffects
    from ..columns.node_grid import ColumnGrid


MOST_LINES = 10  # about the features of one effect


class Note(NamedTuple):
    """A line about how a feature is computed.

    Parameters
    ----------
    effect : {"zones", "entrainment", "forest", "barrier"}
        That it belongs to.
    text : str
    nodes : int64[n]
        Where the feature is: flat indices of nodes [ny + 1, nx + 1], without ghosts.
    """

    effect: str
    text: str
    nodes: np.ndarray


def acting_lines(
    notes: "Sequence[Note]",
    effects: "ColumnEffects | PointEffects",
    grid: "ColumnGrid",
    reached: np.ndarray,
    window: shapely.Geometry | None = None,
) -> list[str]:
    """Return the lines about features of effects that are on, in reach of the flow and in the window of their stage.

    Of one effect there are at most MOST_LINES, and the number of those that are left out.

    Parameters
    ----------
    notes : sequence of Note
    effects : ColumnEffects or PointEffects
    grid : ColumnGrid
    reached : bool[ny + 3, nx + 3]
        Nodes in reach of the flow.
    window : shapely.Geometry, optional
        Outside of which there are no points.
    """
    if not notes:
        return []
    where = reached & grid.domain_nodes()
    if window is not None:
        where &= shapely.intersects_xy(window.buffer(grid.cell_size), *grid.node_points())
    erodes = hasattr(effects, "entrainment") and effects.entrainment.kind != NO_EROSION
    on = {"entrainment": erodes} | {name: getattr(effects, name, False) for name in ("zones", "forest", "barrier")}
    where = where[1:-1, 1:-1].ravel()
    acting = [note for note in notes if on[note.effect] and where[note.nodes].any()]
    lines = []
    for effect in dict.fromkeys(note.effect for note in acting):
        texts = [note.text for note in acting if note.effect == effect]
        lines += texts[:MOST_LINES]
        if len(texts) > MOST_LINES:
            lines.append(f"{effect}: {len(texts) - MOST_LINES} more lines of this kind")
    return lines
