"""Digests of the content of frames, and what a frame keeps besides its particles."""

import hashlib
from pathlib import Path

import numpy as np

from ..system.errors import FormatError, one_line
from ..system.hdf5_reading import opened_whole, require_numbers_that_fit

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


def stored_digests(path):
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
    content, _ = stored_digests(path)
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
    last = stored_digests(before)[1] if before.is_file() else ""
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
        _, stored_result = stored_digests(path)
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
    return (
        AS_WRITTEN
        if recorded in ("", stored_digests(paths[-1])[1])
        else f"frames after {Path(paths[-1]).name} are missing"
    )
