# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where match and odometry disagree: odometry stalls, catches up, slips and jumps.

Every pose that the robot may be at is tried: where the odometry says, where it coasted to at its
last velocity, where the odometry says that it is from before the trouble (a base that stalls
often reports later what it left out), and what a search around these finds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from somfusion_ros.geometry import Array, between, difference, squared_mahalanobis
from somfusion_ros.settings import tuned
from somfusion_ros.slam.correlative import Prior, search
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import Match, refine, register
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class RecoveryTuning:
    """Where a robot is sought whose odometry cannot be trusted."""

    search: tuple[float, float] = tuned(
        (1.2, 1.2), 'm, rad', 'widest window of the search', 'mit-csail')
    stall: tuple[float, float] = tuned(
        (0.2, 0.5), 'm, rad', 'by which odometry may be wrong at once', 'mit-csail')
    stall_speed: tuple[float, float] = tuned(
        (1.2, 1.5), 'm/s, rad/s', 'by which a stalled or slipping odometry may be wrong',
        'mit-csail')
    stall_sigma: tuple[float, float, float] = tuned(
        (1.0, 0.35, 1.0), 'm, m, rad', 'sigmas along the travel, across it, and of heading',
        'mit-csail')
    implausible: float = tuned(
        0.4, 'share of the score', 'that an implausible pose loses', 'mit-csail')
    distinct: float = tuned(
        0.08, 'share of points', 'by which a match must win over any other, to be clear',
        'mit-csail')
    same: tuple[float, float] = tuned(
        (0.15, 0.06), 'm, rad', 'within which two matches are one', 'by design')
    hopeless: float = tuned(
        0.25, 'score', 'below which no pose explains enough of a scan', 'shared logs')
    differ: float = tuned(
        9.0, 'squared sigmas', 'by which two matches are not one, whatever the surface fixes',
        'by design')
    apart: tuple[float, float] = tuned(
        (0.3, 0.3), 'm, rad', 'beyond which an expected pose is searched around, too',
        'not measured')


TUNING = RecoveryTuning()


@dataclass(frozen=True, eq=False)
class Attempt:
    """A match, and what it is worth: its inlier ratio times how plausible its pose is."""

    match: Match
    worth: float


def attempts(scan: Cloud, target: LocalMap, first: Match, expected: Sequence[Array],
             unseen: float, hold: Array) -> list[Attempt]:
    """
    Match a scan from every expected pose (3,), the odometry's first, and by search.

    first is the match from the odometry's pose; it stays the first attempt, and the search's is
    the last. unseen is the time [s] since the last match, which sets the window. hold (3, 3)
    ties the refinement to the odometry's pose where the surface fixes nothing.
    """
    drifted = np.array(TUNING.stall) + unseen * np.array(TUNING.stall_speed)
    window = np.minimum(TUNING.search, drifted)
    plausible = partial(plausibility, expected=expected, window=window)
    matches = [first, refine(scan, target, expected[0], hold),
               *(register(scan, target, pose) for pose in expected[1:]),
               refine(scan, target, _searched(scan, target, expected, window, plausible))]
    return [Attempt(m, m.inlier_ratio * float(plausible(m.T_map_scan[None])[0]))
            for m in matches]


def _searched(scan: Cloud, target: LocalMap, expected: Sequence[Array], window: Array,
              plausible: Prior) -> Array:
    """Return the best pose (3,) around the expected ones."""
    centres: list[Array] = []
    for pose in expected:
        if all(not near(pose, other, TUNING.apart) for other in centres):
            centres.append(pose)
    reach, turn = window.tolist()
    return search(scan, target, centres, reach, turn, plausible, with_rival=False,
                  least=TUNING.hopeless).pose


def plausibility(poses: Array, expected: Sequence[Array], window: Array) -> Array:
    """
    Return factor (n,) in 0..1 for poses (n, 3): how well they continue one of the expected poses.

    A wheeled robot's odometry that stalls is wrong along the travel and in heading, hardly
    across. The factor is bounded below, so that a clear match can still overrule it, but it is 0
    outside the window [m, rad] that the robot's speed sets around every expected pose.
    """
    likelihood, possible = np.zeros(len(poses)), np.zeros(len(poses), bool)
    for pose in expected:
        d = between(pose, poses)
        sigmas = d / np.array(TUNING.stall_sigma)
        likelihood = np.maximum(likelihood, np.exp(-0.5 * (sigmas ** 2).sum(1)))
        possible |= ((np.hypot(d[:, 0], d[:, 1]) <= 1.5 * window[0])
                     & (abs(d[:, 2]) <= 1.2 * window[1]))
    return possible * (1.0 - TUNING.implausible * (1.0 - likelihood))


def rivals(best: Attempt, tried: Sequence[Attempt]) -> bool:
    """
    Return whether another pose is worth nearly as much as the best.

    One that differs only where the surface fixes neither, as along a smooth corridor, is none:
    the odometry holds the pose there.
    """
    return any(a.worth > best.worth - TUNING.distinct and not same(a, best)
               and _apart(a.match, best.match) for a in tried)


def _apart(a: Match, b: Match) -> bool:
    """Return whether two matches differ by more than both know."""
    d = difference(a.T_map_scan, b.T_map_scan)
    return squared_mahalanobis(d, a.covariance + b.covariance) > TUNING.differ


def same(a: Attempt, b: Attempt) -> bool:
    """Return whether two attempts ended at one pose."""
    return near(a.match.T_map_scan, b.match.T_map_scan, TUNING.same)


def near(a: Array, b: Array, limit: tuple[float, float]) -> bool:
    """Return whether two poses (3,) lie within a limit [m, rad] of one another."""
    d = between(a, b)
    return bool(np.hypot(d[0], d[1]) < limit[0] and abs(d[2]) < limit[1])
