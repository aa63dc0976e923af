"""The solver's running peaks as a frame on disk has them: which arrays they are, of which shapes and values."""

import numpy as np

from ..errors import FormatError, one_line
from ..peaks import PEAK_NAMES as MAXIMA
from ..peaks import lattices_of


def require_maxima(path, kept):
    """`kept` (arrays and numbers by name, of the file at `path`) if every lattice of peaks in it is whole.

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
        raise FormatError(f"{path}: its maxima lack {missing[0]!r}, wanted {', '.join(MAXIMA)} and transform")
    shape = np.shape(kept["thickness"])
    for name in MAXIMA:
        values = np.asarray(kept[name])
        if values.shape != shape or values.ndim != 2 or values.dtype.kind not in "fiu":
            raise FormatError(f"{path}: maxima/{name} has shape {values.shape}, wanted numbers in two dimensions alike")
        if not (np.isfinite(values) & (values >= (-1 if name == "arrival_time" else 0))).all():
            raise FormatError(f"{path}: maxima/{name} holds values that are negative, NaN or infinite")
    t = np.asarray(kept["transform"], float).ravel()
    if t.size != 6 or not np.isfinite(t).all() or not t[0] == t[4] > 0 or t[1] != 0 or t[3] != 0:
        raise FormatError(f"{path}: maxima/transform is {t.tolist()}, wanted (dx, 0, west, 0, dx, south)")
    threshold = np.asarray(kept.get("arrival_thickness", 0.0))
    if threshold.size != 1 or threshold.dtype.kind not in "fiu" or not 0 <= threshold.item() < np.inf:
        raise FormatError(f"{path}: maxima/arrival_thickness is {one_line(threshold)[:40]}, wanted a number of metres")
