"""A DTM in blocks with the ground around them, so that memory does not grow with the raster.

What depends on a cell and its surroundings is computed for a block and a halo around it, and has the same bits for
blocks of any size.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..system.source_names import file_of
from .dtm import TerrainFile
from .elevation import Terrain


@dataclass(frozen=True)
class Block:
    """Rows and columns of a DTM.

    Parameters
    ----------
    first, last : (int, int)
        First row and column; row and column after the last ones.
    path : Path
        Of the DTM.
    """

    first: tuple[int, int]
    last: tuple[int, int]
    path: Path = Path()

    @property
    def cells(self) -> tuple[slice, slice]:
        """Slice of rows and slice of columns."""
        return slice(self.first[0], self.last[0]), slice(self.first[1], self.last[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.last[0] - self.first[0], self.last[1] - self.first[1]

    def around(self, halo: int, shape: tuple[int, int]) -> "Block":
        """Return the block with a halo, within the DTM.

        Parameters
        ----------
        halo : int [cells]
        shape : (int, int)
            Rows and columns of the DTM.
        """
        first = max(self.first[0] - halo, 0), max(self.first[1] - halo, 0)
        return Block(first, (min(self.last[0] + halo, shape[0]), min(self.last[1] + halo, shape[1])), self.path)

    def inside(self, larger: "Block") -> tuple[slice, slice]:
        """Return the slices of this block in the arrays of a larger one.

        Parameters
        ----------
        larger : Block
        """
        (row, column), (rows, columns) = larger.first, self.cells
        return slice(rows.start - row, rows.stop - row), slice(columns.start - column, columns.stop - column)


def dtm_blocks(terrain: Terrain | TerrainFile, side: int) -> list[Block]:
    """Return the blocks of a DTM, row by row.

    Parameters
    ----------
    terrain : Terrain or TerrainFile
    side : int [cells]
        Of a block; those at the end of rows and columns are smaller.
    """
    rows, columns = terrain.grid.shape
    path = file_of(terrain.path) if terrain.path else Path()
    return [
        Block((i, j), (min(i + side, rows), min(j + side, columns)), path)
        for i in range(0, rows, side)
        for j in range(0, columns, side)
    ]


def block_heights(terrain: Terrain | TerrainFile, block: Block, halo: int) -> np.ndarray:
    """Return the elevation of a block and of the halo around it.

    Parameters
    ----------
    terrain : Terrain or TerrainFile
        A TerrainFile is read for it.
    block : Block
    halo : int [cells]

    Returns
    -------
    float64[rows + 2 halo, columns + 2 halo] [m]
        NaN for nodata and beyond the DTM.

    Raises
    ------
    FormatError, InputError
    """
    larger = block.around(halo, terrain.grid.shape)
    there = terrain.elevation[larger.cells] if isinstance(terrain, Terrain) else terrain.heights(*larger.cells)
    heights = np.full([n + 2 * halo for n in block.shape], np.nan)
    heights[larger.inside(Block((block.first[0] - halo, block.first[1] - halo), block.last))] = there
    return heights
