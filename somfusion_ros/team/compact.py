# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whole numbers, poses and covariances in few bytes.

Poses are rounded to steps far below what any match knows. Of a covariance
its Cholesky factor is told, to a few percent.
"""

from collections.abc import Iterable, Sequence
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
MOST = 1 << 51     # of a number that is told in steps
OCTAVE = 16       # steps of a sigma that is twice as large, always upwards
MOST_OCTAVES = 48
PART = 1 / 8      # of the diagonal of a row: step of what lies beside it
MOST_BESIDE = 2 ** 24
BESIDE = ((1, 0), (2, 0), (2, 1))


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


def in_steps(values: Array, step: Array) -> list[int]:
    """Return numbers (n,) as whole steps (n,); what no number can hold, as the most that can."""
    counts: list[int] = np.rint(np.clip(np.asarray(values) / step, -MOST, MOST)).astype(
        np.int64).tolist()
    return counts


def from_steps(counts: Sequence[int], step: Array) -> Array:
    """Return the numbers (n,) that whole steps (n,) stand for."""
    return np.array(counts, float) * step


def covariance_numbers(R: Array) -> list[int]:
    """
    Return six whole numbers for a covariance (3, 3), of its Cholesky factor.

    What lies beside the diagonal is told in parts of the diagonal of its row, so that a direction
    that is known far better than another stays so.
    """
    sigma = np.sqrt(np.diag(R))
    values, vectors = np.linalg.eigh(R / np.outer(sigma, sigma))
    even = (vectors * np.maximum(values, 1e-9)) @ vectors.T
    C = np.linalg.cholesky(even * np.outer(sigma, sigma))
    octaves = np.log2(np.maximum(np.diag(C), TUNING.least) / TUNING.least)
    sizes = np.clip(np.ceil(octaves * OCTAVE - 1e-6), 0, MOST_OCTAVES * OCTAVE)
    row = _sizes(sizes)
    C *= row / np.diag(C)      # a slope stays what it is where its column is rounded up
    beside = [C[i, j] / (PART * row[i]) for i, j in BESIDE]
    return [*sizes.astype(int).tolist(), *np.rint(np.clip(beside, -MOST_BESIDE, MOST_BESIDE)
                                                  ).astype(int).tolist()]


def covariance_from(numbers: Sequence[int]) -> Array:
    """Return the covariance (3, 3) of six whole numbers; ValueError where they are none."""
    if not (0 <= min(numbers[:3]) <= max(numbers[:3]) <= MOST_OCTAVES * OCTAVE
            and max(map(abs, numbers[3:])) <= MOST_BESIDE):
        raise ValueError('a covariance is absurd')
    row = _sizes(np.array(numbers[:3]))
    C = np.diag(row)
    for (i, j), part in zip(BESIDE, numbers[3:], strict=True):
        C[i, j] = part * PART * row[i]
    R: Array = C @ C.T
    return R


def _sizes(steps: Array) -> Array:
    """Return the sigmas (n,) that whole steps (n,) stand for."""
    sigma: Array = TUNING.least * 2.0 ** (steps / OCTAVE)
    return sigma
