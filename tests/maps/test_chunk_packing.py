"""Packed chunks: any values come back, long runs without a value are short, and so is what repeats."""

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.maps.qgis.chunk_packing import LARGEST_BLOCK, LEAST_RUN, packed_chunk

NODATA = -9999.0


def unpacked(chunk, count):
    """The values of a chunk, as HDF5 reads it: inflated, then the bytes sorted back."""
    planes = np.frombuffer(zlib.decompress(chunk), np.uint8).reshape(4, count)
    return np.ascontiguousarray(planes.T).view("<f4").ravel()


def with_gaps(lengths, seed=0):
    """Values with random digits and, in turn, gaps of these lengths."""
    random = np.random.default_rng(seed)
    parts = [random.random(length) + 1.0 if k % 2 == 0 else np.full(length, NODATA) for k, length in enumerate(lengths)]
    return np.concatenate(parts).astype("<f4")


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(0, 700), min_size=1, max_size=12), st.integers(0, 99))
def test_values_come_back(lengths, seed):
    values = with_gaps(lengths, seed)
    assert np.array_equal(unpacked(packed_chunk(values, NODATA), len(values)), values)


@pytest.mark.parametrize("length", [*range(LEAST_RUN - 1, LEAST_RUN + 6), *range(256, 264), 516, 517, 518, 100_000])
def test_runs_of_every_length(length):
    values = with_gaps([50, length, 50])
    assert np.array_equal(unpacked(packed_chunk(values, NODATA), len(values)), values)


@pytest.mark.parametrize("count", [0, 1, LARGEST_BLOCK - 1, LARGEST_BLOCK, LARGEST_BLOCK + 1, 2 * LARGEST_BLOCK])
def test_digits_that_do_not_repeat_are_stored(count):
    values = with_gaps([count])
    chunk = packed_chunk(values, NODATA)
    assert np.array_equal(unpacked(chunk, count), values)
    assert len(chunk) <= values.nbytes + 4 * 5 * (1 + count // LARGEST_BLOCK) + 8


def test_gaps_take_no_room():
    values = with_gaps([300, 200] * 400)  # faces of 400 rows of cells
    flow = values[values != NODATA]
    assert len(packed_chunk(values, NODATA)) < 1.01 * len(packed_chunk(flow, NODATA)) + 400 * 4 * 16


def test_what_repeats_is_compressed():
    values = np.repeat(np.arange(1000, dtype="<f4"), 20)
    assert len(packed_chunk(values, NODATA)) < 0.2 * values.nbytes
