# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Loop closure: which old places to try, and which matches to believe.

A candidate is an old view whose surface should lie near the new view's, by the filter's own
uncertainty. A loop must pass the chi-square gate on its innovation; where it does not, or where
the uncertainty is large, other loops found near it must agree before any of them is trusted.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from somfusion_ros.config import SlamConfig
from somfusion_ros.geometry import (
    apply, Array, between, compose, inverse, squared_mahalanobis, wrap)
from somfusion_ros.slam.relation import Relation
from somfusion_ros.slam.scan import Cloud

CANDIDATES = 2           # old passes that a new view is matched against
SPAN = 20                # views back to which every view is tied, loop or not
FARTHEST = 4.0           # [m] beyond the search distance, however uncertain the filter is
CHI2 = 16.3              # 99.9 % of chi-square with 3 degrees of freedom
SURE = (0.25, 0.06)      # [m] [rad] sigma up to which one partner is enough
PARTNERS = 2             # other loops that must agree with one found from afar
PARTNERS_NEAR = 1        # and with one that the filter is surer of than it should be
AGREE = (0.25, 0.05)     # [m] [rad] between two agreeing loops, plus what the odometry drifts
RECENT = 25              # views within which loops are compared


class Estimate(Protocol):
    """What loop closure asks of the filter."""

    @property
    def poses(self) -> Array:
        """View poses T_map_view (n, 3)."""

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Mask (n,) of the views whose covariance is known."""

    def relative(self, i: int, j: int) -> tuple[Array, Array]:
        """Pose (3,) of view j seen from view i, and its covariance (3, 3)."""

    def innovation(self, relation: Relation) -> tuple[Array, Array]:
        """Measured minus expected relation (3,), and its covariance (3, 3)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    An old view to match against, the expected pose (3,) in it, and the 1-sigma window.

    A tie is no loop: it is wanted only where the surfaces overlap as expected.
    """

    old: int
    expected: Array
    sigma: Array
    tie: bool = False

    @property
    def sure(self) -> bool:
        """Tell whether the filter knows already, almost, where the new view lies."""
        return bool((self.sigma[:2] < SURE[0]).all() and self.sigma[2] < SURE[1])


@dataclass(frozen=True, eq=False)
class Loop:
    """A matched candidate: the relation, how well it agrees, and whether it needs partners."""

    relation: Relation
    agreement: float
    sure: bool


def centre(cloud: Cloud) -> Array:
    """Median point (2,) [m] of what a view saw, in its base frame."""
    return np.median(cloud.points, axis=0) if len(cloud) else np.zeros(2)


def candidates(new: int, ekf: Estimate, centres: Array, config: SlamConfig
               ) -> list[Candidate]:
    """
    Old views whose surface lies near that of view `new`; at most one per pass.

    Every view is also tried against the one SPAN views before it: where their surfaces
    overlap, the tie keeps a path that meets no old place from bending.
    """
    last = new - config.loop_minimum_gap
    if last <= 0:
        return []
    poses = ekf.poses
    seen = _seen(poses[:last], centres[:last])
    distance = np.hypot(*(seen - apply(poses[new], centres[new][None])).T)
    distance += 0.5 * np.hypot(*(poses[:last, :2] - poses[new, :2]).T)
    distance[~ekf.kept[:last]] = np.inf
    chosen: list[Candidate] = []
    for old in np.argsort(distance, kind='stable'):
        if len(chosen) == CANDIDATES or distance[old] > config.loop_search_distance + FARTHEST:
            break
        if any(abs(old - c.old) < config.loop_minimum_gap for c in chosen):
            continue
        candidate = _candidate(int(old), new, ekf)
        if distance[old] < config.loop_search_distance + 2.0 * np.hypot(*candidate.sigma[:2]):
            chosen.append(candidate)
    span = new - max(SPAN, config.loop_minimum_gap)
    if span >= 0 and all(
            abs(span - c.old) >= config.loop_minimum_gap // 2 for c in chosen):
        chosen.append(replace(_candidate(span, new, ekf), tie=True))
    return chosen


def _candidate(old: int, new: int, ekf: Estimate) -> Candidate:
    """View `old`, with view `new` expected where the filter has it."""
    expected, P = ekf.relative(old, new)
    return Candidate(old, expected, np.sqrt(np.maximum(np.diag(P), 0.0)))


def _seen(poses: Array, centres: Array) -> Array:
    """Centres (n, 2) placed by their views' poses (n, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return poses[:, :2] + np.column_stack([c * centres[:, 0] - s * centres[:, 1],
                                           s * centres[:, 0] + c * centres[:, 1]])


class LoopClosure:
    """Holds loops back until they are trusted."""

    def __init__(self, config: SlamConfig) -> None:
        self._config = config
        self._pending: list[Loop] = []

    def trusted(self, loop: Loop, ekf: Estimate) -> list[Relation]:
        """Relations that may now enter the filter: this loop, and those it confirms."""
        y, S = ekf.innovation(loop.relation)
        if loop.sure and squared_mahalanobis(y, S) < CHI2:
            return [loop.relation]
        self._pending = [p for p in self._pending
                         if loop.relation.second - p.relation.second <= RECENT]
        partners = [p for p in self._pending if agree(p.relation, loop.relation, ekf)]
        self._pending.append(loop)
        if len(partners) < (PARTNERS_NEAR if loop.sure else PARTNERS):
            return []
        together = [*partners, loop]
        self._pending = [p for p in self._pending if p not in together]
        return [p.relation for p in together]


def agree(a: Relation, b: Relation, ekf: Estimate) -> bool:
    """Tell whether two loops, joined by the robot's own path, close on themselves."""
    if max(a.second, b.second) - min(a.second, b.second) < 1:
        return False
    poses = ekf.poses
    around = compose(compose(a.z, between(poses[a.second], poses[b.second])),
                     inverse(compose(between(poses[a.first], poses[b.first]), b.z)))
    travel = np.hypot(*np.diff(poses[a.second:b.second + 1, :2], axis=0).T).sum()
    return bool(np.hypot(around[0], around[1]) < AGREE[0] + 0.02 * travel
                and abs(wrap(around[2])) < AGREE[1] + 0.005 * travel)
