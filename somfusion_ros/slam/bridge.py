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
from somfusion_ros.geometry import apply, Array, between
from somfusion_ros.settings import tuned
from somfusion_ros.slam.agreement import judge_back, lasting
from somfusion_ros.slam.agreement import TUNING as AGREEMENT
from somfusion_ros.slam.contradiction import sure
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import register
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class BridgeTuning:
    """When views that little holds are right, and when they are taken back."""

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


TUNING = BridgeTuning()


@dataclass(eq=False)
class Bridge:
    """The first view that little holds; before: the views that it was matched against."""

    first: int
    before: Sequence[int]
    _on: int = field(default=0, init=False)
    _against: int = field(default=0, init=False)
    _judged: int = field(default=0, init=False)

    def denied(self, new: int, ekf: DelayedStateEkf, clouds: Sequence[Cloud]) -> bool | None:
        """Return whether the views up to a new one deny those before; None until that is known."""
        before = [k for k in self.before if len(clouds[k])]
        poses: Array = ekf.poses
        if not before or np.hypot(*(poses[before[-1], :2] - poses[new, :2])) > TUNING.reach:
            return False
        at = before[-1]
        placed, pose = list(between(poses[at], poses[before])), between(poses[at], poses[new])
        if not sure(at, new, ekf):
            around = LocalMap.of_views([clouds[k] for k in before], placed)
            pose = register(clouds[new], around, pose).T_map_scan
        on, against = judge_back(pose, clouds[new], lasting(
            [apply(p, clouds[k].points) for p, k in zip(placed, before, strict=True)]))
        if on + against >= AGREEMENT.points:
            self._on, self._against, self._judged = (
                self._on + on, self._against + against, self._judged + 1)
        if self._judged < TUNING.views:
            return None
        least = TUNING.agreement if new - self.first <= TUNING.soon else TUNING.drifted
        return self._on < least * (self._on + self._against)
