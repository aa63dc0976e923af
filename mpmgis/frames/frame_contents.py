"""Contents of a frame: particles, bed change and solver maxima, with checks of shape, type and range."""

from collections.abc import Collection
from pathlib import Path

import h5py
import numpy as np

from ..laws.quantities import PARTICLE
from ..system.errors import FormatError, one_line
from ..system.hdf5_reading import require_memory
from .particles import Particles
from .peaks import PEAK_NAMES, lattices_of

_WIDTH = {"position": 3, "velocity": 3}  # numbers per particle; 1 for all others
_POSITIVE = ("mass", "volume", "area")  # above 0
_LARGEST = {"position": 1e9, "velocity": 1e6}  # [m], [m s-1] above any flow; sums of squares stay finite
_LARGEST_OF_OTHERS = 1e30  # in the unit of the quantity; quotients of two stay finite
_SMALLEST = 1e-30  # smallest mass, volume, area, in their units; quotients of two stay finite
_IDENTITY = ("id", "parent")


def stored_type(name: str, dimension: int) -> np.dtype:
    """Return the type in which a frame stores a quantity; 3D frames store real numbers in float32.

    Parameters
    ----------
    name : str
        Name of the quantity.
    dimension : int
        2 or 3.
    """
    dtype = PARTICLE[name].dtype
    return np.dtype("float32" if dimension == 3 and dtype == "float64" else dtype)


def create_dataset(group: h5py.Group, name: str, count: int, dimension: int) -> None:
    """Create an empty dataset of a quantity, in its `stored_type`.

    Parameters
    ----------
    group : h5py.Group
    name : str
        Name of the quantity.
    count : int
        Number of particles.
    dimension : int
        2 or 3.
    """
    quantity = PARTICLE[name]
    shape = (count, _WIDTH[name]) if name in _WIDTH else (count,)
    dataset = group.create_dataset(name, shape, stored_type(name, dimension))
    dataset.attrs.update(units=quantity.unit, long_name=quantity.long_name)


def particle_count(group: h5py.Group) -> int:
    """Return the number of particles in their group; 0 where it has no positions.

    Parameters
    ----------
    group : h5py.Group
    """
    position = group.get("position")
    return len(position) if isinstance(position, h5py.Dataset) and position.ndim else 0


def read_particles(
    path: str | Path,
    group: h5py.Group,
    dimension: int,
    header: dict,
    density: float,
    memory: dict,
    names: Collection[str] | None,
) -> Particles:
    """Read the particles of a frame.

    Parameters
    ----------
    path : str or Path
        Path of the frame, for messages.
    group : h5py.Group
        Group of the particles.
    dimension : int
        2 or 3.
    header : dict
        Gets the `assumed_density` where mass or volume is missing.
    density : float [kg m-3]
        Gives the missing one of mass and volume.
    memory : dict
        Arrays of an earlier frame, reused where their shapes fit.
    names : collection of str or None
        Arrays to read, `position` included; None for all. Columns without a stored area are read completely.

    Raises
    ------
    FormatError
        No particle, a missing array, wrong shapes, NaN or impossible values.
    """
    arrays = {}
    if dimension == 2 and "area" not in group:
        names = None
    for name in PARTICLE:
        if name in group and (names is None or name in names):
            count = len(arrays["position"]) if "position" in arrays else None
            _require_shape(path, name, group[name], count)
            arrays[name] = _array(path, name, group[name], memory)
    for name in ("position", "velocity"):
        if name not in arrays and (names is None or name in names):
            raise FormatError(f"{path}: no particles/{name}")
    if len(arrays["position"]) == 0:
        raise FormatError(f"{path}: contains no particle")
    if names is not None:
        return Particles(**dict.fromkeys(("velocity", "mass", "volume")) | arrays)
    _complete_mass(path, arrays, header, density)
    if dimension == 2:
        _complete_columns(path, arrays)
    return Particles(**arrays)


def require_particles_fit(path: str | Path, group: h5py.Group, memory: dict, names: Collection[str] | None) -> None:
    """Raise unless the arrays fit into memory as float64, plus one array as it is stored.

    Parameters
    ----------
    path : str or Path
        Path of the frame, for messages.
    group : h5py.Group
        Group of the particles.
    memory : dict
        Arrays of an earlier frame; those of the same shape need no new memory.
    names : collection of str or None
        Arrays to read; None for all.
    """
    read = {name: group[name] for name in PARTICLE if name in group and (names is None or name in names)}
    new = {
        name: some
        for name, some in read.items()
        if isinstance(some, h5py.Dataset) and some.size and np.shape(memory.get(name)) != some.shape
    }
    if new:
        rows = max(some.shape[0] if some.shape else 1 for some in new.values())
        size = sum(8 * some.size for some in new.values())
        require_memory(f"{path}: particles", rows, size / max(rows, 1), *new.values())


def require_bed_change(path: str | Path, kept: dict) -> dict:
    """Return the bed change of a frame if it is valid.

    Masses are at least 0 on north-up squares, the density is above 0. Forest adds arrays of the same shape, which are
    at least 0 too.

    Parameters
    ----------
    path : str or Path
        Path of the frame, for messages.
    kept : dict
        Arrays and numbers by name, as in the file.

    Returns
    -------
    dict
        `kept`.

    Raises
    ------
    FormatError
        An array or a number is missing or not valid.
    """
    mass, transform, density = (np.asarray(kept.get(name)) for name in ("eroded_mass", "transform", "bed_density"))
    if mass.ndim != 2 or mass.dtype.kind != "f" or not (np.isfinite(mass).all() and (mass >= 0).all()):
        raise FormatError(f"{path}: bed_change/eroded_mass is not an array (rows, columns) of numbers of at least 0")
    for name in set(kept) & {"detrained_mass", "broken_forest"}:
        found = np.asarray(kept[name])
        sound = found.shape == mass.shape and found.dtype.kind == "f"
        if not (sound and np.isfinite(found).all() and (found >= 0).all()):
            raise FormatError(f"{path}: bed_change/{name} is not an array {list(mass.shape)} of numbers of at least 0")
    if transform.shape != (6,) or transform.dtype.kind != "f" or not np.isfinite(transform).all():
        raise FormatError(f"{path}: bed_change/transform is not (dx, 0, west, 0, dx, south)")
    dx, shear, _, turn, dy, _ = transform.tolist()
    if not (dx > 0 and dx == dy and shear == turn == 0):
        raise FormatError(f"{path}: bed_change/transform is {transform.tolist()}, expected (dx, 0, west, 0, dx, south)")
    if density.size != 1 or density.dtype.kind not in "fiu" or not (np.isfinite(density).all() and density > 0):
        raise FormatError(f"{path}: bed_change/bed_density is {one_line(density)[:40]}, expected kg m-3 above 0")
    return kept


def require_maxima(path: str | Path, kept: dict) -> dict:
    """Return the maxima of a frame if every lattice of peaks in them is complete.

    Parameters
    ----------
    path : str or Path
        Path of the frame, for messages.
    kept : dict
        Arrays and numbers by name, as in the file.

    Returns
    -------
    dict
        `kept`.

    Raises
    ------
    FormatError
        An array is missing, or has another shape or values that are not valid.
    """
    for lattice in lattices_of(kept):
        _require_lattice(path, lattice)
    return kept


def _require_shape(path: str | Path, name: str, dataset: object, count: int | None) -> None:
    """Refuse a dataset that is no array of numbers of the right width for `count` particles (None: any number)."""
    if not isinstance(dataset, h5py.Dataset):
        raise FormatError(f"{path}: particles/{name} is not a dataset")
    shape = np.shape(dataset)
    count = (shape[0] if shape else 0) if count is None else count
    wanted = (count, _WIDTH[name]) if name in _WIDTH else (count,)
    if shape != wanted or dataset.dtype.kind not in "fiu":
        raise FormatError(
            f"{path}: particles/{name} has shape {shape} of {dataset.dtype}, expected numbers of shape {wanted}"
        )


def _array(path: str | Path, name: str, dataset: h5py.Dataset, memory: dict) -> np.ndarray:
    """Return the values of a dataset: ids as uint64, all others as finite float64 in the valid range."""
    if name not in _IDENTITY:
        values = _filled(dataset, name, memory)
        _require_possible(path, name, values)
        return values
    values = dataset[()]
    if values.dtype.kind == "f" or values.min(initial=0) < 0:
        raise FormatError(f"{path}: particles/{name} must contain integers of at least 0")
    return values.astype(np.uint64, copy=False)


def _complete_mass(path: str | Path, arrays: dict, header: dict, density: float) -> None:
    """Compute mass from volume, or volume from mass, with a `density` [kg m-3] that is recorded in `header`."""
    if "mass" in arrays and "volume" in arrays:
        return
    if "mass" not in arrays and "volume" not in arrays:
        raise FormatError(f"{path}: neither particles/mass nor particles/volume; one of them is needed")
    header["assumed_density"] = density
    arrays.setdefault("mass", arrays.get("volume", 0.0) * density)
    arrays.setdefault("volume", arrays["mass"] / density)


def _complete_columns(path: str | Path, arrays: dict) -> None:
    """Compute area from thickness, or thickness from area, with the volume of the columns."""
    if "thickness" not in arrays and "area" not in arrays:
        raise FormatError(f"{path}: dimension 2 needs particles/thickness or particles/area")
    if "area" not in arrays:
        _require_above_zero(path, "thickness", arrays["thickness"])
        arrays["area"] = arrays["volume"] / arrays["thickness"]
    if "thickness" not in arrays:
        with np.errstate(over="ignore"):
            arrays["thickness"] = arrays["volume"] / arrays["area"]
        _require_possible(path, "thickness", arrays["thickness"])


def _filled(dataset: h5py.Dataset, name: str, memory: dict) -> np.ndarray:
    """Return the dataset as float64, in the array of `memory` if its shape fits."""
    if name not in memory or memory[name].shape != dataset.shape:
        memory[name] = np.empty(dataset.shape)
    values = stored = memory[name]
    if dataset.dtype != values.dtype:  # NumPy converts the type four times as fast as HDF5
        stored = _scratch(memory, dataset.nbytes).view(dataset.dtype).reshape(dataset.shape)
    if values.size:
        dataset.read_direct(stored)
    if stored is not values:
        values[...] = stored
    return values


def _scratch(memory: dict, size: int) -> np.ndarray:
    """Return the first `size` bytes of the scratch array in `memory`, uint8[size]."""
    if "scratch" not in memory or len(memory["scratch"]) < size:
        memory["scratch"] = np.empty(size, np.uint8)
    return memory["scratch"][:size]


def _require_possible(path, name, values):
    largest = float(max(values.max(), -values.min())) if values.size else 0.0  # NaN where one is
    if not np.isfinite(largest):
        bad = ~np.isfinite(values)
        raise FormatError(
            f"{path}: particles/{name} contains {int(bad.sum())} values that are NaN or infinite, the first in row "
            f"{int(np.argwhere(bad)[0][0])}"
        )
    limit = _LARGEST.get(name, _LARGEST_OF_OTHERS)
    if largest > limit:
        row = int(np.argwhere(np.abs(values) == largest)[0][0])
        raise FormatError(
            f"{path}: particles/{name} reaches {largest:g} {PARTICLE[name].unit} in row {row}, expected at most "
            f"{limit:g}"
        )
    if name in _POSITIVE:
        _require_above_zero(path, name, values)
    if name == "thickness" and values.size and values.min() < 0:
        row = int(values.argmin())
        raise FormatError(f"{path}: particles/thickness is {values.min():g} in row {row}, expected 0 or more")


def _require_above_zero(path, name, values):
    if values.size and values.min() < _SMALLEST:
        row = int(values.argmin())
        raise FormatError(
            f"{path}: particles/{name} is {values[row]:g} in row {row}, expected above 0 ({_SMALLEST:g} at least)"
        )


def _require_lattice(path, kept):
    missing = [name for name in (*PEAK_NAMES, "transform") if name not in kept]
    if missing:
        raise FormatError(f"{path}: its maxima lack {missing[0]!r}, expected {', '.join(PEAK_NAMES)} and transform")
    shape = np.shape(kept["thickness"])
    for name in PEAK_NAMES:
        values = np.asarray(kept[name])
        if values.shape != shape or values.ndim != 2 or values.dtype.kind not in "fiu":
            raise FormatError(
                f"{path}: maxima/{name} has shape {values.shape}, expected numbers of shape (rows, columns)"
            )
        if not (np.isfinite(values) & (values >= (-1 if name == "arrival_time" else 0))).all():
            raise FormatError(f"{path}: maxima/{name} contains negative, NaN or infinite values")
    t = np.asarray(kept["transform"], float).ravel()
    if t.size != 6 or not np.isfinite(t).all() or not t[0] == t[4] > 0 or t[1] != 0 or t[3] != 0:
        raise FormatError(f"{path}: maxima/transform is {t.tolist()}, expected (dx, 0, west, 0, dx, south)")
    threshold = np.asarray(kept.get("arrival_thickness", 0.0))
    if threshold.size != 1 or threshold.dtype.kind not in "fiu" or not 0 <= threshold.item() < np.inf:
        raise FormatError(
            f"{path}: maxima/arrival_thickness is {one_line(threshold)[:40]}, expected a number of metres"
        )
