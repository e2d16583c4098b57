# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whole numbers, poses and covariances in few bytes.

A number takes one byte for every seven bits that it has, so that small ones are short. Poses are
rounded to steps far below what any match knows. Of a covariance the logarithms of the sigmas and
the correlations are told, in 16 bits each.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class Rounding:
    """How finely poses and covariances are told."""

    pose: tuple[float, float, float] = tuned(
        (1e-4, 1e-4, 2e-5), 'm, m, rad', 'steps of a pose: a hundredth of what a match knows',
        'by design')
    least: float = tuned(2.0 ** -16, 'm or rad', 'sigma that can be told', 'by design')


TUNING = Rounding()
STEP = np.array(TUNING.pose)
LONGEST = 9       # bytes of a number
OCTAVE = 2048     # steps of a sigma that is twice as large
FULL = 32767      # of a correlation of 1
PAIRS = ((0, 1), (0, 2), (1, 2))


def pack(numbers: Iterable[int]) -> bytes:
    """Pack whole numbers, also negative ones (zigzag, LEB128)."""
    packed = bytearray()
    for number in numbers:
        left = 2 * number if number >= 0 else -2 * number - 1
        while left >= 0x80:
            packed.append(left & 0x7F | 0x80)
            left >>= 7
        packed.append(left)
    return bytes(packed)


def unpack(data: bytes, count: int) -> tuple[list[int], bytes]:
    """Unpack so many whole numbers; return them and what follows. ValueError if cut short."""
    numbers, at = [], 0
    for _ in range(count):
        value = shift = 0
        while True:
            if at >= len(data) or shift >= 7 * LONGEST:
                raise ValueError('a number is cut short')
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
        numbers.append(value >> 1 if not value & 1 else -(value >> 1) - 1)
    return numbers, data[at:]


def pack_scaled(values: Array, step: Array) -> bytes:
    """Pack numbers (n,) in steps (n,)."""
    return pack(np.rint(np.asarray(values) / step).astype(np.int64).tolist())


def unpack_scaled(data: bytes, step: Array) -> tuple[Array, bytes]:
    """Unpack numbers (n,) in steps (n,); return them and what follows."""
    numbers, rest = unpack(data, len(step))
    return np.array(numbers, float) * step, rest


def pack_covariance(R: Array) -> bytes:
    """Pack a covariance (3, 3): 12 bytes."""
    sigma = np.sqrt(np.diag(R))
    octaves = np.log2(np.maximum(sigma, TUNING.least) / TUNING.least)
    sizes = np.clip(np.ceil(octaves * OCTAVE - 1e-6), 0, 65535).astype('<u2')
    correlations = [R[i, j] / max(sigma[i] * sigma[j], 1e-300) for i, j in PAIRS]
    parts = np.rint(np.clip(correlations, -1.0, 1.0) * FULL).astype('<i2')
    return bytes(sizes.tobytes() + parts.tobytes())


def unpack_covariance(data: bytes) -> tuple[Array, bytes]:
    """Unpack a covariance (3, 3), positive or not; return it and what follows."""
    if len(data) < 12:
        raise ValueError('a covariance is cut short')
    sigma = TUNING.least * 2.0 ** (np.frombuffer(data, '<u2', 3) / OCTAVE)
    R = np.diag(sigma ** 2)
    for (i, j), part in zip(PAIRS, np.frombuffer(data, '<i2', 3, 6).tolist(), strict=True):
        R[i, j] = R[j, i] = part / FULL * sigma[i] * sigma[j]
    return R, data[12:]
