# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Loop closure: find an old place, match against it, and believe it only when it agrees.

A candidate is an old view whose surface should lie near the new view's, by the filter's own
uncertainty. A match must cover most of the scan and pass the chi-square gate on its
innovation; where the uncertainty is large it must also win clearly over any other pose in the
window, and agree with other loops found near it, before any of them is trusted.
"""

from dataclasses import dataclass

import numpy as np

from somfusion_ros.config import SlamConfig
from somfusion_ros.geometry import Array, apply, between, compose, inverse, wrap
from somfusion_ros.slam.correlative import search
from somfusion_ros.slam.ekf import DelayedStateEkf, Relation
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import Match, refine, register
from somfusion_ros.slam.scan import Cloud

NEIGHBOURS = 4           # views on each side of an old view that make its local map
CANDIDATES = 2           # old passes that a new view is matched against
CHI2 = 16.3              # 99.9 % of chi-square with 3 degrees of freedom
SURE = (0.25, 0.06)      # [m] [rad] sigma up to which a match at the seed is no question
WINDOW = (4.0, 0.6)      # [m] [rad] the widest search
PARTNERS = 2             # other loops that must agree with a far one
AGREE = (0.25, 0.05)     # [m] [rad] between two agreeing loops, plus what the odometry drifts
RECENT = 25              # views within which loops are compared


@dataclass(frozen=True, eq=False)
class Candidate:
    """An old view to match against, the expected pose (3,) in it, and the 1-sigma window."""

    old: int
    expected: Array
    sigma: Array


@dataclass(frozen=True, eq=False)
class Loop:
    """A matched candidate: the relation, its quality, and whether it needs partners."""

    relation: Relation
    inlier_ratio: float
    sure: bool


def centre(cloud: Cloud) -> Array:
    """Median point (2,) [m] of what a view saw, in its base frame."""
    return np.median(cloud.points, axis=0) if len(cloud) else np.zeros(2)


def candidates(new: int, ekf: DelayedStateEkf, centres: Array, config: SlamConfig
               ) -> list[Candidate]:
    """Old views whose surface lies near that of view `new`; at most one per pass."""
    last = new - config.loop_minimum_gap
    if last <= 0:
        return []
    poses = ekf.poses
    seen = _seen(poses[:last], centres[:last])
    distance = np.hypot(*(seen - apply(poses[new], centres[new][None])).T)
    distance += 0.5 * np.hypot(*(poses[:last, :2] - poses[new, :2]).T)
    chosen: list[Candidate] = []
    for old in np.argsort(distance, kind='stable'):
        if len(chosen) == CANDIDATES or distance[old] > config.loop_search_distance + WINDOW[0]:
            break
        if any(abs(old - c.old) < config.loop_minimum_gap for c in chosen):
            continue
        expected, P = ekf.relative(old, new)
        sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
        if distance[old] < config.loop_search_distance + 2.0 * np.hypot(*sigma[:2]):
            chosen.append(Candidate(int(old), expected, sigma))
    return chosen


def _seen(poses: Array, centres: Array) -> Array:
    """Centres (n, 2) placed by their views' poses (n, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return poses[:, :2] + np.column_stack([c * centres[:, 0] - s * centres[:, 1],
                                           s * centres[:, 0] + c * centres[:, 1]])


def local_map(old: int, newest: int, poses: Array, clouds: list[Cloud]) -> LocalMap:
    """Local map around an old view, in its frame, of views up to `newest`."""
    near = range(max(0, old - NEIGHBOURS), min(newest, old + NEIGHBOURS) + 1)
    return LocalMap.of_views([clouds[k] for k in near], list(between(poses[old], poses[near])))


def match(candidate: Candidate, new: int, cloud: Cloud, target: LocalMap, config: SlamConfig
          ) -> Loop | None:
    """Match a view against a candidate's local map; None where the match is poor."""
    if len(cloud) < 20 or len(target) < 20:
        return None
    sigma = candidate.sigma
    sure = bool((sigma[:2] < SURE[0]).all() and sigma[2] < SURE[1])
    found = _match_near(candidate, cloud, target) if sure else _match_far(
        candidate, cloud, target)
    if found is None or found.inlier_ratio < config.loop_minimum_inlier_ratio:
        return None
    return Loop(Relation(candidate.old, new, found.T_map_scan, found.covariance),
                found.inlier_ratio, sure)


def _match_near(candidate: Candidate, cloud: Cloud, target: LocalMap) -> Match:
    """Match from the expected pose; the uncertainty is smaller than ICP's basin."""
    return register(cloud, target, candidate.expected)


def _match_far(candidate: Candidate, cloud: Cloud, target: LocalMap) -> Match | None:
    """Search the 3-sigma window first; None where another pose scores nearly as well."""
    reach = float(np.clip(3.0 * candidate.sigma[:2].max(), 0.4, WINDOW[0]))
    turn = float(np.clip(3.0 * candidate.sigma[2], 0.15, WINDOW[1]))
    peak = search(cloud, target, candidate.expected, reach, turn)
    if peak.rival > 0.92 * peak.score:
        return None
    return refine(cloud, target, peak.pose)


class LoopClosure:
    """Holds loops back until they are trusted."""

    def __init__(self, config: SlamConfig) -> None:
        self._config = config
        self._pending: list[Loop] = []
        self.rejected = 0

    def trusted(self, loop: Loop, ekf: DelayedStateEkf) -> list[Relation]:
        """Relations that may now enter the filter: this loop, and those it confirms."""
        y, S = ekf.innovation(loop.relation)
        distance = float(y @ np.linalg.solve(S, y))
        if loop.sure and distance < CHI2:
            return [loop.relation]
        self._pending = [p for p in self._pending
                         if loop.relation.second - p.relation.second <= RECENT]
        partners = [p for p in self._pending if agree(p.relation, loop.relation, ekf)]
        self._pending.append(loop)
        if len(partners) < PARTNERS:
            self.rejected += 1
            return []
        together = [*partners, loop]
        self._pending = [p for p in self._pending if p not in together]
        return [p.relation for p in together]


def agree(a: Relation, b: Relation, ekf: DelayedStateEkf) -> bool:
    """Tell whether two loops, joined by the robot's own path, close on themselves."""
    if max(a.second, b.second) - min(a.second, b.second) < 1:
        return False
    poses = ekf.poses
    around = compose(compose(a.z, between(poses[a.second], poses[b.second])),
                     inverse(compose(between(poses[a.first], poses[b.first]), b.z)))
    travel = np.hypot(*np.diff(poses[a.second:b.second + 1, :2], axis=0).T).sum()
    return bool(np.hypot(around[0], around[1]) < AGREE[0] + 0.02 * travel
                and abs(wrap(around[2])) < AGREE[1] + 0.005 * travel)
