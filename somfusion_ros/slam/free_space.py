# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a scan tells of walls and of free space, for the map."""

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array

SPACING = 0.04      # [m] of wall between returns that one point stands for
STRAIGHT = 0.1      # [m] by which neighbouring returns on one wall may miss its line
NO_BEAMS = np.zeros((0, 2), np.float32)
BITS = 15           # of the whole numbers that beams are kept in, beside their sign
MOST = (1 << BITS) - 1
FILLED = 1.0        # [m] widest gap between two returns on one wall that is drawn as wall


class Outline:
    """
    The beams of a scan in the robot's base frame.

    ends (B, 2) [m] of the beams, reach (B,) [m] up to which they saw (0 where they tell nothing),
    the mask hit (B,) of those that returned, and the laser's origin (2,) [m]. Thousands are kept,
    so they are whole numbers of a step that is a power of two: 0.5 mm where all lies within 16 m,
    1 mm within 32 m, 4 mm within 128 m. What is drawn of them is worked out whenever it is drawn.
    """

    __slots__ = ('_beams', '_step', '_origin', '__weakref__')

    def __init__(self, ends: Array = NO_BEAMS, reach: Array = NO_BEAMS[:, 0],
                 hit: NDArray[np.bool_] = NO_BEAMS[:, 0] > 0.0, origin: Array = np.zeros(2)
                 ) -> None:
        farthest = max(1.0, np.abs(ends).max(initial=0.0), np.max(reach, initial=0.0))
        self._step = 2.0 ** (int(np.frexp(farthest)[1]) - BITS)
        numbers = np.rint(np.column_stack([ends, reach]) * (1.0 / self._step))
        beams = np.clip(numbers, -MOST, MOST).astype(np.int16)
        beams[:, 2] = np.maximum(beams[:, 2], np.asarray(reach) > 0.0)
        beams[hit, 2] = ~beams[hit, 2]      # negative where it returned
        self._beams = beams
        self._origin = float(origin[0]), float(origin[1])

    @property
    def ends(self) -> Array:
        """Ends (B, 2) [m] of the beams, in single precision."""
        return self._beams[:, :2] * np.float32(self._step)

    @property
    def reach(self) -> Array:
        """Up to where (B,) [m] the beams saw, in single precision; 0 where they tell nothing."""
        reach = self._beams[:, 2]
        return np.where(reach < 0, ~reach, reach) * np.float32(self._step)

    @property
    def hit(self) -> NDArray[np.bool_]:
        """Mask (B,) of the beams that returned."""
        hit: NDArray[np.bool_] = self._beams[:, 2] < 0
        return hit

    @property
    def origin(self) -> Array:
        """Where the laser was (2,) [m]."""
        return np.array(self._origin)

    def surface(self) -> tuple[Array, Array]:
        """
        Return what was hit.

        Every return and the wall between them (K, 2); both ends (2 L, 2) of each piece of surface
        between neighbouring returns.
        """
        hit = self.hit
        return _walls(self.ends[hit].astype(float), np.flatnonzero(hit), self.reach[hit])

    @property
    def hits(self) -> Array:
        """Every return and the wall between them (K, 2)."""
        return self.surface()[0]

    @property
    def rim(self) -> Array:
        """Polygon (M, 2) of the space that the beams passed, closed through the origin."""
        return _rim(self.ends, self.reach, self.origin)


def _walls(hits: Array, beams: NDArray[np.intp], ranges: Array) -> tuple[Array, Array]:
    """
    Fill the wall between returns (N, 2) that a grazing beam leaves bare; see `Outline`.

    Two neighbouring returns lie on one surface where their ranges differ little, and on one wall
    where a third continues their line: far down a corridor they may be metres apart.
    """
    if len(hits) < 2:
        return hits, np.zeros((0, 2))
    step = np.diff(hits, axis=0)
    gap = np.maximum(np.hypot(*step.T), 1e-9)
    u = step / gap[:, None]
    short, wide = np.minimum(gap[1:], gap[:-1]), np.maximum(gap[1:], gap[:-1])
    bend = np.abs(u[1:, 0] * u[:-1, 1] - u[1:, 1] * u[:-1, 0])
    line = ((bend * short < STRAIGHT) & ((u[1:] * u[:-1]).sum(1) > 0.7)
            & (wide < 3.0 * short + 2.0 * STRAIGHT))
    wall = np.zeros(len(gap), bool)
    wall[1:] |= line
    wall[:-1] |= line
    neighbours = np.diff(beams) <= 2
    wall &= neighbours
    one = wall | neighbours & ~_jumps(ranges[:-1], ranges[1:])
    bare = np.where(wall & (gap < FILLED), gap // SPACING, 0.0).astype(np.intp)
    piece = np.repeat(np.arange(len(gap)), bare)
    part = 1.0 + np.arange(len(piece)) - (np.cumsum(bare) - bare)[piece]
    between = hits[piece] + (part / (bare[piece] + 1.0))[:, None] * step[piece]
    ends = np.stack([hits[:-1], hits[1:]], axis=1)[one].reshape(-1, 2)
    return np.concatenate([hits, between]), ends


def _jumps(one: Array, other: Array) -> NDArray[np.bool_]:
    """Tell where the ranges of two neighbouring beams differ as on two surfaces."""
    return np.maximum(one, other) > 1.2 * np.minimum(one, other) + 0.1


def _rim(placed: Array, reach: Array, origin: Array) -> Array:
    """
    Return the outline (M, 2) of the space the beams passed.

    Between two beams on one surface the outline is the surface; where the range jumps, the
    nearer range holds up to the middle, so that no beam frees what it did not pass.
    """
    near, jump = np.minimum(reach[:-1], reach[1:]), _jumps(reach[:-1], reach[1:])
    half = 0.5 * (placed[:-1] + placed[1:]) - origin
    length = np.maximum(np.hypot(half[:, 0], half[:, 1]), 1e-9)
    corner = origin + half * (near / length)[:, None]
    rim = np.empty((1 + len(placed) + np.count_nonzero(jump), 2))
    index = np.arange(1, len(placed) + 1)
    index[1:] += jump.cumsum()
    rim[0], rim[index], rim[index[:-1][jump] + 1] = origin, placed, corner[jump]
    return rim
