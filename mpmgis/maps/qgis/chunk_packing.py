"""Pack the values of faces as chunks of an HDF5 file with the filters shuffle and deflate.

The bytes of the values are sorted by their place in a value: the first bytes of all values, then the second ones.
Bytes that repeat are compressed by zlib, run lengths only (Z_RLE): a full search takes twice the time and gives a
larger file (measured). The last digits of numbers hardly repeat, except where long runs of faces are without a value:
such bytes are stored as they are, and the runs are written here, in a tenth of zlib's time. All readers of deflate
(RFC 1951) take a stream of several parts.
"""

import zlib

import numpy as np

from ...compiled.jit import jit

LEVEL = 1  # of zlib
LEAST_REPEATED = 0.25  # [1] share of repeated bytes between runs, below which zlib is not worthwhile
LEAST_RUN = 32  # [values] without a value, from which on a run pays for its two blocks of some 10 bytes
LARGEST_BLOCK = 65535  # [bytes] of a stored block
BLOCK_ROOM = 32  # [bytes] for the two blocks of a run of any length up to some thousands, beside the run itself
HEADER = b"\x78\x01"  # of zlib: window of 32 kB
END = b"\x03\x00"  # an empty last block

# Fixed codes of deflate (RFC 1951, 3.2.6), first bit lowest. A literal is a byte; a length repeats the byte before.
_LITERALS = [(0x30 + k, 8) if k < 144 else (0x190 + k - 144, 9) for k in range(256)]
_LENGTHS = [(k + 1, 7) if k < 23 else (0xC0 + k - 23, 8) for k in range(29)]
LITERAL = np.array([(int(f"{code:0{bits}b}"[::-1], 2), bits) for code, bits in _LITERALS], np.int64)
LENGTH = np.array([(int(f"{code:0{bits}b}"[::-1], 2), bits) for code, bits in _LENGTHS], np.int64)
EXTRA = np.array([0] * 8 + [k for k in range(1, 6) for _ in range(4)] + [0])  # [bits] after the code of each length
LONGEST = 258  # [bytes] of a length
SHORTEST = np.minimum(3 + np.cumsum(2**EXTRA) - 2**EXTRA, LONGEST)  # [bytes] of each code of a length
FIXED_BLOCK = 2, 3  # header of a block with these codes, and its bits
DISTANCE_BITS = 5  # of the code 0: the byte before


def packed_chunk(values: np.ndarray, nodata: float) -> bytes:
    """Pack values as a chunk, bytes shuffled, then deflated.

    Parameters
    ----------
    values : float32[n]
    nodata : float
        Of faces without a value.

    Returns
    -------
    bytes
    """
    runs = np.empty((len(values) // (LEAST_RUN + 1) + 1, 2), np.int64)
    runs = runs[: find_runs(values, np.float32(nodata), runs)]
    within = int((runs[:, 1] - runs[:, 0]).sum())
    planes = np.ascontiguousarray(values.view(np.uint8).reshape(-1, values.itemsize).T)
    parts = [HEADER]
    for plane in planes:
        repeated = np.count_nonzero(plane[1:] == plane[:-1]) - (within - len(runs))
        if repeated > LEAST_REPEATED * (plane.size - within):
            packer = zlib.compressobj(LEVEL, zlib.DEFLATED, -15, 9, zlib.Z_RLE)
            parts += [packer.compress(plane), packer.flush(zlib.Z_FULL_FLUSH)]
        else:
            room = plane.size + BLOCK_ROOM * (len(runs) + plane.size // LARGEST_BLOCK + 1)
            packed = np.empty(room, np.uint8)
            parts.append(packed[: pack_runs(plane, runs, packed)])
    return b"".join([*parts, END, zlib.adler32(planes).to_bytes(4, "big")])


@jit
def find_runs(values: np.ndarray, nodata: float, runs: np.ndarray) -> int:
    """Find the runs of at least LEAST_RUN values that are `nodata`.

    Parameters
    ----------
    values : float32[n]
    nodata : float32
    runs : int64[r, 2], out
        First place of each run, and place after its last.

    Returns
    -------
    int
        Number of runs.
    """
    count, first = 0, 0
    for k in range(values.shape[0] + 1):
        if k < values.shape[0] and values[k] == nodata:
            continue
        if k - first >= LEAST_RUN:
            runs[count, 0], runs[count, 1] = first, k
            count += 1
        first = k + 1
    return count


@jit
def pack_runs(plane: np.ndarray, runs: np.ndarray, packed: np.ndarray) -> int:
    """Write bytes as blocks of deflate: runs by their length, all other bytes as they are.

    Parameters
    ----------
    plane : uint8[n]
    runs : int64[r, 2]
        First place of each run of equal bytes, and place after its last, ascending.
    packed : uint8[m], out
        m >= n + BLOCK_ROOM (r + n / LARGEST_BLOCK + 1).

    Returns
    -------
    int
        Bytes written; the last block is not marked as such.
    """
    packed[0] = 0  # header of a stored block
    size, place = 1, 0
    for r in range(runs.shape[0]):
        first, end = runs[r, 0], runs[r, 1]
        size = _store(plane[place:first], packed, size)
        size = _write_run(plane[first], end - first, packed, size)
        place = end
    return _store(plane[place:], packed, size)


@jit
def _store(literals, packed, size):
    """Write stored blocks, the header of the first of which is written; returns the new size."""
    place = 0
    while True:
        count = min(literals.shape[0] - place, LARGEST_BLOCK)
        packed[size], packed[size + 1] = count & 255, count >> 8
        packed[size + 2], packed[size + 3] = 255 - (count & 255), 255 - (count >> 8)
        size += 4
        packed[size : size + count] = literals[place : place + count]
        size, place = size + count, place + count
        if place == literals.shape[0]:
            return size
        packed[size] = 0
        size += 1


@jit
def _write_run(value, count, packed, size):
    """Write a block of `count` >= 4 bytes `value`, and the header of a stored block; returns the new size."""
    held, bits = FIXED_BLOCK
    held |= LITERAL[value, 0] << bits
    bits += LITERAL[value, 1]
    left = count - 1
    while left > 0:
        length = min(left, LONGEST)
        if 0 < left - length < 3:
            length -= 3  # what is left is at least as long as the shortest length
        code = LENGTH.shape[0] - 1
        while SHORTEST[code] > length:
            code -= 1
        held |= LENGTH[code, 0] << bits
        bits += LENGTH[code, 1]
        held |= (length - SHORTEST[code]) << bits
        bits += EXTRA[code] + DISTANCE_BITS
        left -= length
        while bits >= 8:
            packed[size] = held & 255
            size, held, bits = size + 1, held >> 8, bits - 8
    bits += LENGTH[0, 1] + FIXED_BLOCK[1]  # end of the block, and the header: zeros
    while bits > 0:
        packed[size] = held & 255
        size, held, bits = size + 1, held >> 8, bits - 8
    return size
