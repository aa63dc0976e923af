"""Digests (checksums) of frames and of a whole result, to detect changes after writing."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..system.errors import FormatError, one_line
from ..system.hdf5_reading import opened_whole, require_numbers_that_fit

# attributes of a frame
CONTENT = "content_sha256"
RESULT = "result_sha256"
STATE = "state_sha256"
BED_CHANGE = "bed_change"  # group
DIGESTED = ("particles", "maxima", BED_CHANGE)  # groups; not the restart state, which is removed later
AS_WRITTEN = "as written"  # result of a check: nothing has changed


class ContentDigest:
    """Digest of the time and the arrays of a frame, in their stored types, slab by slab.

    Parameters
    ----------
    time : float [s]
    step : int
        Number of time steps.
    """

    def __init__(self, time: float, step: int):
        self._head = f"{float(time).hex()} {int(step)}"
        self._arrays = {}

    def add(self, name: str, values: np.ndarray) -> None:
        """Add the next rows of an array.

        Parameters
        ----------
        name : str
            Group and name of the array.
        values : array[n, ...]
            In the stored type.
        """
        values = np.ascontiguousarray(values)
        if name not in self._arrays:
            self._arrays[name] = hashlib.sha256(f"{values.dtype.str} {values.shape[1:]} ".encode())
        self._arrays[name].update(values.view(np.uint8).reshape(-1) if values.size else b"")

    def hexdigest(self) -> str:
        """Return the digest as 64 hexadecimal digits."""
        lines = [f"{name} {digest.hexdigest()}" for name, digest in sorted(self._arrays.items())]
        return hashlib.sha256("\n".join([self._head, *lines]).encode()).hexdigest()


def state_digest(content: str, state: dict) -> str:
    """Return the digest of the restart state in a frame.

    Parameters
    ----------
    content : str
        Digest of the content of the frame.
    state : dict
        Name -> array.
    """
    digest = hashlib.sha256(content.encode())
    for name, values in sorted(state.items()):
        values = np.ascontiguousarray(values)
        digest.update(f"\n{name} {values.dtype.str} {values.shape} ".encode())
        digest.update(values.view(np.uint8).reshape(-1) if values.size else b"")
    return digest.hexdigest()


def result_after(before: str, content: str) -> str:
    """Return the digest of a result after one more frame.

    Parameters
    ----------
    before : str
        Digest of the result up to the previous frame, '' at the first frame.
    content : str
        Digest of the content of the frame.
    """
    return hashlib.sha256(f"{before} {content}".encode()).hexdigest()


def stored_digests(path: str | Path) -> tuple[str, str]:
    """Read the digests that the frame at `path` stores.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    content, result : str
        '' where one is missing.
    """
    return _read_attributes(path, CONTENT, RESULT)


def _read_attributes(path: str | Path, *names: str) -> tuple[str, ...]:
    try:
        with opened_whole(path) as file:
            return tuple(str(file.attrs.get(name, "")) for name in names)
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        raise FormatError(f"{path} is not a readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def content_of(path: str | Path) -> str:
    """Compute the digest of the present content of the frame at `path`.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        The file is not readable.
    """
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


def check_content(path: str | Path) -> str | None:
    """Compare the content of the frame at `path` with its stored digest.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    str or None
        AS_WRITTEN, or a description of the change; None where the frame has no digest.
    """
    content, _ = stored_digests(path)
    if not content:
        return None
    return AS_WRITTEN if content_of(path) == content else "changed since it was written"


def require_restartable(path: Path, before: Path) -> bool:
    """Return whether the frame at `path` contains a valid restart state.

    Parameters
    ----------
    path : Path
    before : Path
        Previous frame of the run; where it exists, its result digest must fit that of `path`.

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


def state_of(path: str | Path) -> dict:
    """Read the restart state in the frame at `path`.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        Name -> array or number; empty where there is no state.

    Raises
    ------
    FormatError
        The file is not readable.
    """
    try:
        with opened_whole(path) as file:
            group = file.get("state", {})
            require_numbers_that_fit(path, file, "state")
            return {name: values[()] for name, values in group.items()} | dict(getattr(group, "attrs", {}))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise FormatError(f"{path} is not a readable HDF5 file ({one_line(error)[:120]}); it is damaged") from error


def check_result(paths: Sequence[str | Path], recorded: str) -> str | None:
    """Compare the ordered frames of one run with their stored digests.

    Parameters
    ----------
    paths : sequence of str or Path
    recorded : str
        Digest in the record of the run, '' where the run has not ended.

    Returns
    -------
    str or None
        AS_WRITTEN, or a description of the change; None where a frame has no digest.
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


def check_kept(paths: Sequence[str | Path], recorded: str) -> str | None:
    """Compare the frames that a run with rasters keeps with their stored digests.

    Most frames of such a run are missing. Each frame is compared by itself, and the result of the last one with the
    record.

    Parameters
    ----------
    paths : sequence of str or Path
    recorded : str
        Digest in the record of the run, '' where the run has not ended.

    Returns
    -------
    str or None
        AS_WRITTEN, or a description of the change; None where a frame has no digest.
    """
    for path in map(Path, paths):
        found = check_content(path)
        if found != AS_WRITTEN:
            return found and f"{path.name} was {found}"
    return (
        AS_WRITTEN
        if recorded in ("", stored_digests(paths[-1])[1])
        else f"frames after {Path(paths[-1]).name} are missing"
    )
