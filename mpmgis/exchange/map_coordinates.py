"""Default georeference of another code's files: coordinates that lie on the DTM as they are need no axes and origin."""

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..system.errors import MpmgisError
from ..system.file_references import require_local
from ..system.messages import log, muted
from ..terrain.dtm import TerrainFile
from ..terrain.elevation import Terrain
from ..terrain.georeference import AUTO
from .declarations import DIRECTIONS, Declarations, axis_matrix
from .frame_georeferencing import PLACE, named_columns
from .readers.reader_interface import ThirdPartyFrame, require_memory

USUAL_AXES, USUAL_ORIGIN = ("e", "n", "u"), (0.0, 0.0, 0.0)
INSIDE = 0.9  # [1] least share of the particles in the bounds of the DTM: a flow may leave it
NEAR_GROUND = 100.0  # [m] largest median distance of the particles from the ground, more than any flow is thick
MARGIN = 2  # [pixels] of the DTM read around the particles
BYTES_PER_PARTICLE = 100  # [bytes] while the coordinates are compared


@dataclass(frozen=True, kw_only=True)
class Ground:
    """The DTM of some frames: a file that is read under the particles only, or in memory.

    Parameters
    ----------
    dem : str, Path or None
    crs, to_crs : str or None
    band : int or None
        As for `read_terrain`.
    terrain : Terrain or None
    """

    dem: str | Path | None = None
    crs: str | None = None
    band: int | None = None
    to_crs: str | None = None
    terrain: Terrain | None = None

    def opened(self, terms: Declarations) -> Terrain | TerrainFile:
        """Return the terrain, or the file of the DTM, of which nothing is read yet but its georeference.

        Parameters
        ----------
        terms : Declarations
            With the CRS of the particles.
        """
        if self.terrain is not None:
            return self.terrain
        to_crs = self.to_crs
        if to_crs == AUTO and terms.crs is not None and terms.crs.to_epsg():
            to_crs = f"EPSG:{terms.crs.to_epsg()}"
        return TerrainFile(self.dem, self.crs, self.band, to_crs=to_crs)


def _overlap(bounds, others):
    west, south, east, north = others
    return bounds[0] <= east and bounds[2] >= west and bounds[1] <= north and bounds[3] >= south


def with_map_coordinates(frame: ThirdPartyFrame, terms: Declarations, ground: Ground | None) -> Declarations:
    """Complete the declarations of files whose coordinates lie on the DTM as east, north and up.

    Axes and origin that nobody declared become e,n,u and 0 if the particles are then in the bounds of the DTM and near
    its ground, and if they are not with another axis upwards.

    Parameters
    ----------
    frame : ThirdPartyFrame
        The first one.
    terms : Declarations
    ground : Ground or None
        None: the DTM of the sidecar, if it names one.
    """
    if terms.axes is not None and terms.origin is not None:
        return terms
    named = named_columns(frame, terms)
    if frame.count == 0 or not all(name in named for name in PLACE):
        return terms
    if ground is None or (ground.dem is None and ground.terrain is None):
        if terms.dem is None:
            return terms
        require_local(terms.dem, frame.path)
        ground = Ground(dem=terms.dem, crs=None if ground is None else ground.crs)
    require_memory(frame.path, frame.count, BYTES_PER_PARTICLE)
    values = frame.read(tuple(named[name] for name in PLACE))
    own = np.column_stack([values[named[name]] for name in PLACE])
    own = own[np.isfinite(own).all(axis=1)]
    complete = replace(terms, axes=terms.axes or USUAL_AXES, origin=terms.origin or USUAL_ORIGIN)
    with muted():
        try:
            if len(own) == 0:
                return terms
            source = ground.opened(complete)
            if not _is_on(source, own, complete):
                return terms
            if terms.axes is None and any(_is_on(source, own, other) for other in _other_ups(complete)):
                return terms
        except MpmgisError:  # of the DTM: raised again when it is read
            return terms
    where = ground.terrain.path if ground.terrain is not None else ground.dem
    assumed = []
    if terms.axes is None:
        assumed.append(f"axes {','.join(complete.axes)}")
    if terms.origin is None:
        assumed.append("origin 0,0,0")
    log.info(f"{frame.path}: its coordinates lie on {where or 'the terrain'}: {' and '.join(assumed)} are assumed")
    return complete


def _other_ups(terms):
    """Declarations with all axes whose up is not that of `terms`."""
    for axes in itertools.product(DIRECTIONS, repeat=3):
        matrix = np.array([DIRECTIONS[word] for word in axes])
        if np.linalg.det(matrix) > 0.5 and axes[2] != USUAL_AXES[2]:
            yield replace(terms, axes=axes)


def _is_on(source, own, terms):
    """True if particles with these axes and origin are in the bounds of the DTM and near its ground."""
    x, y, z = (own @ axis_matrix(terms.axes) + np.asarray(terms.origin, float)).T
    bounds = x.min(), y.min(), x.max(), y.max()
    if not _overlap(bounds, source.grid.bounds):
        return False
    terrain = source if isinstance(source, Terrain) else source.cropped(bounds, MARGIN)
    west, south, east, north = terrain.grid.bounds
    inside = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    if inside.mean() < INSIDE:
        return False
    above = z[inside] - terrain.sample(x[inside], y[inside])
    known = np.isfinite(above)
    return bool(known.any()) and abs(float(np.median(above[known]))) <= NEAR_GROUND
