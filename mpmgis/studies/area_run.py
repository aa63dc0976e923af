"""Run one release area of a region in its own window of the DTM."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ..system.messages import muted
from ..terrain.dtm import TerrainFile
from ..terrain.release_parts import ReleasePart, require_on_terrain
from ..terrain.release_window import reach_window
from .ensemble_member import MemberTask
from .region_areas import write_area

if TYPE_CHECKING:
    from ..frames.many_runs_folder import RunFiles
    from ..terrain.release_window import ReleaseWindow

MOST_RUNS = 8  # of an area in windows of increasing size
EDGE_CELLS = 2  # [cells] of the solver and of the DTM: flow nearer to an edge of its window has reached it


@dataclass(frozen=True)
class AreaTask:
    """All data that a worker needs to run an area; it is pickled.

    Parameters
    ----------
    number : int
        Of the area, from 1 in the order of the file.
    run : MemberTask
        Without window; its release is the file of the area.
    shape : bytes
        WKB in the CRS of the DTM.
    crs : str or None
        WKT of this CRS.
    mu : float [1]
        Slope of the energy line.
    head : float [m]
        Its height above the release.
    """

    number: int
    run: MemberTask
    shape: bytes
    crs: str | None
    mu: float
    head: float

    @property
    def digest(self) -> str:
        """Digest of all inputs of its result."""
        return self.run.digest

    @property
    def files(self) -> "RunFiles":
        """Paths of its files."""
        return self.run.files

    @property
    def needed(self) -> tuple[Path, ...]:
        """Results without which it is not finished."""
        return self.run.needed

    def terrain(self) -> TerrainFile:
        """Return the file of the DTM."""
        table, folder = self.run.tables["terrain"], Path(self.run.scene_folder)
        keys = ("crs", "band", "fill_nodata", "to_crs")
        return TerrainFile(folder / table["dem"], **{key: table.get(key) for key in keys})

    def first_window(self, terrain: TerrainFile) -> "ReleaseWindow":
        """Return the automatic window; write the file of the area if it is missing.

        Parameters
        ----------
        terrain : TerrainFile

        Raises
        ------
        InputError
            The area is not on the terrain.
        """
        polygon = shapely.from_wkb(self.shape)
        require_on_terrain(ReleasePart(self.run.name, polygon, math.nan), terrain.grid)
        if not self.files.release.exists():
            write_area(self.files.release, self.shape, self.run.name, self.crs)
        return reach_window(terrain.grid, terrain.part, polygon, self.mu, self.head)

    def within(self, terrain: TerrainFile, window: "ReleaseWindow") -> MemberTask:
        """Return the task of a run in a window.

        Parameters
        ----------
        terrain : TerrainFile
        window : ReleaseWindow
        """
        bounds = terrain.grid.part(window.top, window.left, window.shape).bounds
        tables = self.run.tables
        return replace(self.run, tables=tables | {"terrain": tables["terrain"] | {"window": list(bounds)}})

    @muted()
    def result(self, look: Callable) -> dict:
        """Run in the first window whose edges the flow does not reach, or in the last; return the record.

        Parameters
        ----------
        look : callable
            Called with (solver, end time [s]) a few times a second.

        Returns
        -------
        dict
        """
        began = time.perf_counter()
        terrain = self.terrain()
        window = self.first_window(terrain)
        choosing = time.perf_counter() - began
        preparing = 0.0
        for runs in range(1, MOST_RUNS + 1):
            record = self.within(terrain, window).result(look)
            preparing += record["prepare_seconds"]
            sides = sides_left(record, terrain, window, self.run.tables)
            if not sides or runs == MOST_RUNS:
                break
            window = window.grown(sides, terrain.grid.shape)
        return record | {
            "window": list(window),
            "runs": runs,
            "edge_reached": bool(sides),
            "window_seconds": choosing,
            "prepare_seconds": preparing,
        }


def sides_left(record: dict, terrain: TerrainFile, window: "ReleaseWindow", tables: dict) -> tuple[str, ...]:
    """Return the sides of a window, inside the DTM, that the flow reached or left by.

    Parameters
    ----------
    record : dict
        Of the run.
    terrain : TerrainFile
    window : ReleaseWindow
    tables : dict
        Of the scene.
    """
    if record["extent"] is None:
        return ()
    size = tables.get("numerics", {}).get("cell_size") or terrain.grid.cell_size
    near = window.sides_reached(record["extent"], EDGE_CELLS + ceil(EDGE_CELLS * size / min(terrain.grid.sides)))
    inner = window.inner_sides(terrain.grid.shape)
    sides = tuple(side for side in near if side in inner)
    if sides or near or not record["mass_out_share"] > 0.0:
        return sides
    whole = np.isfinite(terrain.part(*window.slices).elevation).all()
    return inner if whole else ()  # otherwise the mass went where the DTM has no data
