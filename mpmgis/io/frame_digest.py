"""Digests of frames: which bytes their arrays were written with, frame by frame and of a whole result."""

import hashlib
from pathlib import Path

import h5py
import numpy as np

from ..errors import FormatError, one_line

CONTENT, RESULT = "content_sha256", "result_sha256"  # attributes of a frame
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


def result_after(before, content):
    """Digest of a result that grew by a frame of the digest `content`; `before` is '' at its first frame."""
    return hashlib.sha256(f"{before} {content}".encode()).hexdigest()


def stored(path):
    """(content, result) as the frame at `path` was written with; '' for what it does not say."""
    try:
        with h5py.File(path, "r") as file:
            return tuple(str(file.attrs.get(name, "")) for name in (CONTENT, RESULT))
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        raise FormatError(f"{path} is no readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def content_of(path):
    """Digest of what the frame at `path` holds now."""
    try:
        with h5py.File(path, "r") as file:
            digest = ContentDigest(file.attrs["time"], file.attrs["step"])
            for group in DIGESTED:
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
