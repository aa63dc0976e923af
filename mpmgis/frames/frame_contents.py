"""Contents of a frame: particles and solver maxima, with checks of shape, type and range.

Digests (checksums) of frames and of a whole result, to detect changes after writing.
"""

import h5py
import numpy as np

from ..laws.quantities import PARTICLE
from ..system.errors import FormatError
from ..system.hdf5_reading import require_memory
from .particles import Particles

_WIDTH = {"position": 3, "velocity": 3}
_POSITIVE = ("mass", "volume", "area")
_LARGEST = {"position": 1e9, "velocity": 1e6}  # [m], [m s-1]: above any flow; sums of squares stay finite
_LARGEST_OF_OTHERS, _SMALLEST = 1e30, 1e-30  # quotients of two stay finite; smallest positive value
_IDENTITY = ("id", "parent")


def stored_type(name, dimension):
    """Type of the quantity `name` in a frame; 3D frames store real numbers in float32."""
    dtype = PARTICLE[name].dtype
    return np.dtype("float32" if dimension == 3 and dtype == "float64" else dtype)


def create_dataset(group, name, count, dimension):
    """An empty dataset of the quantity `name`, in its `stored_type`."""
    quantity = PARTICLE[name]
    shape = (count, _WIDTH[name]) if name in _WIDTH else (count,)
    dataset = group.create_dataset(name, shape, stored_type(name, dimension))
    dataset.attrs.update(units=quantity.unit, long_name=quantity.long_name)


def particle_count(group):
    """Number of particles in their HDF5 `group`; 0 where it has no positions."""
    position = group.get("position")
    return len(position) if isinstance(position, h5py.Dataset) and position.ndim else 0


def read_particles(path, group, dimension, header, density, memory, names):
    """Particles of the HDF5 `group` of a frame; the other arguments as in `frames.read_frame`.

    `header` gets the `assumed_density` where mass or volume is missing; `memory` is a dict.

    Raises
    ------
    FormatError
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


def require_particles_fit(path, group, memory, names):
    """Refuse arrays that do not fit into memory as float64, plus one array as it is stored."""
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


def _require_shape(path, name, dataset, count):
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


def _array(path, name, dataset, memory):
    """The values of a dataset: ids as uint64, all others as finite float64 in the valid range."""
    if name not in _IDENTITY:
        values = _filled(dataset, name, memory)
        _require_possible(path, name, values)
        return values
    values = dataset[()]
    if values.dtype.kind == "f" or values.min(initial=0) < 0:
        raise FormatError(f"{path}: particles/{name} must contain integers of at least 0")
    return values.astype(np.uint64, copy=False)


def _complete_mass(path, arrays, header, density):
    """Mass from volume, or volume from mass, with a `density` [kg m-3] that is recorded in `header`."""
    if "mass" in arrays and "volume" in arrays:
        return
    if "mass" not in arrays and "volume" not in arrays:
        raise FormatError(f"{path}: neither particles/mass nor particles/volume; one of them is needed")
    header["assumed_density"] = density
    arrays.setdefault("mass", arrays.get("volume", 0.0) * density)
    arrays.setdefault("volume", arrays["mass"] / density)


def _complete_columns(path, arrays):
    """Area from thickness, or thickness from area, with the volume of the columns."""
    if "thickness" not in arrays and "area" not in arrays:
        raise FormatError(f"{path}: dimension 2 needs particles/thickness or particles/area")
    if "area" not in arrays:
        _require_above_zero(path, "thickness", arrays["thickness"])
        arrays["area"] = arrays["volume"] / arrays["thickness"]
    if "thickness" not in arrays:
        with np.errstate(over="ignore"):
            arrays["thickness"] = arrays["volume"] / arrays["area"]
        _require_possible(path, "thickness", arrays["thickness"])


def _filled(dataset, name, memory):
    """The dataset as float64, in the array of `memory` if its shape fits."""
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


def _scratch(memory, size):
    """uint8[size] of the scratch array in `memory`."""
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
