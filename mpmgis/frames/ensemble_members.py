"""Results of the members of an ensemble as arrays: values of the varied keys, figures, and the raster of each."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..system.errors import FormatError, one_line
from ..terrain.grid import Grid
from ..terrain.raster_input import band_values, grid_of, open_raster
from ..terrain.undeclared_nodata import RESULT
from .many_runs_folder import ENSEMBLE, TABLE_FILE, RunFiles


@dataclass(frozen=True)
class Members:
    """Members of an ensemble in the order of their numbers.

    Parameters
    ----------
    folder : Path
        Folder of the ensemble.
    rows : tuple of dict
        Rows of `members.csv`: heading -> text.
    """

    folder: Path
    rows: tuple

    def __len__(self) -> int:
        return len(self.rows)

    def values(self, keys: Sequence[str]) -> np.ndarray:
        """Return the values of varied keys.

        Parameters
        ----------
        keys : sequence of str

        Returns
        -------
        float64[n, len(keys)]
        """
        return np.array([[float(row[key]) for key in keys] for row in self.rows]).reshape(len(self), len(keys))

    def figure(self, name: str) -> np.ndarray:
        """Return a figure of each member, NaN where it is missing.

        Parameters
        ----------
        name : str
            Heading of its column.

        Returns
        -------
        float64[n]
        """
        return np.array([float(row[name] or "nan") for row in self.rows])

    @property
    def finished(self) -> np.ndarray:
        """Whether each member has finished, bool[n]."""
        return np.array([row["status"] == "finished" for row in self.rows])

    def raster(self, k: int) -> Path:
        """Return the path of the maxima of a member.

        Parameters
        ----------
        k : int
            Number of the member, from 0.
        """
        return self._files(k).maxima

    def deposit(self, k: int) -> Path:
        """Return the path of the deposit of a member.

        Parameters
        ----------
        k : int
            Number of the member, from 0.
        """
        return self._files(k).deposit

    def _files(self, k):
        return RunFiles(self.folder / ENSEMBLE.runs, self.rows[k]["digest"])

    def band(self, k: int, name: str) -> np.ndarray:
        """Read a band of the maxima of a member.

        Parameters
        ----------
        k : int
            Number of the member, from 0.
        name : str
            Name of the band.

        Returns
        -------
        float64[rows, columns]
            NaN without flow.
        """
        return read_band(self.raster(k), name)

    def grid(self) -> Grid:
        """Return the grid of the rasters of all members."""
        path = self.raster(int(np.argmax(self.finished)))
        with open_raster(path) as source:
            return grid_of(source, path)


def read_band(path: Path, name: str) -> np.ndarray:
    """Read a band of a raster that this program wrote.

    Parameters
    ----------
    path : Path
    name : str
        Name of the band.

    Returns
    -------
    float64[rows, columns]
        NaN without a value.
    """
    with open_raster(path) as source:
        names = [text.split(" [")[0] for text in source.descriptions]
        return band_values(source, path, names.index(name) + 1, RESULT, may_be_empty=True)


def read_members(folder: Path) -> Members:
    """Read the members of the ensemble in `folder`.

    Parameters
    ----------
    folder : Path
        Folder of the ensemble.

    Raises
    ------
    FormatError
        The table of the members is missing or cannot be read.
    """
    path = Path(folder) / TABLE_FILE
    try:
        with open(path, newline="", encoding="utf-8") as file:
            return Members(Path(folder), tuple(csv.DictReader(file)))
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path} cannot be read ({one_line(error)}); expected the members of an ensemble") from error
