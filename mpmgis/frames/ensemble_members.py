"""Results of the members of an ensemble as arrays."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..system.errors import FormatError, one_line
from ..terrain.grid import Grid
from ..terrain.raster_input import band_values, grid_of, open_raster
from .ensemble_folder import MEMBERS, TABLE_FILE, deposit_file, member_files


@dataclass(frozen=True)
class Members:
    """Members of an ensemble in the order of their numbers.

    Parameters
    ----------
    folder : Path
        Of the ensemble.
    rows : tuple of dict
        Column -> text, of `members.csv`.
    """

    folder: Path
    rows: tuple

    def __len__(self) -> int:
        return len(self.rows)

    def values(self, keys) -> np.ndarray:
        """float64[n, len(keys)]: values of varied keys."""
        return np.array([[float(row[key]) for key in keys] for row in self.rows]).reshape(len(self), len(keys))

    def figure(self, name: str) -> np.ndarray:
        """float64[n]: a figure by its column, NaN where it is missing."""
        return np.array([float(row[name] or "nan") for row in self.rows])

    @property
    def finished(self) -> np.ndarray:
        """bool[n]."""
        return np.array([row["status"] == "finished" for row in self.rows])

    def raster(self, k: int) -> Path:
        """Path of the maxima of member `k`, from 0."""
        return member_files(self.folder / MEMBERS, self.rows[k]["digest"])[1]

    def deposit(self, k: int) -> Path:
        """Path of the deposit of member `k`, from 0."""
        return deposit_file(self.folder / MEMBERS, self.rows[k]["digest"])

    def band(self, k: int, name: str) -> np.ndarray:
        """float64[rows, columns] of member `k`, NaN without flow."""
        return read_band(self.raster(k), name)

    def grid(self) -> Grid:
        """Grid of the rasters of all members."""
        path = self.raster(int(np.argmax(self.finished)))
        with open_raster(path) as source:
            return grid_of(source, path)


def read_band(path: Path, name: str) -> np.ndarray:
    """float64[rows, columns] of the band `name` of a raster of this program, NaN without a value."""
    with open_raster(path) as source:
        names = [text.split(" [")[0] for text in source.descriptions]
        return band_values(source, path, names.index(name) + 1, may_be_empty=True)


def read_members(folder: Path) -> Members:
    """The Members of the ensemble in `folder`.

    Raises
    ------
    FormatError
    """
    path = Path(folder) / TABLE_FILE
    try:
        with open(path, newline="", encoding="utf-8") as file:
            return Members(Path(folder), tuple(csv.DictReader(file)))
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path} cannot be read ({one_line(error)}); expected the members of an ensemble") from error
