# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whether views hang where they should on the map before them, though little holds them there.

Where a scan hardly fits and a view is kept all the same, whatever comes next fits that view. A
robot that was taken up then goes on in its map as if nothing had happened.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from somfusion_ros.geometry import apply, Array, between, compose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.agreement import judge_back, lasting, seen_gone
from somfusion_ros.slam.agreement import TUNING as AGREEMENT
from somfusion_ros.slam.contradiction import sure
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.matching import register
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class BridgeTuning:
    """When views that little holds are right, and when they are taken back."""

    fell: float = tuned(
        0.2, 'share of points', 'less than of the scan before that a match explains: the robot '
        'may have been taken up', 'benchmarks/slam/carried.py')
    reach: float = tuned(
        5.0, 'm', 'from the map before, beyond which nothing is judged any more',
        'not measured')
    views: int = tuned(
        4, 'views', 'that are judged together', 'benchmarks/slam/carried.py')
    agreement: float = tuned(
        0.85, 'share of squares', 'that lasted, below which they do not hang there',
        'benchmarks/slam/carried.py')
    soon: int = tuned(
        8, 'views', 'after the first, beyond which the map has drifted', 'belgioioso')
    drifted: float = tuned(
        0.7, 'share of squares', 'that counts then', 'benchmarks/slam/carried.py, belgioioso')
    each: float = tuned(
        0.05, 'share of squares', 'that every view must look through: what few see is of those '
        'views, which slip bent', 'benchmarks/slam/carried.py, benchmarks/slam/look_alikes.py')
    clearer: float = tuned(
        3.0, 'times', 'as much must be looked through as the views before look through of one '
        'another', 'benchmarks/slam/carried.py, benchmarks/slam/look_alikes.py')
    fitted: int = tuned(
        8, 'scans', 'before it, that show what was moved away since its map', 'not measured')


TUNING = BridgeTuning()


@dataclass(eq=False)
class Bridge:
    """
    The first view that little holds; before: the views that it was matched against.

    fitted: scans that fitted these well before it. What they look through was moved away since
    the views saw it, and does not speak against what comes later.
    """

    first: int
    before: Sequence[int]
    fitted: Sequence[MapScan] = ()
    _judged: list[tuple[int, int]] = field(default_factory=list, init=False)

    def denied(self, new: int, ekf: DelayedStateEkf, clouds: Sequence[Cloud]) -> bool | None:
        """Return whether the views up to a new one deny those before; None until that is known."""
        before = [k for k in self.before if len(clouds[k])]
        poses: Array = ekf.poses
        if not before or np.hypot(*(poses[before[-1], :2] - poses[new, :2])) > TUNING.reach:
            return False
        at = before[-1]
        placed, pose = list(between(poses[at], poses[before])), between(poses[at], poses[new])
        shown = [clouds[k] for k in before]
        if new - self.first > TUNING.soon or not sure(at, new, ekf):   # the map has drifted
            pose = register(clouds[new], LocalMap.of_views(shown, placed), pose).T_map_scan
        wall = lasting([apply(p, cloud.points) for p, cloud in zip(placed, shown, strict=True)])
        for scan in self.fitted:
            at_scan = between(poses[at], compose(poses[scan.view], scan.T_view_base))
            wall = wall[~seen_gone(at_scan, scan.outline, wall)]
        self._judge(pose, clouds[new], wall)
        if len(self._judged) < TUNING.views:
            return None
        against = _looked_through(self._judged)
        least = TUNING.agreement if new - self.first <= TUNING.soon else TUNING.drifted
        fewest = min(_looked_through([view]) for view in self._judged)
        if against <= 1.0 - least or fewest < TUNING.each:
            return False
        usual = [judge_back(p, cloud, wall) for p, cloud in zip(placed, shown, strict=True)]
        return against > TUNING.clearer * _looked_through(usual[-TUNING.views:])

    def _judge(self, pose: Array, cloud: Cloud, wall: Array) -> None:
        """Note what a cloud at a pose (3,) says of a wall (N, 2), if it sees enough of it."""
        on, against = judge_back(pose, cloud, wall)
        if on + against >= AGREEMENT.points:
            self._judged.append((on, against))


def _looked_through(judged: Sequence[tuple[int, int]]) -> float:
    """Return the share of all squares judged that views looked through."""
    on, against = np.sum(judged, axis=0)
    return float(against / max(on + against, 1))
