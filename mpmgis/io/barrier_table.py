"""What barriers took up, over time: `barriers.csv` beside the frames."""

import csv
import io
from pathlib import Path

from ..errors import FormatError, one_line
from .atomic import whole_file

COLUMNS = (
    "time [s]",
    "barrier",
    "mean normal force [N]",
    "normal impulse [N s]",
    "impulse east [N s]",
    "impulse north [N s]",
    "overtopped mass [kg]",
    "peak normal force [N]",
)


class BarrierTable:
    """The file `path`, a row for each frame and barrier; written anew, as a whole, with every frame.

    The mean force is that of the time since the frame before; impulses, mass and peak are those of the run so far.

    Parameters
    ----------
    path : str or Path
    names : tuple of str
        Of the barriers.
    resumed : float, optional
        Time [s] of the frame that a run goes on from: what the file has until then is kept.
    """

    def __init__(self, path, names, resumed=None):
        self.path, self.names = Path(path), tuple(names)
        self._rows = [] if resumed is None else self._read(resumed)

    def add(self, time, sums):
        """Write the rows of one frame at `time` [s].

        `sums` float64[barriers, 5]: normal impulse [N s], impulse east and north, overtopped mass [kg], peak force [N].
        """
        before = {row[1]: (row[0], row[3]) for row in self._rows}
        for name, (normal, east, north, mass, peak) in zip(self.names, sums.tolist(), strict=True):
            last_time, last_impulse = before.get(name, (time, normal))
            mean = (normal - last_impulse) / (time - last_time) if time > last_time else 0.0
            self._rows.append((time, name, mean, normal, east, north, mass, peak))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(self._rows)
        with whole_file(self.path) as part:
            part.write_text(text.getvalue(), encoding="utf-8")

    def _read(self, until):
        """Rows of an earlier part of the run up to the frame that it goes on from."""
        if not self.path.is_file():
            return []
        try:
            with open(self.path, encoding="utf-8", newline="") as handle:
                lines = list(csv.reader(handle))[1:]
            rows = [(float(time), name, *map(float, values)) for time, name, *values in lines]
        except (OSError, ValueError) as error:
            raise FormatError(f"{self.path} cannot be read ({one_line(error)[:80]}); remove it to go on") from error
        return [row for row in rows if row[0] <= until * (1.0 + 1e-12)]
