# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a scan tells of walls and of free space, for the map."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array

SPACING = 0.04      # [m] of wall between returns that one point stands for
STRAIGHT = 0.1      # [m] by which neighbouring returns on one wall may miss its line
FILLED = 1.0        # [m] widest gap between two returns on one wall that is drawn as wall


@dataclass(frozen=True, eq=False)
class Outline:
    """
    The beams of a scan in the robot's base frame.

    ends (B, 2) [m] of the beams, reach (B,) [m] up to which they saw (0 where they tell nothing),
    the mask hit (B,) of those that returned, and the laser's origin (2,) [m]. Thousands are kept,
    so they are in single precision, and what is drawn of them is worked out whenever it is drawn.
    """

    ends: Array = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    reach: Array = field(default_factory=lambda: np.zeros(0, np.float32))
    hit: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    origin: Array = field(default_factory=lambda: np.zeros(2))

    def surface(self) -> tuple[Array, Array]:
        """
        Return what was hit.

        Every return and the wall between them (K, 2); both ends (2 L, 2) of each piece of surface
        between neighbouring returns.
        """
        return _walls(self.ends[self.hit].astype(float), np.flatnonzero(self.hit),
                      self.reach[self.hit])

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
