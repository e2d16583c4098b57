# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which clusters of two maps stand for the same wall, for many poses at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Clusters, Index
from somfusion_ros.fusion.rasters import Raster
from somfusion_ros.geometry import Array, place


@dataclass(frozen=True, eq=False)
class Matches:
    """
    Source clusters placed by B poses, each with the nearest target cluster.

    at (2, B, K) places [m]; other (B, K) index of the target cluster, with its normal (2, B, K)
    and weight (B, K) [m]; off (B, K) distance to its line [m], positive along its normal; agrees
    (B, K).
    """

    at: NDArray[np.float32]
    other: Index
    normals: NDArray[np.float32]
    weights: NDArray[np.float32]
    off: NDArray[np.float32]
    agrees: NDArray[np.bool_]


def match(poses: Array, source: Clusters, target: Clusters, nearest: Raster, angle: float,
          reach: float) -> Matches:
    """
    Match source clusters, placed by poses (B, 3), with the nearest target clusters.

    Two agree if they lie within `reach` [m] and their normals within `angle` [rad]; normals are
    compared without sign where one of them does not know its free side.
    """
    return match_at(place(poses, source.centres), poses[:, 2], source, target, nearest, angle,
                    reach)


def match_at(at: NDArray[np.float32], turns: Array, source: Clusters, target: Clusters,
             nearest: Raster, angle: float, reach: float) -> Matches:
    """Match source clusters that lie at places (2, B, K) [m], turned by B angles [rad]."""
    other = nearest.at(at).astype(np.intp)
    agrees = other >= 0
    # Index -1, for "none", reads the first cluster: harmless, it does not agree.
    x, y, across, up, weights, signed = np.take(target.table, other, axis=1, mode='clip')
    turn = np.column_stack([np.zeros((len(turns), 2)), turns])
    mine = place(turn, source.normals)
    cosine = mine[0] * across + mine[1] * up
    both = signed * source.table[5] > 0
    agrees &= np.where(both, cosine, np.abs(cosine)) > np.cos(angle)
    x, y = x - at[0], y - at[1]
    agrees &= x * x + y * y < reach ** 2
    return Matches(at, other, np.stack([across, up]), weights, x * across + y * up, agrees)
