"""Digests of the content of frames, and what a frame keeps besides its particles."""

import hashlib
from pathlib import Path

import numpy as np

from ..system.errors import FormatError, one_line
from ..system.hdf5_reading import opened_whole, require_numbers_that_fit
from .peaks import PEAK_NAMES as MAXIMA
from .peaks import lattices_of

CONTENT, RESULT, STATE = "content_sha256", "result_sha256", "state_sha256"  # attributes of a frame
BED_CHANGE = "bed_change"
DIGESTED = ("particles", "maxima", BED_CHANGE)  # groups; the restart state is removed later
AS_WRITTEN = "as written"


class ContentDigest:
    """Digest of the time and the arrays of a frame, in their stored types, slab by slab."""

    def __init__(self, time, step):
        self._head = f"{float(time).hex()} {int(step)}"
        self._arrays = {}

    def add(self, name, values):
        """Add the next rows of the array `name`."""
        values = np.ascontiguousarray(values)
        if name not in self._arrays:
            self._arrays[name] = hashlib.sha256(f"{values.dtype.str} {values.shape[1:]} ".encode())
        self._arrays[name].update(values.view(np.uint8).reshape(-1) if values.size else b"")

    def hexdigest(self):
        """64 hexadecimal digits."""
        lines = [f"{name} {digest.hexdigest()}" for name, digest in sorted(self._arrays.items())]
        return hashlib.sha256("\n".join([self._head, *lines]).encode()).hexdigest()


def state_digest(content, state):
    """Digest of the restart `state` (dict) in a frame with the digest `content`."""
    digest = hashlib.sha256(content.encode())
    for name, values in sorted(state.items()):
        values = np.ascontiguousarray(values)
        digest.update(f"\n{name} {values.dtype.str} {values.shape} ".encode())
        digest.update(values.view(np.uint8).reshape(-1) if values.size else b"")
    return digest.hexdigest()


def result_after(before, content):
    """Digest of a result after a frame with the digest `content`; `before` is '' at the first frame."""
    return hashlib.sha256(f"{before} {content}".encode()).hexdigest()


def stored(path):
    """(content, result) digests stored in the frame at `path`; '' where one is missing."""
    return _read_attributes(path, CONTENT, RESULT)


def _read_attributes(path, *names):
    try:
        with opened_whole(path) as file:
            return tuple(str(file.attrs.get(name, "")) for name in names)
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        raise FormatError(f"{path} is not a readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def content_of(path):
    """Digest of the present content of the frame at `path`."""
    try:
        with opened_whole(path) as file:
            digest = ContentDigest(file.attrs["time"], file.attrs["step"])
            for group in DIGESTED:
                require_numbers_that_fit(path, file, group)
                for name, values in file.get(group, {}).items():
                    digest.add(f"{group}/{name}", values[()])
            return digest.hexdigest()
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path} is not a readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def check_content(path):
    """AS_WRITTEN, or a description of the change in the frame at `path`; None where it has no digest."""
    content, _ = stored(path)
    if not content:
        return None
    return AS_WRITTEN if content_of(path) == content else "changed since it was written"


def require_restartable(path, before):
    """Whether the frame at `path` contains a valid restart state.

    Parameters
    ----------
    path : Path
    before : Path
        The previous frame of the run; where it exists, its result digest must fit that of `path`.

    Raises
    ------
    FormatError
        The frame was changed, belongs to another result, or has a state without a digest.
    """
    content, result, state = _read_attributes(path, CONTENT, RESULT, STATE)
    kept = state_of(path)
    if not kept:
        return False
    fix = "remove it to continue from the previous frame, or start with --overwrite"
    if not (content and state):
        raise FormatError(f"{path} has no digest of the restart state (written by an older mpmgis); {fix}")
    if content_of(path) != content or state_digest(content, kept) != state:
        raise FormatError(f"{path} was changed since it was written, a run cannot continue from it; {fix}")
    last = stored(before)[1] if before.is_file() else ""
    if result and last and result_after(last, content) != result:
        raise FormatError(f"{path} does not follow {before.name}: they belong to different runs; {fix}")
    return True


def state_of(path):
    """The restart state in the frame at `path`, by name; {} where it has none."""
    try:
        with opened_whole(path) as file:
            group = file.get("state", {})
            require_numbers_that_fit(path, file, "state")
            return {name: values[()] for name, values in group.items()} | dict(getattr(group, "attrs", {}))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path} is not a readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def check_result(paths, recorded):
    """AS_WRITTEN, or a description of the change in the ordered frames `paths` of one run; None without digests.

    `recorded` is the digest in the record of the run, '' where the run has not ended.
    """
    result = ""
    for number, path in enumerate(map(Path, paths)):
        if path.stem.rpartition("_")[2] != f"{number:06d}":
            return f"frame {number} is missing"
        _, stored_result = stored(path)
        if not stored_result:
            return None
        result = result_after(result, content_of(path))
        if result != stored_result:
            return f"{path.name} was changed, or belongs to another run"
    return AS_WRITTEN if recorded in ("", result) else f"frames after {Path(paths[-1]).name} are missing"


def check_kept(paths, recorded):
    """As `check_result` for the frames that a run with rasters keeps: each by itself, and the last one's result."""
    for path in map(Path, paths):
        found = check_content(path)
        if found != AS_WRITTEN:
            return found and f"{path.name} was {found}"
    return AS_WRITTEN if recorded in ("", stored(paths[-1])[1]) else f"frames after {Path(paths[-1]).name} are missing"


def require_bed_change(path, kept):
    """`kept` if it is what a frame holds of its bed: masses of at least 0 on north-up squares, a density above 0.

    Forest adds further arrays of the same shape, which are of at least 0 too.

    Raises
    ------
    FormatError
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


def require_maxima(path, kept):
    """`kept` (arrays and numbers by name, from the file at `path`) if every lattice of peaks in it is complete.

    Raises
    ------
    FormatError
    """
    for lattice in lattices_of(kept):
        _require_lattice(path, lattice)
    return kept


def _require_lattice(path, kept):
    missing = [name for name in (*MAXIMA, "transform") if name not in kept]
    if missing:
        raise FormatError(f"{path}: its maxima lack {missing[0]!r}, expected {', '.join(MAXIMA)} and transform")
    shape = np.shape(kept["thickness"])
    for name in MAXIMA:
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
