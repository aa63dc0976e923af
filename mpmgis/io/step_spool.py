"""What mesh and GeoPackage need of every exported step, on disk until they are made.

Both can be written only when all steps are known. Kept like this, memory is that of one step however many there are,
and no raster is packed out again.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

BANDS = ("h", "t", "Un", "Ut", "Ut_E", "Ut_N")
SHOWN = ("ids", "place", "velocity")


class StepOutline(NamedTuple):
    """Outline of the flow at one step: its WKB, its number of `cells`, largest `depth` [m] and `speed` [m s-1]."""

    wkb: bytes
    cells: int
    depth: float
    speed: float


class StepSpool:
    """Steps one after the other into a folder, and from there one at a time.

    Parameters
    ----------
    folder : path
        Is made; whoever made the spool removes it.
    """

    def __init__(self, folder):
        self._folder, self.count = Path(folder), 0
        self._folder.mkdir()

    def add(self, index, bands, outline=None, shown=None):
        """Keep one step.

        Parameters
        ----------
        index : int64[k]
            Flat index of its cells in the export grid, ascending.
        bands : dict of str to float32[k]
            Of BANDS; without `Ut_E` and `Ut_N` the mesh has no arrows.
        outline : StepOutline or None
        shown : dict or None
            The particles to show: `ids` uint64[m], `place` float64[m, 3] [m], `velocity` float64[m, 3] [m s-1].
        """
        kept = {name: np.asarray(bands[name], np.float32) for name in BANDS if name in bands}
        with open(self._cells(self.count), "wb") as file:
            for array in (np.array(list(kept), "U8"), np.asarray(index, np.int64), *kept.values()):
                np.save(file, array)
        shapes = {}
        if outline is not None:
            shapes = {"wkb": np.frombuffer(outline.wkb, np.uint8), "facts": np.array(outline[1:], float)}
        np.savez(self._shapes(self.count), **shapes, **(shown or {}))
        self.count += 1

    def bands(self, step):
        """(Flat index int64[k], dict of str to float32[k]) of a step's cells."""
        with open(self._cells(step), "rb") as file:
            names, index = np.load(file), np.load(file)
            return index, {str(name): np.load(file) for name in names}

    def outline(self, step):
        """The StepOutline of a step, None where it has none."""
        with np.load(self._shapes(step)) as kept:
            if "wkb" not in kept:
                return None
            cells, depth, speed = kept["facts"].tolist()
            return StepOutline(kept["wkb"].tobytes(), int(cells), depth, speed)

    def shown(self, step):
        """The particles to show of a step as `add` got them, None where it has none."""
        with np.load(self._shapes(step)) as kept:
            return {name: kept[name] for name in SHOWN} if "ids" in kept else None

    def _cells(self, step):
        return self._folder / f"{step}.npy"

    def _shapes(self, step):
        return self._folder / f"{step}.npz"
