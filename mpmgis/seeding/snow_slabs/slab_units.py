"""Divide the cells on which a slab can release into units by ridges, gullies and aspect.

Cells of one sector of aspect that share a side are a seed. Seeds too small to release join the neighbour with the
longest common border; then neighbours with similar aspects grow together, each with its most similar one (mutual best
fitting, Baatz and Schaepe 2000, the segmentation of Buehler et al. 2018). Nothing joins across a ridge or gully.

The order of rows and columns decides nothing: where two neighbours fit equally well, neither is taken.
"""

from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are first used

from ...compiled.jit import jit
from ...compiled.mask_rings import root_of
from .slab_ground import RIDGE, TURN

JOIN_ANGLE = 60.0  # [degrees] between the mean aspects of a small seed and of the neighbour that it joins, at most
GROW_ANGLE = 30.0  # [degrees] between the mean aspects of units that grow together, at most
_SAME = 1e-9  # [1] two cosines that differ by less are equal
_SCALE = 1 << 20  # steps of a unit vector


class Units(NamedTuple):
    """Units, the largest first.

    Parameters
    ----------
    labels : int32[rows, columns]
        Number of the unit of each cell, from 1; 0 outside.
    cells : int64[n]
        Number of cells of each.
    aspect : float64[n] [degrees]
        Mean azimuth downslope.
    """

    labels: np.ndarray
    cells: np.ndarray
    aspect: np.ndarray


def divided(classes: np.ndarray, aspect: np.ndarray, least: int) -> Units:
    """Divide cells into units.

    Parameters
    ----------
    classes : uint8[rows, columns]
    aspect : uint16[rows, columns]
        Both as in `SlabGround`.
    least : int
        Smallest number of cells of a unit.
    """
    azimuths = (np.arange(TURN) + 0.5) * (2.0 * np.pi / TURN)
    towards = np.rint(_SCALE * np.stack([np.sin(azimuths), np.cos(azimuths)], 1)).astype(np.int64)
    labels, parents = np.zeros(classes.shape, np.int32), np.zeros(classes.size + 1, np.int32)
    count = _label(classes, labels, parents)
    cells, sums = _sums(labels, aspect, towards, count)
    joined = _joined(_Seeds(cells, sums, *_borders(labels, count)), least)
    _renumber(labels, joined)
    cells, _ = _sums(labels, aspect, towards, int(joined.max(initial=0)))
    _renumber(labels, np.concatenate([[0], np.where(cells < least, -1, np.arange(1, len(cells) + 1))]).astype(np.int32))
    _give_back(labels, aspect, _between(classes, labels))
    cells, sums = _sums(labels, aspect, towards, int(joined.max(initial=0)))
    first = _first_cells(labels, len(cells))
    order = np.lexsort((first, -cells))
    order = order[cells[order] >= least]
    numbers = np.zeros(len(cells) + 1, np.int32)
    numbers[1 + order] = np.arange(1, len(order) + 1)
    _renumber(labels, numbers)
    east, north = sums[order].T
    return Units(labels, cells[order], np.degrees(np.arctan2(east, north)) % 360.0)


class _Seeds(NamedTuple):
    """Seeds and their common borders.

    cells int64[n], sums int64[n, 2] of unit vectors downslope (east, north); pairs int64[m, 2] of seeds counted from 0,
    the smaller number first, borders int64[m] in sides of cells.
    """

    cells: np.ndarray
    sums: np.ndarray
    pairs: np.ndarray
    borders: np.ndarray

    def cosines(self):
        """Return the cosine of the angle between the mean aspects of each pair; -1 where one has none."""
        one, other = self.sums[self.pairs[:, 0]].astype(float), self.sums[self.pairs[:, 1]].astype(float)
        lengths = np.hypot(*one.T) * np.hypot(*other.T)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(lengths > 0, (one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1]) / lengths, -1.0)

    def united(self, chosen):
        """Return the seeds after the union of the `chosen` pairs, and the new number of each old one."""
        n = len(self.cells)
        links = scipy.sparse.coo_array((np.ones(len(chosen), np.int8), tuple(self.pairs[chosen].T)), (n, n))
        count, numbers = scipy.sparse.csgraph.connected_components(links, directed=False)
        cells, sums = np.zeros(count, np.int64), np.zeros((count, 2), np.int64)
        np.add.at(cells, numbers, self.cells)
        np.add.at(sums, numbers, self.sums)
        pairs = np.sort(numbers[self.pairs].astype(np.int64), axis=1)
        apart = pairs[:, 0] != pairs[:, 1]
        keys, place = np.unique(pairs[apart, 0] * count + pairs[apart, 1], return_inverse=True)
        borders = np.zeros(len(keys), np.int64)
        np.add.at(borders, place, self.borders[apart])
        return _Seeds(cells, sums, np.stack([keys // count, keys % count], 1), borders), numbers


def _joined(seeds: _Seeds, least: int) -> np.ndarray:
    """Return the number of the unit of each seed, both counted from 1; entry 0 is 0."""
    numbers = np.arange(len(seeds.cells))
    for choose in (_small_to_join, _similar_to_grow):
        while len(seeds.pairs):
            chosen = choose(seeds, least)
            if not len(chosen):
                break
            seeds, new = seeds.united(chosen)
            numbers = new[numbers]
    return np.concatenate([[0], numbers + 1]).astype(np.int32)


def _small_to_join(seeds: _Seeds, least: int) -> np.ndarray:
    """Return the pairs of a small seed and the neighbour with the longest border, then the most similar aspect."""
    cosines = seeds.cosines()
    fits = np.flatnonzero(cosines >= np.cos(np.radians(JOIN_ANGLE)))
    pair = np.concatenate([fits, fits])
    seed = np.concatenate([seeds.pairs[fits, 0], seeds.pairs[fits, 1]])
    small = seeds.cells[seed] < least
    return _best(pair[small], seed[small], (seeds.borders[pair[small]], np.rint(cosines[pair[small]] / _SAME)))


def _similar_to_grow(seeds: _Seeds, least: int) -> np.ndarray:
    """Return the pairs of which each is the most similar neighbour of the other."""
    cosines = seeds.cosines()
    large = (seeds.cells[seeds.pairs] >= least).all(axis=1)
    fits = np.flatnonzero(large & (cosines >= np.cos(np.radians(GROW_ANGLE))))
    pair = np.concatenate([fits, fits])
    seed = np.concatenate([seeds.pairs[fits, 0], seeds.pairs[fits, 1]])
    best = _best(pair, seed, (np.rint(cosines[pair] / _SAME), seeds.borders[pair]))
    found, times = np.unique(best, return_counts=True)
    return found[times == 2]


def _best(pair: np.ndarray, seed: np.ndarray, keys: tuple) -> np.ndarray:
    """Return for each seed its pair with the largest keys, the first key first; none where two are equal."""
    order = np.lexsort((*keys[::-1], seed))
    pair, seed, keys = pair[order], seed[order], [key[order] for key in keys]
    last = np.append(seed[1:] != seed[:-1], True)[: len(seed)]
    tied = np.zeros(len(seed), bool)
    if len(seed) > 1:
        tied[1:] = (seed[1:] == seed[:-1]) & np.all([key[1:] == key[:-1] for key in keys], axis=0)
    return pair[last & ~tied]


@jit
def _label(classes, labels, parents):
    """Number the groups of cells of one sector that share sides, from 1; return how many there are."""
    rows, columns = classes.shape
    n = 0
    for i in range(rows):
        for j in range(columns):
            one = classes[i, j]
            if one == 0 or one == RIDGE:
                continue
            left = labels[i, j - 1] if j > 0 and classes[i, j - 1] == one else 0
            above = labels[i - 1, j] if i > 0 and classes[i - 1, j] == one else 0
            if left == 0 and above == 0:
                n += 1
                parents[n] = n
                labels[i, j] = n
                continue
            if left == 0 or above == 0:
                labels[i, j] = left + above
                continue
            left, above = root_of(parents, left), root_of(parents, above)
            low = min(left, above)
            parents[left] = low
            parents[above] = low
            labels[i, j] = low
    count = 0
    for k in range(1, n + 1):  # a parent has a smaller number
        if parents[k] == k:
            count += 1
            parents[k] = count
        else:
            parents[k] = parents[parents[k]]
    for i in range(rows):
        for j in range(columns):
            labels[i, j] = parents[labels[i, j]]
    return count


@jit
def _sums(labels, aspect, towards, count):
    """Return cells and sum of the unit vectors downslope of each label from 1 to `count`."""
    cells, sums = np.zeros(count, np.int64), np.zeros((count, 2), np.int64)
    rows, columns = labels.shape
    for i in range(rows):
        for j in range(columns):
            k = labels[i, j] - 1
            if k >= 0:
                cells[k] += 1
                sums[k, 0] += towards[aspect[i, j], 0]
                sums[k, 1] += towards[aspect[i, j], 1]
    return cells, sums


def _borders(labels, count):
    """Return the pairs of labels that share sides of cells, counted from 0, and the number of these sides."""
    keys = np.empty(_border_keys(labels, count, np.empty(0, np.int64)), np.int64)
    _border_keys(labels, count, keys)
    found, sides = np.unique(keys, return_counts=True)
    return np.stack([found // max(count, 1), found % max(count, 1)], 1), sides


@jit
def _border_keys(labels, count, keys):
    """Write a key for each side between two labels, where there is room; return how many there are."""
    rows, columns = labels.shape
    n = 0
    for i in range(rows):
        for j in range(columns):
            one = np.int64(labels[i, j]) - 1
            if one < 0:
                continue
            for k in range(2):
                if (k == 0 and j + 1 == columns) or (k == 1 and i + 1 == rows):
                    continue
                other = np.int64(labels[i, j + 1] if k == 0 else labels[i + 1, j]) - 1
                if other >= 0 and other != one:
                    if len(keys) > 0:
                        keys[n] = min(one, other) * count + max(one, other)
                    n += 1
    return n


@jit
def _first_cells(labels, count):
    """Return the index of the first cell of each label from 1 to `count`."""
    rows, columns = labels.shape
    first = np.full(count, rows * columns, np.int64)
    for i in range(rows):
        for j in range(columns):
            k = labels[i, j] - 1
            if k >= 0:
                first[k] = min(first[k], i * columns + j)
    return first


@jit
def _renumber(labels, numbers):
    """Replace each label by its entry in `numbers`, in place."""
    rows, columns = labels.shape
    for i in range(rows):
        for j in range(columns):
            labels[i, j] = numbers[labels[i, j]]


@jit
def _between(classes, labels):
    """Return the cells of crests and of groups that are too small, row and column, int32[n, 2]; the latter get 0."""
    rows, columns = classes.shape
    found = np.empty((np.count_nonzero(classes == RIDGE) + np.count_nonzero(labels < 0), 2), np.int32)
    n = 0
    for i in range(rows):
        for j in range(columns):
            if classes[i, j] == RIDGE or labels[i, j] < 0:
                labels[i, j] = 0
                found[n, 0] = i
                found[n, 1] = j
                n += 1
    return found


@jit
def _give_back(labels, aspect, cells):
    """Give cells to the only unit beside them with a similar aspect there, from its sides to the middle, in place.

    A cell between two units stays outside both.
    """
    rows, columns = labels.shape
    similar = int(JOIN_ANGLE / 360.0 * TURN)
    count = len(cells)
    given = np.zeros(count, np.int32)
    while True:
        left, changed = 0, 0
        for n in range(count):
            i, j = cells[n]
            found, several = 0, False
            for k in range(4):
                a, b = i + (k == 0) - (k == 1), j + (k == 2) - (k == 3)
                if not (0 <= a < rows and 0 <= b < columns) or labels[a, b] == 0:
                    continue
                apart = abs(np.int64(aspect[a, b]) - np.int64(aspect[i, j]))
                if min(apart, TURN - apart) <= similar:
                    several = several or (found != 0 and labels[a, b] != found)
                    found = labels[a, b]
            if several:
                continue
            cells[left] = cells[n]
            given[left] = found
            changed += found != 0
            left += 1
        if changed == 0:
            return
        count = 0
        for n in range(left):
            if given[n] != 0:
                labels[cells[n, 0], cells[n, 1]] = given[n]
            else:
                cells[count] = cells[n]
                count += 1
