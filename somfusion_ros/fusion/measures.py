# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Is a hypothesis right? (section III-C, equations (10)-(12), and a calibrated verdict).

V of (12) cannot tell right from wrong where the overlap is small, so several measures decide
together: how much wall is matched, how much wall should be seen and is not, how well the
direction with the least evidence is fixed (two parallel walls fit into every corridor of that
width), how much of the smaller map lies on the other one, and the best rival.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.cluster_matching import match_at
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.rasters import FREE, NEAR, TOLERANCE, WALL
from somfusion_ros.fusion.warp import Warp
from somfusion_ros.geometry import Array, inverse, place, rotation, wrap

ANGLE = np.radians(25.0)
PLACE = 0.8            # evidence that one place can give at most [m]


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """
    Measures of one hypothesis.

    matched, against: wall of the clusters that coincides, and that the other map saw as free,
    mean of both maps [m]; fine, fine_against: the same of the cells, on the likelihood field;
    overlap: share of the smaller map's free area that the other map knows; weak, weak_against:
    wall of distinct places that speaks for and against along the direction with the least
    evidence [m], which `axis` (2,) is, in the target's frame; V of (12) [0..1].
    """

    matched: float
    against: float
    fine: float
    fine_against: float
    overlap: float
    weak: float
    weak_against: float
    V: float
    axis: Array

    @property
    def ratio(self) -> float:
        """Share of the wall that coincides, of the clusters."""
        return self.matched / (self.matched + self.against + 1.0)

    @property
    def fine_ratio(self) -> float:
        """Share of the wall that coincides, of the cells."""
        return self.fine / (self.fine + self.fine_against + 1.0)

    @property
    def weak_ratio(self) -> float:
        """Share of the evidence along the weakest direction that speaks for it."""
        return self.weak / (self.weak + self.weak_against + 0.5)

    @property
    def weak_score(self) -> float:
        """Ratio times the root of the length, along the direction with the least evidence."""
        return self.weak_ratio * np.sqrt(self.weak)

    @property
    def score(self) -> float:
        """
        Rank of a hypothesis: the square of the matched ratio, times the root of the length.

        Of the cells: the clusters of two corridors of equal width coincide, their doors do not.
        """
        return self.fine_ratio ** 2 * np.sqrt(self.fine)


def scores(poses: Array, target: LearnedMap, source: LearnedMap, every: int = 1) -> Array:
    """Score (B,) of hypotheses (B, 3) as `Evidence.score`, from every n-th cluster of both."""
    total = np.zeros((2, len(poses)))
    for way, seen, by in ((poses, source, target), (inverse(poses), target, source)):
        clusters = seen.clusters.take(np.s_[::every])
        total += tally(by.zones.at(place(way, clusters.centres)), clusters)
    matched, against = total * every / 2.0
    return matched / (matched + against + 1.0) * np.sqrt(matched)


def tally(zones: NDArray[np.uint8], clusters: Clusters) -> Array:
    """Length (2, B) [m] of wall in zones (B, K) near a wall, and in free ones away from walls."""
    weights = clusters.weights.astype(np.float32)
    return np.stack([((zones & NEAR) == NEAR) @ weights, (zones == FREE) @ weights])


def fine(poses: Array, target: LearnedMap, source: LearnedMap) -> Array:
    """
    Wall cells of both maps on the other's likelihood field, for hypotheses (B, 3).

    Returns
    -------
    (2, B) wall that coincides within a cell or two, and wall on what the other saw as free, mean
    of both maps [m]
    """
    total = np.zeros((2, len(poses)))
    for way, seen, by in ((poses, source, target), (inverse(poses), target, source)):
        at = place(way, seen.probes)
        total += _tally_cells(by.likelihood.at(at), by.zones.at(at), seen)
    return total / 2.0


def _tally_cells(likelihood: NDArray[np.uint8], zones: NDArray[np.uint8],
                 seen: LearnedMap) -> Array:
    """Length (2, B) [m] of wall cells (B, P) on a wall, and on what is known to be free."""
    against = np.where(zones & FREE, 255 - likelihood, 0)
    sums = [part.sum(1, dtype=np.int64) for part in (likelihood, against)]
    return np.stack(sums) * (seen.probe_length / 255.0)


def distinct(poses: Array, score: Array, pivot: Array, count: int) -> Array:
    """Best `count` of hypotheses (B, 3) that differ by 0.5 m at pivot (2,) or 6 degrees."""
    poses = poses[np.argsort(-score, kind='stable')]
    spot = place(poses, pivot[None])[:, :, 0].T
    away = np.hypot(*(spot[:, None] - spot).transpose(2, 0, 1))
    same = (away < 0.5) & (np.abs(wrap(poses[:, None, 2] - poses[:, 2])) < 0.1)
    kept: list[int] = []
    for i, near in enumerate(same):
        if not near[kept].any():
            kept.append(i)
    return poses[kept[:count]]


def measure(poses: Array, target: LearnedMap, source: LearnedMap,
            warp: Warp | None = None) -> list[Evidence]:
    """Take all measures of hypotheses (B, 3), of the source as it is or bent by a warp."""
    lay = Overlay(np.asarray(poses, dtype=float), warp)
    ways = [_Way(source, target, lay.forth, lay.poses[:, 2]),
            _Way(target, source, lay.back, -lay.poses[:, 2])]
    matched, against = sum(way.lengths() for way in ways) / 2.0
    near, far = sum(way.cells() for way in ways) / 2.0
    R = rotation(lay.poses[:, 2])
    info = ways[0].information(), ways[1].information()
    axis = np.linalg.eigh(R @ info[0] @ np.swapaxes(R, 1, 2) + info[1])[1][:, :, 0]
    held, lost = (ways[0].places(np.einsum('bji,bj->bi', R, axis)) + ways[1].places(axis)) / 2.0
    shares, votes = zip(*(way.free_agreement() for way in ways), strict=True)
    agree, differ = sum(votes)
    found = {'matched': matched, 'against': against, 'fine': near, 'fine_against': far,
             'overlap': np.max(shares, axis=0), 'weak': held, 'weak_against': lost,
             'V': agree / np.maximum(agree + differ, 1.0), 'axis': axis}
    return [Evidence(**dict(zip(found, row, strict=True)))
            for row in zip(*found.values(), strict=True)]


@dataclass(frozen=True, eq=False)
class Overlay:
    """Poses (B, 3) and a warp in the target's frame, applied forth and back."""

    poses: Array
    warp: Warp | None

    def forth(self, points: Array) -> NDArray[np.float32]:
        """Lay source points (K, 2) on the target: (2, B, K)."""
        at = place(self.poses, points)
        return at if self.warp is None else at + self.warp.at(at)

    def back(self, points: Array) -> NDArray[np.float32]:
        """Lay target points (K, 2) on the source: (2, B, K)."""
        if self.warp is not None:
            points = points - self.warp.at(points.T.astype(np.float32)).T
        return place(inverse(self.poses), points)


class _Way:
    """One map laid on the other by B poses: what of it is seen where it should be."""

    def __init__(self, seen: LearnedMap, by: LearnedMap,
                 lay: Callable[[Array], NDArray[np.float32]], turns: Array) -> None:
        """Look up where everything falls, all at once."""
        self.seen = seen
        parts = seen.features.centres, seen.clusters.centres, seen.probes, seen.free
        ends = np.cumsum([len(part) for part in parts])
        at = lay(np.concatenate(parts))
        off, self.clusters, self.probes, self.free = np.split(by.zones.at(at), ends[:-1], axis=1)
        self.likelihood = by.likelihood.at(at[:, :, ends[1]:ends[2]])
        self.weight = seen.features.weights * seen.features.straight
        found = match_at(at[:, :, :ends[0]], turns, seen.features, by.features, by.nearest, ANGLE,
                         0.8)
        self.on = found.agrees & (np.abs(found.off) <= TOLERANCE)
        self.off = off == FREE

    def lengths(self) -> Array:
        """Length (2, B) [m] of wall of the clusters on a wall, and on free space."""
        return tally(self.clusters, self.seen.clusters)

    def cells(self) -> Array:
        """Length (2, B) [m] of wall of the cells on a wall, and on free space."""
        return _tally_cells(self.likelihood, self.probes, self.seen)

    def information(self) -> Array:
        """Sum (B, 2, 2) of w n n' over the matched features, in the frame of this map [m]."""
        normals = self.seen.features.normals
        outer = (normals[:, :, None] * normals[:, None]).reshape(-1, 4) * self.weight[:, None]
        return (self.on @ outer).reshape(-1, 2, 2)

    def places(self, axis: Array) -> Array:
        """
        Evidence (2, B) along axes (B, 2) of this map's frame: matched, and against [m].

        Walls across an axis fix the place along it. What lies within one metre along the axis is
        one place and counts up to `PLACE`: two end walls may meet by chance, many doors do not.
        """
        clusters = self.seen.features
        weight = self.weight * (axis @ clusters.normals.T) ** 2
        bins = np.floor(axis @ clusters.centres.T).astype(np.intp)
        bins -= bins.min(initial=0)
        count = int(bins.max(initial=0)) + 1
        flat = (bins + count * np.arange(len(axis))[:, None]).ravel()
        sums = [np.bincount(flat, (weight * which).ravel(), len(axis) * count)
                for which in (self.on, self.off)]
        return np.minimum(np.reshape(sums, (2, len(axis), count)), PLACE).sum(2)

    def free_agreement(self) -> tuple[Array, Array]:
        """Share (B,) of free places that the other map knows; agreeing and not, (2, B)."""
        wall = np.count_nonzero(self.free & WALL, axis=1)
        free = np.count_nonzero(self.free & FREE, axis=1)
        return (wall + free) / max(self.free.shape[1], 1), np.stack([free, wall]).astype(float)
