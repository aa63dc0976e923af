"""Digests of frames: which bytes their arrays were written with, frame by frame and of a whole result."""

import hashlib
from pathlib import Path

import numpy as np

from ..errors import FormatError, one_line
from .hdf5 import opened_whole, require_numbers_that_fit

CONTENT, RESULT, STATE = "content_sha256", "result_sha256", "state_sha256"  # attributes of a frame
DIGESTED = ("particles", "maxima")  # groups; the state of a restart is dropped later
AS_WRITTEN = "as written"


class ContentDigest:
    """The digest of a frame's time and arrays, in the types that they are stored in, slab by slab."""

    def __init__(self, time, step):
        self._head = f"{float(time).hex()} {int(step)}"
        self._arrays = {}

    def add(self, name, values):
        """The next rows of the array `name`."""
        values = np.ascontiguousarray(values)
        if name not in self._arrays:
            self._arrays[name] = hashlib.sha256(f"{values.dtype.str} {values.shape[1:]} ".encode())
        self._arrays[name].update(values.view(np.uint8).reshape(-1) if values.size else b"")

    def hexdigest(self):
        """64 hexadecimal digits."""
        lines = [f"{name} {digest.hexdigest()}" for name, digest in sorted(self._arrays.items())]
        return hashlib.sha256("\n".join([self._head, *lines]).encode()).hexdigest()


def state_digest(content, state):
    """Digest of the `state` of a restart, a dictionary, in a frame of the digest `content`."""
    digest = hashlib.sha256(content.encode())
    for name, values in sorted(state.items()):
        values = np.ascontiguousarray(values)
        digest.update(f"\n{name} {values.dtype.str} {values.shape} ".encode())
        digest.update(values.view(np.uint8).reshape(-1) if values.size else b"")
    return digest.hexdigest()


def result_after(before, content):
    """Digest of a result that grew by a frame of the digest `content`; `before` is '' at its first frame."""
    return hashlib.sha256(f"{before} {content}".encode()).hexdigest()


def stored(path):
    """(content, result) as the frame at `path` was written with; '' for what it does not say."""
    return _stored(path, CONTENT, RESULT)


def _stored(path, *names):
    try:
        with opened_whole(path) as file:
            return tuple(str(file.attrs.get(name, "")) for name in names)
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        raise FormatError(f"{path} is no readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def content_of(path):
    """Digest of what the frame at `path` holds now."""
    try:
        with opened_whole(path) as file:
            digest = ContentDigest(file.attrs["time"], file.attrs["step"])
            for group in DIGESTED:
                require_numbers_that_fit(path, file, group)
                for name, values in file.get(group, {}).items():
                    digest.add(f"{group}/{name}", values[()])
            return digest.hexdigest()
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path} is no readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def check_content(path):
    """AS_WRITTEN, or what is wrong with the frame at `path`; None where it does not say its digest."""
    content, _ = stored(path)
    if not content:
        return None
    return AS_WRITTEN if content_of(path) == content else "changed since it was written"


def require_restartable(path, before):
    """Whether the frame at `path` holds the state of a restart; then nothing in it was changed since it was written.

    Parameters
    ----------
    path : Path
    before : Path
        The frame before it in the run; its result is held against that of `path`, where it is there.

    Raises
    ------
    FormatError
        It was changed, is of another result, or holds a state of which it tells no digest.
    """
    content, result, state = _stored(path, CONTENT, RESULT, STATE)
    kept = state_of(path)
    if not kept:
        return False
    cure = "remove it to go on from the frame before, or start with --overwrite"
    if not (content and state):
        raise FormatError(f"{path} tells no digest of what a restart needs, an older mpmgis wrote it; {cure}")
    if content_of(path) != content or state_digest(content, kept) != state:
        raise FormatError(f"{path} was changed since it was written, a run cannot go on from it; {cure}")
    last = stored(before)[1] if before.is_file() else ""
    if result and last and result_after(last, content) != result:
        raise FormatError(f"{path} does not follow {before.name}, one of them is of another run; {cure}")
    return True


def state_of(path):
    """The state of a restart in the frame at `path`, by name; {} where it has none."""
    try:
        with opened_whole(path) as file:
            group = file.get("state", {})
            require_numbers_that_fit(path, file, "state")
            return {name: values[()] for name, values in group.items()} | dict(getattr(group, "attrs", {}))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path} is no readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def check_result(paths, recorded):
    """AS_WRITTEN, or what is wrong with the frames `paths` of one run, in their order.

    `recorded` is the digest in the run's record, '' where the run has not ended. None where frames say no digest.
    """
    result = ""
    for number, path in enumerate(map(Path, paths)):
        if path.stem.rpartition("_")[2] != f"{number:06d}":
            return f"frame {number} is missing"
        _, said = stored(path)
        if not said:
            return None
        result = result_after(result, content_of(path))
        if result != said:
            return f"{path.name} was changed, or is of another run"
    return AS_WRITTEN if recorded in ("", result) else f"frames after {Path(paths[-1]).name} are missing"
