# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the merge knows of one map: its clusters with norms, and rasters that answer for any point.

Records that the stages fill and read; no stage of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from somfusion_ros.geometry import Array, Pose, apply, inverse, rotation

Index = NDArray[np.intp]
SURE = 0.3      # sidedness from which the sign of a norm counts


@dataclass(frozen=True, eq=False)
class Clusters:
    """
    K neurons of a map, in its frame, with the chain that joins them.

    centres (K, 2) [m]; weights (K,) length of wall that each stands for [m]; segments (K,) the
    segment of each; edges (E, 2) pairs of adjacent neurons; norms (K, 2) unit point norms towards
    free space, zero where unknown; straight (K,) 0..1, how well the surfaces around agree; sided
    (K,) 0..1, how sure the sign of the norm is.
    """

    centres: Array
    weights: Array
    segments: Index
    edges: Index
    norms: Array
    straight: Array
    sided: Array

    def __len__(self) -> int:
        """Count the neurons."""
        return len(self.centres)

    def take(self, chosen: Index) -> 'Clusters':
        """Return the chosen clusters, without edges."""
        parts = (self.norms, self.straight, self.sided)
        return Clusters(self.centres[chosen], self.weights[chosen], self.segments[chosen],
                        np.empty((0, 2), np.intp), *(part[chosen] for part in parts))


@dataclass(frozen=True, eq=False)
class Raster:
    """Values (H, W) on cells of `resolution` [m] with the corner at T_frame_raster."""

    values: NDArray
    resolution: float
    T_frame_raster: Pose
    outside: float

    def at(self, points: Array) -> NDArray:
        """Values (...) at points (..., 2) [m] of the map frame."""
        shape = points.shape[:-1]
        local = apply(inverse(self.T_frame_raster), points.reshape(-1, 2)) / self.resolution
        cell = np.floor(local).astype(np.intp)
        height, width = self.values.shape
        inside = ((cell >= 0) & (cell < (width, height))).all(1)
        flat = np.where(inside, cell[:, 1] * width + cell[:, 0], 0)
        return np.where(inside, self.values.ravel()[flat], self.outside).reshape(shape)


@dataclass(frozen=True, eq=False)
class Map:
    """
    One learned map.

    cells (N, 2) occupied cells' centres [m] with segment (N,) and winner (N,) each; clusters;
    surfaces: norms (E, 2) of the clusters' edges with length (E,) [m] and sidedness (E,);
    features: the clusters that have a norm; sketch: the few hundred best of them; clearance:
    distance to the next wall [m], negative where a cell is not known to be free; nearest: index
    of the nearest feature; free (F, 2): an even sample of free places [m]; histogram (360,) of
    norms; spectrum: Radon sharpness of half a turn; resolution of the grid [m].
    """

    cells: Array
    segments: Index
    winners: Index
    clusters: Clusters
    surfaces: tuple[Array, Array, Array]
    features: Clusters
    sketch: Clusters
    clearance: Raster
    nearest: Raster
    free: Array
    histogram: Array
    spectrum: Array
    resolution: float

    @property
    def pivot(self) -> Array:
        """Middle (2,) of the features [m], where poses are compared."""
        return self.features.centres.mean(0)


def place(poses: Array, points: Array) -> Array:
    """Take points (K, 2) of the source into the target by each of poses (B, 3): (B, K, 2)."""
    return points @ np.swapaxes(rotation(poses[:, 2]), 1, 2) + poses[:, None, :2]


def match(poses: Array, source: Clusters, target: Clusters, nearest: Raster, angle: float,
          reach: float) -> tuple[Array, Array, Array]:
    """
    Match source clusters, placed by poses (B, 3), with the nearest target clusters.

    Two match if they lie within `reach` [m] and their norms within `angle` [rad]; norms are
    compared without sign where one of them does not know its free side.

    Returns
    -------
    places (B, K, 2) [m] of the source clusters in the target, index (B, K) of the nearest target
    cluster, and whether (B, K) they match
    """
    at = place(poses, source.centres)
    other = nearest.at(at)
    agrees = other >= 0
    other = np.where(agrees, other, 0)
    turned = source.norms @ np.swapaxes(rotation(poses[:, 2]), 1, 2)
    cosine = (turned * target.norms[other]).sum(-1)
    sure = np.minimum(source.sided[None], target.sided[other]) > SURE
    agrees &= np.where(sure, cosine, np.abs(cosine)) > np.cos(angle)
    agrees &= ((at - target.centres[other]) ** 2).sum(-1) < reach ** 2
    return at, other, agrees
