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
RECENT_VIEWS = 4         # newest views that are matched together
THINNING = 0.1           # [m] edge of a square that keeps one of their points
CANDIDATES = 2           # old passes that a new view is matched against
CHI2 = 16.3              # 99.9 % of chi-square with 3 degrees of freedom
SURE = (0.25, 0.06)      # [m] [rad] sigma up to which a match needs no partners
NEAR = (0.06, 0.02)      # [m] [rad] sigma up to which a match needs no search
WINDOW = (4.0, 0.6)      # [m] [rad] the widest search
UNIQUE = 0.92            # share of the score that no rival may reach
ON_SURFACE, CONFLICT = 0.12, 0.2  # [m] from the old surface: on it; off it
PARTNERS = 2             # other loops that must agree with one found from afar
PARTNERS_NEAR = 1        # and with one that the filter is surer of than it should be
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
    """A matched candidate: the relation, how well it agrees, and whether it needs partners."""

    relation: Relation
    agreement: float
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


def recent(new: int, poses: Array, clouds: list[Cloud]) -> Cloud:
    """
    What the newest views saw together, in the frame of view `new`.

    One scan of a short-range laser shows too little to know a place by.
    """
    near = np.arange(max(0, new - RECENT_VIEWS + 1), new + 1)
    seen = LocalMap.of_views([clouds[k] for k in near], list(between(poses[new], poses[near])))
    _, first = np.unique(np.floor(seen.points / THINNING).astype(int), axis=0, return_index=True)
    first.sort()
    return Cloud(seen.points[first], seen.normals[first], seen.points[first], np.zeros(2),
                 np.zeros((0, 2)))


def match(candidate: Candidate, new: int, cloud: Cloud, target: LocalMap, config: SlamConfig
          ) -> Loop | None:
    """Match a view against a candidate's local map; None where the match is poor."""
    if len(cloud) < 20 or len(target) < 20:
        return None
    sigma = candidate.sigma
    sure, near = (bool((sigma[:2] < limit[0]).all() and sigma[2] < limit[1])
                  for limit in (SURE, NEAR))
    found = (_match_near(candidate, cloud, target) if near else
             _match_far(candidate, cloud, target, 1.0 if sure else UNIQUE))
    if found is None or found.inlier_ratio < config.loop_minimum_overlap:
        return None
    agreement = agreement_of(found, cloud, target)
    if agreement < config.loop_minimum_agreement:
        return None
    return Loop(Relation(candidate.old, new, found.T_map_scan, found.covariance),
                agreement, sure)


def agreement_of(found: Match, cloud: Cloud, target: LocalMap) -> float:
    """
    Share of the judged points that lie on the old surface.

    Judged are those that lie on it and those in space that the old views saw to be free; what
    the old views never saw says nothing.
    """
    p = apply(found.T_map_scan, cloud.points)
    distance, _ = target.tree.query(p, distance_upper_bound=CONFLICT)
    far = ~np.isfinite(distance)
    on = int((distance < ON_SURFACE).sum())
    against = int((far & target.seen_through(p)).sum())
    return on / max(on + against, 1)


def _match_near(candidate: Candidate, cloud: Cloud, target: LocalMap) -> Match:
    """Match from the expected pose; the uncertainty is smaller than ICP's basin."""
    return register(cloud, target, candidate.expected)


def _match_far(candidate: Candidate, cloud: Cloud, target: LocalMap, unique: float
               ) -> Match | None:
    """Search the 3-sigma window first; None where another pose scores nearly as well."""
    reach = float(np.clip(0.4 + 3.0 * candidate.sigma[:2].max(), 0.0, WINDOW[0]))
    turn = float(np.clip(0.15 + 3.0 * candidate.sigma[2], 0.0, WINDOW[1]))
    peak = search(cloud, target, candidate.expected, reach, turn)
    if peak.rival > unique * peak.score:
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
        if len(partners) < (PARTNERS_NEAR if loop.sure else PARTNERS):
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
