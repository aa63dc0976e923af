"""What the user says about another code's files: all that the files do not say themselves."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...geo.georeference import parse_crs

EAST, NORTH, UP = np.eye(3)
DIRECTIONS = {"e": EAST, "n": NORTH, "u": UP, "w": -EAST, "s": -NORTH, "d": -UP}
NAMES = (  # ours, that --columns may give a column each
    *("x", "y", "z", "vx", "vy", "vz", "mass", "volume", "radius", "diameter", "id", "active", "time"),
)
VECTORS = {"position": ("x", "y", "z"), "velocity": ("vx", "vy", "vz")}  # the same for a column of three components
POSSIBLE = {"density": (0.1, 1e5, "kg m-3"), "particle volume": (1e-18, 1e9, "m3")}
COMPONENTS = ("x", "y", "z")


@dataclass(frozen=True)
class ForeignTerms:
    """The command line's options for another code's files, as text and numbers.

    Parameters
    ----------
    reader : str or None
        Name of the code; None to find it out from the files.
    crs : pyproj.CRS or None
        Of the particles; None where it is not said, or metres without a place.
    local : bool
        It was said that they are metres without a place.
    origin : tuple of 3 floats or None
        (E, N, H) [m] of the file's own origin.
    axes : tuple of 3 str or None
        Where the file's x, y and z point: e, n, u, w, s, d, or one of the first three with a minus.
    times : tuple of float or None
        Time [s] of each file, in the order of their numbers.
    time_step, frames_per_second : float or None
        Time [s] from one file's number to the next, or its inverse [s-1].
    columns : tuple of (str, str)
        Names of NAMES or VECTORS and the file's own columns for them.
    density : float or None
        [kg m-3]
    particle_volume : float or None
        [m3] of every particle.
    dem : str or None
        Path of the DTM, where a sidecar names it.
    sidecar : Path or None
        The file that tells all this for the particles (`foreign/sidecar`); None to look for it beside them.
    """

    reader: str | None = None
    crs: object = None
    local: bool = False
    origin: tuple | None = None
    axes: tuple | None = None
    times: tuple | None = None
    time_step: float | None = None
    frames_per_second: float | None = None
    columns: tuple = ()
    density: float | None = None
    particle_volume: float | None = None
    dem: str | None = None
    sidecar: Path | None = None

    def __post_init__(self):
        given = [option for option, value in self._of_time().items() if value is not None]
        if len(given) > 1:
            raise InputError(f"{' and '.join(given)} all say the time of the frames; give one of them")
        if self.axes is not None:
            axis_matrix(self.axes)
        for name, value in (("density", self.density), ("particle volume", self.particle_volume)):
            low, high, unit = POSSIBLE[name]
            if value is not None and not low <= value <= high:
                raise InputError(f"a {name} of {value:g} {unit} is none of a flow, wanted {low:g} to {high:g}")
        for name, _ in self.columns:
            if name not in NAMES and name not in VECTORS:
                known = ", ".join((*NAMES, *VECTORS))
                raise InputError(f"--columns: there is no quantity {name!r}; choose from {known}")

    def _of_time(self):
        return {"--times": self.times, "--dt": self.time_step, "--fps": self.frames_per_second}

    def column_pairs(self):
        """(name of NAMES, column) of all that was said; of a vector's column `U` the components are U.x, U.y, U.z."""
        for name, column in self.columns:
            if name in VECTORS:
                yield from zip(VECTORS[name], (f"{column}.{letter}" for letter in COMPONENTS), strict=True)
            else:
                yield name, column

    def column_for(self, name):
        """The column that was said for a name of NAMES; None where none was."""
        return dict(self.column_pairs()).get(name)

    def only_for_foreign(self):
        """Options given that mean nothing for mpmgis' own frames, which say all of that themselves."""
        options = {
            "--origin": self.origin, "--axes": self.axes, **self._of_time(), "--columns": self.columns or None,
            "--particle-volume": self.particle_volume, "--sidecar": self.sidecar,
        }  # fmt: skip
        return [option for option, value in options.items() if value is not None]

    @classmethod
    def named(cls, values, crs=None):
        """The terms in a mapping that may hold more than them, where `crs` is a CRS by its word, or None."""
        said = {field.name: values[field.name] for field in fields(cls) if field.name in values}
        place = None if crs is None else parse_crs(crs)
        return cls(**said | {"crs": place, "local": crs is not None and place is None})


def axis_matrix(axes):
    """float64[3, 3]: map vector (E, N, up) of the file's x, y and z, one a row.

    Raises
    ------
    InputError
        Not three directions at right angles to each other, or a mirror image.
    """
    rows = []
    for word in axes:
        sign, letter = (-1.0, word[1:]) if word[:1] == "-" else (1.0, word)
        if letter not in DIRECTIONS:
            raise InputError(f"--axes {','.join(axes)}: {word!r} is no direction, wanted e, n, u (or -e, -n, -u)")
        rows.append(sign * DIRECTIONS[letter])
    matrix = np.array(rows)
    if matrix.shape != (3, 3) or abs(np.linalg.det(matrix)) < 0.5:
        raise InputError(f"--axes {','.join(axes)}: wanted three directions at right angles, for example e,u,-n")
    if np.linalg.det(matrix) < 0:
        raise InputError(
            f"--axes {','.join(axes)} is a mirror image of the terrain: right-handed axes are, for example, e,n,u or "
            "e,u,-n (y up)"
        )
    return matrix
