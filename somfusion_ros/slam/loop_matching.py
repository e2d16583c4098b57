# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Closing a loop: match what the newest views saw together against an old place.

The match must cover part of what was seen and contradict nothing that the old views saw to be
free; from afar it must also win clearly over any other pose where the robot may be.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from somfusion_ros.geometry import apply, Array, between, compose, inverse
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Relation
from somfusion_ros.slam.correlative import DISTINCT, search
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loops import Candidate, Loop, PLACE
from somfusion_ros.slam.matching import COARSE_GATE, Match, refine, register
from somfusion_ros.slam.scan import Cloud

NEIGHBOURS = 4           # views on each side of an old view that make its local map
RECENT_VIEWS = 4         # newest views that are matched together
THINNING = 0.1           # [m] edge of a square that keeps one of their points
NEAR = (0.06, 0.02)      # [m] [rad] sigma up to which a match needs no search
WINDOW = (4.0, 0.6)      # [m] [rad] the widest search
UNEXPECTED = 0.1         # share of the score that a pose far from the expected one loses
FLOOR = np.array([0.1, 0.1, 0.05])  # [m] [m] [rad] added to the sigmas for that
UNIQUE = 0.92            # share of the score that no rival may reach from afar
CLEAR = 0.02             # by which its agreement must be better than at any other place
ON_SURFACE, CONFLICT = 0.12, 0.2  # [m] from the old surface: on it; off it
FEWEST = 20              # points that make a place
Around = Callable[[int], LocalMap]   # local map of an old view


def local_map(old: int, newest: int, poses: Array, clouds: Sequence[Cloud]) -> LocalMap:
    """Local map around an old view, in its frame, of views up to `newest`."""
    near = range(max(0, old - NEIGHBOURS), min(newest, old + NEIGHBOURS) + 1)
    return LocalMap.of_views([clouds[k] for k in near], list(between(poses[old], poses[near])))


def recent(new: int, poses: Array, clouds: Sequence[Cloud]) -> Cloud:
    """
    Put together what the newest views saw, in the frame of view `new`.

    One scan of a short-range laser shows too little to know a place by.
    """
    near = np.arange(max(0, new - RECENT_VIEWS + 1), new + 1)
    seen = LocalMap.of_views([clouds[k] for k in near], list(between(poses[new], poses[near])))
    squares = np.floor(seen.points / THINNING).astype(int) @ (1 << 20, 1)
    _, first = np.unique(squares, return_index=True)
    first.sort()
    return Cloud(seen.points[first], seen.normals[first],
                 noise=float(np.mean([clouds[k].noise for k in near])), spacing=THINNING)


def match(candidate: Candidate, new: int, cloud: Cloud, around: Around, config: SlamConfig
          ) -> Loop | None:
    """Match a view against a candidate's local map; None where the match is poor."""
    target = around(candidate.old)
    if len(cloud) < FEWEST or len(target) < FEWEST:
        return None
    near = (candidate.sigma[:2] < NEAR[0]).all() and candidate.sigma[2] < NEAR[1]
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
    R = RECENT_VIEWS * found.covariance
    unique = candidate.sure or (unique and not _fits_elsewhere(
        candidate, found.T_map_scan, agreement, cloud, around, config))
    return Loop(Relation(candidate.old, new, found.T_map_scan, R), agreement, candidate.sure,
                float(candidate.sigma[:2].max()), unique)


def _within_reach(candidate: Candidate, cloud: Cloud, target: LocalMap) -> float:
    """Share of the points that lie, as expected, so near the old surface that it draws them."""
    p = apply(candidate.expected, cloud.points)
    distance, _ = target.tree.query(p, distance_upper_bound=COARSE_GATE)
    return float(np.isfinite(distance).mean())


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


def _match_far(candidate: Candidate, cloud: Cloud, target: LocalMap) -> tuple[Match, bool]:
    """Search the 3-sigma window first; tell, too, whether no other pose scores nearly as well."""
    reach = float(np.clip(0.4 + 3.0 * candidate.sigma[:2].max(), 0.0, WINDOW[0]))
    turn = float(np.clip(0.15 + 3.0 * candidate.sigma[2], 0.0, WINDOW[1]))
    peak = search(cloud, target, candidate.expected, reach, turn, partial(_expected, candidate))
    return refine(cloud, target, peak.pose), peak.rival <= UNIQUE * peak.score


def _fits_elsewhere(candidate: Candidate, found: Array, agreement: float, cloud: Cloud,
                    around: Around, config: SlamConfig) -> bool:
    """Tell whether a view found at a pose (3,) fits nearly as well at another place."""
    for place in candidate.elsewhere:
        target = around(place.old)
        T_place_old = compose(place.expected, inverse(candidate.expected))
        here = partial(_apart, compose(T_place_old, found))
        turn = min(0.15 + 3.0 * place.sigma[2], np.pi)
        peak = search(cloud, target, place.expected * (0.0, 0.0, 1.0), PLACE, turn, here,
                      with_rival=False)
        rival = refine(cloud, target, peak.pose)
        if (here(rival.T_map_scan[None]).all()
                and rival.inlier_ratio >= config.loop_minimum_overlap
                and agreement_of(rival, cloud, target) > agreement - CLEAR):
            return True
    return False


def _apart(found: Array, poses: Array) -> Array:
    """Mask (n,) of the poses (n, 3) that are not merely the one found (3,)."""
    d = between(found, poses)
    return (np.hypot(d[:, 0], d[:, 1]) > DISTINCT[0]) | (np.abs(d[:, 2]) > DISTINCT[1])


def _expected(candidate: Candidate, poses: Array) -> Array:
    """
    Factor (n,) of the score of poses (n, 3): a little less, the farther from where expected.

    Along a corridor all poses fit alike. In a round one the match is then a curve, not a line,
    and a relation far along it would be wrong by more than its covariance says.
    """
    d = between(candidate.expected, poses) / (candidate.sigma + FLOOR)
    return 1.0 - UNEXPECTED * (1.0 - np.exp(-0.5 * (d ** 2).sum(1)))
