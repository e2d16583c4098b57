# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whole numbers in few bits: how many bits each has, and these without the top one.

The first is deflated by whoever calls, as most numbers of a kind are about as long. The second no
compression makes shorter.
"""

from typing import Any
import zlib

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.uint64]
POWERS = 2 ** np.arange(63, dtype=np.uint64)


def zigzag(values: NDArray[np.int64]) -> Numbers:
    """Return numbers without a sign that are small where the given ones are."""
    return ((values << 1) ^ (values >> 63)).view(np.uint64)


def zagzig(values: Numbers) -> NDArray[np.int64]:
    """Return what `zigzag` was given."""
    one = np.uint64(1)
    return (values >> one).view(np.int64) ^ -(values & one).view(np.int64)


def lengths(values: Numbers) -> NDArray[np.uint8]:
    """Return how many bits numbers (n,) below 2^62 have, 0 for 0."""
    return np.searchsorted(POWERS, values, side='right').astype(np.uint8)


def pack_bits(values: Numbers) -> bytes:
    """Pack numbers (n,), without the top bit of each, which its length tells."""
    count = lengths(values)
    bits = np.unpackbits(values.astype('>u8').view(np.uint8).reshape(-1, 8), axis=1)
    return np.packbits(bits[_below_the_top(count, 64)]).tobytes()


def bytes_for(count: NDArray[np.uint8]) -> int:
    """Return how many bytes `pack_bits` makes of numbers of so many bits (n,)."""
    return -(-int(np.maximum(count.astype(np.int64) - 1, 0).sum()) // 8)


def unpack_bits(data: bytes, count: NDArray[np.uint8]) -> Numbers:
    """Unpack numbers of so many bits (n,) from exactly `bytes_for` them."""
    width = 64 if count.max(initial=0) > 16 else 16
    bits = np.arange(width) == width - count[:, None].astype(int)
    below = _below_the_top(count, width)
    bits[below] = np.unpackbits(np.frombuffer(data, np.uint8), count=int(below.sum()))
    whole = np.packbits(bits, axis=1).view(f'>u{width // 8}')[:, 0]
    return whole.astype(np.uint64)


def _below_the_top(count: NDArray[Any], width: int) -> NDArray[np.bool_]:
    """Mask the bits (n, width) below the top one of numbers of so many bits (n,)."""
    mask: NDArray[np.bool_] = np.arange(width) > width - count[:, None].astype(int)
    return mask & (count[:, None] > 0)


def deflate(data: bytes) -> bytes:
    """Deflate without a header, with or without repetitions, whichever is shorter."""
    packed = []
    for strategy in (zlib.Z_DEFAULT_STRATEGY, zlib.Z_HUFFMAN_ONLY):
        packer = zlib.compressobj(9, zlib.DEFLATED, -15, 9, strategy)
        packed.append(packer.compress(data) + packer.flush())
    return min(packed, key=len)


def inflate(data: bytes, size: int) -> tuple[NDArray[np.uint8], bytes]:
    """Inflate exactly so many bytes; return them and what follows. ValueError if damaged."""
    unpacker = zlib.decompressobj(wbits=-15)
    try:
        symbols = unpacker.decompress(data, size + 1)
    except zlib.error as error:
        raise ValueError(f'cannot be decompressed ({error})') from error
    if len(symbols) != size or not unpacker.eof:
        raise ValueError('does not fit its length')
    return np.frombuffer(symbols, np.uint8), unpacker.unused_data
