# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quick scores of many hypotheses, by which the search ranks them before any is judged."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.rasters import FREE, NEAR
from somfusion_ros.geometry import Array, inverse, place, wrap
from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class ScoringSettings:
    """Numbers that the scores were tuned with."""

    front: float = tuned(
        0.25, 'm', 'of free space that both maps saw lie before a wall that both saw; at least '
        '0.27 in 1693 right poses, less than 0.1 in a third of the wrong ones of true pairs',
        'benchmarks/fusion/calibration.py')
    free_every: int = tuned(4, 'places', 'of the free ones one is looked up', 'by design')


SCORING = ScoringSettings()


def scores(poses: Array, target: LearnedMap, source: LearnedMap, every: int = 1) -> Array:
    """Score (B,) hypotheses (B, 3) by every n-th cluster of both maps."""
    total = np.zeros((2, len(poses)))
    for way, seen, by in ((poses, source, target), (inverse(poses), target, source)):
        clusters = seen.clusters.take(np.arange(0, len(seen.clusters), every))
        total += tally(by.zones.at(place(way, clusters.centres)), clusters)
    matched, against = total * every / 2.0
    return np.asarray(matched / (matched + against + 1.0) * np.sqrt(matched))


def tally(zones: NDArray[np.uint8], clusters: Clusters) -> Array:
    """Return (2, B) [m] of wall in zones (B, K) near a wall, and in free ones away from it."""
    weights = clusters.weights.astype(np.float32)
    alone = (zones & (FREE | NEAR)) == FREE
    return np.stack([((zones & NEAR) == NEAR) @ weights, alone @ weights])


def fine(poses: Array, target: LearnedMap, source: LearnedMap) -> Array:
    """
    Return the wall cells of both maps on the other's likelihood field, for hypotheses (B, 3).

    Returns
    -------
    (2, B) wall that coincides within a cell or two, and wall on what the other saw as free, mean
    of both maps [m]
    """
    total = np.zeros((2, len(poses)))
    for way, seen, by in ((poses, source, target), (inverse(poses), target, source)):
        at = place(way, seen.probes)
        total += tally_cells(by.likelihood.at(at), by.zones.at(at), seen)
    return total / 2.0


def common(poses: Array, target: LearnedMap, source: LearnedMap) -> Array:
    """Return the area (B,) that both maps saw free, about, for hypotheses (B, 3) [m2]."""
    some = source.free[::SCORING.free_every]
    both = np.count_nonzero(target.zones.at(place(poses, some)) & FREE, axis=1)
    return np.asarray(both * (source.free_share * len(source.free) / max(len(some), 1)))


def seen_in_front(free: Array, wall: Array) -> Array:
    """Return how much walls [m] that coincide count, by the common free area [m2], 0..1."""
    return np.asarray(np.minimum(1.0, free / (SCORING.front * (wall + 1.0))))


def tally_cells(likelihood: NDArray[np.uint8], zones: NDArray[np.uint8],
                seen: LearnedMap) -> Array:
    """Return length (2, B) [m] of wall cells (B, P) on a wall, and on what is known to be free."""
    against = np.where(zones & FREE, 255 - likelihood, 0)
    sums = [part.sum(1, dtype=np.int64) for part in (likelihood, against)]
    return np.stack(sums) * (seen.probe_length / 255.0)


def distinct(poses: Array, score: Array, pivot: Array, count: int) -> Array:
    """Return best `count` of hypotheses (B, 3) that differ by 0.5 m at pivot (2,) or 6 degrees."""
    poses = poses[np.argsort(-score, kind='stable')]
    spot = place(poses, pivot[None])[:, :, 0].T
    away = np.hypot(*(spot[:, None] - spot).transpose(2, 0, 1))
    same = (away < 0.5) & (np.abs(wrap(poses[:, None, 2] - poses[:, 2])) < 0.1)
    kept: list[int] = []
    for i, near in enumerate(same):
        if not near[kept].any():
            kept.append(i)
    return poses[kept[:count]]
