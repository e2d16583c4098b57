# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a scan saw, as straight lines from corner to corner: a wall of 100 beams is two corners.

A line ends where it would miss a return by more than a tolerance across it, so that what is left
out is the scatter of the laser (the swing filter of Elmeleegy et al., VLDB 2009, in 1 / range,
which is linear along a line). Ends of lines are whole steps of range.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.team.bit_code import zagzig


@dataclass(frozen=True)
class OutlineTuning:
    """How closely lines follow what a scan saw."""

    step: float = tuned(0.02, 'm', 'of the range of a corner; 0.03 costs a 20th less',
                        'shared teams')
    across: float = tuned(0.03, 'm', 'from a line that a return may lie: twice the scatter of a '
                          'laser', 'shared teams')
    along: float = tuned(0.1, 'm', 'of range by which a line may miss a return that grazes it',
                         'shared teams')
    widest: float = tuned(1.2, 'rad', 'of beams along one line', 'by design')


TUNING = OutlineTuning()
MOST = 10_000                # steps of the longest range: 200 m
HIT, OPEN, DARK = range(3)   # returns; free as far as is told; tells nothing
AHEAD = 64                   # beams that are looked at first for the end of a line


class Corners(NamedTuple):
    """
    Corners of what a scan saw.

    gaps (n,) beams from the corner before; 0 begins another piece, of another kind or not, with
    the next beam. values (n,): changes of the range in steps, signed (zigzag); where a piece
    begins, three times the change since the last of its kind, and the kind.
    """

    gaps: NDArray[np.uint16]
    values: NDArray[np.uint16]


def corners_of(outline: Outline, angle_step: float) -> Corners:
    """Find the corners of what a scan saw, its beams an angle [rad] apart."""
    kinds = np.where(outline.hit, HIT, np.where(outline.reach > 0.0, OPEN, DARK))
    codes = np.clip(np.rint(outline.reach / TUNING.step), 1, MOST).astype(int)
    kinds[(kinds == HIT) & (outline.reach > MOST * TUNING.step)] = OPEN
    level = np.where(kinds == OPEN, codes, 0)       # a piece without returns has one range
    cuts = np.flatnonzero((np.diff(kinds) != 0) | (np.diff(level) != 0)) + 1
    gaps: list[int] = []
    values: list[int] = []
    last = [0, 0, 0]
    for a, b in zip([0, *cuts], [*cuts, len(kinds)], strict=True):
        kind = int(kinds[a]) if b > a else DARK
        if kind == HIT:
            at, told = _lines(outline.reach[a:b], abs(angle_step))
        else:
            at = [0, b - a - 1][:b - a]
            told = [int(level[a])] * len(at) if b > a else []
        for k, (beam, code) in enumerate(zip(at, told, strict=True)):
            change = code - last[kind]
            signed = 2 * change if change >= 0 else -2 * change - 1
            gaps.append(beam - at[k - 1] if k else 0)
            values.append(signed if k else 3 * signed + kind)
            last[kind] = code
    return Corners(np.array(gaps, np.uint16), np.array(values, np.uint16))


def _lines(reach: Array, angle_step: float) -> tuple[list[int], list[int]]:
    """Follow returns (n,) by lines; return at which beams they end, and their ranges in steps."""
    at, told = [0], [max(1, round(float(reach[0]) / TUNING.step))]
    while at[-1] < len(reach) - 1:
        k = at[-1]
        size, found = AHEAD, 0
        while True:
            end = min(len(reach), k + 1 + size)
            found, r = _line(told[-1] * TUNING.step, reach[k + 1:end], angle_step)
            if found < end - k - 1 or end == len(reach):
                break
            size *= 4
        at.append(k + found)
        told.append(max(1, round(r / TUNING.step)))
    return at, told


def _line(start: float, reach: Array, angle_step: float) -> tuple[int, float]:
    """
    Draw one line from a range [m] on, along the returns (n,) that follow.

    Returns how many it serves, at least one, and the range [m] at which it ends.
    """
    phi = angle_step * np.arange(1, len(reach) + 1)
    phi = phi[:max(1, int(np.searchsorted(phi, TUNING.widest)))]
    r, c, s = reach[:len(phi)], np.cos(phi), np.sin(phi)
    # A line through (start, 0) has 1 / r = cos(phi) / start + slope sin(phi).
    x, y = r * c - start, r * s
    grazing = np.abs(x * s - y * c) / np.maximum(np.hypot(x, y), 1e-6)
    slack = np.minimum(TUNING.across / np.maximum(grazing, 1e-3), TUNING.along)
    sine = np.maximum(s, 1e-9)
    least = np.maximum.accumulate((1.0 / (r + slack) - c / start) / sine)
    most = np.minimum.accumulate((1.0 / np.maximum(r - slack, 0.2 * r) - c / start) / sine)
    fits = least <= most
    n = len(fits) if fits.all() else max(1, int(np.argmin(fits)))
    inverse = float(c[n - 1] / start + 0.5 * (least[n - 1] + most[n - 1]) * s[n - 1])
    end, seen = 1.0 / max(inverse, 1e-6), float(r[n - 1])
    return n, end if abs(end - seen) <= slack[n - 1] else seen


def follow(corners: Corners, beams: int, angle_step: float) -> tuple[Array, NDArray[np.bool_]]:
    """
    Return how far each beam saw (beams,) [m] along corners, and whether it returned.

    Raises ValueError where the corners are none of so many beams.
    """
    gaps, values = corners.gaps.astype(np.int64), corners.values.astype(np.int64)
    begins = gaps == 0
    at = np.cumsum(np.where(begins, 1, gaps)) - 1
    if (len(at) and not begins[0]) or (at[-1] + 1 if len(at) else 0) != beams:
        raise ValueError('a view is damaged (its corners do not fit its beams)')
    kinds = (values % 3)[begins][np.cumsum(begins) - 1]
    change = zagzig(np.where(begins, values // 3, values).view(np.uint64))
    codes = np.zeros(len(at))
    for kind in (HIT, OPEN, DARK):
        of_kind = kinds == kind
        codes[of_kind] = np.cumsum(change[of_kind])
    if len(codes) and not (codes.min() >= 0 and codes.max() <= MOST
                           and (gaps * abs(angle_step))[kinds == HIT].max(initial=0.0) < 1.5):
        raise ValueError('a view is damaged (its corners lie nowhere)')
    return _between(at, TUNING.step * codes, kinds, beams, abs(angle_step))


def _between(at: NDArray[np.int64], ranges: Array, kinds: NDArray[np.int64], beams: int,
             angle_step: float) -> tuple[Array, NDArray[np.bool_]]:
    """Fill in the beams between corners at some beams (n,), of ranges (n,) [m] and kinds."""
    beam = np.arange(beams)
    after = np.searchsorted(at, beam)      # the corner at or after every beam
    before = np.where(at[after] == beam, after, after - 1) if beams else after
    ra, rb = ranges[before], ranges[after]
    a, b = angle_step * (beam - at[before]), angle_step * (at[after] - beam)
    across = ra * np.sin(a) + rb * np.sin(b)
    reach = np.where(across > 1e-12, ra * rb * np.sin(a + b) / np.maximum(across, 1e-12), ra)
    hit = kinds[after] == HIT if beams else np.zeros(0, bool)
    return np.where(hit, reach, ra), hit & (reach > 0.0)
