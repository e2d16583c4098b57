# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Closing a loop: match what the newest views saw together against an old place.

The match must cover part of what was seen and contradict nothing that the old views saw to be
free; from afar it must also win clearly over any other pose where the robot may be.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import apply, Array, between, compose, inverse
from somfusion_ros.settings import tuned
from somfusion_ros.slam.agreement import judge
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.correlative import search
from somfusion_ros.slam.correlative import TUNING as SEARCH
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loop_trust import Loop
from somfusion_ros.slam.loops import Candidate
from somfusion_ros.slam.loops import TUNING as PLACES
from somfusion_ros.slam.matching import Match, refine, register
from somfusion_ros.slam.matching import TUNING as MATCHING
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class LoopMatchingTuning:
    """What is matched when a loop is closed, and how clear a match must be."""

    neighbours: int = tuned(
        4, 'views', 'on each side of an old view, make its local map', 'shared logs')
    recent_views: int = tuned(
        4, 'views',
        'newest, are matched together: one scan of a short-range laser shows too little',
        'mines logs')
    thinning: float = tuned(
        0.1, 'm', 'edge of a square that keeps one of their points', 'not measured')
    near: tuple[float, float] = tuned(
        (0.06, 0.02), 'm, rad', 'sigma up to which a match needs no search', 'shared logs')
    window: tuple[float, float] = tuned(
        (10.0, 0.6), 'm, rad', 'the widest search', 'public logs')
    unexpected: float = tuned(
        0.1, 'share of the score', 'lost by a pose far from the expected one',
        'benchmarks/slam/look_alikes.py')
    floor: tuple[float, float, float] = tuned(
        (0.1, 0.1, 0.05), 'm, m, rad', 'added to the sigmas for that', 'not measured')
    unique: float = tuned(
        0.92, 'share of the score', 'no rival may reach it from afar',
        'benchmarks/slam/look_alikes.py')
    clear: float = tuned(
        0.02, 'share of points', 'by which agreement must be better than at any other place',
        'benchmarks/slam/look_alikes.py')


TUNING = LoopMatchingTuning()
FEWEST = 20                          # points that make a place
Around = Callable[[int], LocalMap]   # local map of an old view


def local_map(old: int, chain: range, poses: Array, clouds: Sequence[Cloud]) -> LocalMap:
    """Return the local map around an old view, in its frame, of views of its chain."""
    near = range(max(chain.start, old - TUNING.neighbours),
                 min(chain.stop, old + TUNING.neighbours + 1))
    return LocalMap.of_views([clouds[k] for k in near], list(between(poses[old], poses[near])))


def recent(new: int, chain: range, poses: Array, clouds: Sequence[Cloud]) -> Cloud:
    """
    Join what the newest views of a chain saw, in the frame of view `new`.

    One scan of a short-range laser shows too little to know a place by.
    """
    near = range(max(chain.start, new - TUNING.recent_views + 1), new + 1)
    seen = LocalMap.of_views([clouds[k] for k in near], list(between(poses[new], poses[near])))
    squares = np.floor(seen.points / TUNING.thinning).astype(int) @ (1 << 20, 1)
    _, first = np.unique(squares, return_index=True)
    first.sort()
    return Cloud(seen.points[first], seen.normals[first],
                 noise=float(np.mean([clouds[k].noise for k in near])), spacing=TUNING.thinning)


def match(candidate: Candidate, new: int, cloud: Cloud, around: Around, config: SlamConfig
          ) -> Loop | None:
    """Match a view against a candidate's local map; None where the match is poor."""
    target = around(candidate.old)
    if len(cloud) < FEWEST or len(target) < FEWEST:
        return None
    near = (candidate.sigma[:2] < TUNING.near[0]).all() and candidate.sigma[2] < TUNING.near[1]
    # A search for a tie along a smooth wall would move the view until the surfaces overlap.
    if ((near or candidate.tie)
            and _within_reach(candidate, cloud, target) < config.loop_minimum_overlap):
        return None
    found, unique = ((register(cloud, target, candidate.expected), True) if near else
                     _match_far(candidate, cloud, target))
    if found.inlier_ratio < config.loop_minimum_overlap:
        return None
    agreement = agreement_of(found, cloud, target)
    if agreement < config.loop_minimum_agreement:
        return None
    # What a view saw takes part in the loops of as many views as are matched together.
    R = TUNING.recent_views * found.covariance
    unique = candidate.sure or (unique and not _fits_elsewhere(
        candidate, found.T_map_scan, agreement, cloud, around, config))
    return Loop(Constraint(candidate.old, new, found.T_map_scan, R), agreement, candidate.sure,
                float(candidate.sigma[:2].max()), unique)


def _within_reach(candidate: Candidate, cloud: Cloud, target: LocalMap) -> float:
    """Return the share of points that lie, as expected, within reach of the old surface."""
    p = apply(candidate.expected, cloud.points)
    distance, _ = target.tree.query(p, distance_upper_bound=MATCHING.coarse_gate)
    return float(np.isfinite(distance).mean())


def agreement_of(found: Match, cloud: Cloud, target: LocalMap) -> float:
    """
    Return the share of the judged points that lie on the old surface.

    Judged are those that lie on it and those in space that the old views saw to be free; what
    the old views never saw says nothing.
    """
    on, against = judge(found.T_map_scan, cloud, target)
    return on / max(on + against, 1)


def _match_far(candidate: Candidate, cloud: Cloud, target: LocalMap) -> tuple[Match, bool]:
    """Search the 3-sigma window first; tell, too, whether no other pose scores nearly as well."""
    reach = float(np.clip(0.4 + 3.0 * candidate.sigma[:2].max(), 0.0, TUNING.window[0]))
    turn = float(np.clip(0.15 + 3.0 * candidate.sigma[2], 0.0, TUNING.window[1]))
    peak = search(cloud, target, candidate.expected, reach, turn, partial(_expected, candidate))
    return refine(cloud, target, peak.pose), peak.rival <= TUNING.unique * peak.score


def _fits_elsewhere(candidate: Candidate, found: Array, agreement: float, cloud: Cloud,
                    around: Around, config: SlamConfig) -> bool:
    """Return whether a view found at a pose (3,) fits nearly as well at another place."""
    for place in candidate.elsewhere:
        target = around(place.old)
        T_place_old = compose(place.expected, inverse(candidate.expected))
        here = partial(_apart, compose(T_place_old, found))
        turn = min(0.15 + 3.0 * place.sigma[2], np.pi)
        peak = search(cloud, target, place.expected * (0.0, 0.0, 1.0), PLACES.place, turn, here,
                      with_rival=False)
        rival = refine(cloud, target, peak.pose)
        if (here(rival.T_map_scan[None]).all()
                and rival.inlier_ratio >= config.loop_minimum_overlap
                and agreement_of(rival, cloud, target) > agreement - TUNING.clear):
            return True
    return False


def _apart(found: Array, poses: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the poses (n, 3) that are not merely the one found (3,)."""
    d = between(found, poses)
    away, turned = SEARCH.distinct
    apart: NDArray[np.bool_] = (np.hypot(d[:, 0], d[:, 1]) > away) | (np.abs(d[:, 2]) > turned)
    return apart


def _expected(candidate: Candidate, poses: Array) -> Array:
    """
    Return factors (n,) for the scores of poses (n, 3): less, the farther from expected.

    Along a corridor all poses fit alike. In a round one the match is then a curve, not a line,
    and a constraint far along it would be wrong by more than its covariance says.
    """
    d = between(candidate.expected, poses) / (candidate.sigma + np.array(TUNING.floor))
    factors: Array = 1.0 - TUNING.unexpected * (1.0 - np.exp(-0.5 * (d ** 2).sum(1)))
    return factors
