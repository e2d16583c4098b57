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
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from somfusion_ros.geometry import apply, Array, inverse
from somfusion_ros.settings import tuned
from somfusion_ros.slam.free_space import Outline
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
    straight: float = tuned(
        0.5, 'm', 'around a square, of which the direction of its surface is told', 'by design')
    flat: float = tuned(
        0.8, '0..1', 'agreement of the directions there, from which it is straight', 'by design')
    grazing: float = tuned(
        0.2, 'rad', 'between a surface and the beams, below which they tell nothing of it: a wall '
        'of 3 m seen along it, and a pose that is 0.1 m and 0.05 rad off', 'by design')
    denied: float = tuned(
        0.5, 'share of points', 'judged, below which a scan denies what others saw', 'shared logs')


TUNING = AgreementTuning()


def judge(T_map_scan: Array, cloud: Cloud, target: LocalMap) -> tuple[int, int]:
    """Count the points of a cloud at a pose (3,) on the old surface, and in free space off it."""
    return _count(apply(T_map_scan, cloud.points), target)


def judge_back(T_map_scan: Array, cloud: Cloud, points: Array) -> tuple[int, int]:
    """Count points (N, 2) of a surface that a scan at a pose (3,) shows, and looks through."""
    on, through = _looked_at(T_map_scan, cloud.outline, points)
    return int(on.sum()), int(through.sum())


def seen_gone(T_map_scan: Array, outline: Outline, points: Array) -> NDArray[np.bool_]:
    """Return which points (N, 2) of a surface a scan at a pose (3,) looks through."""
    return _looked_at(T_map_scan, outline, points)[1]


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


def _looked_at(T_map_scan: Array, outline: Outline, points: Array
               ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which points (N, 2) a scan at a pose (3,) shows, and which it looks through."""
    hits = outline.hits
    if not len(hits):
        return np.zeros(len(points), bool), np.zeros(len(points), bool)
    at = apply(inverse(T_map_scan), points)
    tells = ~_looked_along(at, outline.origin)
    on, through = _parts(at, LocalMap(hits, np.zeros_like(hits), (outline.rim,)))
    return on & tells, through & tells


def _looked_along(points: Array, origin: Array) -> NDArray[np.bool_]:
    """
    Return which points (N, 2) lie on a straight surface that is seen edge on from an origin (2,).

    A centimetre decides on which side of it the beams pass, so they tell nothing of it.
    """
    i, j = cKDTree(points).query_pairs(TUNING.straight, output_type='ndarray').T
    # Squares of complex numbers: both ways along a surface are one direction.
    steps, sight = (line[:, 0] + 1j * line[:, 1]
                    for line in (points[j] - points[i], points - origin))
    along, length = np.zeros(len(points), complex), np.zeros(len(points))
    for end in (i, j):
        np.add.at(along, end, steps ** 2)
        np.add.at(length, end, np.abs(steps) ** 2)
    off = np.angle(along * sight.conj() ** 2) / 2.0
    return np.asarray((np.abs(along) > TUNING.flat * length) & (np.abs(off) < TUNING.grazing))


def _count(points: Array, target: LocalMap) -> tuple[int, int]:
    on, against = _parts(points, target)
    return int(on.sum()), int(against.sum())


def _parts(points: Array, target: LocalMap) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which points (N, 2) lie on a surface, and which in free space off it."""
    distance, _ = target.tree.query(points, distance_upper_bound=TUNING.conflict)
    return (distance < TUNING.on_surface,
            ~np.isfinite(distance) & target.seen_through(points))


def _denies(on: int, against: int) -> bool | None:
    if on + against < TUNING.points:
        return None
    return on < TUNING.denied * (on + against)
