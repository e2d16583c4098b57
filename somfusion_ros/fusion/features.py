# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the merge knows of one map: its clusters with norms, and rasters that answer for any point.

Records that the stages fill and read; no stage of its own.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, inverse, Pose

Index = NDArray[np.intp]
SURE = 0.3      # sidedness from which the sign of a norm counts
WIDEST = 32767  # OpenCV looks up fewer places in a row, in rasters with fewer cells in a row


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

    @cached_property
    def table(self) -> NDArray[np.float32]:
        """Centres, norms, weights and whether the norm's sign is sure, (6, K): one look-up."""
        return np.stack([*self.centres.T, *self.norms.T, self.weights,
                         self.sided > SURE]).astype(np.float32)

    def take(self, chosen: Index) -> 'Clusters':
        """Return the chosen clusters, without edges."""
        parts = (self.norms, self.straight, self.sided)
        return Clusters(self.centres[chosen], self.weights[chosen], self.segments[chosen],
                        np.empty((0, 2), np.intp), *(part[chosen] for part in parts))


@dataclass(frozen=True, eq=False)
class Raster:
    """
    Values (H, W) on cells of `resolution` [m] with the corner at T_frame_raster.

    Every point beyond has the value `outside`.
    """

    values: NDArray
    resolution: float
    T_frame_raster: Pose
    outside: float

    def at(self, points: NDArray[np.float32]) -> NDArray:
        """Values (...) at points (2, ...) [m] of the map frame."""
        c, s, across, up = self._to_cells
        x, y = points
        column, row = (x * c, y * c) if s == 0.0 else (x * c - y * s, x * s + y * c)
        column, row = column + across, row + up
        if column.size and max(self.values.shape + column.shape) < WIDEST:
            found = cv2.remap(self.values, column, row, cv2.INTER_NEAREST,
                              borderMode=cv2.BORDER_CONSTANT, borderValue=self.outside)
            return found.reshape(column.shape)
        height, width = self.values.shape
        column, row = np.rint(column).astype(np.intp), np.rint(row).astype(np.intp)
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        found = self.values.ravel()[np.where(inside, row * width + column, 0)]
        return np.where(inside, found, self.values.dtype.type(self.outside))

    @cached_property
    def _to_cells(self) -> NDArray[np.float32]:
        """Cosine, sine and shift that take map points to cells, whose centres are whole."""
        x, y, theta = inverse(self.T_frame_raster)
        scaled = np.array([np.cos(theta), np.sin(theta), x, y]) / self.resolution
        return (scaled - [0.0, 0.0, 0.5, 0.5]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Warp:
    """Displacements (rows, columns, 2) [m] on a lattice with its first node at `corner` [m]."""

    displacements: NDArray[np.float32]
    corner: Array
    spacing: float

    def at(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Displacement (2, ...) [m] at points (2, ...) [m] of the target's frame."""
        flat = points.reshape(2, -1)
        index, share = lattice_shares(flat, self.corner, self.spacing,
                                      self.displacements.shape[:2])
        moves = [(np.take(axis, index) * share).sum(0)
                 for axis in np.moveaxis(self.displacements, -1, 0).reshape(2, -1)]
        return np.stack(moves).reshape(points.shape)


def lattice_shares(points: Array, corner: Array, spacing: float,
                   shape: tuple[int, int]) -> tuple[Index, NDArray[np.float32]]:
    """Nodes (4, N) around points (2, N), clipped to the lattice, and their shares (4, N)."""
    rows, columns = shape
    x, y = ((points - np.asarray(corner, points.dtype)[:, None]) / spacing).astype(np.float32)
    x, y = np.clip(x, 0.0, columns - 1.001), np.clip(y, 0.0, rows - 1.001)
    column, row = x.astype(np.intp), y.astype(np.intp)
    x, y = x - column.astype(np.float32), y - row.astype(np.float32)
    first = row * columns + column
    index = np.stack([first, first + 1, first + columns, first + columns + 1])
    return index, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])


@dataclass(frozen=True, eq=False)
class Map:
    """
    One learned map.

    cells (N, 2) occupied cells' centres [m] with segment (N,) and winner (N,) each; clusters;
    surfaces: norms (E, 2) of the clusters' edges with length (E,) [m] and sidedness (E,);
    features: the clusters that have a norm; sketch: the few hundred best of them; zones: whether
    a place is wall, near one, known to be free (field.zones); nearest: index of the nearest
    feature, -1 for none; likelihood: field of the walls, 0..255; probes (P, 2): an even sample
    of the wall cells [m], each for `probe_length` of wall [m]; free (F, 2): an even sample of
    free places [m]; histogram (360,) of
    norms; spectrum: Radon sharpness of half a turn; resolution of the grid [m].
    """

    cells: Array
    segments: Index
    winners: Index
    clusters: Clusters
    surfaces: tuple[Array, Array, Array]
    features: Clusters
    sketch: Clusters
    zones: Raster
    nearest: Raster
    likelihood: Raster
    probes: Array
    probe_length: float
    free: Array
    histogram: Array
    spectrum: Array
    resolution: float

    @property
    def pivot(self) -> Array:
        """Middle (2,) of the features [m], where poses are compared."""
        return self.features.centres.mean(0)


def place(poses: Array, points: Array) -> NDArray[np.float32]:
    """Take points (K, 2) of the source into the target by each of poses (B, 3): (2, B, K)."""
    x, y, theta = np.asarray(poses, dtype=float).T
    c, s = np.cos(theta), np.sin(theta)
    # One matrix product: several times faster than sums and products one by one.
    matrix = np.array([[c, -s, x], [s, c, y]], np.float32).transpose(0, 2, 1).reshape(-1, 3)
    flat = np.concatenate([points.T, np.ones((1, len(points)))], dtype=np.float32)
    return (matrix @ flat).reshape(2, len(c), len(points))


@dataclass(frozen=True, eq=False)
class Matches:
    """
    Source clusters placed by B poses, each with the nearest target cluster.

    at (2, B, K) places [m]; other (B, K) index of the target cluster, with its norm (2, B, K) and
    weight (B, K) [m]; off (B, K) distance to its line [m], positive along its norm; agrees (B, K).
    """

    at: NDArray[np.float32]
    other: Index
    norms: NDArray[np.float32]
    weights: NDArray[np.float32]
    off: NDArray[np.float32]
    agrees: NDArray[np.bool_]


def match(poses: Array, source: Clusters, target: Clusters, nearest: Raster, angle: float,
          reach: float) -> Matches:
    """
    Match source clusters, placed by poses (B, 3), with the nearest target clusters.

    Two agree if they lie within `reach` [m] and their norms within `angle` [rad]; norms are
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
    mine = place(turn, source.norms)
    cosine = mine[0] * across + mine[1] * up
    both = signed * source.table[5] > 0
    agrees &= np.where(both, cosine, np.abs(cosine)) > np.cos(angle)
    x, y = x - at[0], y - at[1]
    agrees &= x * x + y * y < reach ** 2
    return Matches(at, other, np.stack([across, up]), weights, x * across + y * up, agrees)
