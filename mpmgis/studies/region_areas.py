"""Read and write the release areas of a region with the columns of their table."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyproj
import shapely

from ..frames.region_layers import AREAS, write_layer
from ..seeding.release_areas import read_parts
from ..system.errors import InputError
from ..system.messages import log, muted
from ..system.optional_libraries import pyogrio
from ..system.whole_files import whole_file
from ..terrain.vector_table import read_table, require_polygons

if TYPE_CHECKING:
    from ..terrain.dtm import TerrainFile
    from ..terrain.elevation import Terrain


@dataclass(frozen=True)
class RegionAreas:
    """Release areas in the CRS of the DTM.

    Parameters
    ----------
    parts : list of ReleasePart
    columns : dict of str to array
        Columns of their table, by name.
    crs : pyproj.CRS or None
    """

    parts: list
    columns: dict
    crs: pyproj.CRS | None

    def column(self, name: str, option: str) -> np.ndarray:
        """Return the values of a column.

        Parameters
        ----------
        name : str
        option : str
            That names the column, for messages.

        Raises
        ------
        InputError
            There is no such column.
        """
        if name not in self.columns:
            known = ", ".join(self.columns) or "none"
            raise InputError(f"`{option}={name}`: the release areas have no such column; they have {known}")
        return self.columns[name]

    def frequencies(self, name: str) -> np.ndarray:
        """Return the frequencies in a column.

        Parameters
        ----------
        name : str

        Returns
        -------
        float64[n]

        Raises
        ------
        InputError
            There is no such column, or it contains something other than numbers of at least 0.
        """
        values = self.column(name, "frequency")
        wanted = "expected a number of at least 0 for every release area"
        if values.dtype.kind not in "fiu":
            raise InputError(f"`frequency={name}`: the column is text (the first is {values[0]!r}), {wanted}")
        wrong = np.flatnonzero(~(np.isfinite(values) & (values >= 0)))
        if wrong.size:
            first = values[wrong[0]]
            got = f"{first:g}" if np.isfinite(first) else "empty"
            raise InputError(f"`frequency={name}`: area {wrong[0] + 1} has {got}, {wanted}")
        return values.astype(float)


def read_areas(
    path: str | Path,
    terrain: "Terrain | TerrainFile",
    thickness: float | str | None = None,
    surface: str | Path | None = None,
) -> RegionAreas:
    """Read the release areas of a region.

    Parameters
    ----------
    path : str or Path
    terrain : Terrain or TerrainFile
    thickness : float or str, optional
        As in `release_areas.read_release`.
    surface : path, optional
        As in `release_areas.read_release`.

    Raises
    ------
    FormatError, GeoreferenceError, InputError
    """
    with muted():  # `read_parts` reads it again and reports what it ignores or repairs
        require_polygons(read_table(path, flag="--releases "), path)
    return RegionAreas(*read_parts(path, terrain, thickness, surface), terrain.grid.crs)


def write_area(path: Path, shape: bytes, name: str, crs: str | None) -> None:
    """Write one release area as FlatGeobuf.

    Parameters
    ----------
    path : Path
    shape : bytes
        WKB.
    name : str
    crs : str or None
        WKT.
    """
    pyogrio()
    from pyogrio.raw import write

    kind = shapely.from_wkb(shape).geom_type
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a local frame has no CRS
        write(
            part,
            np.array([shape], object),
            [np.array([name], object)],
            ["name"],
            geometry_type=kind,
            crs=crs,
            driver="FlatGeobuf",
            layer=AREAS,
            SPATIAL_INDEX="NO",
        )


def write_areas(path: Path, areas: RegionAreas, results: dict[str, list]) -> None:
    """Write a GeoPackage of all areas with the columns of the input and the results.

    Parameters
    ----------
    path : Path
    areas : RegionAreas
    results : dict of str to list
        Columns by name.
    """
    taken, own, left_out = {"fid", "geometry", *map(str.lower, results)}, {}, []
    for name, values in areas.columns.items():  # GeoPackage does not distinguish upper and lower case
        if name.lower() not in taken:
            own[name] = values
            taken.add(name.lower())
        elif name.lower() not in ("fid", "geometry"):
            left_out.append(f"`{name}`")
    if left_out:
        log.info(
            f"{path}: columns of the release areas with the name of a result, or of another column, are left out: "
            f"{', '.join(left_out)}; rename them to keep them"
        )
    geometry = [part.polygon for part in areas.parts]
    write_layer(path, AREAS, geometry, {**own, **results}, areas.crs)
