"""Table of the loads on barriers, with a row for each frame and barrier."""

import csv
import io
from pathlib import Path

import numpy as np

from ..system.errors import FormatError, one_line
from ..system.whole_files import whole_file

# sum of a solver -> heading of its column
SUMS = {
    "normal_impulse": "normal impulse [N s]",
    "impulse_east": "impulse east [N s]",
    "impulse_north": "impulse north [N s]",
    "impulse_up": "impulse up [N s]",
    "moment_impulse_east": "angular impulse east [N m s]",
    "moment_impulse_north": "angular impulse north [N m s]",
    "moment_impulse_up": "angular impulse up [N m s]",
    "overtopped_mass": "overtopped mass [kg]",
    "peak_normal_force": "largest normal force of a step so far [N]",
}
# sums with a column of their mean rate since the previous frame; all but the first in 3D only
RATES = {
    "normal_impulse": "mean normal force [N]",
    "impulse_east": "mean force east [N]",
    "impulse_north": "mean force north [N]",
    "impulse_up": "mean force up [N]",
    "moment_impulse_east": "mean moment east [N m]",
    "moment_impulse_north": "mean moment north [N m]",
    "moment_impulse_up": "mean moment up [N m]",
}


class LoadTable:
    """Writer of a table with a row for each frame and barrier; the file is rewritten atomically with every frame.

    The mean force is over the time since the previous frame; impulses, mass and the largest force of a single step
    are those of the run so far.

    Parameters
    ----------
    path : str or Path
    names : tuple of str
        Names of the barriers.
    sums : tuple of str
        Keys of SUMS: the sums of the solver for each barrier.
    resumed : float, optional [s]
        Time of the frame from which a run continues: earlier rows of the file are kept.
    """

    def __init__(self, path: str | Path, names: tuple[str, ...], sums: tuple[str, ...], resumed: float | None = None):
        self.path, self.names, self.sums = Path(path), tuple(names), tuple(sums)
        self._rated = [k for k, name in enumerate(sums) if name in (RATES if "impulse_up" in sums else list(RATES)[:1])]
        self._rows = [] if resumed is None else self._read(resumed)

    def add(self, time: float, sums: np.ndarray) -> None:
        """Write the rows of one frame.

        Parameters
        ----------
        time : float [s]
        sums : float64[barriers, k]
            In the order of `self.sums`.
        """
        before = {row[1]: (row[0], row[2 + len(self._rated) :]) for row in self._rows}
        for name, now in zip(self.names, sums.tolist(), strict=True):
            last_time, last = before.get(name, (time, now))
            passed = time - last_time
            rates = [(now[k] - last[k]) / passed if passed > 0 else 0.0 for k in self._rated]
            self._rows.append((time, name, *rates, *now))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        rated = [RATES[self.sums[k]] for k in self._rated]
        writer.writerow(["time [s]", "barrier", *rated, *(SUMS[name] for name in self.sums)])
        writer.writerows(self._rows)
        with whole_file(self.path) as part:
            part.write_text(text.getvalue(), encoding="utf-8", newline="\n")

    def _read(self, until):
        """Rows of the earlier part of the run, up to the time [s] of the restart."""
        if not self.path.is_file():
            return []
        try:
            with open(self.path, encoding="utf-8", newline="") as handle:
                lines = list(csv.reader(handle))[1:]
            rows = [(float(time), name, *map(float, values)) for time, name, *values in lines]
        except (OSError, ValueError) as error:
            raise FormatError(f"{self.path} cannot be read ({one_line(error)[:80]}); remove it to continue") from error
        return [row for row in rows if row[0] <= until * (1.0 + 1e-12)]


def read_barrier_table(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Read a file that LoadTable wrote.

    Parameters
    ----------
    path : Path

    Returns
    -------
    dict
        Name of a barrier -> heading of a column -> float64[frames].

    Raises
    ------
    FormatError
        The file is not such a table.
    """
    try:
        with open(path, encoding="utf-8", newline="") as handle:
            rows = list(csv.DictReader(handle))
        found = {}
        for name in dict.fromkeys(row["barrier"] for row in rows):
            mine = [row for row in rows if row["barrier"] == name]
            headings = [heading for heading in mine[0] if heading != "barrier"]
            found[name] = {heading: np.array([float(row[heading]) for row in mine]) for heading in headings}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path} is not a table of barriers of a run ({one_line(error)[:80]})") from error
    return found
