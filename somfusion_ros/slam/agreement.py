# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whether what a scan shows agrees with what others saw at the same place.

What stands in space that others saw to be free may have come there: people, doors, furniture.
A wall that a scan looks through speaks against its place whoever stands around.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import apply, Array, inverse
from somfusion_ros.settings import tuned
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class AgreementTuning:
    """Which points agree with a surface."""

    on_surface: float = tuned(
        0.12, 'm', 'a point this near lies on the old surface', 'not measured')
    conflict: float = tuned(
        0.2, 'm', 'a point this far lies off it', 'not measured')
    square: float = tuned(
        0.15, 'm', 'edge of a square of an old surface that counts once', 'not measured')
    lasts: int = tuned(
        3, 'views', 'that have seen what does not move; fewer take people for walls',
        'test/unit/test_relocation.py')
    points: int = tuned(
        30, 'points', 'that are judged, at least', 'not measured')
    denied: float = tuned(
        0.5, 'share of points', 'judged, below which a scan denies what others saw', 'shared logs')


TUNING = AgreementTuning()


def judge(T_map_scan: Array, cloud: Cloud, target: LocalMap) -> tuple[int, int]:
    """Count the points of a cloud at a pose (3,) on the old surface, and in free space off it."""
    return _count(apply(T_map_scan, cloud.points), target)


def judge_back(T_map_scan: Array, cloud: Cloud, points: Array) -> tuple[int, int]:
    """Count points (N, 2) of a surface that a scan at a pose (3,) shows, and looks through."""
    hits = cloud.outline.hits
    if not len(hits):
        return 0, 0
    seen = LocalMap(hits, np.zeros_like(hits), (cloud.outline.rim,))
    return _count(apply(inverse(T_map_scan), points), seen)


def lasting(surfaces: Sequence[Array]) -> Array:
    """
    Return the middles (N, 2) of the squares in which at least three surfaces (M, 2) have a point.

    What moves is not there for long; with fewer surfaces, whatever they show counts.
    """
    squares = [np.unique(np.floor(surface / TUNING.square), axis=0) for surface in surfaces]
    if not squares:
        return np.zeros((0, 2))
    found, times = np.unique(np.concatenate(squares), axis=0, return_counts=True)
    middles: Array = (found[times >= min(TUNING.lasts, len(squares))] + 0.5) * TUNING.square
    return middles


def denies(T_map_scan: Array, cloud: Cloud, target: LocalMap) -> bool | None:
    """Return whether a cloud at a pose (3,) denies a surface; None where little says so or not."""
    return _denies(*judge(T_map_scan, cloud, target))


def looks_through(T_map_scan: Array, cloud: Cloud, target: LocalMap) -> bool | None:
    """Return whether a cloud at a pose (3,) looks through most of a surface, as `denies`."""
    return _denies(*judge_back(T_map_scan, cloud, lasting([target.points])))


def _count(points: Array, target: LocalMap) -> tuple[int, int]:
    distance, _ = target.tree.query(points, distance_upper_bound=TUNING.conflict)
    far = ~np.isfinite(distance)
    return (int((distance < TUNING.on_surface).sum()),
            int((far & target.seen_through(points)).sum()))


def _denies(on: int, against: int) -> bool | None:
    if on + against < TUNING.points:
        return None
    return on < TUNING.denied * (on + against)
