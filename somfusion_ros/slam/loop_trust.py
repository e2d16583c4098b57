# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Loop closure: which matches to believe.

A loop must pass the chi-square gate on its innovation, unless the filter is sure: it may be surer
than it should be. Then, and where it is unsure, other loops found near must agree before any of
them is trusted.

Where places look alike, loops that are all shifted to the next one agree as well. So while the
uncertainty is large, a loop counts only if it fits nowhere else that the robot may be, and those
that agree must span as much travel as the robot may be off: if it has not yet come to the place,
the right loop would show itself by then.
"""

from collections.abc import Container
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, between, compose, inverse, squared_mahalanobis, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.loops import Estimate
from somfusion_ros.slam.loops import TUNING as PLACES


@dataclass(frozen=True)
class TrustTuning:
    """When a loop is believed (doc/slam.md)."""

    partners: int = tuned(
        2, 'loops', 'must agree with one found from afar', 'benchmarks/slam/look_alikes.py')
    partners_near: int = tuned(
        1, 'loop', 'must agree with one that the filter is surer of than it should be',
        'benchmarks/slam/look_alikes.py')
    agree: tuple[float, float] = tuned(
        (0.25, 0.05), 'm, rad', 'between two agreeing loops, plus what the odometry drifts',
        'shared logs')
    drift: tuple[float, float] = tuned(
        (0.02, 0.005), 'share, rad/m',
        'of the travel between two agreeing loops, that the odometry drifts', 'shared logs')
    recent: int = tuned(
        60, 'views', 'within which loops are compared', 'not measured')
    newest: int = tuned(
        20, 'loops', 'that are not believed yet may say where to seek more: bounds time',
        'by design')
    spanned: float = tuned(
        3.0, 'sigmas', 'of travel that agreeing loops span', 'benchmarks/slam/look_alikes.py')


TUNING = TrustTuning()


@dataclass(frozen=True, eq=False)
class Loop:
    """
    A matched candidate: the constraint, and how well it agrees.

    It needs partners unless the filter was sure already, of which sigma [m] is the larger of two;
    it is unique if the view fits nowhere else nearly as well.
    """

    constraint: Constraint
    agreement: float
    sure: bool
    sigma: float = 0.0
    unique: bool = True


class LoopClosure:
    """Holds loops back until they are trusted."""

    def __init__(self) -> None:
        self._pending: list[Loop] = []

    def trusted(self, loop: Loop, ekf: Estimate) -> list[Constraint]:
        """Return the constraints that may enter the filter: this loop, and those it confirms."""
        possible = _possible(loop, ekf)
        if loop.sure and possible:
            return [loop.constraint]
        self._pending = [p for p in self._pending
                         if loop.constraint.second - p.constraint.second <= TUNING.recent]
        if not loop.unique or not (loop.sure or possible):
            return []
        partners = [p for p in self._pending if agree(p.constraint, loop.constraint, ekf)]
        self._pending.append(loop)
        together = [*partners, loop]
        if (len(partners) < (TUNING.partners_near if loop.sure else TUNING.partners)
                or not (loop.sure or _far_enough(together, ekf))):
            return []
        self._pending = [p for p in self._pending if p not in together]
        return [p.constraint for p in together]

    def forget(self, views: Container[int]) -> None:
        """Drop the loops that wait and join one of some views, which show nothing any more."""
        self._pending = [p for p in self._pending if p.constraint.first not in views
                         and p.constraint.second not in views]

    def supposed(self, new: int, ekf: Estimate) -> Constraint | None:
        """
        Return the newest loop with which enough others agree to be believed later on.

        None where there is none of those with which one of view `new` would be compared.
        """
        newest = [p for p in self._pending[-TUNING.newest:]
                  if new - p.constraint.second <= TUNING.recent]
        for loop in reversed(newest):
            partners = sum(agree(other.constraint, loop.constraint, ekf)
                           for other in newest if other is not loop)
            if partners >= TUNING.partners and _possible(loop, ekf):
                return loop.constraint
        return None


def _possible(loop: Loop, ekf: Estimate) -> bool:
    """Return whether a loop passes the filter's gate."""
    return bool(squared_mahalanobis(*ekf.innovation(loop.constraint)) < PLACES.chi2)


def _far_enough(loops: list[Loop], ekf: Estimate) -> bool:
    """Return whether the loops span so much travel that a right place would have shown itself."""
    seconds = [loop.constraint.second for loop in loops]
    return (_travel(min(seconds), max(seconds), ekf.poses)
            >= TUNING.spanned * max(loop.sigma for loop in loops))


def _travel(first: int, last: int, poses: Array) -> float:
    """Return the length [m] of the path through poses (n, 3) from one view to another."""
    return float(np.hypot(*np.diff(poses[first:last + 1, :2], axis=0).T).sum())


def agree(a: Constraint, b: Constraint, ekf: Estimate) -> bool:
    """Return whether two loops and the robot's path between them close to a ring."""
    if a.second == b.second:
        return False
    if a.second > b.second:
        a, b = b, a
    poses = ekf.poses
    around = compose(compose(a.z, between(poses[a.second], poses[b.second])),
                     inverse(compose(between(poses[a.first], poses[b.first]), b.z)))
    travel = _travel(a.second, b.second, poses)
    return bool(np.hypot(around[0], around[1]) < TUNING.agree[0] + TUNING.drift[0] * travel
                and abs(wrap(around[2])) < TUNING.agree[1] + TUNING.drift[1] * travel)
