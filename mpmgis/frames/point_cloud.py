"""Points of a frame as a point cloud, in the format LAS 1.4."""

from pathlib import Path

import numpy as np

from .. import __version__
from ..system.errors import InputError, one_line
from ..system.optional_libraries import needed_for
from ..system.whole_files import whole_file
from .particles import Frame

SUFFIX = ".las"
RESOLUTION = 0.001  # [m] of a coordinate, which LAS keeps as a 32-bit integer
_POINT_FORMAT = 6  # the first one of LAS 1.4: coordinates, returns, GPS time
# extra dimension -> unit, description
_EXTRA = {
    "velocity_e": ("m s-1", "velocity to the east"),
    "velocity_n": ("m s-1", "velocity to the north"),
    "velocity_u": ("m s-1", "velocity upwards"),
    "speed": ("m s-1", "speed"),
    "mass": ("kg", "mass"),
    "volume": ("m3", "volume"),
}


def is_point_cloud(path: Path) -> bool:
    """Return whether a file name is that of a point cloud.

    Parameters
    ----------
    path : Path
    """
    return Path(path).suffix.lower() == SUFFIX


def require_point_cloud(path: Path) -> None:
    """Raise unless the library for point clouds is installed, before any work.

    Parameters
    ----------
    path : Path
        Path of the point cloud, for the message.

    Raises
    ------
    InputError
        The library is not installed.
    """
    with needed_for(f"{path}: LAS", "pointcloud"):
        import laspy  # noqa: F401


def write_las(path: Path, frame: Frame) -> None:
    """Write the particles of a frame; the file appears whole or not at all.

    Coordinates are map coordinates and elevation in the frame's CRS, to a millimetre. Besides them each point has its
    velocity and speed [m s-1], mass [kg] and volume [m3] as extra dimensions, and the frame's time [s] as GPS time.

    Parameters
    ----------
    path : Path
    frame : Frame
        Frame of points (dimension 3).

    Raises
    ------
    InputError
        No library laspy, or a cloud wider than 2^31 millimetres.
    """
    require_point_cloud(path)
    import laspy

    particles = frame.particles
    header = laspy.LasHeader(point_format=_POINT_FORMAT, version="1.4")
    place = particles.position.astype(float) + np.asarray(frame.origin, dtype=float)
    header.scales = np.full(3, RESOLUTION)
    header.offsets = np.floor(place.min(axis=0)) if len(place) else np.zeros(3)
    header.generating_software, header.system_identifier = f"mpmgis {__version__}"[:32], "Material Point Method"
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, "f4", f"{text} [{unit}]"[:32]) for name, (unit, text) in _EXTRA.items()]
    )
    if frame.crs is not None:
        header.add_crs(frame.crs)
    cloud = laspy.LasData(header)
    try:
        cloud.x, cloud.y, cloud.z = place.T
    except OverflowError as error:
        raise InputError(f"{path}: too wide for the millimetres of LAS ({one_line(error)})") from error
    for name, values in _extra_values(particles).items():
        cloud[name] = values.astype(np.float32)
    cloud.gps_time = np.full(len(place), float(frame.time))
    cloud.return_number[:] = cloud.number_of_returns[:] = 1
    with whole_file(path) as part:
        cloud.write(part)


def _extra_values(particles):
    velocity = particles.velocity.astype(float)
    values = (*velocity.T, np.linalg.norm(velocity, axis=1), particles.mass, particles.volume)
    return dict(zip(_EXTRA, values, strict=True))
