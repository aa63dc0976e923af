"""Make the walls of a scene from their files, and check that they stand on the terrain and off the release."""

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ...scene.tables import HIGHEST_WALL
from ...system.errors import InputError
from .feature_notes import Note
from .wall_openings import SPLINE, narrow_openings
from .walls import CORE_CELLS, FACE_CELLS, Wall, half_thickness, margin_in_3d, wall_nodes

if TYPE_CHECKING:
    from ...frames.particles import Frame
    from ...scene.tables import BarrierTable
    from ..columns.node_grid import ColumnGrid
    from .feature_placement import PlacedFiles
    from .walls import WallNodes

BURIED = 0.01  # [1] share of a wall below the terrain up to which nothing is said
MOST_NAMED = 5  # narrow openings that are reported one by one


def standing_walls(
    barriers: "Iterable[tuple[BarrierTable, PlacedFiles]]",
    grid: "ColumnGrid",
    everything: "Frame",
    in_3d: bool,
    notes: list[Note],
) -> "tuple[tuple[Wall, ...], WallNodes | None]":
    """Make the walls of a scene and their nodes, and check both.

    Parameters
    ----------
    barriers : iterable of (BarrierTable, PlacedFiles)
    grid : ColumnGrid
    everything : Frame
        All columns that are ever released.
    in_3d : bool
        The solver is that of points.
    notes : list of Note
        To which lines about how walls are computed are added.

    Returns
    -------
    (tuple of Wall, WallNodes)
        ((), None) without barriers.

    Raises
    ------
    InputError
        A wall off the terrain, below it or on the release; an invalid height.
    """
    walls = walls_of(barriers)
    if not walls:
        return (), None
    nodes = wall_nodes(walls, *grid.node_axes(), grid.bed, grid.cell_size)
    _require_standing(walls, nodes, grid, everything)
    notes += _wall_notes(walls, nodes, grid, in_3d)
    return walls, nodes


def walls_of(barriers: "Iterable[tuple[BarrierTable, PlacedFiles]]") -> tuple[Wall, ...]:
    """Return the walls of barriers, each with a name of its own.

    Parameters
    ----------
    barriers : iterable of (BarrierTable, PlacedFiles)

    Raises
    ------
    InputError
        A height that is not above 0, or above HIGHEST_WALL.
    """
    walls = []
    for table, files in barriers:
        for k, feature in enumerate(files.features, 1):
            height, crest = (
                feature.number(value) if isinstance(value, str) else value for value in (table.height, table.crest)
            )
            if height is not None and not 0.0 < height <= HIGHEST_WALL:
                raise InputError(
                    f"{feature.path}: '{feature.name}' has height {height:g}, expected metres above 0, at most "
                    f"{HIGHEST_WALL:g}"
                )
            name = _unique_name(_wall_name(table, feature.name, k, len(files.features)), walls)
            walls.append(Wall(name, feature.shape, height, crest, table.mu))
    return tuple(walls)


def _wall_name(table, feature_name, k, count):
    """Return the name of feature `k` of `count`: the table's, else its own, else the file's; numbered if shared."""
    stem = Path(table.source).stem
    own = stem if feature_name.startswith("feature ") else feature_name
    name = table.name or own
    return f"{name} {k}" if count > 1 and (table.name or own == stem) else name


def _unique_name(name, walls):
    """Return `name`, with a number where a wall has it already."""
    taken = {wall.name for wall in walls}
    numbered = (name if k == 1 else f"{name} ({k})" for k in itertools.count(1))
    return next(candidate for candidate in numbered if candidate not in taken)


def _require_standing(walls, nodes, grid, frame):
    """Refuse walls off the terrain, under the ground or on the release."""
    i, j = (np.rint(place / grid.cell_size).astype(int) + 1 for place in grid.from_corner(frame))
    closed = np.where(nodes.share > 0.0, 0, nodes.number)
    under = closed[np.clip(j, 0, grid.bed.shape[0] - 1), np.clip(i, 0, grid.bed.shape[1] - 1)]
    for number, wall in enumerate(walls, 1):
        own = nodes.number == number
        if not own.any():
            _refuse_without_nodes(wall, walls, nodes, grid)
        above = (nodes.crest - grid.bed)[own]
        if wall.crest is not None and above.max() > HIGHEST_WALL:
            raise InputError(
                f"barrier '{wall.name}': its crest at {wall.crest:g} m is {above.max():.4g} m above the terrain, "
                f"expected at most {HIGHEST_WALL:g} m; give the elevation of the crest [m], or height"
            )
        if wall.crest is not None and above.max() <= 0:
            raise InputError(
                f"barrier '{wall.name}': its crest at {wall.crest:g} m is below the terrain, which is at "
                f"{grid.bed[own].min():.1f} to {grid.bed[own].max():.1f} m there; give a higher crest, or height"
            )
        if (under == number).any():
            raise InputError(
                f"barrier '{wall.name}' is on the release ({int((under == number).sum())} particles start inside it, "
                f"including one cell on each side); move it, or take a smaller [numerics] cell_size"
            )


def _wall_notes(walls, nodes, grid, in_3d):
    """Yield a Note of narrow openings, and of the foot of each wall and what of it is below the terrain."""
    size = grid.cell_size
    x, y = grid.node_points()
    for east, north, width in narrow_openings([wall.footprint for wall in walls], size)[:MOST_NAMED]:
        text = (
            f"barriers: the opening at E {east:.1f} N {north:.1f} is {width:.2g} m wide, narrower than a cell; it "
            f"passes the flow by its share of the cells. [numerics] cell_size = {width:.2g} or less resolves it"
        )
        yield Note("barrier", text, np.flatnonzero((np.hypot(x - east, y - north) < SPLINE * size)[1:-1, 1:-1]))
    for number, wall in enumerate(walls, 1):
        own = nodes.number == number
        where, half = np.flatnonzero(own[1:-1, 1:-1]), half_thickness(wall.footprint)
        if in_3d:
            held = wall.footprint.buffer(margin_in_3d(half, size)).area
        else:
            held = (1.0 - nodes.share)[own & grid.domain_nodes()].sum() * size**2
        text = f"barrier '{wall.name}': its foot has {wall.footprint.area:.6g} m2, nodes of {held:.6g} m2 hold the flow"
        if 2.0 * half < 2.0 * (FACE_CELLS + CORE_CELLS - 1.0) * size:
            thick = 2.0 * (FACE_CELLS + CORE_CELLS) * size
            text += (
                f"; it is {2.0 * half:.3g} m thick, thinner than a cell, and its nodes are {thick:g} m across (3 "
                "cells), the least that stops a flow on this grid"
            )
        yield Note("barrier", text, where)
        buried = np.mean((nodes.crest - grid.bed)[own] <= 0.0)
        if wall.crest is not None and buried > BURIED:
            text = f"barrier '{wall.name}': {100 * buried:.0f} % of it is below the terrain, where it has no effect"
            yield Note("barrier", text, where)


def _refuse_without_nodes(wall, walls, nodes, grid):
    """Refuse a wall that has no node: other walls have them, or it is not on the terrain."""
    x, y = grid.node_points()
    owners = nodes.number[shapely.intersects_xy(wall.footprint.buffer(grid.cell_size), x, y) & grid.domain_nodes()]
    others = ", ".join(f"'{walls[number - 1].name}'" for number in np.unique(owners[owners > 0])[:MOST_NAMED])
    if others:
        raise InputError(
            f"barrier '{wall.name}' is completely inside barrier {others}; remove one of them, or change their outlines"
        )
    raise InputError(f"barrier '{wall.name}' is outside the terrain; check its CRS, or use a larger DTM")
