"""Running peaks (maxima over all steps) at the nodes of a solver's lattice, and in a frame.

A frame contains them as a flat dictionary: `thickness` [m, vertical], `speed` [m s-1], `pressure` [Pa], `arrival_time`
[s, -1: never], float32[rows, columns] with row 0 in the south, their `transform` (spacing, 0, west, 0, spacing, south),
and the threshold `arrival_thickness` [m] of all but the thickness. If stages of a run have different cell sizes, the
peaks of the other lattices have the names `other1_thickness`, ..., `other1_transform`, `other2_...`.
"""

import re

import numpy as np

PEAK_NAMES = ("thickness", "speed", "pressure", "arrival_time")
# entries of the peaks of a node, in the order of PEAK_NAMES
THICKNESS = 0  # [m] vertical
SPEED = 1  # [m s-1]
PRESSURE = 2  # [Pa]
ARRIVAL = 3  # [s] -1 where the flow never arrived
PEAK_ENTRIES = 4
PEAK_STATE = ("peaks", "peak_nodes")  # names in the restart state of a frame
TRANSFORM, THRESHOLD = "transform", "arrival_thickness"
_ALIGNED = 1e-6  # [spacings] tolerance for nodes of two lattices to coincide, far above rounding
_OTHER = re.compile(r"other(\d+)_")


def no_peaks(shape: tuple[int, int], entries: int = PEAK_ENTRIES) -> np.ndarray:
    """Return the peaks of nodes that no flow has reached.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of nodes.
    entries : int
        PEAK_ENTRIES, or 1: the thickness alone.

    Returns
    -------
    float64[*shape, entries]
    """
    peaks = np.zeros((*shape, entries))
    peaks[..., ARRIVAL:] = -1.0
    return peaks


def peaks_state(peaks: np.ndarray) -> dict[str, np.ndarray]:
    """Return data for a restart: the peaks of the nodes that the flow has reached.

    Parameters
    ----------
    peaks : float64[rows, columns, entries]

    Returns
    -------
    dict
        The names PEAK_STATE -> float64[n, entries] peaks, int64[n] flat indices of the nodes.
    """
    nodes = np.flatnonzero((peaks[..., THICKNESS] > 0.0) | (peaks[..., ARRIVAL:] >= 0.0).any(axis=-1))
    return dict(zip(PEAK_STATE, (peaks.reshape(-1, peaks.shape[-1])[nodes], nodes), strict=True))


def is_peaks_state(peaks: np.ndarray, state: dict) -> bool:
    """Return whether `state` is a valid result of `peaks_state` for an array like `peaks`.

    Parameters
    ----------
    peaks : float64[rows, columns, entries]
    state : dict
    """
    if not set(PEAK_STATE) <= set(state):
        return False
    values, nodes = (state[name] for name in PEAK_STATE)
    return values.shape == (len(nodes), peaks.shape[-1]) and not np.any(nodes >= peaks[..., THICKNESS].size)


def restore_peaks(peaks: np.ndarray, state: dict) -> None:
    """Set peaks from a result of `peaks_state`.

    Parameters
    ----------
    peaks : float64[rows, columns, entries]
        Changed in place.
    state : dict
    """
    peaks[:] = 0.0
    peaks[..., ARRIVAL:] = -1.0
    peaks.reshape(-1, peaks.shape[-1])[state["peak_nodes"]] = state["peaks"]


def maxima_of(peaks: np.ndarray, west: float, south: float, spacing: float, arrival_thickness: float) -> dict:
    """Return peaks in the form of a frame, cropped to the nodes that the flow reached.

    Parameters
    ----------
    peaks : float64[rows, columns, entries]
    west, south : float [m]
        Map position of the first node.
    spacing : float [m]
        Distance of neighbouring nodes.
    arrival_thickness : float [m]
        Threshold of all peaks but the thickness.

    Returns
    -------
    dict
        As described in the module.
    """
    j, i = np.nonzero(peaks[..., THICKNESS] > 0)
    window = (slice(j.min(), j.max() + 1), slice(i.min(), i.max() + 1)) if len(j) else (slice(0, 1), slice(0, 1))
    kept = {name: peaks[(*window, k)].astype(np.float32) for k, name in enumerate(PEAK_NAMES[: peaks.shape[-1]])}
    corner = west + (window[1].start - 0.5) * spacing, south + (window[0].start - 0.5) * spacing
    kept[TRANSFORM] = np.array([spacing, 0.0, corner[0], 0.0, spacing, corner[1]])
    return kept | {THRESHOLD: float(arrival_thickness)}


def lattices_of(kept: dict) -> list[dict]:
    """Return the peaks of each lattice separately.

    Parameters
    ----------
    kept : dict
        Peaks as in a frame.

    Returns
    -------
    list of dict
        Peaks of each lattice under their plain names; empty for an empty `kept`.
    """
    if not kept:
        return []
    numbers = sorted({int(found.group(1)) for name in kept if (found := _OTHER.match(name))})
    common = {name: value for name, value in kept.items() if not _OTHER.match(name)}
    sets = [common]
    for number in numbers:
        prefix = f"other{number}_"
        own = {name.removeprefix(prefix): value for name, value in kept.items() if name.startswith(prefix)}
        sets.append(({THRESHOLD: common[THRESHOLD]} if THRESHOLD in common else {}) | own)
    return sets


def combined_peaks(now: dict, *others: dict) -> dict:
    """Combine peaks of several flows, or of one at several times: the largest values and the earliest arrival.

    Lattices whose nodes coincide are merged; that of `now` is the first.

    Parameters
    ----------
    now, *others : dict
        Peaks as in a frame.

    Returns
    -------
    dict
        Peaks as in a frame.
    """
    lattices = []
    for one in (lattice for kept in (now, *others) for lattice in lattices_of(kept)):
        at = next((k for k, other in enumerate(lattices) if _meet(one, other)), None)
        if at is None:
            lattices.append(one)
        else:
            lattices[at] = _larger(lattices[at], one)
    if not lattices:
        return {}
    first, rest = lattices[0], [lattice for lattice in lattices[1:] if _reached(lattice)]
    rest.sort(key=lambda lattice: float(lattice[TRANSFORM][0]))
    for number, lattice in enumerate(rest, 1):
        first = first | {f"other{number}_{name}": lattice[name] for name in (*PEAK_NAMES, TRANSFORM)}
    return first


def largest_peaks(kept: dict) -> dict:
    """Return the largest values of all lattices as plain numbers.

    Parameters
    ----------
    kept : dict
        Peaks as in a frame.

    Returns
    -------
    dict
        `thickness` [m], `speed` [m s-1] and `pressure` [Pa]; `reached`: for each lattice its `cell_size` [m] and the
        `area` [m2] that the flow reached. Empty for an empty `kept`.
    """
    lattices = lattices_of(kept)
    if not lattices:
        return {}
    found = {name: max(float(lattice[name].max()) for lattice in lattices) for name in PEAK_NAMES[:ARRIVAL]}
    reached = [(float(lattice[TRANSFORM][0]), int((lattice["arrival_time"] >= 0).sum())) for lattice in lattices]
    found["reached"] = [{"cell_size": spacing, "area": count * spacing**2} for spacing, count in reached]
    return found | ({THRESHOLD: float(kept[THRESHOLD])} if THRESHOLD in kept else {})


def _reached(lattice):
    return bool((lattice["thickness"] > 0).any())


def _offset(one: dict, other: dict) -> np.ndarray:
    """Return the offset of `one` to the north and east of `other` [nodes], float64[2]."""
    a, b = np.asarray(one[TRANSFORM], float), np.asarray(other[TRANSFORM], float)
    return (a[[5, 2]] - b[[5, 2]]) / a[0]


def _meet(one: dict, other: dict) -> bool:
    """Return whether the nodes of two lattices coincide."""
    if float(one[TRANSFORM][0]) != float(other[TRANSFORM][0]):
        return False
    offset = _offset(one, other)
    return bool((np.abs(offset - np.rint(offset)) <= _ALIGNED * (1.0 + np.abs(offset))).all())


def _larger(one: dict, other: dict) -> dict:
    """Return the larger values of two lattices whose nodes coincide, on the smallest window that contains both."""
    if not _reached(other):
        return one
    if not _reached(one):
        return one | {name: other[name] for name in (*PEAK_NAMES, TRANSFORM)}
    begins = np.stack([np.zeros(2, int), np.rint(_offset(other, one)).astype(int)])
    ends = begins + np.array([one["thickness"].shape, other["thickness"].shape])
    first, shape = begins.min(axis=0), ends.max(axis=0) - begins.min(axis=0)
    merged = dict(one)
    for name in PEAK_NAMES:
        values = np.full(shape, np.inf if name == "arrival_time" else 0.0, np.float32)
        for lattice, begin, end in zip((one, other), begins - first, ends - first, strict=True):
            part = values[begin[0] : end[0], begin[1] : end[1]]
            if name == "arrival_time":
                np.minimum(part, np.where(lattice[name] >= 0, lattice[name], np.inf), out=part)
            else:
                np.maximum(part, lattice[name], out=part)
        merged[name] = np.where(np.isinf(values), np.float32(-1.0), values)
    transforms = [np.asarray(lattice[TRANSFORM], float) for lattice in (one, other)]
    merged[TRANSFORM] = transforms[0].copy()
    for k, axis in ((5, 0), (2, 1)):
        merged[TRANSFORM][k] = transforms[0 if first[axis] == 0 else 1][k]
    return merged
